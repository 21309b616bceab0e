//! From neighborhoods to the triangles of a surface: planes, stars, sides, gaps.

use std::f64::consts::{PI, TAU};

use rayon::prelude::*;

use super::frames::Frames;
use super::layers::{REACHED, leads_across, steepness, tells_layers};
use super::neighborhoods::{NearestNeighbors, SearchTree};
use super::orientation::Orientation;
use super::points::{GeometryError, Points};
use super::stars::{Spoke, Stars};
use super::votes::voted_normals;
use crate::progress::Progress;

/// The rules by which triangles are chosen; each can be left out, to measure what it is worth (`docs/accuracy.md`).
#[derive(Debug, Clone, Copy, PartialEq)]
#[allow(clippy::struct_excessive_bools)] // independent switches
pub struct Rules {
    /// Points that lie off the surface are left out.
    pub leave_strays: bool,
    /// Planes through more neighbors where the nearest lie on a line.
    pub widen_planes: bool,
    /// Planes along the sheet of the point alone where another one is as near.
    pub robust_planes: bool,
    /// Neighbors on another layer of a thin part are left out of stars that stay closed without them.
    pub part_layers: bool,
    /// Rounds in which planes are turned to the triangles around their points.
    pub turns: usize,
    /// Planes that no neighbor agrees with are turned to where the neighbors see their points.
    pub outvote_planes: bool,
    /// Neighbors that face the other way are left out of stars that close without them.
    pub part_sheets: bool,
    /// Gaps are opened only where the triangles around them are smaller.
    pub verify_gaps: bool,
    /// Points that repeat one another but for rounding or jitter become one.
    pub merge_repetitions: bool,
    /// Lengths are measured on a smoothed surface where the points are noisy.
    pub smooth_noise: bool,
    /// Kernels are wider where points are farther apart in one direction than in the other.
    pub resolve_stretch: bool,
    /// Cells on rims that zigzag are extended to where the surface ends.
    pub extend_rims: bool,
    /// Kernels are wider around cells that are larger than the covering radius.
    pub widen_kernels: bool,
    /// Near rims the moment of a kernel along the rim is made right.
    pub calibrate_rims: bool,
    /// Eigenvalues of `voronoi` get back what cells as large as they are lose of their modes.
    pub correct_resolution: bool,
}

impl Default for Rules {
    fn default() -> Self {
        Self {
            leave_strays: true,
            widen_planes: true,
            robust_planes: true,
            part_layers: true,
            turns: 2,
            outvote_planes: true,
            part_sheets: true,
            verify_gaps: true,
            merge_repetitions: true,
            smooth_noise: true,
            resolve_stretch: true,
            extend_rims: true,
            widen_kernels: true,
            calibrate_rims: true,
            correct_resolution: true,
        }
    }
}

/// Planes that the triangles turn by less than this (sine of the angle) are left as they are: beside a crease the plane
/// through both sides serves better. With 0.1, 0.3, 0.5 and 0.7 the worst error of 29 eigenvalues is 11.8, 7.8, 7.6 and 7.6 %
/// on a camel's head, 3.3, 1.6, 1.1 and 1.1 % on a bust; of a plate folded at a right angle it is 2.0 % with 0.3, 1.8 % with
/// 0.5, and 1.8 % without turns.
const TURN_MIN: f64 = 0.5;

/// Planes whose triangles more of the other corners see than this are left as they are: beside a hole two thirds do, and points
/// across it would be joined. With two thirds the bunny's worst error of 29 eigenvalues is 1.1 % in the place of 0.85.
const AGREED_MAX: f64 = 1.0 / 3.0;

/// Gain in the share of a star's triangles that their other corners see too from which on the plane that the neighbors vote for
/// is better. With 0.2, 0.3, 0.4, 0.5 and never the worst error of 29 eigenvalues is 1.4, 1.4, 1.4, 1.4 and 17.6 % on a figure,
/// 2.7, 1.3, 1.3, 2.1 and 2.1 % on a skull, 6.0, 5.3, 5.3, 4.9 and 4.9 % on a camel's head.
const GAIN_MIN: f64 = 0.4;

/// Rounds in which neighbors vote: a plane that was turned votes anew.
const BALLOTS: usize = 2;

/// Widest gap in a star that lost the neighbors that face the other way: half of the plane on an edge, more beside a knife
/// edge that no point lies on, where only these close it. On the thin boat the worst error of 29 eigenvalues is 7.5 %
/// without a limit, on fandisk with a tenth less than half of the plane 5.0 instead of 0.7 %.
const GAP_ANGLE_MAX: f64 = 1.05 * PI;

/// Planes whose oriented normals are more than 90° apart face away from each other.
const FACING_MIN: f64 = 0.0;

/// Share of conflicts beyond which sides mean nothing: a Möbius band, a tangle.
const CONFLICTS_MAX: f64 = 0.02;

/// What a surface is triangulated from.
#[derive(Clone, Copy)]
pub struct Survey<'a> {
    /// The points.
    pub points: &'a Points,
    /// The points, searchable.
    pub tree: &'a SearchTree,
    /// Their nearest neighbors.
    pub nearest: &'a NearestNeighbors,
    /// How.
    pub rules: Rules,
}

/// A triangulated surface.
#[derive(Debug)]
pub struct Surveyed {
    /// Tangent planes.
    pub frames: Frames,
    /// The triangles around every point, gaps left open.
    pub stars: Stars,
    /// Sides of the planes.
    pub orientation: Orientation,
    /// What the triangles tell of the sampling.
    pub traits: Traits,
}

/// What triangles tell of the sampling of their surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Traits {
    /// Share of the triangles' area that was taken out as gaps.
    pub opened: f64,
    /// Median ratio of the principal lengths of the stars: 1 where points are as far apart in all directions.
    pub stretch: f64,
}

impl Survey<'_> {
    /// Triangulates a surface; `frames` are planes to begin with.
    ///
    /// # Errors
    /// [`GeometryError::Canceled`].
    pub fn triangulate(
        &self,
        frames: Frames,
        sheet_aware: bool,
        progress: &Progress,
    ) -> Result<Surveyed, GeometryError> {
        let Self { points, tree, nearest, rules } = *self;
        let mut frames = frames.among_creases(points, tree, nearest, rules.widen_planes, progress)?;
        if rules.robust_planes {
            frames = frames.on_one_sheet(points, nearest, progress)?;
        }
        let mut stars = Stars::find(points, tree, nearest, &frames, sheet_aware, progress)?;
        if sheet_aware {
            for _ in 0..rules.turns {
                let turned = frames.turn_to_stars(points, &stars, TURN_MIN, progress)?;
                let (none, any) = (|_: usize, _: u32| false, |_: usize, _: &[Spoke]| true);
                stars = stars.found_again(points, tree, nearest, &frames, &none, &turned, any, progress)?;
            }
        }
        if sheet_aware && rules.outvote_planes && points.dimension() == 3 {
            for _ in 0..BALLOTS {
                stars = self.outvoted(stars, &mut frames, progress)?;
            }
        }
        let tells_layers = if sheet_aware && rules.part_layers {
            tells_layers(
                &stars,
                |i, q| if progress.is_canceled() { 0.0 } else { self.steepness(&frames, i, q) },
            )
        } else {
            vec![false; stars.len()]
        };
        if sheet_aware && rules.part_layers {
            progress.checkpoint()?;
            stars = self.on_one_layer(&stars, &frames, &tells_layers, progress)?;
        }
        // sides are told by the triangles; what a point sees is better left to the plane that found them
        let mut sides = frames.clone();
        let _ = sides.turn_to_stars(points, &stars, 0.0, progress)?;
        let orientation = Orientation::find(&sides, points.len(), &stars.links(progress)?, progress)?;
        if sheet_aware && rules.part_sheets && orientation.conflicts < CONFLICTS_MAX {
            stars = self.parted(&stars, &frames, (&orientation, &sides), &tells_layers, progress)?;
        }
        drop((sides, tells_layers));
        let whole = stars.area(points, progress)?;
        let stars = stars.with_open_gaps(points, nearest, rules.verify_gaps, progress)?;
        let left = stars.area(points, progress)?;
        let opened = if whole > 0.0 { 1.0 - left / whole } else { 0.0 };
        let stretch = stretch(points, &frames, &stars, progress)?;
        Ok(Surveyed { frames, stars, orientation, traits: Traits { opened, stretch } })
    }

    pub(super) fn steepness(&self, frames: &Frames, i: usize, q: u32) -> f64 {
        let Self { points, nearest, .. } = *self;
        let reach = |i: usize| {
            let around = nearest.of(i);
            points.squared_distance(i, around[REACHED.min(around.len()) - 1] as usize)
        };
        steepness(points, frames, reach, i, q as usize)
    }

    /// The stars, those of points found again whose planes lie otherwise by the vote of their neighbors; these planes are turned.
    pub(super) fn outvoted(
        &self,
        stars: Stars,
        frames: &mut Frames,
        progress: &Progress,
    ) -> Result<Stars, GeometryError> {
        let Self { points, tree, nearest, .. } = *self;
        let normals = voted_normals(points, &stars, AGREED_MAX, progress)?;
        if normals.is_empty() {
            return Ok(stars);
        }
        let before = frames.turn_to(&normals);
        let mut which = vec![false; stars.len()];
        for &(i, _) in &normals {
            which[i] = true;
        }
        // at a rim the triangles that others see lean to one side
        let gains = |i: usize, star: &[Spoke]| {
            star.iter().all(|spoke| spoke.filled)
                && stars.agreed_share(i, star) >= stars.agreed_share(i, stars.of(i)) + GAIN_MIN
        };
        let none = |_: usize, _: u32| false;
        let found = stars.found_again(points, tree, nearest, frames, &none, &which, gains, progress)?;
        for ((i, _), before) in normals.iter().zip(&before) {
            if found.of(*i) == stars.of(*i) {
                frames.turn_back(*i, before);
            }
        }
        Ok(found)
    }

    /// The stars without neighbors on another layer, where the others still surround the point.
    fn on_one_layer(
        &self,
        stars: &Stars,
        frames: &Frames,
        tells_layers: &[bool],
        progress: &Progress,
    ) -> Result<Stars, GeometryError> {
        let Self { points, tree, nearest, .. } = *self;
        let across = |i: usize, q: u32| !progress.is_canceled() && leads_across(self.steepness(frames, i, q));
        let layered: Vec<bool> = (0..stars.len())
            .into_par_iter()
            .with_min_len(256)
            .map(|i| tells_layers[i] && stars.of(i).iter().any(|spoke| across(i, spoke.neighbor)))
            .collect();
        let surrounds = |i: usize, star: &[Spoke]| {
            widest_gap(points, frames, i, star) <= widest_gap(points, frames, i, stars.of(i))
        };
        stars.found_again(points, tree, nearest, frames, &across, &layered, surrounds, progress)
    }

    /// The stars without neighbors that face the other way, where the others still surround the point.
    fn parted(
        &self,
        stars: &Stars,
        frames: &Frames,
        (orientation, planes): (&Orientation, &Frames),
        tells_layers: &[bool],
        progress: &Progress,
    ) -> Result<Stars, GeometryError> {
        let Self { points, tree, nearest, .. } = *self;
        let faces_away = |i: usize, q: u32| orientation.agreement(planes, i, q as usize) < FACING_MIN;
        let is_mixed = |i: usize| {
            !progress.is_canceled() && stars.of(i).iter().any(|spoke| faces_away(i, spoke.neighbor))
        };
        let mixed: Vec<bool> = (0..stars.len()).into_par_iter().with_min_len(256).map(is_mixed).collect();
        let surrounds = |i: usize, star: &[Spoke]| {
            let allowed = GAP_ANGLE_MAX.max(widest_gap(points, frames, i, stars.of(i)));
            widest_gap(points, frames, i, star) <= allowed
        };
        let leaves_out = |i: usize, q: u32| {
            faces_away(i, q) || (tells_layers[i] && leads_across(self.steepness(frames, i, q)))
        };
        stars.found_again(points, tree, nearest, frames, &leaves_out, &mixed, surrounds, progress)
    }
}

/// Widest angle between consecutive spokes without a triangle between them; 2π for fewer than two spokes.
fn widest_gap(points: &Points, frames: &Frames, i: usize, star: &[Spoke]) -> f64 {
    if star.len() < 2 {
        return TAU;
    }
    let direction = |k: usize| -> f64 {
        let [x, y] = frames.project::<2>(points, i, star[k % star.len()].neighbor as usize);
        y.atan2(x)
    };
    (0..star.len())
        .filter(|&k| !star[k].filled)
        .map(|k| (direction(k + 1) - direction(k)).rem_euclid(TAU))
        .fold(0.0, f64::max)
}

/// Ratio of the principal lengths of the offsets around a point whose star is closed.
pub(crate) fn stretch_of(points: &Points, frames: &Frames, stars: &Stars, i: usize) -> Option<f64> {
    let star = stars.of(i);
    if star.is_empty() || star.iter().any(|spoke| !spoke.filled) {
        return None;
    }
    let (mut xx, mut xy, mut yy) = (0.0, 0.0, 0.0);
    for spoke in star {
        let [x, y] = frames.project::<2>(points, i, spoke.neighbor as usize);
        xx += x * x;
        xy += x * y;
        yy += y * y;
    }
    let (mean, spread) = (0.5 * (xx + yy), (0.25 * (xx - yy) * (xx - yy) + xy * xy).sqrt());
    (mean > spread).then(|| ((mean + spread) / (mean - spread)).sqrt())
}

/// Median ratio of the principal lengths of the offsets around every point.
fn stretch(
    points: &Points,
    frames: &Frames,
    stars: &Stars,
    progress: &Progress,
) -> Result<f64, GeometryError> {
    let of_point =
        |i: usize| if progress.is_canceled() { None } else { stretch_of(points, frames, stars, i) };
    let mut ratios: Vec<f64> =
        (0..stars.len()).into_par_iter().with_min_len(256).filter_map(of_point).collect();
    progress.checkpoint()?;
    if ratios.is_empty() {
        return Ok(1.0);
    }
    let middle = ratios.len() / 2;
    Ok(*ratios.select_nth_unstable_by(middle, f64::total_cmp).1)
}

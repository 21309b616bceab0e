//! Planes where another sheet is as near as the point's own neighbors.
//!
//! Principal components of both sheets lie across them. The plane through the point that most of its neighbors lie on, and
//! lie on with planes alike, is found by trying planes through two of them (random sample consensus, Fischler and Bolles
//! 1981; all pairs of the nearest instead of random ones), in weights that fall with steepness (Tukey's biweight).

use std::f64::consts::{PI, TAU};

use nalgebra::{Matrix3, SymmetricEigen, Vector3};
use rayon::prelude::*;

use super::frames::{Frames, SWEEPS_MAX};
use super::points::Points;
use super::stars::Stars;

/// Neighbors that are counted.
const COUNTED: usize = 20;

/// Nearest neighbors of which pairs span planes.
const SPANNING: usize = 10;

/// Neighbors steeper than this against a plane (sine of the angle) do not lie on it.
const STEEP: f64 = 0.35;

/// Sine of the least angle between two neighbors that span a plane.
const SPANNED_MIN: f64 = 0.4;

/// A plane is another one's better when this many times the weight lies on it.
const BETTER: f64 = 1.4;

/// Widest angle without a neighbor around a point that lies in the middle of its sheet: beside a crease there is half of
/// the plane.
const SURROUNDED: f64 = 0.7 * PI;

/// Angle by which a link from one layer to another is steeper than the turn of the planes.
const ACROSS: f64 = PI / 3.0;

/// Angle from which a link is not along the sheet. Between layers links are steep or flat; where points are noisy there is
/// every slope between.
const RISING: f64 = 7.0 * PI / 36.0;

/// Rings of neighbors that are asked: one is too few where points are noisy. With 20, 30 and 35° and two rings the kernels of
/// a sphere of which one half is noisy get 2, 11 and 13 % wider, by 43 % where steepness is always believed; the worst errors
/// of 29 eigenvalues are 3.6, 3.6 and 2.1 % on a skull, 10.7, 8.8 and 8.8 % on a sword.
const RINGS: usize = 2;

/// Nearest neighbors whose distance is a scale, and the least rise of a link between layers in units of it.
pub(super) const REACHED: usize = 8;
const RISE_MIN: f64 = 0.2;

/// The normal of a plane through point `i` that clearly more of its neighbors lie on, all around it and with planes alike,
/// than on that with the normal it has. `normals` are of unit length, of either sign.
pub(super) fn better_normal(
    points: &Points,
    i: usize,
    neighbors: &[u32],
    normals: &[Vector3<f64>],
) -> Option<Vector3<f64>> {
    let p = Vector3::from_column_slice(points.point(i));
    let around: Vec<Around> = neighbors[..COUNTED.min(neighbors.len())]
        .iter()
        .map(|&q| {
            let offset = Vector3::from_column_slice(points.point(q as usize)) - p;
            Around { offset, length: offset.norm(), normal: normals[q as usize] }
        })
        .collect();
    let reach = around.last()?.length;
    let weight = |normal: Vector3<f64>, at: &Around| {
        let steep = normal.dot(&at.offset) / (at.length * STEEP);
        let near = (-2.0 * at.length * at.length / (reach * reach)).exp();
        let alike = normal.dot(&at.normal).powi(2);
        if steep * steep < 1.0 { near * alike * (1.0 - steep * steep).powi(2) } else { 0.0 }
    };
    let score = |normal: Vector3<f64>| around.iter().map(|at| weight(normal, at)).sum::<f64>();
    let mut best = (BETTER * score(normals[i]), None);
    for a in 0..SPANNING.min(around.len()) {
        for b in 0..a {
            let spanned = around[a].offset.cross(&around[b].offset);
            let size = spanned.norm();
            if size < SPANNED_MIN * around[a].length * around[b].length {
                continue;
            }
            let score = score(spanned / size);
            if score > best.0 {
                best = (score, Some(spanned / size));
            }
        }
    }
    let found = best.1?;
    // the plane that fits those on it best, through the point
    let scatter: Matrix3<f64> = around
        .iter()
        .map(|at| at.offset * at.offset.transpose() * (weight(found, at) / (at.length * at.length)))
        .sum();
    let eigen = SymmetricEigen::try_new(scatter, f64::EPSILON, SWEEPS_MAX)?;
    let found = eigen.eigenvectors.column(eigen.eigenvalues.imin()).into_owned();
    surrounds(&around, found).then_some(found)
}

/// A neighbor.
struct Around {
    offset: Vector3<f64>,
    length: f64,
    /// Normal of its own plane.
    normal: Vector3<f64>,
}

/// Whether the neighbors that lie on the plane with this normal are on all sides.
fn surrounds(around: &[Around], normal: Vector3<f64>) -> bool {
    let on: Vec<Vector3<f64>> = around
        .iter()
        .filter(|at| normal.dot(&at.offset).abs() < STEEP * at.length)
        .map(|at| at.offset)
        .collect();
    let Some(first) = on.first() else { return false };
    let x = (first - normal * normal.dot(first)).normalize();
    let y = normal.cross(&x);
    let mut angles: Vec<f64> = on.iter().map(|offset| y.dot(offset).atan2(x.dot(offset))).collect();
    angles.sort_unstable_by(f64::total_cmp);
    let across = angles[0] + TAU - angles[angles.len() - 1];
    angles.windows(2).map(|pair| pair[1] - pair[0]).fold(across, f64::max) < SURROUNDED
}

/// Angle by which a link is steeper against the planes of its ends than these are against each other.
///
/// Along an arc, and across a crease, the angles of a link against the planes of its ends add up to that between the planes.
/// From one layer of a thin part to the other the planes are parallel and the link is steep. Links that rise by less than
/// a share of the spacing belong to one sheet that was scanned twice: 0; `reach` is the squared distance of a point's
/// [`REACHED`] nearest.
pub(super) fn steepness(
    points: &Points,
    frames: &Frames,
    reach: impl Fn(usize) -> f64,
    i: usize,
    q: usize,
) -> f64 {
    let squared = points.squared_distance(i, q);
    let flat = |i: usize, q: usize| {
        let [x, y] = frames.project::<2>(points, i, q);
        x * x + y * y
    };
    let (here, there) = (flat(i, q), flat(q, i));
    if squared - here.min(there) < RISE_MIN * RISE_MIN * reach(i).max(reach(q)) {
        return 0.0;
    }
    let [rise, back] = [here, there].map(|flat| (flat / squared).min(1.0).sqrt().acos());
    let between = frames.agreement(i, q).abs().min(1.0).acos();
    rise + back - between
}

/// Whether a link of this steepness leads from one layer to another, where there are layers.
pub(super) fn leads_across(steepness: f64) -> bool {
    steepness > ACROSS
}

/// The points around which steepness tells layers apart.
///
/// Noise makes steep links too, and leaving them out would make the surface smoother than its points are: in the stars of a
/// point and of the [`RINGS`] around it there must be no more links between flat and steep than steep ones.
pub(super) fn tells_layers(stars: &Stars, steepness: impl Fn(usize, u32) -> f64 + Sync) -> Vec<bool> {
    let mut counts: Vec<[u32; 2]> = (0..stars.len())
        .into_par_iter()
        .with_min_len(256)
        .map(|i| {
            stars.of(i).iter().fold([0, 0], |[across, between], spoke| {
                let steepness = steepness(i, spoke.neighbor);
                let leads = leads_across(steepness);
                [across + u32::from(leads), between + u32::from(!leads && steepness > RISING)]
            })
        })
        .collect();
    for _ in 0..RINGS {
        counts = (0..stars.len())
            .into_par_iter()
            .with_min_len(256)
            .map(|i| {
                let around = stars.of(i).iter().map(|spoke| counts[spoke.neighbor as usize]);
                around.fold(counts[i], |[a, b], [across, between]| [a + across, b + between])
            })
            .collect();
    }
    counts.iter().map(|[across, between]| across >= between).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cloud::{NonFinite, PointCloud};
    use crate::geometry::stars::tests::jitter;
    use crate::geometry::survey::{Rules, Survey};
    use crate::geometry::{NearestNeighbors, SearchTree, frames};
    use crate::progress::Progress;

    const SIDE: u64 = 24;

    /// Two jittered lattices of unit squares, `gap` apart, without noise across them.
    fn plates(gap: f64) -> (Points, SearchTree, NearestNeighbors) {
        let at = |k: u64, seed: u64| k as f64 + 0.5 * jitter(seed);
        let rows: Vec<[f64; 3]> = (0..2 * SIDE * SIDE)
            .map(|i| {
                let upper = i / (SIDE * SIDE);
                [at(i % SIDE, 2 * i), at(i / SIDE % SIDE, 2 * i + 1), gap * upper as f64]
            })
            .collect();
        searchable(&rows)
    }

    fn searchable(rows: &[[f64; 3]]) -> (Points, SearchTree, NearestNeighbors) {
        let cloud = PointCloud::new(3, rows.concat(), NonFinite::Reject).unwrap();
        let points = Points::prepare(&cloud, 2).unwrap();
        let tree = SearchTree::new(&points);
        let nearest = NearestNeighbors::find(&tree, &points, 20, &Progress::new()).unwrap();
        (points, tree, nearest)
    }

    /// The points away from the rims.
    fn inner(points: &Points) -> impl Iterator<Item = usize> {
        let middle = |x: &f64| x.abs() < 0.5 * SIDE as f64 - 3.0;
        (0..points.len()).filter(move |&i| points.point(i)[..2].iter().all(middle))
    }

    #[test]
    fn planes_follow_the_sheet_of_their_point_where_another_is_as_near() {
        let (points, tree, nearest) = plates(0.8);
        let progress = Progress::new();
        let across = frames(&points, &nearest, 2, &progress)
            .unwrap()
            .among_creases(&points, &tree, &nearest, true, &progress)
            .unwrap();
        let tilted = |frames: &Frames| {
            let level = |i: usize| frames.tangent(i, 0)[2].hypot(frames.tangent(i, 1)[2]) < 0.5;
            inner(&points).filter(|&i| !level(i)).count()
        };
        let along = across.clone().on_one_sheet(&points, &nearest, &progress).unwrap();
        let (before, after) = (tilted(&across), tilted(&along));
        assert!(before > 4 && after == 0, "{before} {after}");
    }

    #[test]
    fn fewer_links_join_the_layers_of_a_thin_part() {
        let (points, tree, nearest) = plates(0.6);
        let joining = |part_layers: bool| {
            let rules = Rules { part_layers, part_sheets: false, ..Rules::default() };
            let survey = Survey { points: &points, tree: &tree, nearest: &nearest, rules };
            let planes = frames(&points, &nearest, 2, &Progress::new()).unwrap();
            let stars = survey.triangulate(planes, true, &Progress::new()).unwrap().stars;
            let across = |i: usize, q: u32| points.point(i)[2] * points.point(q as usize)[2] < 0.0;
            inner(&points)
                .map(|i| stars.of(i).iter().filter(|spoke| across(i, spoke.neighbor)).count())
                .sum::<usize>()
        };
        let (without, with) = (joining(false), joining(true));
        assert!(without > 500 && 4 * with < 3 * without, "{without} {with}");
    }

    #[test]
    fn noise_is_not_taken_for_layers() {
        // one lattice, half of which has heights as noisy as half of its spacing is wide
        let at = |k: u64, seed: u64| k as f64 + 0.5 * jitter(seed);
        let height = |i: u64| if i % SIDE < SIDE / 2 { 1.25 * jitter(i + 10_000) } else { 0.0 };
        let noisy: Vec<[f64; 3]> =
            (0..SIDE * SIDE).map(|i| [at(i % SIDE, 2 * i), at(i / SIDE, 2 * i + 1), height(i)]).collect();
        let share = |(points, tree, nearest): (Points, SearchTree, NearestNeighbors)| {
            let frames = frames(&points, &nearest, 2, &Progress::new()).unwrap();
            let survey = Survey { points: &points, tree: &tree, nearest: &nearest, rules: Rules::default() };
            let stars = Stars::find(&points, &tree, &nearest, &frames, true, &Progress::new()).unwrap();
            let tells = tells_layers(&stars, |i, q| survey.steepness(&frames, i, q));
            let steep = |i: usize| {
                stars.of(i).iter().any(|spoke| leads_across(survey.steepness(&frames, i, spoke.neighbor)))
            };
            let steep: Vec<usize> = inner(&points).filter(|&i| steep(i)).collect();
            steep.iter().filter(|&&i| tells[i]).count() as f64 / steep.len() as f64
        };
        let (noise, layers) = (share(searchable(&noisy)), share(plates(0.6)));
        assert!(noise < 0.3 && layers > 0.8, "{noise} {layers}");
    }
}

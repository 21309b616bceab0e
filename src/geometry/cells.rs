//! Voronoi cells in the tangent spaces [PBMHB §3.3, step 2], with their facets.

use rayon::prelude::*;

use super::frames::Frames;
use super::neighborhoods::{NearestNeighbors, Neighbor, SearchTree};
use super::points::{GeometryError, Points};
use super::polytope::{Interval, Polygon, Polyhedron, Polytope, Site, dot};
use crate::progress::Progress;

/// Nearest neighbours that define the local spacing.
const SPACING_NEIGHBORS: usize = 16;

/// Corners farther than this many local spacings are not on the manifold: among Poisson-distributed points of a surface
/// one in 10⁸ is (the chance of an empty circumcircle of radius r at density ρ is `(1+πρr²)·exp(−πρr²)`).
const CORNER_RADIUS_MAX: f64 = 2.5;

/// Neighbours steeper than this against the tangent space (sine of the angle) belong to another sheet.
const STEEPNESS_MAX: f64 = 0.8;

/// Points handled between two looks at the progress.
const BATCH: usize = 16_384;

/// How cells are measured.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct CellOptions {
    /// Scale every projected neighbour back to its true distance: projecting shortens lengths, so that areas come out
    /// O(h²) too small. Ours; the papers only project.
    pub isometric: bool,
    /// Cut open cells along the rim of the surface; otherwise they are invalid, as in [PBMHB §5.6].
    pub clip_rims: bool,
    /// Leave out neighbours that lie steeply above or below the tangent plane.
    pub sheet_aware: bool,
}

/// What a cell is worth.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum CellKind {
    /// Bounded by neighbours all around.
    Closed,
    /// Open; measured inside the simplices of the local Delaunay triangulation.
    Rim,
    /// Not measurable: its volume is the mean of the others.
    Invalid,
}

/// One Voronoi cell per point.
#[derive(Debug, Clone)]
pub struct Cells {
    /// Volume in `length^k`: the area on a surface.
    pub volume: Vec<f64>,
    /// Distance to the farthest corner on the manifold; 0 for an invalid cell.
    pub radius: Vec<f64>,
    /// What the cell is worth.
    pub kind: Vec<CellKind>,
    /// Neighbours with the volume of the common facet over the distance (`length^(k−2)`, ≥ 0), by index, as seen from
    /// this point's tangent space; its neighbour may see the facet differently.
    pub conductance: Vec<Vec<(u32, f64)>>,
}

impl Cells {
    /// Number of cells of a kind.
    #[must_use]
    pub fn count(&self, kind: CellKind) -> usize {
        self.kind.iter().filter(|&&k| k == kind).count()
    }
}

struct Cell {
    volume: f64,
    radius: f64,
    kind: CellKind,
    conductance: Vec<(u32, f64)>,
}

/// Measures the cells of all points.
///
/// Only the nearest few neighbours can bound a cell (Lemma 1.4 of the supplement), so clipping by bisectors, nearest
/// first, until the next neighbour is farther than twice the farthest corner gives the cell of the full diagram.
///
/// # Errors
/// [`GeometryError::Canceled`].
pub fn cells(
    points: &Points,
    tree: &SearchTree,
    nearest: &NearestNeighbors,
    frames: &Frames,
    options: CellOptions,
    progress: &Progress,
) -> Result<Cells, GeometryError> {
    let measure = match frames.intrinsic() {
        1 => cells_in::<1, Interval>,
        2 => cells_in::<2, Polygon>,
        _ => cells_in::<3, Polyhedron>,
    };
    let all = measure(points, tree, nearest, frames, options, progress)?;
    let valid = all.iter().filter(|cell| cell.kind != CellKind::Invalid);
    let (count, total) = valid.fold((0_usize, 0.0), |(count, total), cell| (count + 1, total + cell.volume));
    // with no valid cell at all every volume is 1: the operator is then a graph's, and the count says so
    let mean = if count > 0 { total / count as f64 } else { 1.0 };
    let mut cells = Cells {
        volume: Vec::with_capacity(all.len()),
        radius: Vec::with_capacity(all.len()),
        kind: Vec::with_capacity(all.len()),
        conductance: Vec::with_capacity(all.len()),
    };
    for cell in all {
        cells.volume.push(if cell.kind == CellKind::Invalid { mean } else { cell.volume });
        cells.radius.push(cell.radius);
        cells.kind.push(cell.kind);
        cells.conductance.push(cell.conductance);
    }
    Ok(cells)
}

fn cells_in<const K: usize, P: Polytope<K>>(
    points: &Points,
    tree: &SearchTree,
    nearest: &NearestNeighbors,
    frames: &Frames,
    options: CellOptions,
    progress: &Progress,
) -> Result<Vec<Cell>, GeometryError> {
    let n = points.len();
    let mut all = Vec::with_capacity(n);
    for start in (0..n).step_by(BATCH) {
        progress.advance(start as f64 / n as f64)?;
        let clipper = || Clipper {
            points,
            tree,
            frames,
            options,
            polytope: P::default(),
            candidates: Vec::new(),
            limit: 0.0,
        };
        let batch: Vec<Cell> = (start..n.min(start + BATCH))
            .into_par_iter()
            .with_min_len(256)
            .map_init(clipper, |clipper, i| clipper.cell(i, nearest.of(i)))
            .collect();
        all.extend(batch);
    }
    Ok(all)
}

/// Distance between points that are spread evenly, `count` of them within `radius`: the k-th root of the volume of
/// the ball over the count.
fn spacing_within<const K: usize>(squared_radius: f64, count: usize) -> f64 {
    let unit_ball = [2.0, std::f64::consts::PI, 4.0 / 3.0 * std::f64::consts::PI][K - 1];
    (unit_ball * squared_radius.powf(0.5 * K as f64) / count as f64).powf(1.0 / K as f64)
}

/// Scratch memory of one thread.
struct Clipper<'a, P> {
    points: &'a Points,
    tree: &'a SearchTree,
    frames: &'a Frames,
    options: CellOptions,
    polytope: P,
    candidates: Vec<Neighbor>,
    /// Largest distance of a corner that counts as on the manifold.
    limit: f64,
}

impl<P> Clipper<'_, P> {
    fn cell<const K: usize>(&mut self, i: usize, nearest: &[u32]) -> Cell
    where
        P: Polytope<K>,
    {
        let count = SPACING_NEIGHBORS.min(nearest.len());
        let reach = self.points.squared_distance(i, nearest[count - 1] as usize);
        self.limit = CORNER_RADIUS_MAX * spacing_within::<K>(reach, count);
        self.polytope.reset(self.limit);

        let mut closed = self.clip_by::<K>(i, nearest.iter().copied());
        let mut count = nearest.len();
        while !closed && count < self.points.len() - 1 {
            let seen = count;
            count *= 2;
            let mut candidates = std::mem::take(&mut self.candidates);
            self.tree.nearest(self.points, i, count, &mut candidates);
            closed = self.clip_by::<K>(i, candidates[seen..].iter().map(|q| q.index));
            self.candidates = candidates;
        }
        self.measure::<K>()
    }

    /// Clips by `neighbors`, nearest first; true when no farther one can reach the cell.
    fn clip_by<const K: usize>(&mut self, i: usize, neighbors: impl Iterator<Item = u32>) -> bool
    where
        P: Polytope<K>,
    {
        for neighbor in neighbors {
            let squared_distance = self.points.squared_distance(i, neighbor as usize);
            if squared_distance > 4.0 * self.polytope.squared_radius() {
                return true;
            }
            let flat: [f64; K] = self.frames.project(self.points, i, neighbor as usize);
            let squared_flat = dot(&flat, &flat);
            let steep = squared_flat < (1.0 - STEEPNESS_MAX * STEEPNESS_MAX) * squared_distance;
            if squared_flat == 0.0 || (self.options.sheet_aware && steep) {
                continue;
            }
            let scale = if self.options.isometric { (squared_distance / squared_flat).sqrt() } else { 1.0 };
            self.polytope.clip(Site { at: flat.map(|x| scale * x), neighbor });
        }
        false
    }

    /// Sums volume and facets over the corners on the manifold.
    fn measure<const K: usize>(&self) -> Cell
    where
        P: Polytope<K>,
    {
        let (mut volume, mut squared_radius, mut missing) = (0.0, 0.0_f64, false);
        let mut conductance: Vec<(u32, f64)> = Vec::new();
        for corner in self.polytope.corners() {
            let squared = dot(&corner.at, &corner.at);
            if corner.is_open() || squared > self.limit * self.limit {
                missing = true;
                continue;
            }
            squared_radius = squared_radius.max(squared);
            let carry = |q: u32, share: f64| match conductance.iter_mut().find(|(r, _)| *r == q) {
                Some((_, w)) => *w += share,
                None => conductance.push((q, share)),
            };
            volume += corner.measure(carry).unwrap_or(0.0);
        }
        let conductance = positive(conductance);
        if volume.is_nan() || volume <= 0.0 || (missing && !self.options.clip_rims) {
            return Cell { volume: 0.0, radius: 0.0, kind: CellKind::Invalid, conductance };
        }
        let kind = if missing { CellKind::Rim } else { CellKind::Closed };
        Cell { volume, radius: squared_radius.sqrt(), kind, conductance }
    }
}

/// Facets by index; an obtuse simplex at a rim gives a negative one, which would cost the operator its
/// definiteness.
fn positive(mut conductance: Vec<(u32, f64)>) -> Vec<(u32, f64)> {
    conductance.retain(|&(_, w)| w > 0.0);
    conductance.sort_unstable_by_key(|&(q, _)| q);
    conductance
}

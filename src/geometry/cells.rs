//! Voronoi cells in the tangent planes [PBMHB §3.3, step 2], with their edges.

use rayon::prelude::*;

use super::frames::Frames;
use super::neighborhoods::{NearestNeighbors, Neighbor, SearchTree};
use super::points::{GeometryError, Points};
use super::polygon::{BOX, Polygon, cross, dot};
use crate::progress::Progress;

/// Nearest neighbours that define the local spacing.
const SPACING_NEIGHBORS: usize = 16;

/// Corners farther than this many local spacings are not on the surface: among Poisson-distributed points one in 10⁸
/// is (the chance of an empty circumcircle of radius r at density ρ is `(1+πρr²)·exp(−πρr²)`).
const CORNER_RADIUS_MAX: f64 = 2.5;

/// Neighbours steeper than this against the tangent plane (sine of the angle) belong to another sheet.
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
    /// Open; measured inside the triangles of the local Delaunay triangulation.
    Rim,
    /// Not measurable: its area is the mean of the others.
    Invalid,
}

/// One Voronoi cell per point.
#[derive(Debug, Clone)]
pub struct Cells {
    /// Area in length².
    pub area: Vec<f64>,
    /// Distance to the farthest corner on the surface; 0 for an invalid cell.
    pub radius: Vec<f64>,
    /// What the cell is worth.
    pub kind: Vec<CellKind>,
    /// Neighbours with the length of the common edge over the distance (dimensionless, ≥ 0), by index, as seen from
    /// this point's plane; its neighbour may see the edge differently.
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
    area: f64,
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
    let n = points.len();
    let mut all = Vec::with_capacity(n);
    for start in (0..n).step_by(BATCH) {
        progress.advance(start as f64 / n as f64)?;
        let clipper = || Clipper {
            points,
            tree,
            frames,
            options,
            polygon: Polygon::default(),
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
    let valid = all.iter().filter(|cell| cell.kind != CellKind::Invalid);
    let (count, total) = valid.fold((0_usize, 0.0), |(count, total), cell| (count + 1, total + cell.area));
    // with no valid cell at all every area is 1: the operator is then a graph's, and the count says so
    let mean = if count > 0 { total / count as f64 } else { 1.0 };
    let mut cells = Cells {
        area: Vec::with_capacity(n),
        radius: Vec::with_capacity(n),
        kind: Vec::with_capacity(n),
        conductance: Vec::with_capacity(n),
    };
    for cell in all {
        cells.area.push(if cell.kind == CellKind::Invalid { mean } else { cell.area });
        cells.radius.push(cell.radius);
        cells.kind.push(cell.kind);
        cells.conductance.push(cell.conductance);
    }
    Ok(cells)
}

/// Scratch memory of one thread.
struct Clipper<'a> {
    points: &'a Points,
    tree: &'a SearchTree,
    frames: &'a Frames,
    options: CellOptions,
    polygon: Polygon,
    candidates: Vec<Neighbor>,
    /// Largest distance of a corner that counts as on the surface.
    limit: f64,
}

impl Clipper<'_> {
    fn cell(&mut self, i: usize, nearest: &[u32]) -> Cell {
        let spacing_neighbors = SPACING_NEIGHBORS.min(nearest.len());
        let reach = self.points.squared_distance(i, nearest[spacing_neighbors - 1] as usize);
        // k points within r of a point mean a density of k/(π r²)
        let spacing = (reach * std::f64::consts::PI / spacing_neighbors as f64).sqrt();
        self.limit = CORNER_RADIUS_MAX * spacing;
        self.polygon.reset(self.limit);

        let mut closed = self.clip_by(i, nearest.iter().copied());
        let mut count = nearest.len();
        while !closed && count < self.points.len() - 1 {
            let seen = count;
            count *= 2;
            let mut candidates = std::mem::take(&mut self.candidates);
            self.tree.nearest(self.points, i, count, &mut candidates);
            closed = self.clip_by(i, candidates[seen..].iter().map(|q| q.index));
            self.candidates = candidates;
        }
        self.measure(i)
    }

    /// Clips by `neighbors`, nearest first; true when no farther one can reach the polygon.
    fn clip_by(&mut self, i: usize, neighbors: impl Iterator<Item = u32>) -> bool {
        for q in neighbors {
            let squared_distance = self.points.squared_distance(i, q as usize);
            if squared_distance > 4.0 * self.polygon.squared_radius() {
                return true;
            }
            let flat = self.frames.project(self.points, i, q as usize);
            let squared_flat = dot(flat, flat);
            let steep = squared_flat < (1.0 - STEEPNESS_MAX * STEEPNESS_MAX) * squared_distance;
            if squared_flat == 0.0 || (self.options.sheet_aware && steep) {
                continue;
            }
            let scale = if self.options.isometric { (squared_distance / squared_flat).sqrt() } else { 1.0 };
            self.polygon.clip(flat.map(|x| scale * x), q);
        }
        false
    }

    /// Sums area and edges over the corners on the surface.
    ///
    /// A corner between the edges of neighbours q and r is the circumcentre of the Delaunay triangle (p, q, r). It
    /// carries the quadrilateral p, q/2, corner, r/2. Around a closed cell these add up to the cell; on a rim, where
    /// the triangle between two corners is missing, they are the cell's part inside the triangulation, which is how
    /// the cotangent scheme ends a mesh.
    fn measure(&self, i: usize) -> Cell {
        let corners = self.polygon.corners();
        let site = |q: u32| {
            let flat = self.frames.project(self.points, i, q as usize);
            let scale = if self.options.isometric {
                (self.points.squared_distance(i, q as usize) / dot(flat, flat)).sqrt()
            } else {
                1.0
            };
            flat.map(|x| scale * x)
        };
        let (mut area, mut squared_radius, mut missing) = (0.0, 0.0_f64, false);
        let mut conductance: Vec<(u32, f64)> = Vec::with_capacity(corners.len());
        let mut carry =
            |q: u32, length: f64, distance: f64| match conductance.iter_mut().find(|(r, _)| *r == q) {
                Some((_, w)) => *w += length / distance,
                None => conductance.push((q, length / distance)),
            };
        for (k, corner) in corners.iter().enumerate() {
            let previous = corners[(k + corners.len() - 1) % corners.len()].edge;
            let squared = dot(corner.at, corner.at);
            if previous == BOX || corner.edge == BOX || squared > self.limit * self.limit {
                missing = true;
                continue;
            }
            squared_radius = squared_radius.max(squared);
            let (before, after) = (site(previous), site(corner.edge));
            let (before_length, after_length) = (dot(before, before).sqrt(), dot(after, after).sqrt());
            // signed distances along the edges from the feet q/2 to the corner
            let along_before = cross(before, corner.at) / before_length;
            let along_after = -cross(after, corner.at) / after_length;
            area += 0.25 * (before_length * along_before + after_length * along_after);
            carry(previous, along_before, before_length);
            carry(corner.edge, along_after, after_length);
        }
        if area.is_nan() || area <= 0.0 || (missing && !self.options.clip_rims) {
            return Cell {
                area: 0.0,
                radius: 0.0,
                kind: CellKind::Invalid,
                conductance: positive(conductance),
            };
        }
        let kind = if missing { CellKind::Rim } else { CellKind::Closed };
        Cell { area, radius: squared_radius.sqrt(), kind, conductance: positive(conductance) }
    }
}

/// Edges by index; an obtuse triangle at a rim gives a negative one, which would cost the operator its
/// definiteness.
fn positive(mut conductance: Vec<(u32, f64)>) -> Vec<(u32, f64)> {
    conductance.retain(|&(_, w)| w > 0.0);
    conductance.sort_unstable_by_key(|&(q, _)| q);
    conductance
}

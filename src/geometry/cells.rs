//! Voronoi cells in the tangent spaces [PBMHB §3.3, step 2], with their facets.

use rayon::prelude::*;

use super::clipper::{Clipper, View};
use super::frames::Frames;
use super::neighborhoods::{NearestNeighbors, SearchTree};
use super::points::{GeometryError, Points};
use super::polytope::{Corner, Interval, Polygon, Polyhedron, Polytope, dot};
use crate::progress::{Canceled, Progress};

/// Neighbors steeper than this against the tangent space (sine of the angle) belong to another sheet.
const STEEPNESS_MAX: f64 = 0.8;

/// Points handled between two looks at the progress.
const BATCH: usize = 16_384;

/// How cells are measured.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct CellOptions {
    /// Scale every projected neighbor back to its true distance: projecting shortens lengths, so that areas come out
    /// O(h²) too small. Ours; the papers only project.
    pub isometric: bool,
    /// Cut open cells along the rim of the surface; otherwise they are invalid, as in [PBMHB §5.6].
    pub clip_rims: bool,
    /// Leave out neighbors that lie steeply above or below the tangent plane.
    pub sheet_aware: bool,
}

/// What a cell is worth.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum CellKind {
    /// Bounded by neighbors all around.
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
    /// Neighbors with the volume of the common facet over the distance (`length^(k−2)`), by index, as seen from this
    /// point's tangent space; its neighbor may see the facet differently.
    pub conductance: Vec<Vec<(u32, f64)>>,
}

impl Cells {
    /// Number of cells of a kind.
    #[must_use]
    pub fn count(&self, kind: CellKind) -> usize {
        self.kind.iter().filter(|&&k| k == kind).count()
    }
}

impl Cells {
    /// How differently walls are seen from their two sides: the sum of the differences over the sum of the sizes, 0 to 1.
    /// Diagonals of squares, which points choose as they like, have no wall and do not count.
    ///
    /// # Errors
    /// [`Canceled`].
    pub fn disagreement(&self, progress: &Progress) -> Result<f64, Canceled> {
        let (mut apart, mut all) = (0.0, 0.0);
        for (p, walls) in self.conductance.iter().enumerate() {
            if p.is_multiple_of(BATCH) {
                progress.checkpoint()?;
            }
            for &(q, wall) in walls {
                let back = &self.conductance[q as usize];
                let seen = back.binary_search_by_key(&(p as u32), |&(r, _)| r).map_or(0.0, |k| back[k].1);
                apart += (wall - seen).abs();
                all += wall.abs();
            }
        }
        Ok(if all > 0.0 { (apart / all).min(1.0) } else { 0.0 })
    }
}

/// One cell, as [`Cells`] holds them.
pub(super) struct Cell {
    pub(super) volume: f64,
    pub(super) radius: f64,
    pub(super) kind: CellKind,
    pub(super) conductance: Vec<(u32, f64)>,
}

impl Cell {
    /// A cell that cannot be measured.
    const INVALID: Self = Self { volume: 0.0, radius: 0.0, kind: CellKind::Invalid, conductance: Vec::new() };
}

/// Measures the cells of all points in their tangent spaces.
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
    Ok(gather(all))
}

/// Puts single cells together; invalid ones get the mean volume [PBMHB §5.6].
pub(super) fn gather(all: Vec<Cell>) -> Cells {
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
    cells
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
    let steepness_max = if options.sheet_aware { STEEPNESS_MAX } else { 1.0 };
    let view = View { isometric: options.isometric, steepness_max, leaves_out: None };
    let mut all = Vec::with_capacity(n);
    for start in (0..n).step_by(BATCH) {
        progress.advance(start as f64 / n as f64)?;
        let clipper = || Clipper::<P>::new(points, tree, frames, view);
        let batch: Vec<Cell> = (start..n.min(start + BATCH))
            .into_par_iter()
            .with_min_len(256)
            .map_init(clipper, |clipper, i| {
                if progress.is_canceled() {
                    return Cell::INVALID;
                }
                clipper.clip::<K>(i, nearest.of(i));
                measure::<K>(clipper.corners(), options.clip_rims)
            })
            .collect();
        progress.checkpoint()?;
        all.extend(batch);
    }
    Ok(all)
}

/// Sums volume and facets over the corners on the manifold.
fn measure<const K: usize>(corners: impl Iterator<Item = (Corner<K>, bool)>, clip_rims: bool) -> Cell {
    let (mut volume, mut squared_radius, mut missing) = (0.0, 0.0_f64, false);
    let mut conductance: Vec<(u32, f64)> = Vec::new();
    for (corner, on_manifold) in corners {
        if !on_manifold {
            missing = true;
            continue;
        }
        squared_radius = squared_radius.max(dot(&corner.at, &corner.at));
        let carry = |q: u32, share: f64| match conductance.iter_mut().find(|(r, _)| *r == q) {
            Some((_, w)) => *w += share,
            None => conductance.push((q, share)),
        };
        volume += corner.measure(carry).unwrap_or(0.0);
    }
    let conductance = positive(conductance);
    if volume.is_nan() || volume <= 0.0 || (missing && !clip_rims) {
        return Cell { volume: 0.0, radius: 0.0, kind: CellKind::Invalid, conductance };
    }
    let kind = if missing { CellKind::Rim } else { CellKind::Closed };
    Cell { volume, radius: squared_radius.sqrt(), kind, conductance }
}

/// Facets by index; an obtuse simplex at a rim gives a negative one, which would cost the operator its
/// definiteness.
fn positive(mut conductance: Vec<(u32, f64)>) -> Vec<(u32, f64)> {
    conductance.retain(|&(_, w)| w > 0.0);
    conductance.sort_unstable_by_key(|&(q, _)| q);
    conductance
}

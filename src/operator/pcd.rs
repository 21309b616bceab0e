//! The PCD Laplace operator [PCD §2.2, steps S1–S3, eq. 2.1]: a heat kernel weighted, for every point anew, by the
//! Delaunay triangulation of its projected neighborhood.

use super::heat_kernel::HeatKernel;
use super::sheets::Sheets;
use super::{Distance, LaplaceBeltrami, Parameterization, Sparse, Structure};
use crate::geometry::delaunay::simplices_around;
use crate::geometry::frames::weighted_frame;
use crate::geometry::neighborhoods::Neighbor;
use crate::geometry::polytope::dot;
use crate::geometry::{Frames, NearestNeighbors, Points, SearchTree};
use crate::progress::{Canceled, Progress};

/// Default `δ/√(2t)`. Simplices count only with all corners within δ/2, so that the Gaussian is cut up to an edge
/// nearer than there, and nothing makes up for it: where the other kernels cut, at 8, the first eigenvalues of 8,000
/// independent points of the sphere are 4.6 % too low, at 10 1.7 %, at 12 1.5 %. The paper's proof wants δ ≥ 10ε.
pub const DELTA_FACTOR: f64 = 10.0;

/// Neighbors steeper than this against the tangent space (sine of the angle) belong to another sheet, as for the cells:
/// on a unit circle those more than 106° away.
const STEEPNESS_MAX: f64 = 0.8;

/// Nearest points that the authors' program takes the mean distance of, the point itself among them.
const NEAREST: usize = 10;

/// How rows are computed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Options {
    /// t and δ.
    pub kernel: HeatKernel,
    /// Distance in the Gaussian.
    pub distance: Distance,
    /// Which simplices count, and how planes are found.
    pub parameterization: Parameterization,
}

/// t and δ of [`Parameterization::NearestTen`] in intrinsic dimension `dimension`: `4t = h²`, `δ = 3h`.
#[must_use]
pub fn nearest_ten(points: &Points, nearest: &NearestNeighbors, dimension: usize) -> HeatKernel {
    let n = points.len();
    let mean_distance = |i: usize| {
        let found = nearest.of(i).iter().take(NEAREST - 1);
        let count = found.len() + 1;
        found.map(|&q| points.squared_distance(i, q as usize).sqrt()).sum::<f64>() / count as f64
    };
    let h = 2.0 * (0..n).map(mean_distance).sum::<f64>() / n as f64;
    HeatKernel { t: 0.25 * h * h, delta: 3.0 * h, truncation_compensation: false, dimension }
}

/// Where rows look for their neighbors, and onto which planes they project them.
pub enum Planes {
    /// All neighbors, as the paper has it.
    Ball(Frames),
    /// Those on the same sheet: the projection of a ball that reaches through a thin part, or around a bend of more than
    /// a right angle, lays points between each other that are far apart, and takes volume from both.
    Sheet(Sheets),
}

impl Planes {
    fn frames(&self) -> &Frames {
        match self {
            Self::Ball(frames) => frames,
            Self::Sheet(sheets) => sheets.frames(),
        }
    }
}

/// Assembles the operator as `L = −B⁻¹S` with the Voronoi cells' volumes as `B`: `S = −B L` is not symmetric. Rows sum to
/// zero.
///
/// # Errors
/// [`Canceled`].
pub fn build(
    points: &Points,
    tree: &SearchTree,
    planes: &Planes,
    mass: Vec<f64>,
    options: &Options,
    progress: &Progress,
) -> Result<LaplaceBeltrami, Canceled> {
    let mut stiffness = negative_laplacian(points, tree, planes, options, progress)?;
    stiffness.scale_rows(&mass);
    Ok(LaplaceBeltrami {
        structure: Structure::General,
        ..LaplaceBeltrami::diffusive(stiffness, mass, options.kernel)
    })
}

/// Assembles the trivial extension `½(L + Lᵀ)` [PBMHB §3.4], `B = I`: symmetric, but neither definite nor zero on constants.
///
/// # Errors
/// [`Canceled`].
pub fn build_symmetrized(
    points: &Points,
    tree: &SearchTree,
    planes: &Planes,
    options: &Options,
    progress: &Progress,
) -> Result<LaplaceBeltrami, Canceled> {
    let stiffness = negative_laplacian(points, tree, planes, options, progress)?.symmetric_part();
    let mass = vec![1.0; points.len()];
    Ok(LaplaceBeltrami {
        structure: Structure::Symmetric,
        ..LaplaceBeltrami::diffusive(stiffness, mass, options.kernel)
    })
}

/// `−L` of eq. 2.1, in 1/length².
fn negative_laplacian(
    points: &Points,
    tree: &SearchTree,
    planes: &Planes,
    options: &Options,
    progress: &Progress,
) -> Result<Sparse, Canceled> {
    let n = points.len();
    let rows = match planes.frames().intrinsic() {
        1 => Row::fill::<1>,
        2 => Row::fill::<2>,
        _ => Row::fill::<3>,
    };
    Sparse::stiffness(
        n,
        Row::default,
        |i, scratch, row| {
            if !progress.is_canceled() {
                rows(scratch, points, tree, planes, options, i, row);
            }
        },
        |done| progress.advance(done as f64 / n as f64),
    )
}

/// Scratch memory of one thread.
#[derive(Default)]
struct Row {
    neighbors: Vec<Neighbor>,
    frame: Vec<f64>,
    volume: Vec<f64>,
}

impl Row {
    /// Appends the weights of row `i`: `A_q/(k+1) · exp(−|p−q|²/4t)/((4πt)^{k/2} t)`.
    #[allow(clippy::too_many_arguments)] // the scratch memory beside what is read
    fn fill<const K: usize>(
        &mut self,
        points: &Points,
        tree: &SearchTree,
        planes: &Planes,
        options: &Options,
        i: usize,
        row: &mut Vec<(u32, f64)>,
    ) {
        let kernel = options.kernel;
        tree.within(points, i, kernel.delta, &mut self.neighbors);
        if let Planes::Sheet(sheets) = planes {
            let is_flat = |q: &Neighbor| {
                let site: [f64; K] = sheets.frames().project(points, i, q.index as usize);
                dot(&site, &site) >= (1.0 - STEEPNESS_MAX * STEEPNESS_MAX) * q.squared_distance
            };
            self.neighbors.retain(|q| sheets.same(i, q.index as usize) && is_flat(q));
        }
        let all = options.parameterization == Parameterization::NearestTen;
        if all {
            // 4t = h²
            let weight = |squared_distance: f64| (-0.25 * squared_distance / kernel.t).exp();
            weighted_frame(points, i, &self.neighbors, weight, K, &mut self.frame);
        }
        let project = |q: usize| -> [f64; K] {
            if all { project(points, i, q, &self.frame) } else { planes.frames().project(points, i, q) }
        };
        // the point itself is the last site
        let mut sites: Vec<[f64; K]> = self.neighbors.iter().map(|q| project(q.index as usize)).collect();
        sites.push([0.0; K]);
        let squared_half = 0.25 * kernel.delta * kernel.delta;
        let counts = |site: usize| all || dot(&sites[site], &sites[site]) <= squared_half;
        simplices_around(&sites, counts, &mut self.volume);
        let factor = kernel.factor() / (K + 1) as f64;
        for ((q, site), volume) in self.neighbors.iter().zip(&sites).zip(&self.volume) {
            let squared_distance = match options.distance {
                Distance::Ambient => q.squared_distance,
                Distance::Projected => dot(site, site),
            };
            if *volume > 0.0 {
                row.push((q.index, volume * factor * (-0.25 * squared_distance / kernel.t).exp()));
            }
        }
    }
}

/// Coordinates of `q − p_i` in a frame of K axes, one after the other.
fn project<const K: usize>(points: &Points, i: usize, q: usize, frame: &[f64]) -> [f64; K] {
    let (p, q) = (points.point(i), points.point(q));
    let d = p.len();
    std::array::from_fn(|axis| {
        frame[axis * d..(axis + 1) * d].iter().zip(p.iter().zip(q)).map(|(t, (p, q))| t * (q - p)).sum()
    })
}

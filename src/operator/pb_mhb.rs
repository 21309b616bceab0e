//! Point-Based Manifold Harmonics: the symmetrizable Voronoi-weighted heat-kernel operator [PBMHB §3.3–3.4].

use super::sheets::Sheets;
use super::{HeatKernel, LaplaceBeltrami, heat_kernel};
use crate::geometry::{Cells, Points, SearchTree};
use crate::progress::{Canceled, Progress};

/// Default `t/ε²` on surfaces: between 0.35 (coarse clouds, thin parts) and 1.5 (iid-random sampling).
///
/// Worst relative error of the first eigenvalues at 0.35, 0.5 and 0.7 (with `δ = 4√(2t)`): regular sphere of 4,000
/// points 2.5, 0.27 and 0.19 %, iid-random sphere 4.0, 2.0 and 1.0 %; small ones suit thin parts. Below `t = ε²` the
/// lattice is too coarse for the Gaussian and leaves a floor (0.2 % at 0.5) that more points do not lower.
const T_FACTOR_SURFACE: f64 = 0.5;

/// The same on curves, where ε is but half the spacing.
const T_FACTOR_CURVE: f64 = 2.0;

/// The same in volumes, where a Gaussian of the same width reaches many more neighbours: flat three-torus of 4,000
/// points, worst of 18 eigenvalues 5.5 % with 111 neighbours a row, at 0.5 9.5 % with 190.
const T_FACTOR_VOLUME: f64 = 0.35;

/// Default `t/ε²` in intrinsic dimension k.
#[must_use]
pub const fn t_factor(dimension: usize) -> f64 {
    match dimension {
        1 => T_FACTOR_CURVE,
        2 => T_FACTOR_SURFACE,
        _ => T_FACTOR_VOLUME,
    }
}

/// Default `δ/√(2t)`. On a regular sphere of 4,000 points with `t = 0.7ε²` the worst error of 25 eigenvalues is
/// 0.59 % with 3.5 and 25 neighbours a row, 0.19 % with 4 and 35.
pub const DELTA_FACTOR: f64 = 4.0;

/// Default `δ/√(2t)` of the paper's own operator, which has no compensation: the share of the second moment lost is
/// `exp(−12.5)·13.5`, 5·10⁻⁵.
pub const DELTA_FACTOR_PAPER: f64 = 5.0;

/// Assembles the operator: mass `a_i`, stiffness as [`heat_kernel::stiffness`] with weights `a_i`.
///
/// Without `sheets` every pair in the Euclidean ball is coupled, as in the paper.
///
/// # Errors
/// [`Canceled`].
pub fn build(
    points: &Points,
    tree: &SearchTree,
    cells: &Cells,
    sheets: Option<&Sheets>,
    kernel: HeatKernel,
    progress: &Progress,
) -> Result<LaplaceBeltrami, Canceled> {
    let couples = |i, j| sheets.is_none_or(|sheets| sheets.same(i, j));
    let stiffness = heat_kernel::stiffness(points, tree, &cells.volume, kernel, couples, progress)?;
    Ok(LaplaceBeltrami::diffusive(stiffness, cells.volume.clone(), kernel))
}

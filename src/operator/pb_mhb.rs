//! Point-Based Manifold Harmonics: the symmetrizable Voronoi-weighted heat-kernel operator [PBMHB §3.3–3.4].

use super::sheets::Sheets;
use super::{HeatKernel, LaplaceBeltrami, heat_kernel};
use crate::geometry::{Cells, Points, SearchTree};
use crate::progress::{Canceled, Progress};

/// Default `t/ε²`: between 0.35 (coarse clouds, thin parts) and 1.5 (iid-random sampling), see [`crate::analysis`].
pub const T_FACTOR: f64 = 0.7;

/// Default `δ/√(2t)`: with truncation compensation 3.5 comes near the result of 5 with half the neighbours; 3 is too
/// coarse on regular clouds.
pub const DELTA_FACTOR: f64 = 3.5;

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
    let stiffness = heat_kernel::stiffness(points, tree, &cells.area, kernel, couples, progress)?;
    Ok(LaplaceBeltrami { stiffness, mass: cells.area.clone(), heat_kernel: Some(kernel) })
}

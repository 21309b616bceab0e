//! The narrow companion of a wide operator, on the same points and masses: its eigenvectors start the iteration.

use super::factor::Cholesky;
use super::inverse::{Nearest, Shifted};
use super::ritz::rayleigh_ritz;
use super::shift_invert::ritz_vectors;
use super::vectors::block::Block;
use super::{Problem, SpectrumError};
use crate::operator::Sparse;
use crate::progress::Progress;

/// Guard vectors beside the wanted ones: at least this number, and this share of the wanted.
const GUARD_MIN: usize = 12;
const GUARD_SHARE: f64 = 0.2;

/// Residual of the narrow operator's eigenvectors; the wide one's own first step is coarser.
const START_TOLERANCE: f64 = 1e-2;

/// Start vectors for `wanted` eigenpairs: the others guard the gap behind them.
pub(super) fn guarded(wanted: usize) -> usize {
    wanted + GUARD_MIN.max((GUARD_SHARE * wanted as f64) as usize)
}

/// Eigenvectors of the narrow operator, roughly: the start of the wide one's iteration.
pub(super) fn narrow_vectors(
    problem: &Problem,
    narrow: &Sparse,
    factor: &Cholesky<'_>,
    count: usize,
    progress: &Progress,
) -> Result<Block, SpectrumError> {
    let narrow = problem.with_matrix(narrow.clone());
    let none = Block::zeros(narrow.size(), 0);
    // rough solutions are good enough, and so are residuals of vectors that the two operators' null spaces keep apart
    let shifted = Shifted { inverse: factor, shift: -factor.shift() };
    let nearest = Nearest { below: 0, above: count };
    let share = |share| 0.3 * share;
    let vectors = ritz_vectors(&narrow, shifted, &none, nearest, START_TOLERANCE, progress, share)?;
    Ok(rayleigh_ritz(&narrow, vectors, progress)?.vectors)
}

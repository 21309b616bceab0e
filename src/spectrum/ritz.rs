//! The Rayleigh–Ritz step: the best eigenpairs in the span of some vectors.

use super::orthogonal::{eigen, orthonormalize};
use super::vectors::block::{Block, gram, replace_by_product};
use super::vectors::sparse_product::sparse_product;
use super::{Eigenpairs, Problem, SpectrumError};
use crate::progress::Progress;

/// Ritz pairs of `A` in the span of `vectors`, ascending.
///
/// # Errors
/// [`SpectrumError::Dense`], [`SpectrumError::Canceled`].
pub(super) fn rayleigh_ritz(
    problem: &Problem,
    mut vectors: Block,
    progress: &Progress,
) -> Result<Eigenpairs, SpectrumError> {
    orthonormalize(&mut vectors, &Block::<f64>::zeros(problem.size(), 0), progress)?;
    progress.checkpoint()?;
    let mut product = Block::zeros(problem.size(), vectors.columns());
    sparse_product(&mut product, &problem.matrix, &vectors);
    progress.checkpoint()?;
    let (values, coefficients) = eigen(gram(&vectors, &product).as_ref())?;
    drop(product);
    progress.checkpoint()?;
    replace_by_product(&mut vectors, coefficients.as_ref());
    Ok(Eigenpairs::real(values, vectors))
}

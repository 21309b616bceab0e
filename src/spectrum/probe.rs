//! A search for eigenvalues that an iteration missed.

use faer::Mat;

use super::block::{Block, add_product, gram};
use super::cholesky::Cholesky;
use super::lobpcg::Preconditioner;
use super::orthogonal::{eigen, orthonormalize};
use super::sparse_product::sparse_product;
use super::{Problem, SpectrumError, start};
use crate::progress::Progress;

const VECTORS: usize = 8;
const STEPS: usize = 4;

/// What draws vectors towards the small eigenvalues.
pub(super) enum Towards<'a> {
    /// The inverse of the shifted operator.
    Inverse(&'a Cholesky<'a>),
    /// A preconditioner `M` of a heat kernel: `−M (1/t − A)` amplifies what is near the shift, and at the top, where
    /// `M ≈ t` and `A ≈ 1/t`, nothing is left.
    Preconditioned(&'a Preconditioner<'a>),
}

/// Smallest Ritz value after a few steps from hashed vectors orthogonal to `found` and the null space: an eigenvalue
/// that the iteration missed shows up as one below those found.
///
/// # Errors
/// [`SpectrumError::Dense`], [`SpectrumError::Canceled`].
pub(super) fn smallest_beside(
    problem: &Problem,
    towards: &Towards<'_>,
    found: &Block,
    progress: &Progress,
) -> Result<f64, SpectrumError> {
    let mut probe = Block::zeros(problem.size(), VECTORS);
    start::fill(&mut probe, 1 << 20);
    let mut smallest = f64::INFINITY;
    let mut product = Block::zeros(problem.size(), VECTORS);
    for step in 0..STEPS {
        progress.advance(step as f64 / STEPS as f64)?;
        match towards {
            Towards::Inverse(factor) => factor.solve(&mut probe),
            Towards::Preconditioned(preconditioner) => {
                let identity = Mat::<f64>::identity(VECTORS, VECTORS);
                sparse_product(&mut product, &problem.matrix, &probe);
                add_product(&mut product, -(1.0 / preconditioner.t), &probe, identity.as_ref());
                preconditioner.apply(&mut product);
                std::mem::swap(&mut probe, &mut product);
            }
        }
        problem.project_out_null(&mut probe);
        orthonormalize(&mut probe, found)?;
        sparse_product(&mut product, &problem.matrix, &probe);
        let (values, _) = eigen(gram(&probe, &product).as_ref())?;
        smallest = values.first().copied().unwrap_or(smallest).min(smallest);
    }
    Ok(smallest)
}

//! The Rayleigh–Ritz step: the best eigenpairs in the span of some vectors.

use faer::{Mat, MatRef};

use super::orthogonal::{eigen, orthonormalize, pencil};
use super::vectors::block::{Block, gram, replace_by_product};
use super::vectors::pair::gram_pair;
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

/// The same in place, of the columns behind the null vectors, which come first and stay; also their values, zeros first.
/// The other columns need not be orthogonal to anything; those that depend on others are dropped.
///
/// # Errors
/// [`SpectrumError::Dense`], also of vectors that are not finite, [`SpectrumError::Canceled`].
pub(super) fn rayleigh_ritz_beside(
    problem: &Problem,
    vectors: &mut Block,
    progress: &Progress,
) -> Result<Vec<f64>, SpectrumError> {
    let [gram, image] = gram_pair(&problem.matrix, vectors, progress)?;
    progress.checkpoint()?;
    let (values, change) = change_beside(problem.zero_modes(), gram.as_ref(), image.as_ref())?;
    replace_by_product(vectors, change.as_ref());
    progress.checkpoint()?;
    Ok(values)
}

/// The Ritz values of vectors behind `zeros` null vectors, zeros first, and the matrix that makes Ritz vectors of them, from
/// the products of the vectors with themselves and with their images.
///
/// # Errors
/// [`SpectrumError::Dense`].
pub(super) fn change_beside(
    zeros: usize,
    gram: MatRef<'_, f64>,
    image: MatRef<'_, f64>,
) -> Result<(Vec<f64>, Mat<f64>), SpectrumError> {
    let others = gram.nrows() - zeros;
    let along = gram.submatrix(0, zeros, zeros, others);
    let gram = gram.submatrix(zeros, zeros, others, others) - along.transpose() * along;
    let (values, coefficients) = pencil(image.submatrix(zeros, zeros, others, others), gram.as_ref())?;
    let taken = along * &coefficients;
    let change = Mat::from_fn(zeros + others, zeros + values.len(), |i, j| match (i < zeros, j < zeros) {
        (true, true) => f64::from(u8::from(i == j)),
        (true, false) => -taken[(i, j - zeros)],
        (false, true) => 0.0,
        (false, false) => coefficients[(i - zeros, j - zeros)],
    });
    Ok((std::iter::repeat_n(0.0, zeros).chain(values).collect(), change))
}

//! Invariant subspaces of operators without symmetry: the block iteration of [`super::lobpcg`] with a Schur form in the
//! place of Ritz values.
//!
//! The basis stays orthonormal: `X` spans the approximate space of the smallest eigenvalues, its leading columns those
//! of the smallest among them, so that `T = XᵀAX` is (nearly) quasi-triangular and `A X − X T` is the residual.

use faer::Mat;

use super::dense::ritz;
use super::general::{self, GeneralPairs};
use super::preconditioner::Preconditioner;
use super::trial_space::{Residuals, TrialSpace, iterate};
use super::vectors::block::{Block, add_product, replace_by_product};
use super::{Problem, SpectrumError};
use crate::progress::Progress;

/// Iterations before giving up; measured cases need 5 to 40.
const ITERATIONS_MAX: usize = 100;

/// The `count` eigenpairs with the smallest real parts, to a relative residual of `tolerance`, from the start vectors
/// `start` (more than `count`). Returns the eigenvalues with the columns that belong to them.
///
/// # Errors
/// [`SpectrumError::NotConverged`], [`SpectrumError::Canceled`], [`SpectrumError::Dense`].
pub fn solve(
    problem: &Problem,
    preconditioner: &Preconditioner<'_>,
    start: Block,
    count: usize,
    tolerance: f64,
    progress: &Progress,
    share: impl Fn(f64) -> f64,
) -> Result<(GeneralPairs, Block), SpectrumError> {
    let (space, schur) = iterate(
        begin(problem, start, progress)?,
        tolerance,
        ITERATIONS_MAX,
        progress,
        share,
        |space, schur| residuals(problem, space, schur, count, tolerance),
        |space, residuals| step(problem, preconditioner, space, residuals, progress),
    )?;
    finish(problem, space, &schur, count)
}

/// The span of the start vectors, and `T = XᵀAX`.
fn begin(
    problem: &Problem,
    start: Block,
    progress: &Progress,
) -> Result<(TrialSpace, Mat<f64>), SpectrumError> {
    let mut space = TrialSpace::new(problem, start, progress)?;
    let projected = space.projected();
    let found = ritz(problem.structure, projected.as_ref(), space.columns())?;
    let turn = general::orthonormal(found.columns.as_ref());
    space.turn(turn.as_ref());
    Ok((space, turn.transpose() * projected * &turn))
}

/// `A X − X T` of the columns that have not converged.
fn residuals(
    problem: &Problem,
    space: &TrialSpace,
    schur: &Mat<f64>,
    count: usize,
    tolerance: f64,
) -> Residuals {
    let columns = schur.ncols();
    let mut leading = Block::<f64>::zeros(problem.size(), columns);
    leading.copy_columns(0, &space.basis, 0, columns);
    let mut residual = Block::zeros(problem.size(), columns);
    residual.copy_columns(0, &space.product, 0, columns);
    add_product(&mut residual, -1.0, &leading, schur.as_ref());
    let scales = (0..columns).map(|j| schur[(j, j)].abs() + problem.shift);
    Residuals::of(residual, scales, count, tolerance)
}

/// Extends the space by preconditioned residuals and keeps the part with the smallest Ritz values; returns its `T`.
fn step(
    problem: &Problem,
    preconditioner: &Preconditioner<'_>,
    space: &mut TrialSpace,
    Residuals { block, active, .. }: Residuals,
    progress: &Progress,
) -> Result<Mat<f64>, SpectrumError> {
    let columns = space.columns();
    space.extend(problem, preconditioner, block, |_| (), progress)?;
    let projected = space.projected();
    let pairs = ritz(problem.structure, projected.as_ref(), columns)?;
    progress.checkpoint()?;
    // a conjugate pair at the end is cut: the block keeps its width
    let best = general::orthonormal(pairs.columns.as_ref().subcols(0, columns));
    space.contract(best.as_ref(), &active, progress)?;
    Ok(best.transpose() * &projected * &best)
}

/// Eigenvectors out of the invariant subspace.
fn finish(
    problem: &Problem,
    space: TrialSpace,
    schur: &Mat<f64>,
    count: usize,
) -> Result<(GeneralPairs, Block), SpectrumError> {
    let mut basis = space.basis;
    let pairs = ritz(problem.structure, schur.as_ref(), count)?;
    basis.set_columns(schur.ncols());
    replace_by_product(&mut basis, pairs.columns.as_ref());
    Ok((pairs, basis))
}

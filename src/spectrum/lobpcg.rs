//! Block LOBPCG for operators too wide to factor, preconditioned by a narrow operator that can be.
//!
//! The basis is kept orthonormal (Hetmaniuk and Lehoucq 2006; Duersch et al. 2018), so that every Rayleigh–Ritz step
//! is a plain symmetric eigenproblem.

use faer::Mat;

use super::orthogonal::eigen;
use super::preconditioner::Preconditioner;
use super::trial_space::{Residuals, TrialSpace, iterate};
use super::vectors::block::Block;
use super::{Eigenpairs, Problem, SpectrumError};
use crate::progress::Progress;

/// Iterations before giving up; measured cases need 5 to 25.
const ITERATIONS_MAX: usize = 200;

/// Vectors in memory for each that is iterated: X, P and W with their products, residuals, and what becomes a new one.
const VECTORS_HELD: usize = 8;

/// The `count` smallest non-zero eigenpairs to a relative residual of `tolerance`, from the start vectors `start`
/// (more than `count`: the others guard the gap and bound the rate of convergence).
///
/// # Errors
/// [`SpectrumError::NotConverged`], [`SpectrumError::Canceled`].
pub fn solve(
    problem: &Problem,
    preconditioner: &Preconditioner<'_>,
    start: Block,
    count: usize,
    tolerance: f64,
    progress: &Progress,
    share: impl Fn(f64) -> f64,
) -> Result<Eigenpairs, SpectrumError> {
    progress.afford_beside((VECTORS_HELD * start.columns() * problem.size() * size_of::<f64>()) as u64)?;
    let (space, values) = iterate(
        begin(problem, start, progress)?,
        tolerance,
        ITERATIONS_MAX,
        progress,
        share,
        |space, values| residuals(problem, space, values, count, tolerance),
        |space, residuals| step(problem, preconditioner, space, residuals, progress),
    )?;
    let mut basis = space.basis;
    basis.set_columns(values.len());
    Ok(Eigenpairs::real(values, basis))
}

/// Rayleigh–Ritz in the span of the start vectors: the space and its Ritz values.
fn begin(
    problem: &Problem,
    mut start: Block,
    progress: &Progress,
) -> Result<(TrialSpace, Vec<f64>), SpectrumError> {
    problem.project_out_null(&mut start);
    let mut space = TrialSpace::new(problem, start, progress)?;
    let (values, coefficients) = eigen(space.projected().as_ref())?;
    space.turn(coefficients.as_ref());
    Ok((space, values))
}

/// Residuals of the pairs that have not converged.
fn residuals(
    problem: &Problem,
    space: &TrialSpace,
    values: &[f64],
    count: usize,
    tolerance: f64,
) -> Residuals {
    let mut residual = Block::zeros(problem.size(), values.len());
    residual.for_each_row(|i, row| {
        let (x, product) = (space.basis.row(i), space.product.row(i));
        for (j, r) in row.iter_mut().enumerate() {
            *r = product[j] - values[j] * x[j];
        }
    });
    Residuals::of(residual, values.iter().map(|value| value + problem.shift), count, tolerance)
}

/// Extends the space by preconditioned residuals and takes the Ritz vectors of the whole; returns their values.
fn step(
    problem: &Problem,
    preconditioner: &Preconditioner<'_>,
    space: &mut TrialSpace,
    Residuals { block, active, .. }: Residuals,
    progress: &Progress,
) -> Result<Vec<f64>, SpectrumError> {
    let columns = space.columns();
    space.extend(problem, preconditioner, block, |residual| problem.project_out_null(residual), progress)?;
    let projected = space.projected();
    let symmetric = Mat::from_fn(projected.nrows(), projected.ncols(), |i, j| {
        0.5 * (projected[(i, j)] + projected[(j, i)])
    });
    let (values, vectors) = eigen(symmetric.as_ref())?;
    progress.checkpoint()?;
    space.contract(vectors.as_ref().subcols(0, columns), &active, progress)?;
    Ok(values[..columns].to_vec())
}

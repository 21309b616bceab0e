//! Invariant subspaces of operators without symmetry: the block iteration of [`super::lobpcg`] with a Schur form in the
//! place of Ritz values.
//!
//! The basis stays orthonormal: `X` spans the approximate space of the smallest eigenvalues, its leading columns those
//! of the smallest among them, so that `T = XᵀAX` is (nearly) quasi-triangular and `A X − X T` is the residual.

use faer::Mat;

use super::dense::ritz;
use super::general::{self, GeneralPairs};
use super::lobpcg::{Preconditioner, new_directions};
use super::orthogonal::orthonormalize;
use super::vectors::block::{Block, add_product, column_norms, gram, replace_by_product};
use super::vectors::sparse_product::sparse_product;
use super::{Problem, SpectrumError};
use crate::progress::Progress;

/// Iterations before giving up; measured cases need 5 to 40.
const ITERATIONS_MAX: usize = 100;

/// X, P and W side by side, orthonormal, and their products with `A`.
struct Space {
    basis: Block,
    product: Block,
    /// `T = XᵀAX`.
    schur: Mat<f64>,
    /// Columns of P.
    directions: usize,
}

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
    let mut space = begin(problem, start, progress)?;
    let mut worst = f64::INFINITY;
    let mut first_worst = None;
    for _ in 0..ITERATIONS_MAX {
        let (residual, active, reached) = residuals(problem, &space, count, tolerance);
        worst = reached;
        if worst <= tolerance {
            return finish(problem, space, count);
        }
        let from = *first_worst.get_or_insert(worst);
        progress.advance(share(((from / worst).ln() / (from / tolerance).ln()).clamp(0.0, 1.0)))?;
        step(problem, preconditioner, &mut space, residual, &active, progress)?;
    }
    Err(SpectrumError::NotConverged { reached: worst, tolerance, iterations: ITERATIONS_MAX })
}

fn begin(problem: &Problem, mut start: Block, progress: &Progress) -> Result<Space, SpectrumError> {
    let n = problem.size();
    orthonormalize(&mut start, &Block::<f64>::zeros(n, 0), progress)?;
    let columns = start.columns();
    let mut basis = Block::zeros(n, 3 * columns);
    basis.set_columns(columns);
    basis.copy_columns(0, &start, 0, columns);
    drop(start);
    let mut product = Block::zeros(n, 3 * columns);
    progress.checkpoint()?;
    sparse_product(&mut product, &problem.matrix, &basis);
    progress.checkpoint()?;
    let projected = gram(&basis, &product);
    let turn = general::orthonormal(ritz(problem.structure, projected.as_ref(), columns)?.columns.as_ref());
    replace_by_product(&mut basis, turn.as_ref());
    replace_by_product(&mut product, turn.as_ref());
    let schur = turn.transpose() * projected * &turn;
    Ok(Space { basis, product, schur, directions: 0 })
}

/// `A X − X T` of the columns that have not converged, which ones they are, and the largest relative norm among the
/// first `count`.
fn residuals(problem: &Problem, space: &Space, count: usize, tolerance: f64) -> (Block, Vec<usize>, f64) {
    let columns = space.schur.ncols();
    let mut leading = Block::<f64>::zeros(problem.size(), columns);
    leading.copy_columns(0, &space.basis, 0, columns);
    let mut residual = Block::zeros(problem.size(), columns);
    residual.copy_columns(0, &space.product, 0, columns);
    add_product(&mut residual, -1.0, &leading, space.schur.as_ref());
    let relative: Vec<f64> = column_norms(&residual)
        .into_iter()
        .enumerate()
        .map(|(j, norm)| norm / (space.schur[(j, j)].abs() + problem.shift))
        .collect();
    let worst = relative[..count.min(columns)].iter().copied().fold(0.0, f64::max);
    let active: Vec<usize> = (0..columns).filter(|&j| relative[j] > 0.5 * tolerance).collect();
    residual.for_each_row(|_, row| {
        for (to, &from) in active.iter().enumerate() {
            row[to] = row[from];
        }
    });
    residual.set_columns(active.len());
    (residual, active, worst)
}

/// Extends the space by preconditioned residuals and keeps the part with the smallest Ritz values.
fn step(
    problem: &Problem,
    preconditioner: &Preconditioner<'_>,
    space: &mut Space,
    mut residual: Block,
    active: &[usize],
    progress: &Progress,
) -> Result<(), SpectrumError> {
    let columns = space.schur.ncols();
    let known = columns + space.directions;
    preconditioner.apply(&mut residual, progress)?;
    orthonormalize(&mut residual, &space.basis, progress)?;
    let width = residual.columns();
    let mut product = Block::zeros(problem.size(), width);
    sparse_product(&mut product, &problem.matrix, &residual);
    space.basis.set_columns(known + width);
    space.basis.copy_columns(known, &residual, 0, width);
    space.product.set_columns(known + width);
    space.product.copy_columns(known, &product, 0, width);
    drop((residual, product));

    progress.checkpoint()?;
    let projected = gram(&space.basis, &space.product);
    let pairs = ritz(problem.structure, projected.as_ref(), columns)?;
    progress.checkpoint()?;
    // a conjugate pair at the end is cut: the block keeps its width
    let best = general::orthonormal(pairs.columns.as_ref().subcols(0, columns));
    let directions = new_directions(best.as_ref(), columns, active)?;
    space.schur = best.transpose() * &projected * &best;
    let change = Mat::from_fn(known + width, columns + directions.ncols(), |i, j| {
        if j < columns { best[(i, j)] } else { directions[(i, j - columns)] }
    });
    replace_by_product(&mut space.basis, change.as_ref());
    progress.checkpoint()?;
    replace_by_product(&mut space.product, change.as_ref());
    space.directions = directions.ncols();
    Ok(())
}

/// Eigenvectors out of the invariant subspace.
fn finish(problem: &Problem, space: Space, count: usize) -> Result<(GeneralPairs, Block), SpectrumError> {
    let Space { mut basis, schur, .. } = space;
    let pairs = ritz(problem.structure, schur.as_ref(), count)?;
    basis.set_columns(schur.ncols());
    replace_by_product(&mut basis, pairs.columns.as_ref());
    Ok((pairs, basis))
}

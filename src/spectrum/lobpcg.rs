//! Block LOBPCG for operators too wide to factor, preconditioned by a narrow operator that can be.
//!
//! The basis is kept orthonormal (Hetmaniuk and Lehoucq 2006; Duersch et al. 2018), so that every Rayleigh–Ritz step
//! is a plain symmetric eigenproblem.

use faer::{Mat, MatRef};

use super::factor::Cholesky;
use super::orthogonal::{eigen, orthonormalize, orthonormalize_small};
use super::vectors::block::{Block, column_norms, gram, replace_by_product};
use super::vectors::sparse_product::sparse_product;
use super::{Eigenpairs, Problem, SpectrumError};
use crate::progress::{Canceled, Progress};

/// Iterations before giving up; measured cases need 5 to 25.
const ITERATIONS_MAX: usize = 200;

/// Vectors in memory for each that is iterated: X, P and W with their products, residuals, and what becomes a new one.
const VECTORS_HELD: usize = 8;

/// The share of t in the preconditioner. The inverse of `(1 − exp(−tλ))/t` is `1/λ + t/2 + …` where λ is small and t where
/// it is large. Condition numbers with 0.5, 0.8 and 1: 1.77, 1.75 and 1.93 on a bumpy sphere of 90,000 points, 2.7, 2.0
/// and 1.9 on an independent sample, 4.3, 4.8 and 5.2 on Igea.
const PLATEAU_SHARE: f64 = 0.8;

/// `r ↦ (A_narrow + σI)⁻¹ r + 0.8 t·r`, with the factor of a narrow operator on the same points and masses.
///
/// The kernel operator is `(1 − exp(−tλ))/t`, flat at the top, where the narrow one still grows: without the second
/// term, which is a multiple of `B⁻¹ r` before scaling, the preconditioned condition number is about 13.
pub struct Preconditioner<'a> {
    /// Factor of the narrow operator.
    pub factor: &'a Cholesky<'a>,
    /// t in length²: of any operator with long rows the inverse of its largest eigenvalues.
    pub t: f64,
}

impl Preconditioner<'_> {
    pub(super) fn apply(&self, r: &mut Block, progress: &Progress) -> Result<(), Canceled> {
        let residual = r.clone();
        self.factor.solve(r, progress)?;
        r.for_each_row(|i, row| {
            for (x, r) in row.iter_mut().zip(residual.row(i)) {
                *x += PLATEAU_SHARE * self.t * r;
            }
        });
        Ok(())
    }
}

/// X, P and W side by side, orthonormal, and their products with `A`.
struct Space {
    basis: Block,
    product: Block,
    /// Ritz values of X.
    values: Vec<f64>,
    /// Columns of P.
    directions: usize,
}

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
    let mut space = begin(problem, start, progress)?;
    let mut worst = f64::INFINITY;
    let mut first_worst = None;
    for _ in 0..ITERATIONS_MAX {
        let (residual, active, reached) = residuals(problem, &space, count, tolerance);
        worst = reached;
        if worst <= tolerance {
            let Space { mut basis, values, .. } = space;
            basis.set_columns(values.len());
            return Ok(Eigenpairs::real(values, basis));
        }
        let from = *first_worst.get_or_insert(worst);
        progress.advance(share(((from / worst).ln() / (from / tolerance).ln()).clamp(0.0, 1.0)))?;
        step(problem, preconditioner, &mut space, residual, &active, progress)?;
    }
    Err(SpectrumError::NotConverged { reached: worst, tolerance, iterations: ITERATIONS_MAX })
}

/// Rayleigh–Ritz in the span of the start vectors.
fn begin(problem: &Problem, mut start: Block, progress: &Progress) -> Result<Space, SpectrumError> {
    let n = problem.size();
    problem.project_out_null(&mut start);
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
    let (values, coefficients) = eigen(gram(&basis, &product).as_ref())?;
    replace_by_product(&mut basis, coefficients.as_ref());
    replace_by_product(&mut product, coefficients.as_ref());
    Ok(Space { basis, product, values, directions: 0 })
}

/// Residuals of the pairs that have not converged, which ones they are, and the worst relative one of the wanted.
fn residuals(problem: &Problem, space: &Space, count: usize, tolerance: f64) -> (Block, Vec<usize>, f64) {
    let columns = space.values.len();
    let mut residual = Block::zeros(problem.size(), columns);
    residual.for_each_row(|i, row| {
        let (x, product) = (space.basis.row(i), space.product.row(i));
        for (j, r) in row.iter_mut().enumerate() {
            *r = product[j] - space.values[j] * x[j];
        }
    });
    let relative: Vec<f64> = column_norms(&residual)
        .into_iter()
        .zip(&space.values)
        .map(|(norm, value)| norm / (value + problem.shift))
        .collect();
    let worst = relative[..count].iter().copied().fold(0.0, f64::max);
    // a pair well below the tolerance would only add noise directions
    let active: Vec<usize> = (0..columns).filter(|&j| relative[j] > 0.5 * tolerance).collect();
    if active.len() < columns {
        residual.for_each_row(|_, row| {
            for (to, &from) in active.iter().enumerate() {
                row[to] = row[from];
            }
        });
        residual.set_columns(active.len());
    }
    (residual, active, worst)
}

/// Extends the space by preconditioned residuals and takes the Ritz vectors of the whole.
fn step(
    problem: &Problem,
    preconditioner: &Preconditioner<'_>,
    space: &mut Space,
    mut residual: Block,
    active: &[usize],
    progress: &Progress,
) -> Result<(), SpectrumError> {
    let columns = space.values.len();
    let known = columns + space.directions;
    preconditioner.apply(&mut residual, progress)?;
    problem.project_out_null(&mut residual);
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
    let symmetric =
        Mat::from_fn(known + width, known + width, |i, j| 0.5 * (projected[(i, j)] + projected[(j, i)]));
    let (values, vectors) = eigen(symmetric.as_ref())?;
    progress.checkpoint()?;
    let best = vectors.as_ref().subcols(0, columns);
    let directions = new_directions(best, columns, active)?;
    let change = Mat::from_fn(known + width, columns + directions.ncols(), |i, j| {
        if j < columns { best[(i, j)] } else { directions[(i, j - columns)] }
    });
    replace_by_product(&mut space.basis, change.as_ref());
    progress.checkpoint()?;
    replace_by_product(&mut space.product, change.as_ref());
    space.values = values[..columns].to_vec();
    space.directions = directions.ncols();
    Ok(())
}

/// Coefficients of P: what the active Ritz vectors gained outside the old X, orthogonal to the new X.
pub(super) fn new_directions(
    best: MatRef<'_, f64>,
    columns: usize,
    active: &[usize],
) -> Result<Mat<f64>, SpectrumError> {
    let gained =
        Mat::from_fn(best.nrows(), active.len(), |i, k| if i < columns { 0.0 } else { best[(i, active[k])] });
    orthonormalize_small(gained, best)
}

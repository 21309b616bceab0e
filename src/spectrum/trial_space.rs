//! The space in which block iterations look for eigenvectors: X, P and W side by side, orthonormal, with their products.

use faer::{Mat, MatRef};

use super::orthogonal::{orthonormalize, orthonormalize_small};
use super::preconditioner::Preconditioner;
use super::vectors::block::{Block, column_norms, gram, replace_by_product};
use super::vectors::sparse_product::sparse_product;
use super::{Problem, SpectrumError};
use crate::progress::Progress;

/// Approximate eigenvectors X, the directions P that they came by, and while it is extended W.
pub(super) struct TrialSpace {
    /// n × (columns of X, then P, then W), orthonormal.
    pub(super) basis: Block,
    /// `A` times the basis.
    pub(super) product: Block,
    /// Columns of X.
    columns: usize,
    /// Columns of P.
    directions: usize,
}

/// What the columns of X lack to be converged.
pub(super) struct Residuals {
    /// Residuals of the active columns.
    pub(super) block: Block,
    /// The columns that have not converged.
    pub(super) active: Vec<usize>,
    /// Largest relative norm among the wanted columns.
    pub(super) worst: f64,
}

impl Residuals {
    /// Of the residuals of all columns, over `scales`; the first `count` columns are wanted.
    pub(super) fn of(
        mut block: Block,
        scales: impl Iterator<Item = f64>,
        count: usize,
        tolerance: f64,
    ) -> Self {
        let relative: Vec<f64> =
            column_norms(&block).into_iter().zip(scales).map(|(norm, scale)| norm / scale).collect();
        let columns = relative.len();
        let worst = relative[..count.min(columns)].iter().copied().fold(0.0, f64::max);
        // a column well below the tolerance would only add noise directions
        let active: Vec<usize> = (0..columns).filter(|&j| relative[j] > 0.5 * tolerance).collect();
        if active.len() < columns {
            block.for_each_row(|_, row| {
                for (to, &from) in active.iter().enumerate() {
                    row[to] = row[from];
                }
            });
            block.set_columns(active.len());
        }
        Self { block, active, worst }
    }
}

/// Steps from a space, and what is found in it, until the largest residual is at most `tolerance`; `share` turns the part of
/// the way that lies behind into progress.
///
/// # Errors
/// [`SpectrumError::NotConverged`] after `iterations_max` steps; those of `step`; [`SpectrumError::Canceled`].
pub(super) fn iterate<T>(
    (mut space, mut found): (TrialSpace, T),
    tolerance: f64,
    iterations_max: usize,
    progress: &Progress,
    share: impl Fn(f64) -> f64,
    residuals: impl Fn(&TrialSpace, &T) -> Residuals,
    step: impl Fn(&mut TrialSpace, Residuals) -> Result<T, SpectrumError>,
) -> Result<(TrialSpace, T), SpectrumError> {
    let mut worst = f64::INFINITY;
    let mut first_worst = None;
    for _ in 0..iterations_max {
        let residuals = residuals(&space, &found);
        worst = residuals.worst;
        if worst <= tolerance {
            return Ok((space, found));
        }
        let from = *first_worst.get_or_insert(worst);
        progress.advance(share(((from / worst).ln() / (from / tolerance).ln()).clamp(0.0, 1.0)))?;
        found = step(&mut space, residuals)?;
    }
    Err(SpectrumError::NotConverged { reached: worst, tolerance, iterations: iterations_max })
}

impl TrialSpace {
    /// The span of the start vectors, with room for P and W.
    pub(super) fn new(
        problem: &Problem,
        mut start: Block,
        progress: &Progress,
    ) -> Result<Self, SpectrumError> {
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
        Ok(Self { basis, product, columns, directions: 0 })
    }

    /// Columns of X.
    pub(super) fn columns(&self) -> usize {
        self.columns
    }

    /// `A` between all of its columns.
    pub(super) fn projected(&self) -> Mat<f64> {
        gram(&self.basis, &self.product)
    }

    /// X becomes `X·turn`, for a space of X alone.
    pub(super) fn turn(&mut self, turn: MatRef<'_, f64>) {
        replace_by_product(&mut self.basis, turn);
        replace_by_product(&mut self.product, turn);
    }

    /// Extends the space by W, the preconditioned residuals, made orthogonal to what `exclude` takes out.
    pub(super) fn extend(
        &mut self,
        problem: &Problem,
        preconditioner: &Preconditioner<'_>,
        mut residual: Block,
        exclude: impl Fn(&mut Block),
        progress: &Progress,
    ) -> Result<(), SpectrumError> {
        let known = self.columns + self.directions;
        preconditioner.apply(&mut residual, progress)?;
        exclude(&mut residual);
        orthonormalize(&mut residual, &self.basis, progress)?;
        let width = residual.columns();
        let mut product = Block::zeros(problem.size(), width);
        sparse_product(&mut product, &problem.matrix, &residual);
        self.basis.set_columns(known + width);
        self.basis.copy_columns(known, &residual, 0, width);
        self.product.set_columns(known + width);
        self.product.copy_columns(known, &product, 0, width);
        progress.checkpoint()?;
        Ok(())
    }

    /// X becomes the combinations `best` of all columns, and P what the `active` ones of them gained outside of the old X.
    pub(super) fn contract(
        &mut self,
        best: MatRef<'_, f64>,
        active: &[usize],
        progress: &Progress,
    ) -> Result<(), SpectrumError> {
        let columns = self.columns;
        let directions = new_directions(best, columns, active)?;
        let change = Mat::from_fn(best.nrows(), columns + directions.ncols(), |i, j| {
            if j < columns { best[(i, j)] } else { directions[(i, j - columns)] }
        });
        replace_by_product(&mut self.basis, change.as_ref());
        progress.checkpoint()?;
        replace_by_product(&mut self.product, change.as_ref());
        self.directions = directions.ncols();
        Ok(())
    }
}

/// Coefficients of P: what the active columns gained outside the old X, orthogonal to the new X.
fn new_directions(
    best: MatRef<'_, f64>,
    columns: usize,
    active: &[usize],
) -> Result<Mat<f64>, SpectrumError> {
    let gained =
        Mat::from_fn(best.nrows(), active.len(), |i, k| if i < columns { 0.0 } else { best[(i, active[k])] });
    orthonormalize_small(gained, best)
}

//! Corrections of many approximate eigenvectors at a time, each by its own residual.
//!
//! `x ← x − ω M (A − μ) x` multiplies what `x` has of another eigenvector, of eigenvalue λ, by about
//! `1 − ω (λ − μ)/(λ + σ)`. What is solved for is as small as the residual, so that an inverse in single precision, and one
//! of a similar operator, are good enough.

use super::weights::Weights;
use crate::progress::{Canceled, Progress};
use crate::spectrum::Problem;
use crate::spectrum::factor::Cholesky;
use crate::spectrum::vectors::block::{Block, Columns, column_norms};
use crate::spectrum::vectors::pair::rounded_residual;
use crate::spectrum::vectors::sparse_product::{Finish, Rows, finished_product};
use crate::spectrum::vectors::start;

/// Vectors that are corrected together: as many as one reading of the factor serves.
pub(super) const GROUP: usize = 64;

/// Sweeps of Jacobi's iteration after a solution with the factor of a narrower operator; one comes before.
const SWEEPS: usize = 2;

/// Hashed vectors, and products with them, that the largest eigenvalue is estimated from.
const PROBED: usize = 16;
const PROBES: usize = 5;

/// An approximate inverse of the matrix of a problem, and what it works with.
pub(super) struct Correction<'a> {
    problem: &'a Problem,
    factor: &'a Cholesky<'a>,
    /// The matrix in single precision, and the inverse of its diagonal where solutions are smoothed.
    values: Vec<f32>,
    inverse_diagonal: Vec<f32>,
    residual: Block<f32>,
    solution: Block<f32>,
    other: Block<f32>,
    buffer: Vec<f32>,
}

impl<'a> Correction<'a> {
    /// By a factor of the problem's own matrix or, `smoothed`, of a narrower one with a similar lower end of the spectrum.
    pub(super) fn new(problem: &'a Problem, factor: &'a Cholesky<'a>, smoothed: bool) -> Self {
        let (n, matrix) = (problem.size(), &problem.matrix);
        let diagonal = |i: usize| {
            let (columns, values) = matrix.row(i);
            columns.binary_search(&(i as u32)).map_or(1.0, |k| values[k])
        };
        let block = |needed: bool| Block::zeros(if needed { n } else { 0 }, GROUP);
        Self {
            problem,
            factor,
            values: single(matrix.values()),
            inverse_diagonal: if smoothed {
                (0..n).map(|i| (1.0 / diagonal(i)) as f32).collect()
            } else {
                Vec::new()
            },
            residual: block(true),
            solution: block(smoothed),
            other: block(smoothed),
            buffer: Vec::new(),
        }
    }

    /// σ of the factor.
    pub(super) fn shift(&self) -> f64 {
        self.factor.shift()
    }

    /// Largest eigenvalue of `M A`, nearly: 1 where the factor is the matrix's own.
    pub(super) fn upper_end(&mut self, progress: &Progress) -> Result<f64, Canceled> {
        if self.inverse_diagonal.is_empty() {
            return Ok(1.0);
        }
        let mut hashed = Block::zeros(self.problem.size(), PROBED);
        start::fill(&mut hashed, 1 << 24);
        let mut x = Block::<f32>::zeros(self.problem.size(), PROBED);
        x.copy_columns(0, &hashed, 0, PROBED);
        let mut growth = 0.0;
        for _ in 0..PROBES {
            let rows = Self::rows(self.problem, &self.values);
            finished_product(&mut self.residual, rows, x.columns_from(0, PROBED), Finish::Product);
            progress.checkpoint()?;
            let image = self.solved(progress)?;
            hashed.copy_columns(0, image, 0, PROBED);
            let norms = column_norms(&hashed);
            growth = norms.iter().copied().fold(0.0, f64::max);
            x.for_each_row(|i, row| {
                let image = hashed.row(i).iter().zip(&norms);
                row.iter_mut().zip(image).for_each(|(x, (image, norm))| *x = (image / norm) as f32);
            });
        }
        Ok(growth)
    }

    /// Vectors of a coarser level at the points of this one, `(μ + σ) (A + σI)⁻¹ W x`: the inverse takes away what is rough
    /// about the weights.
    pub(super) fn start(
        &mut self,
        x: &mut Block<f32>,
        weights: &Weights,
        coarse: Columns<'_, f32>,
        values: &[f64],
        progress: &Progress,
    ) -> Result<(), Canceled> {
        finished_product(x, weights, coarse, Finish::Product);
        progress.checkpoint()?;
        self.factor.solve_single(x, &mut self.buffer, progress)?;
        let scale: Vec<f32> = values.iter().map(|value| (value + self.shift()) as f32).collect();
        x.for_each_row(|_, row| row.iter_mut().zip(&scale).for_each(|(x, scale)| *x *= scale));
        progress.checkpoint()
    }

    /// One step for vectors in single precision.
    pub(super) fn in_single(
        &mut self,
        x: &mut Block<f32>,
        values: &[f64],
        omega: &[f64],
        progress: &Progress,
    ) -> Result<(), Canceled> {
        let mu: Vec<f32> = values.iter().map(|&value| value as f32).collect();
        let rows = Self::rows(self.problem, &self.values);
        finished_product(&mut self.residual, rows, x.columns_from(0, x.columns()), Finish::Residual(&mu));
        progress.checkpoint()?;
        let correction = self.solved(progress)?;
        let omega: Vec<f32> = omega.iter().map(|&omega| omega as f32).collect();
        x.for_each_row(|i, row| {
            for ((x, c), omega) in row.iter_mut().zip(correction.row(i)).zip(&omega) {
                *x -= omega * c;
            }
        });
        progress.checkpoint()
    }

    /// One step for the columns `from ..` of vectors in double precision, whose residual is taken in double.
    pub(super) fn in_double(
        &mut self,
        x: &mut Block,
        from: usize,
        values: &[f64],
        omega: &[f64],
        progress: &Progress,
    ) -> Result<(), Canceled> {
        let some = x.columns_from(from, values.len());
        rounded_residual(&mut self.residual, &self.problem.matrix, some, values);
        progress.checkpoint()?;
        let correction = self.solved(progress)?;
        x.for_each_row(|i, row| {
            for ((x, &c), omega) in row[from..].iter_mut().zip(correction.row(i)).zip(omega) {
                *x -= omega * f64::from(c);
            }
        });
        progress.checkpoint()
    }

    fn rows<'r>(problem: &'r Problem, values: &'r [f32]) -> Rows<'r, f32> {
        Rows { offsets: problem.matrix.offsets(), columns: problem.matrix.columns(), values }
    }

    /// `M r` of the residual at hand.
    fn solved(&mut self, progress: &Progress) -> Result<&Block<f32>, Canceled> {
        let Self { residual, solution, other, buffer, factor, .. } = self;
        if self.inverse_diagonal.is_empty() {
            factor.solve_single(residual, buffer, progress)?;
            return Ok(residual);
        }
        let rows = Self::rows(self.problem, &self.values);
        let count = residual.columns();
        // before: z = D⁻¹ r, and what A makes of it is solved for no more
        solution.set_columns(count);
        solution.for_each_row(|i, row| {
            let inverse = self.inverse_diagonal[i];
            row.iter_mut().zip(residual.row(i)).for_each(|(z, r)| *z = inverse * r);
        });
        finished_product(
            other,
            rows,
            solution.columns_from(0, count),
            Finish::Defect(residual.columns_from(0, count)),
        );
        progress.checkpoint()?;
        factor.solve_single(other, buffer, progress)?;
        solution.for_each_row(|i, row| row.iter_mut().zip(other.row(i)).for_each(|(z, t)| *z += t));
        for _ in 0..SWEEPS {
            progress.checkpoint()?;
            let finish = Finish::Relaxed(residual.columns_from(0, count), &self.inverse_diagonal);
            finished_product(other, rows, solution.columns_from(0, count), finish);
            std::mem::swap(solution, other);
        }
        Ok(solution)
    }
}

fn single(values: &[f64]) -> Vec<f32> {
    use rayon::prelude::*;
    values.par_iter().with_min_len(1 << 14).map(|&value| value as f32).collect()
}

//! Eigenpairs from the vectors of a Krylov space: as they are where solutions are exact, corrected where they are in
//! single precision.

use super::factor::Cholesky;
use super::krylov::Complement;
use super::ritz::rayleigh_ritz;
use super::vectors::block::{Block, column_products};
use super::vectors::sparse_product::sparse_product;
use super::{Eigenpairs, Problem, SpectrumError, certificates};
use crate::progress::{Canceled, Progress};

/// Vectors that are corrected together: as many as one reading of the factor serves.
const TOGETHER: usize = 64;

/// Rounds of corrections before giving up.
const ROUNDS_MAX: usize = 5;

/// Ritz pairs with relative residuals of at most `tolerance` in the span of `vectors`, orthogonal to the eigenvectors
/// `beside`.
///
/// Vectors in single precision have noise of all scales, which the operator magnifies: the most of smooth ones, whose
/// eigenvalues are small beside its largest. One correction takes it away, so that none is looked at before; what that
/// leaves is corrected again.
///
/// # Errors
/// [`SpectrumError::NotConverged`], [`SpectrumError::Canceled`].
pub(super) fn polished(
    problem: &Problem,
    factor: &Cholesky<'_>,
    beside: &Block,
    mut vectors: Block,
    tolerance: f64,
    progress: &Progress,
) -> Result<Eigenpairs, SpectrumError> {
    if factor.is_exact() {
        return rayleigh_ritz(problem, vectors, progress);
    }
    let complement = Complement { problem, beside };
    let mut rough: Vec<usize> = (0..vectors.columns()).collect();
    let mut reached = f64::INFINITY;
    for _ in 0..ROUNDS_MAX {
        for some in rough.chunks(TOGETHER) {
            progress.checkpoint()?;
            correct(&complement, factor, &mut vectors, some, progress)?;
        }
        let pairs = rayleigh_ritz(problem, vectors, progress)?;
        let residuals = certificates::measure(problem, &pairs, progress)?.residuals;
        rough = (0..residuals.len()).filter(|&j| residuals[j] > tolerance).collect();
        if rough.is_empty() {
            return Ok(pairs);
        }
        reached = residuals.into_iter().fold(0.0, f64::max);
        vectors = pairs.vectors;
    }
    Err(SpectrumError::NotConverged { reached, tolerance, iterations: ROUNDS_MAX })
}

/// An inverse iteration of some of the vectors, `y − (A+σI)⁻¹ (A−μI) y = (μ+σ) (A+σI)⁻¹ y` for the Rayleigh quotient μ:
/// what is solved for is as small as the residual, so that single precision is enough for it.
fn correct(
    complement: &Complement<'_>,
    factor: &Cholesky<'_>,
    vectors: &mut Block,
    some: &[usize],
    progress: &Progress,
) -> Result<(), Canceled> {
    let rows = vectors.rows();
    let mut rough = Block::zeros(rows, some.len());
    rough.for_each_row(|i, row| {
        let from = vectors.row(i);
        row.iter_mut().zip(some).for_each(|(x, &j)| *x = from[j]);
    });
    let mut correction = Block::zeros(rows, some.len());
    sparse_product(&mut correction, &complement.problem.matrix, &rough);
    let (curvature, squared) = (column_products(&rough, &correction), column_products(&rough, &rough));
    let quotients: Vec<f64> = curvature.iter().zip(&squared).map(|(c, s)| c / s).collect();
    correction.for_each_row(|i, row| {
        for ((r, y), quotient) in row.iter_mut().zip(rough.row(i)).zip(&quotients) {
            *r -= quotient * y;
        }
    });
    progress.checkpoint()?;
    factor.solve(&mut correction, progress)?;
    rough.for_each_row(|i, row| row.iter_mut().zip(correction.row(i)).for_each(|(y, c)| *y -= c));
    complement.project(&mut rough);
    vectors.for_each_row(|i, row| some.iter().zip(rough.row(i)).for_each(|(&j, &x)| row[j] = x));
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::spectrum::factor::Symbolic;
    use crate::spectrum::grid::{grid, grid_eigenvalues};
    use crate::spectrum::inverse::{Nearest, Shifted};
    use crate::spectrum::shift_invert::ritz_vectors;

    #[test]
    fn what_rough_solutions_leave_is_taken_away_or_said_to_be_left() {
        let (side, tolerance) = (100, 1e-6);
        let problem = grid(side);
        let order: Vec<u32> = (0..(side * side) as u32).collect();
        let symbolic = Symbolic::analyze(&problem.matrix, order, &Progress::new()).unwrap();
        let factor = symbolic.factor(&problem.matrix, problem.shift, &Progress::new()).unwrap();
        assert!(!factor.is_exact());
        let none = Block::zeros(problem.size(), 0);
        let rough = || {
            let shifted = Shifted { inverse: &factor, shift: -factor.shift() };
            let nearest = Nearest { below: 0, above: 20 };
            let progress = Progress::new();
            ritz_vectors(&problem, shifted, &none, nearest, tolerance, &progress, |share| share).unwrap()
        };
        let largest =
            |pairs: &Eigenpairs| certificates::measure(&problem, pairs, &Progress::new()).unwrap().residual();
        assert!(largest(&rayleigh_ritz(&problem, rough(), &Progress::new()).unwrap()) > 10.0 * tolerance);
        let polish = |tolerance| polished(&problem, &factor, &none, rough(), tolerance, &Progress::new());
        let pairs = polish(tolerance).unwrap();
        assert!(largest(&pairs) <= tolerance);
        for (found, exact) in pairs.values.iter().zip(&grid_eigenvalues(side)[1..]) {
            assert!((found - exact).abs() < 1e-9 * exact, "{found} {exact}");
        }
        assert!(matches!(polish(1e-15), Err(SpectrumError::NotConverged { .. })));
    }
}

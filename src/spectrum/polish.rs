//! Inverse iterations that take away what rough solutions have left of the residuals.

use super::block::{Block, column_norms};
use super::cholesky::Cholesky;
use super::shift_invert::{BLOCK, Complement, rayleigh_ritz};
use super::{Eigenpairs, Problem, SpectrumError, certificates};
use crate::progress::Progress;

/// Rounds before giving up, and the error of solutions in them.
const ROUNDS_MAX: usize = 4;
const ERROR: f64 = 1e-6;

/// The pairs with relative residuals of at most `tolerance`, orthogonal to the eigenvectors `beside`; as they are where
/// the factor is exact.
///
/// A factor in single precision is wrong where the inverse is large: in the smooth vectors, of which a few iterations with
/// refined solutions are enough.
///
/// # Errors
/// [`SpectrumError::NotConverged`], [`SpectrumError::Canceled`].
pub(super) fn polished(
    problem: &Problem,
    factor: &Cholesky<'_>,
    beside: &Block,
    mut pairs: Eigenpairs,
    tolerance: f64,
    progress: &Progress,
) -> Result<Eigenpairs, SpectrumError> {
    if factor.is_exact() {
        return Ok(pairs);
    }
    let complement = Complement { problem, beside };
    let mut rounds = 0;
    loop {
        let residuals = certificates::residuals(problem, &pairs);
        let rough: Vec<usize> = (0..residuals.len()).filter(|&j| residuals[j] > tolerance).collect();
        if rough.is_empty() {
            return Ok(pairs);
        }
        if rounds == ROUNDS_MAX {
            let reached = residuals.into_iter().fold(0.0, f64::max);
            return Err(SpectrumError::NotConverged { reached, tolerance, iterations: rounds });
        }
        for some in rough.chunks(BLOCK) {
            progress.checkpoint()?;
            iterate(&complement, factor, &mut pairs.vectors, some);
        }
        pairs = rayleigh_ritz(problem, pairs.vectors)?;
        rounds += 1;
    }
}

/// An inverse iteration of some of the vectors.
fn iterate(complement: &Complement<'_>, factor: &Cholesky<'_>, vectors: &mut Block, some: &[usize]) {
    let mut work = Block::zeros(vectors.rows(), some.len());
    for (to, &from) in some.iter().enumerate() {
        work.copy_columns(to, vectors, from, 1);
    }
    factor.solve_to(&mut work, ERROR);
    complement.project(&mut work);
    let norms = column_norms(&work);
    work.for_each_row(|_, row| row.iter_mut().zip(&norms).for_each(|(x, norm)| *x /= norm));
    for (from, &to) in some.iter().enumerate() {
        vectors.copy_columns(to, &work, from, 1);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::spectrum::cholesky::Symbolic;
    use crate::spectrum::shift_invert::tests::{grid, grid_eigenvalues};
    use crate::spectrum::shift_invert::{Nearest, Shifted, ritz_vectors};

    #[test]
    fn what_rough_solutions_leave_is_taken_away_or_said_to_be_left() {
        let (side, tolerance) = (100, 1e-6);
        let problem = grid(side);
        let order: Vec<u32> = (0..(side * side) as u32).collect();
        let symbolic = Symbolic::analyze(&problem.matrix, order).unwrap();
        let factor = symbolic.factor(&problem.matrix, problem.shift, &Progress::new()).unwrap();
        assert!(!factor.is_exact());
        let none = Block::zeros(problem.size(), 0);
        let rough = || {
            let shifted = Shifted { inverse: &factor, shift: -factor.shift() };
            let nearest = Nearest { below: 0, above: 20 };
            let progress = Progress::new();
            let vectors =
                ritz_vectors(&problem, shifted, &none, nearest, tolerance, &progress, |share| share).unwrap();
            rayleigh_ritz(&problem, vectors).unwrap()
        };
        let largest =
            |pairs: &Eigenpairs| certificates::residuals(&problem, pairs).into_iter().fold(0.0, f64::max);
        assert!(largest(&rough()) > 10.0 * tolerance);
        let polish = |tolerance| polished(&problem, &factor, &none, rough(), tolerance, &Progress::new());
        let pairs = polish(tolerance).unwrap();
        assert!(largest(&pairs) <= tolerance);
        for (found, exact) in pairs.values.iter().zip(&grid_eigenvalues(side)[1..]) {
            assert!((found - exact).abs() < 1e-9 * exact, "{found} {exact}");
        }
        assert!(matches!(polish(1e-15), Err(SpectrumError::NotConverged { .. })));
    }
}

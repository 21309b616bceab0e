//! Wide operators of which the factor does not fit: pairs by a polynomial inverse or by LOBPCG, probed for what was missed.

use super::certificates::{self, MissedCheck};
use super::chebyshev::Chebyshev;
use super::factor::Symbolic;
use super::inverse::{Nearest, Shifted};
use super::lobpcg;
use super::narrow::{guarded, narrow_vectors};
use super::preconditioner::Preconditioner;
use super::probe::{Probe, Towards};
use super::ritz::rayleigh_ritz;
use super::shift_invert::ritz_vectors;
use super::shifted_system::ByFactor;
use super::solution::{Method, Request, Solution, certified, with_null_space};
use super::vectors::block::Block;
use super::{Eigenpairs, Problem, SpectrumError};
use crate::operator::Sparse;
use crate::progress::{Phase, Progress};

/// Error of the inverse as a polynomial, as a share of the tolerance, and the most steps that it may take: beyond, LOBPCG
/// needs fewer products.
const POLYNOMIAL_ERROR: f64 = 0.8;
const POLYNOMIAL_STEPS_MAX: usize = 10;

/// Searches for eigenvalues that were missed, before the answer says that some are.
const SEARCHES_MAX: usize = 10;

/// The smallest eigenpairs, with the help of a narrow operator on the same points and masses.
///
/// # Errors
/// [`SpectrumError`].
pub(super) fn solve<'a, P: Fn(u32) -> &'a [f64] + Sync>(
    problem: &Problem,
    narrow: &Sparse,
    request: &Request<'_, P>,
    progress: &Progress,
) -> Result<Solution, SpectrumError> {
    let symbolic = Symbolic::by_position(narrow, &request.position, progress)?;
    progress.advance(0.5)?;
    let factor = symbolic.factor(narrow, problem.shift, progress)?;
    progress.enter(Phase::Eigenpairs)?;
    let wanted = request.count - problem.zero_modes();
    let preconditioner = Preconditioner { factor: &factor, t: request.plateau.unwrap_or(0.0) };
    let polynomial =
        Chebyshev::new(problem, &preconditioner, POLYNOMIAL_ERROR * request.tolerance, progress)?;
    let (pairs, method) = if let Some(polynomial) = polynomial.filter(|p| p.steps() <= POLYNOMIAL_STEPS_MAX) {
        let pairs = polynomial_solve(problem, &polynomial, &preconditioner, wanted, request, progress)?;
        (pairs, Method::Polynomial)
    } else {
        let start = narrow_vectors(problem, narrow, &factor, guarded(wanted), progress)?;
        let rest = |share| 0.3 + 0.7 * share;
        let pairs =
            lobpcg::solve(problem, &preconditioner, start, wanted, request.tolerance, progress, rest)?;
        (pairs, Method::Lobpcg)
    };
    progress.enter(Phase::Certificates)?;
    let (mut pairs, missed) =
        with_missed(problem, &preconditioner, pairs, wanted, request.tolerance, progress)?;
    pairs.values.truncate(wanted);
    let pairs = with_null_space(problem, Some(&pairs), request.count);
    let mut inverse = ByFactor::new(&factor, true);
    let missed = (Some(missed), MissedCheck::Probe);
    certified(problem, pairs, request, method, missed, Some(&mut inverse), progress)
}

/// Block Lanczos on the approximate inverse; what its error leaves of the residuals, LOBPCG takes away.
fn polynomial_solve<P>(
    problem: &Problem,
    polynomial: &Chebyshev<'_>,
    preconditioner: &Preconditioner<'_>,
    wanted: usize,
    request: &Request<'_, P>,
    progress: &Progress,
) -> Result<Eigenpairs, SpectrumError> {
    let shifted = Shifted { inverse: polynomial, shift: -problem.shift };
    let none = Block::zeros(problem.size(), 0);
    let nearest = Nearest { below: 0, above: wanted };
    let most = |share| 0.9 * share;
    let vectors = ritz_vectors(problem, shifted, &none, nearest, request.tolerance, progress, most)?;
    let pairs = rayleigh_ritz(problem, vectors, progress)?;
    let residuals = certificates::measure(problem, &pairs, progress)?.residuals;
    if residuals.iter().all(|&residual| residual <= request.tolerance) {
        return Ok(pairs);
    }
    let rest = |share| 0.9 + 0.1 * share;
    lobpcg::solve(problem, preconditioner, pairs.vectors, wanted, request.tolerance, progress, rest)
}

/// The pairs with those that a probe finds among them, and how many it still finds in the end: the vectors of the probe
/// are what LOBPCG starts from beside the pairs that are known.
fn with_missed(
    problem: &Problem,
    preconditioner: &Preconditioner<'_>,
    mut pairs: Eigenpairs,
    wanted: usize,
    tolerance: f64,
    progress: &Progress,
) -> Result<(Eigenpairs, usize), SpectrumError> {
    let mut searches = 0;
    loop {
        let towards = Towards::Preconditioned(preconditioner);
        let probe = Probe::beside(problem, &towards, &pairs.vectors, progress)?;
        let missed = probe.below(pairs.values[wanted - 1]);
        if missed == 0 || searches == SEARCHES_MAX {
            return Ok((pairs, missed));
        }
        searches += 1;
        let known = pairs.vectors.columns();
        let mut start = Block::zeros(problem.size(), known + probe.vectors.columns());
        start.copy_columns(0, &pairs.vectors, 0, known);
        start.copy_columns(known, &probe.vectors, 0, probe.vectors.columns());
        drop((pairs, probe));
        pairs = lobpcg::solve(problem, preconditioner, start, wanted, tolerance, progress, |_| 0.0)?;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::spectrum::grid::{grid, grid_eigenvalues};
    use crate::spectrum::shift_invert;

    #[test]
    fn pairs_that_were_left_out_are_found_again() {
        let (side, wanted) = (40, 20);
        let problem = grid(side);
        let order: Vec<u32> = (0..(side * side) as u32).collect();
        let progress = Progress::new();
        let symbolic = Symbolic::analyze(&problem.matrix, order, &progress).unwrap();
        let factor = symbolic.factor_double(&problem.matrix, problem.shift, &progress).unwrap();
        let none = Block::zeros(problem.size(), 0);
        let all = shift_invert::solve(&problem, &factor, &none, wanted + 2, 1e-8, &progress, |s| s).unwrap();
        let mut kept = Block::zeros(problem.size(), wanted);
        let mut values = Vec::new();
        for (to, from) in (0..wanted + 2).filter(|j| ![3, 11].contains(j)).enumerate() {
            kept.copy_columns(to, &all.vectors, from, 1);
            values.push(all.values[from]);
        }
        // as t of a heat kernel, what is larger than all of the grid's eigenvalues
        let preconditioner = Preconditioner { factor: &factor, t: 1.0 / 9.0 };
        let pairs = Eigenpairs::real(values, kept);
        let (found, missed) = with_missed(&problem, &preconditioner, pairs, wanted, 1e-8, &progress).unwrap();
        assert_eq!(missed, 0);
        for (found, exact) in found.values[..wanted].iter().zip(&grid_eigenvalues(side)[1..]) {
            assert!((found - exact).abs() < 1e-9 * exact, "{found} {exact}");
        }
    }
}

//! Operators of which the factor fits: pairs by inverse iteration, counted or probed for what was missed.

use super::certificates::MissedCheck;
use super::factor::{Cholesky, Symbolic};
use super::probe::{Probe, Towards};
use super::ritz::rayleigh_ritz;
use super::shifted_system::{ByFactor, NearInverse};
use super::solution::{Method, Request, Solution, certified, with_null_space};
use super::vectors::block::Block;
use super::{Eigenpairs, Problem, SpectrumError, shift_invert, slicing};
use crate::progress::{Phase, Progress};

/// Entries of the factor, per row, up to which a second factorization counts the eigenvalues below a bound.
const INERTIA_ENTRIES_PER_ROW: usize = 200;

/// Searches for eigenvalues that were missed, before the answer says that some are.
const SEARCHES_MAX: u32 = 30;

/// Gaps at which the count of eigenvalues is tried: a factorization at each.
const GAPS_TRIED: usize = 9;

/// Least tolerance for which factors in single precision are tried.
const SINGLE_TOLERANCE: f64 = 1e-6;

/// Distance of the shift from zero as a share of the largest eigenvalue wanted: factors in single precision are the better
/// the larger it is, and Krylov spaces hardly take notice.
const SHIFT_SHARE: f64 = 0.1;

/// The smallest eigenpairs.
///
/// # Errors
/// [`SpectrumError`].
pub(super) fn solve<P>(
    problem: &Problem,
    symbolic: &Symbolic,
    request: &Request<'_, P>,
    progress: &Progress,
) -> Result<Solution, SpectrumError> {
    progress.advance(0.2)?;
    let wanted = request.count - problem.zero_modes();
    // one more, so that the count below is taken in a gap
    let found = (wanted + 1).min(problem.size() - problem.zero_modes());
    let counts = symbolic.factor_entries() <= INERTIA_ENTRIES_PER_ROW * problem.size();
    progress.enter(Phase::Eigenpairs)?;
    let expected = request.weyl.map_or(0.0, |weyl| weyl.eigenvalue(wanted as f64));
    let shift = problem.shift.max(SHIFT_SHARE * expected);
    // one slice of a wide operator is taken from the end of the spectrum, where a factor in single precision is enough
    let worthwhile = if counts { slicing::SLICED_FROM } else { slicing::SLICE + 1 };
    let sliced = match request.weyl.filter(|_| wanted >= worthwhile) {
        Some(weyl) => slicing::solve(problem, symbolic, weyl, found, request.tolerance, progress)?,
        None => None,
    };
    let (mut pairs, mut factor) = if let Some((pairs, factor)) = sliced {
        (pairs, Some(factor))
    } else {
        let none = Block::zeros(problem.size(), 0);
        let whole = |share| share;
        let (pairs, factor) =
            inverse_iteration(problem, symbolic, shift, &none, found, request.tolerance, progress, whole)?;
        (pairs, Some(factor))
    };
    progress.enter(Phase::Certificates)?;
    let mut searches = 0;
    let missed = loop {
        let missed = match &factor {
            Some(factor) if !counts => {
                let probe = Probe::beside(problem, &Towards::Inverse(factor), &pairs.vectors, progress)?;
                (Some(probe.below(pairs.values[wanted - 1])), MissedCheck::Probe)
            }
            _ => {
                // the count has a factor of its own: both at once would be the peak of the whole analysis
                factor = None;
                missed_by_inertia(problem, symbolic, &pairs.values, progress)?
            }
        };
        searches += 1;
        match missed.0 {
            Some(more) if more > 0 && searches <= SEARCHES_MAX => {
                progress.advance(f64::from(searches) / f64::from(SEARCHES_MAX + 1))?;
                drop(factor.take());
                let (all, inverse) =
                    with_missed(problem, symbolic, shift, pairs, more, request.tolerance, progress)?;
                pairs = all;
                pairs.truncate(found);
                factor = Some(inverse);
            }
            _ => break missed,
        }
    };
    pairs.values.truncate(wanted);
    let pairs = with_null_space(problem, Some(&pairs), request.count);
    let definite = factor.take().filter(|factor| factor.negative_eigenvalues() == 0);
    let definite = match definite {
        Some(factor) => Some(factor),
        None => symbolic.factor_roughly(&problem.matrix, shift, progress)?,
    };
    let mut inverse = definite.as_ref().map(|factor| ByFactor::new(factor, false));
    let inverse = inverse.as_mut().map(|inverse| inverse as &mut dyn NearInverse);
    certified(problem, pairs, request, Method::ShiftInvert, missed, inverse, progress)
}

/// The `count` smallest non-zero eigenpairs beside `beside` and the factor that they come from: in single precision where
/// that reaches the tolerance.
#[allow(clippy::too_many_arguments)] // where, how many, how well, and who watches
fn inverse_iteration<'a>(
    problem: &'a Problem,
    symbolic: &'a Symbolic,
    shift: f64,
    beside: &Block,
    count: usize,
    tolerance: f64,
    progress: &Progress,
    share: impl Fn(f64) -> f64,
) -> Result<(Eigenpairs, Cholesky<'a>), SpectrumError> {
    let pairs = |factor: &Cholesky<'a>| {
        shift_invert::solve(problem, factor, beside, count, tolerance, progress, &share)
    };
    if tolerance >= SINGLE_TOLERANCE {
        let factor = symbolic.factor(&problem.matrix, shift, progress)?;
        match pairs(&factor) {
            // single precision was not enough after all
            Err(SpectrumError::NotConverged { .. }) if !factor.is_exact() => {}
            solved => return Ok((solved?, factor)),
        }
    }
    let factor = symbolic.factor_double(&problem.matrix, shift, progress)?;
    Ok((pairs(&factor)?, factor))
}

/// The pairs with `more` others, searched for in the space that they leave: blocks find as many of a multiple eigenvalue
/// at a time. Also the factor that these come from.
fn with_missed<'a>(
    problem: &'a Problem,
    symbolic: &'a Symbolic,
    shift: f64,
    pairs: Eigenpairs,
    more: usize,
    tolerance: f64,
    progress: &Progress,
) -> Result<(Eigenpairs, Cholesky<'a>), SpectrumError> {
    let known = pairs.vectors.columns();
    let more = more.min(problem.size() - problem.zero_modes() - known);
    let (others, factor) =
        inverse_iteration(problem, symbolic, shift, &pairs.vectors, more, tolerance, progress, |_| 0.0)?;
    let mut all = Block::zeros(problem.size(), known + more);
    all.copy_columns(0, &pairs.vectors, 0, known);
    drop(pairs);
    all.copy_columns(known, &others.vectors, 0, more);
    drop(others);
    Ok((rayleigh_ritz(problem, all, progress)?, factor))
}

/// Counts the eigenvalues below the last gap between found ones: in a cluster at the end, of which only a part was asked
/// for, nothing counts as missed.
pub(super) fn missed_by_inertia(
    problem: &Problem,
    symbolic: &Symbolic,
    values: &[f64],
    progress: &Progress,
) -> Result<(Option<usize>, MissedCheck), SpectrumError> {
    let gaps = values.windows(2).enumerate().rev().filter(|(_, pair)| pair[1] - pair[0] >= 1e-4 * pair[1]);
    for (k, pair) in gaps.take(GAPS_TRIED) {
        let bound = 0.5 * (pair[0] + pair[1]);
        if let Some(below) = symbolic.eigenvalues_below(&problem.matrix, bound, progress)? {
            let expected = problem.zero_modes() + k + 1;
            return Ok((Some(below.saturating_sub(expected)), MissedCheck::Inertia));
        }
    }
    Ok((None, MissedCheck::None))
}

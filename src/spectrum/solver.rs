//! Chooses a solver.

use super::certificates::MissedCheck;
use super::coarse_to_fine::prolonged::{self, Sample};
use super::factor::Symbolic;
use super::solution::{Method, Request, Solution, certified, with_null_space};
use super::{Problem, SpectrumError, coarse_to_fine, dense, direct, indefinite, iterative, slicing};
use crate::operator::Structure;
use crate::progress::{Phase, Progress};

/// Entries of the factor, per row and in all (1.6 GB in single precision), up to which a wide operator is factored too.
const DIRECT_ENTRIES_PER_ROW: usize = 600;
const DIRECT_ENTRIES: usize = 400_000_000;

/// Bytes per point and pair of a solver on all points.
const SOLVER_BYTES: usize = 20;

/// Points from which on thinned samples are worth their time: a scan of 36,000 points is another surface without eight
/// ninths of them.
const COARSE_FROM: usize = 60_000;

/// The smallest eigenpairs of a problem.
///
/// # Errors
/// [`SpectrumError`].
pub fn solve<'a, P: Fn(u32) -> &'a [f64] + Sync>(
    problem: &Problem,
    request: &Request<'_, P>,
    progress: &Progress,
) -> Result<Solution, SpectrumError> {
    let (n, count) = (problem.size(), request.count);
    if problem.structure != Structure::SemiDefinite {
        return indefinite::solve(problem, request, progress);
    }
    if n > request.solved_max {
        progress.enter(Phase::Factorization)?;
        let solve_sample =
            |sample: Sample<'_>| solve_sample(&sample, request.solved_max, request.tolerance, progress);
        if let Some(solution) = prolonged::solve(problem, request, &solve_sample, progress)? {
            return Ok(solution);
        }
        // nobody counted on vectors of all points
        progress.afford_beside((SOLVER_BYTES * n * count) as u64)?;
    }
    if dense::is_dense(n, count) {
        progress.enter(Phase::Eigenpairs)?;
        let pairs = dense::solve(problem, count)?;
        progress.enter(Phase::Certificates)?;
        let missed = (Some(0), MissedCheck::Dense);
        return certified(problem, pairs, request, Method::Dense, missed, None, progress);
    }
    progress.enter(Phase::Factorization)?;
    let zeros = problem.zero_modes().min(count);
    if zeros == count {
        let pairs = with_null_space(problem, None, count);
        progress.enter(Phase::Certificates)?;
        // the null space is the smallest there is
        let missed = (Some(0), MissedCheck::Inertia);
        return certified(problem, pairs, request, Method::ShiftInvert, missed, None, progress);
    }
    if n >= COARSE_FROM
        && let Some(solution) = coarse_to_fine::solve(problem, request, progress)?
    {
        return Ok(solution);
    }
    let analyze = || Symbolic::by_position(&problem.matrix, &request.position, progress);
    let direct = match request.narrow {
        None => Some(analyze()?),
        Some(_) if problem.matrix.nonzeros() / n > 200 => None,
        Some(_) => {
            // slices take factors in double precision
            let most = if count > slicing::SLICE { DIRECT_ENTRIES / 2 } else { DIRECT_ENTRIES };
            Some(analyze()?).filter(|s| s.factor_entries() <= most.min(n * DIRECT_ENTRIES_PER_ROW))
        }
    };
    match (direct, request.narrow) {
        (Some(symbolic), _) => direct::solve(problem, &symbolic, request, progress),
        (None, Some(narrow)) => iterative::solve(problem, narrow, request, progress),
        (None, None) => Err(SpectrumError::Factorization("the operator has no narrow companion".into())),
    }
}

/// The smallest eigenpairs of a thinned sample, which is thinned out again where it has too many points.
fn solve_sample(
    sample: &Sample<'_>,
    solved_max: usize,
    tolerance: f64,
    progress: &Progress,
) -> Result<Solution, SpectrumError> {
    let request = Request {
        count: sample.count,
        tolerance,
        position: |i: u32| &sample.positions[i as usize][..],
        narrow: None,
        weyl: Some(sample.weyl),
        plateau: None,
        solved_max,
        saturates: false,
    };
    solve(sample.problem, &request, progress)
}

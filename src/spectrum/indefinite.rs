//! Operators that are not symmetric, or symmetric but not definite: from the dense matrix, or by an invariant subspace.

use super::certificates::MissedCheck;
use super::factor::Symbolic;
use super::general::GeneralPairs;
use super::narrow::{guarded, narrow_vectors};
use super::preconditioner::Preconditioner;
use super::solution::{Method, Request, Solution, certified};
use super::vectors::block::Block;
use super::{Eigenpairs, Problem, SpectrumError, dense, invariant};
use crate::progress::{Phase, Progress};

/// Eigenpairs of an operator that is not symmetric, or symmetric but not definite.
pub(super) fn solve<'a, P: Fn(u32) -> &'a [f64] + Sync>(
    problem: &Problem,
    request: &Request<'_, P>,
    progress: &Progress,
) -> Result<Solution, SpectrumError> {
    let (n, count) = (problem.size(), request.count);
    let dense = dense::is_dense_general(n, count);
    // a conjugate pair must not be cut before its residual is known
    let (found, vectors, method) = if dense {
        progress.enter(Phase::Eigenpairs)?;
        let (found, vectors) = dense::solve_general(problem, count)?;
        (found, vectors, Method::Dense)
    } else {
        let (found, vectors) = iteration(problem, request, progress)?;
        (found, vectors, Method::InvariantSubspace)
    };
    progress.enter(Phase::Certificates)?;
    let GeneralPairs { real: values, imaginary, .. } = found;
    let mut pairs = Eigenpairs { values, imaginary, vectors };
    pairs.normalize();
    let checked = if dense { (Some(0), MissedCheck::Dense) } else { (None, MissedCheck::None) };
    let mut solution = certified(problem, pairs, request, method, checked, None, progress)?;
    solution.truncate(count);
    Ok(solution)
}

fn iteration<'a, P: Fn(u32) -> &'a [f64] + Sync>(
    problem: &Problem,
    request: &Request<'_, P>,
    progress: &Progress,
) -> Result<(GeneralPairs, Block), SpectrumError> {
    let Some(narrow) = request.narrow else {
        return Err(SpectrumError::Factorization("the operator has no narrow companion".into()));
    };
    progress.enter(Phase::Factorization)?;
    let symbolic = Symbolic::by_position(narrow, &request.position, progress)?;
    progress.advance(0.5)?;
    let factor = symbolic.factor(narrow, problem.shift, progress)?;
    progress.enter(Phase::Eigenpairs)?;
    let zeros = problem.zero_modes();
    let narrow_start = narrow_vectors(problem, narrow, &factor, guarded(request.count), progress)?;
    let mut start = Block::zeros(problem.size(), zeros + narrow_start.columns());
    problem.write_null_vectors(&mut start, 0..zeros);
    start.copy_columns(zeros, &narrow_start, 0, narrow_start.columns());
    drop(narrow_start);
    let preconditioner = Preconditioner { factor: &factor, t: request.plateau.unwrap_or(0.0) };
    invariant::solve(problem, &preconditioner, start, request.count, request.tolerance, progress, |share| {
        0.3 + 0.7 * share
    })
}

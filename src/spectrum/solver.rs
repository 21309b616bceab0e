//! Chooses a solver, runs it, checks what it found.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::block::Block;
use super::certificates::{self, Certificates, MissedCheck};
use super::cholesky::{Cholesky, Symbolic};
use super::general::GeneralPairs;
use super::lobpcg::Preconditioner;
use super::order::nested_dissection;
use super::shift_invert::{Nearest, Shifted, rayleigh_ritz, ritz_vectors};
use super::slicing::{self, Weyl};
use super::{Eigenpairs, Problem, SpectrumError, dense, direct, invariant, iterative};
use crate::operator::{Sparse, Structure};
use crate::progress::{Phase, Progress};

/// Problems of at most this many points are solved densely.
const DENSE_POINTS: usize = 500;

/// Larger shares `k/n` of the spectrum than this are solved densely.
const DENSE_SHARE: f64 = 0.2;

/// Largest order that is solved densely: 8 n² bytes thrice and 10 n³ operations.
pub const DENSE_POINTS_MAX: usize = 5_000;

/// The same for operators without symmetry, which take 25 n³ operations.
pub const DENSE_POINTS_MAX_GENERAL: usize = 1_500;

/// Entries of the factor, per row and in all (1.6 GB in single precision), up to which a wide operator is factored too.
const DIRECT_ENTRIES_PER_ROW: usize = 600;
const DIRECT_ENTRIES: usize = 400_000_000;

/// Guard vectors of LOBPCG: at least so many, and this share of the wanted.
pub(super) const GUARD_MIN: usize = 12;
pub(super) const GUARD_SHARE: f64 = 0.2;

/// Residual of the narrow operator's eigenvectors that LOBPCG starts from; its own first step is coarser.
const START_TOLERANCE: f64 = 1e-2;

/// How eigenpairs were computed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Method {
    /// All eigenpairs of the dense matrix.
    Dense,
    /// Block Lanczos on the inverse of the shifted operator.
    ShiftInvert,
    /// Block Lanczos on the inverse of the shifted operator, made of a polynomial in the operator and the factor of the
    /// finite-volume operator.
    Polynomial,
    /// LOBPCG preconditioned by the finite-volume operator's factor.
    Lobpcg,
    /// The same iteration with a Schur form, for operators that are not symmetric or not definite.
    InvariantSubspace,
}

/// What a solve needs beside the problem.
pub struct Request<'a, P> {
    /// Number of eigenpairs, zero modes included, at most n.
    pub count: usize,
    /// Largest relative residual.
    pub tolerance: f64,
    /// Position of a point, for the elimination order.
    pub position: P,
    /// `B^-½ S B^-½` of a narrow operator on the same points and masses, for kernel operators.
    pub narrow: Option<&'a Sparse>,
    /// Where the eigenvalues are expected; absent where nothing is known of them.
    pub weyl: Option<Weyl>,
    /// `1/μ` at the upper end of the spectrum of operators with long rows: t of a heat kernel.
    pub plateau: Option<f64>,
    /// Whether μ beyond a share of `1/plateau` says nothing about λ.
    pub saturates: bool,
}

/// Eigenpairs with their certificates.
pub struct Solution {
    /// The pairs.
    pub pairs: Eigenpairs,
    /// Their residuals.
    pub residuals: Vec<f64>,
    /// The checks.
    pub certificates: Certificates,
    /// How they were computed.
    pub method: Method,
}

/// Whether `count` pairs of a semi-definite problem of `n` points are computed from the dense matrix.
#[must_use]
pub fn is_dense(n: usize, count: usize) -> bool {
    n <= DENSE_POINTS || (count as f64 > DENSE_SHARE * n as f64 && n <= DENSE_POINTS_MAX)
}

/// The smallest eigenpairs of a problem.
///
/// # Errors
/// [`SpectrumError`].
pub fn solve<'a, P: Fn(u32) -> &'a [f64]>(
    problem: &Problem,
    request: &Request<'_, P>,
    progress: &Progress,
) -> Result<Solution, SpectrumError> {
    let (n, count) = (problem.size(), request.count);
    if problem.structure != Structure::SemiDefinite {
        return general_solve(problem, request, progress);
    }
    if is_dense(n, count) {
        progress.enter(Phase::Eigenpairs)?;
        let pairs = dense::solve(problem, count)?;
        progress.enter(Phase::Certificates)?;
        return certified(problem, pairs, request, Method::Dense, (Some(0), MissedCheck::Dense), progress);
    }
    progress.enter(Phase::Factorization)?;
    let zeros = problem.zero_modes().min(count);
    if zeros == count {
        let pairs = with_null_space(problem, None, count);
        progress.enter(Phase::Certificates)?;
        // the null space is the smallest there is
        let missed = (Some(0), MissedCheck::Inertia);
        return certified(problem, pairs, request, Method::ShiftInvert, missed, progress);
    }
    let direct = match request.narrow {
        None => Some(analyze(&problem.matrix, request, progress)?),
        Some(_) if problem.matrix.nonzeros() / n > 200 => None,
        Some(_) => {
            // slices take factors in double precision
            let most = if count > slicing::SLICE { DIRECT_ENTRIES / 2 } else { DIRECT_ENTRIES };
            Some(analyze(&problem.matrix, request, progress)?)
                .filter(|s| s.factor_entries() <= most.min(n * DIRECT_ENTRIES_PER_ROW))
        }
    };
    match (direct, request.narrow) {
        (Some(symbolic), _) => direct::solve(problem, &symbolic, request, progress),
        (None, Some(narrow)) => iterative::solve(problem, narrow, request, progress),
        (None, None) => Err(SpectrumError::Factorization("the operator has no narrow companion".into())),
    }
}

pub(super) fn analyze<'a, P: Fn(u32) -> &'a [f64]>(
    matrix: &Sparse,
    request: &Request<'_, P>,
    progress: &Progress,
) -> Result<Symbolic, SpectrumError> {
    let order = nested_dissection(matrix, &request.position);
    progress.checkpoint()?;
    let symbolic = Symbolic::analyze(matrix, order, progress)?;
    progress.checkpoint()?;
    Ok(symbolic)
}

/// Eigenpairs of an operator that is not symmetric, or symmetric but not definite.
fn general_solve<'a, P: Fn(u32) -> &'a [f64]>(
    problem: &Problem,
    request: &Request<'_, P>,
    progress: &Progress,
) -> Result<Solution, SpectrumError> {
    let (n, count) = (problem.size(), request.count);
    let dense = n <= DENSE_POINTS || count as f64 > DENSE_SHARE * n as f64;
    // a conjugate pair must not be cut before its residual is known
    let (found, vectors, method) = if dense {
        progress.enter(Phase::Eigenpairs)?;
        let (found, vectors) = dense::solve_general(problem, count)?;
        (found, vectors, Method::Dense)
    } else {
        let (found, vectors) = general_iteration(problem, request, progress)?;
        (found, vectors, Method::InvariantSubspace)
    };
    progress.enter(Phase::Certificates)?;
    let GeneralPairs { real: values, imaginary, .. } = found;
    let mut pairs = Eigenpairs { values, imaginary, vectors };
    pairs.normalize();
    let checked = if dense { (Some(0), MissedCheck::Dense) } else { (None, MissedCheck::None) };
    let mut solution = certified(problem, pairs, request, method, checked, progress)?;
    solution.pairs.truncate(count);
    solution.residuals.truncate(count);
    Ok(solution)
}

fn general_iteration<'a, P: Fn(u32) -> &'a [f64]>(
    problem: &Problem,
    request: &Request<'_, P>,
    progress: &Progress,
) -> Result<(GeneralPairs, Block), SpectrumError> {
    let Some(narrow) = request.narrow else {
        return Err(SpectrumError::Factorization("the operator has no narrow companion".into()));
    };
    progress.enter(Phase::Factorization)?;
    let symbolic = analyze(narrow, request, progress)?;
    progress.advance(0.5)?;
    let factor = symbolic.factor(narrow, problem.shift, progress)?;
    progress.enter(Phase::Eigenpairs)?;
    let zeros = problem.zero_modes();
    let guard = GUARD_MIN.max((GUARD_SHARE * request.count as f64) as usize);
    let narrow_start = narrow_vectors(problem, narrow, &factor, request.count + guard, progress)?;
    let mut start = Block::zeros(problem.size(), zeros + narrow_start.columns());
    problem.write_null_vectors(&mut start, zeros);
    start.copy_columns(zeros, &narrow_start, 0, narrow_start.columns());
    drop(narrow_start);
    let preconditioner = Preconditioner { factor: &factor, t: request.plateau.unwrap_or(0.0) };
    invariant::solve(problem, &preconditioner, start, request.count, request.tolerance, progress, |share| {
        0.3 + 0.7 * share
    })
}

/// Eigenvectors of the narrow operator, roughly: the start of the wide one's iteration.
pub(super) fn narrow_vectors(
    problem: &Problem,
    narrow: &Sparse,
    factor: &Cholesky<'_>,
    count: usize,
    progress: &Progress,
) -> Result<Block, SpectrumError> {
    let narrow = problem.with_matrix(narrow.clone());
    let none = Block::zeros(narrow.size(), 0);
    // rough solutions are good enough, and so are residuals of vectors that the two operators' null spaces keep apart
    let shifted = Shifted { inverse: factor, shift: -factor.shift() };
    let nearest = Nearest { below: 0, above: count };
    let share = |share| 0.3 * share;
    let vectors = ritz_vectors(&narrow, shifted, &none, nearest, START_TOLERANCE, progress, share)?;
    Ok(rayleigh_ritz(&narrow, vectors, progress)?.vectors)
}

/// Null vectors first, then the pairs found beside them.
pub(super) fn with_null_space(problem: &Problem, found: Option<&Eigenpairs>, count: usize) -> Eigenpairs {
    let zeros = problem.zero_modes().min(count);
    let mut vectors = Block::zeros(problem.size(), count);
    problem.write_null_vectors(&mut vectors, zeros);
    let mut values = vec![0.0; zeros];
    if let Some(found) = found {
        vectors.copy_columns(zeros, &found.vectors, 0, count - zeros);
        values.extend_from_slice(&found.values[..count - zeros]);
    }
    Eigenpairs::real(values, vectors)
}

pub(super) fn certified<P>(
    problem: &Problem,
    pairs: Eigenpairs,
    request: &Request<'_, P>,
    method: Method,
    (missed, missed_check): (Option<usize>, MissedCheck),
    progress: &Progress,
) -> Result<Solution, SpectrumError> {
    let residuals = certificates::residuals(problem, &pairs, progress)?;
    progress.checkpoint()?;
    let certificates = Certificates {
        orthogonality: certificates::orthogonality(&pairs),
        residual: residuals.iter().copied().fold(0.0, f64::max),
        zero_modes: match problem.structure {
            Structure::SemiDefinite => problem.zero_modes().min(request.count),
            _ => pairs.values.iter().filter(|value| value.abs() <= request.tolerance * problem.shift).count(),
        },
        missed,
        missed_check,
        saturation: request
            .plateau
            .filter(|_| request.saturates)
            .map(|t| t * pairs.values.last().copied().unwrap_or(0.0)),
    };
    Ok(Solution { pairs, residuals, certificates, method })
}

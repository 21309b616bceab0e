//! Many points: eigenvectors of a thinned sample of the surface, brought to all points and corrected there.
//!
//! Multilevel correction (Lin and Xie 2015; HSIM of Nasikun and Hildebrandt 2022) with the finite volumes of the thinned
//! samples themselves in the place of Galerkin's operators. A vector takes four to five solutions in single precision on the
//! finest level; a Krylov space takes nearly four and orthogonalizes all of its vectors. Here that is one Rayleigh–Ritz step
//! in double precision.
//!
//! What decides about the vectors that a coarse level gives is its operator (60,000 points, coarse 6,800): Galerkin's with
//! linear weights leaves vectors that one inverse iteration takes to a sine of 0.013, the finite volumes of the coarse
//! points themselves 0.003; quadratic weights leave residuals of 0.4 in the place of 12.

mod ascent;
mod correction;
mod level;
pub(super) mod prolonged;
mod roots;
#[cfg(test)]
mod tests;
mod two_grid;
mod weights;

use ascent::{Ascent, Start};
use level::{Level, coarser};

use super::certificates::MissedCheck;
use super::dual;
use super::factor::Symbolic;
use super::probe::{Probe, Towards};
use super::shifted_system::ByFactor;
use super::solution::{Method, Request, Solution, certified_by, with_null_space};
use super::vectors::block::Block;
use super::{Eigenpairs, Problem, SpectrumError, direct, shift_invert};
use crate::operator::Sparse;
use crate::progress::{Phase, Progress};

/// Guards beside the wanted vectors: at least so many, and this share of the wanted, rounded up to whole groups of 32. They
/// keep what is next to the last wanted vectors out of them.
const GUARD_MIN: usize = 28;
const GUARD_SHARE: f64 = 0.5;
const ROUNDED: usize = 32;

/// Fewest points of the coarsest level, as a multiple of the vectors, and about how many points one of a coarser level
/// stands for.
const POINTS_PER_VECTOR: usize = 12;
const THINNED_BY: usize = 9;

/// Shift of the factors as a share of the last wanted eigenvalue.
const SHIFT_SHARE: f64 = 0.2;

/// Residual of the vectors of the coarsest level.
const COARSEST_TOLERANCE: f64 = 1e-3;

/// Steps in single precision of the vectors that are far from the guards, of those next to them and of the guards: on the
/// finest level, and on the levels between.
const STEPS: [usize; 3] = [1, 2, 0];
const STEPS_BETWEEN: [usize; 3] = [2, 2, 2];

/// Points, and entries of a row, up to which a wide operator is factored itself. Of more points its narrow companion's factor
/// is the faster one: the prototype's corrections of 250,000 took 6.5 CPU seconds with it and 7.8 with their own.
const OWN_FACTOR_POINTS: usize = 200_000;
const OWN_FACTOR_NONZEROS_PER_ROW: usize = 80;

/// Least tolerance that corrections by single precision are made for.
const TOLERANCE_MIN: f64 = 1e-5;

/// Most vectors: beyond, Rayleigh–Ritz takes longer than slices.
const WANTED_MAX: usize = 300;

/// Least relative gap, and its least ratio to the rounding of factors in single precision, in which eigenvalues are counted.
const GAP_MIN: f64 = 2e-3;
const GAP_OVER_ROUNDING: f64 = 10.0;

/// The smallest eigenpairs; none where coarse levels do not help.
///
/// # Errors
/// [`SpectrumError`].
pub(super) fn solve<'a, P: Fn(u32) -> &'a [f64] + Sync>(
    problem: &Problem,
    request: &Request<'_, P>,
    progress: &Progress,
) -> Result<Option<Solution>, SpectrumError> {
    let n = problem.size();
    let is_worth_it = n <= OWN_FACTOR_POINTS && problem.matrix.nonzeros() <= OWN_FACTOR_NONZEROS_PER_ROW * n;
    by_factor(problem, request, request.narrow.is_none() || is_worth_it, progress)
}

/// The same by a factor of the operator's `own` matrix, or else of its narrow companion's.
fn by_factor<'a, P: Fn(u32) -> &'a [f64] + Sync>(
    problem: &Problem,
    request: &Request<'_, P>,
    own: bool,
    progress: &Progress,
) -> Result<Option<Solution>, SpectrumError> {
    let zeros = problem.zero_modes();
    let Some(weyl) = request.weyl.filter(|weyl| weyl.dimension == 2) else { return Ok(None) };
    if request.count <= zeros || request.tolerance < TOLERANCE_MIN || (request.position)(0).len() != 3 {
        return Ok(None);
    }
    let wanted = request.count - zeros;
    let vectors = wanted + GUARD_MIN.max((GUARD_SHARE * wanted as f64) as usize);
    let vectors = vectors.next_multiple_of(ROUNDED);
    if wanted > WANTED_MAX || problem.size() < POINTS_PER_VECTOR * THINNED_BY * vectors {
        return Ok(None);
    }
    let narrow = request.narrow.unwrap_or(&problem.matrix);
    let to_factor = if own { &problem.matrix } else { narrow };
    let (levels, symbolic) = rayon::join(
        || levels(problem, narrow, &request.position, vectors, weyl.first, progress),
        || Symbolic::by_position(to_factor, &request.position, progress),
    );
    let (levels, symbolic) = (levels?, symbolic?);
    let Some(nearest) = levels.first() else { return Ok(None) };
    progress.enter(Phase::Eigenpairs)?;
    let Some(coarse) = coarse_pairs(&levels, vectors, wanted, progress)? else { return Ok(None) };
    let start = Start::of(nearest, &coarse, weyl.t);
    drop(coarse);
    progress.advance(0.2)?;
    let shift = SHIFT_SHARE * start.values[wanted - 1];
    let Some(factor) = symbolic.factor_roughly(to_factor, shift, progress)? else { return Ok(None) };
    progress.advance(0.3)?;
    let Some(mut ascent) = Ascent::new(problem, &factor, !own, wanted, progress)? else { return Ok(None) };
    let first = ascent.pairs(&start, STEPS, 1, |share| 0.3 + 0.5 * share, progress);
    drop(start);
    let Some((mut pairs, measured)) = ascent.corrected(first, request.tolerance, progress)? else {
        return Ok(None);
    };
    drop(ascent);
    progress.enter(Phase::Certificates)?;
    let dual = {
        let mut inverse = ByFactor::new(&factor, !own);
        let values = &pairs.values[..request.count];
        dual::bounds(problem, values, &pairs.vectors, Some(&mut inverse), progress)?.bounds
    };
    let missed = if request.narrow.is_none() {
        // the count has a factor of its own
        drop(factor);
        missed_by_inertia(problem, &symbolic, &pairs.values, request.count, progress)?
    } else {
        pairs.vectors.set_columns(request.count);
        let probe = Probe::beside(problem, &Towards::Inverse(&factor), &pairs.vectors, progress)?;
        (Some(probe.below(pairs.values[request.count - 1])), MissedCheck::Probe)
    };
    if missed.0 != Some(0) {
        return Ok(None);
    }
    pairs.truncate(request.count);
    Ok(Some(certified_by(problem, pairs, (measured, Some(dual)), request, Method::CoarseToFine, missed)))
}

/// Coarser and coarser levels, the finest first; none where the points do not make up a surface.
fn levels<'a>(
    problem: &Problem,
    graph: &Sparse,
    position: &(impl Fn(u32) -> &'a [f64] + Sync),
    vectors: usize,
    first_eigenvalue: f64,
    progress: &Progress,
) -> Result<Vec<Level>, SpectrumError> {
    let mut levels: Vec<Level> = Vec::new();
    loop {
        let size = levels.last().map_or(problem.size(), |level| level.problem.size());
        if size < POINTS_PER_VECTOR * THINNED_BY * vectors {
            return Ok(levels);
        }
        let next = match levels.last() {
            None => coarser(problem, graph, position, first_eigenvalue, progress)?,
            Some(Level { problem, positions, .. }) => {
                let at = |i: u32| &positions[i as usize][..];
                coarser(problem, &problem.matrix, at, first_eigenvalue, progress)?
            }
        };
        match next {
            Some(next) if next.problem.size() <= size / 4 => levels.push(next),
            _ => return Ok(levels),
        }
    }
}

/// The null vectors and `vectors` others of the finest of the coarse levels; none where a level cannot be solved.
fn coarse_pairs(
    levels: &[Level],
    vectors: usize,
    wanted: usize,
    progress: &Progress,
) -> Result<Option<Eigenpairs>, SpectrumError> {
    let Some(coarsest) = levels.last() else { return Ok(None) };
    let mut pairs = {
        let problem = &coarsest.problem;
        let symbolic = symbolic_of(coarsest, progress)?;
        let factor = symbolic.factor(&problem.matrix, problem.shift, progress)?;
        let none = Block::zeros(problem.size(), 0);
        let share = |share| 0.1 * share;
        match shift_invert::solve(problem, &factor, &none, vectors, COARSEST_TOLERANCE, progress, share) {
            Ok(found) => with_null_space(problem, Some(&found), problem.zero_modes() + vectors),
            Err(SpectrumError::NotConverged { .. }) => return Ok(None),
            Err(error) => return Err(error),
        }
    };
    for pair in levels.windows(2).rev() {
        let (level, coarser) = (&pair[0], &pair[1]);
        let start = Start::of(coarser, &pairs, None);
        drop(pairs);
        let symbolic = symbolic_of(level, progress)?;
        let shift = SHIFT_SHARE * start.values[wanted - 1];
        let Some(factor) = symbolic.factor_roughly(&level.problem.matrix, shift, progress)? else {
            return Ok(None);
        };
        let Some(mut ascent) = Ascent::new(&level.problem, &factor, false, wanted, progress)? else {
            return Ok(None);
        };
        let share = |share| 0.1 + 0.1 * share;
        pairs = match ascent.pairs(&start, STEPS_BETWEEN, 0, share, progress) {
            Ok(pairs) => pairs,
            Err(SpectrumError::Dense { .. }) => return Ok(None),
            Err(error) => return Err(error),
        };
    }
    Ok(Some(pairs))
}

fn symbolic_of(level: &Level, progress: &Progress) -> Result<Symbolic, SpectrumError> {
    let at = |i: u32| &level.positions[i as usize][..];
    Ok(Symbolic::by_position(&level.problem.matrix, at, progress)?)
}

/// Counts the eigenvalues below the first wide gap behind the wanted ones, in single precision where the gap is wider than
/// its rounding; what does not agree is counted again in double.
fn missed_by_inertia(
    problem: &Problem,
    symbolic: &Symbolic,
    values: &[f64],
    count: usize,
    progress: &Progress,
) -> Result<(Option<usize>, MissedCheck), SpectrumError> {
    let matrix = &problem.matrix;
    // the largest eigenvalue is below twice the largest entry of a matrix whose diagonal dominates
    let largest = 2.0 * matrix.values().iter().copied().fold(0.0, f64::max);
    let rounding = f64::from(f32::EPSILON) * largest;
    let is_wide = |pair: &[f64]| pair[1] - pair[0] > (GAP_MIN * pair[1]).max(GAP_OVER_ROUNDING * rounding);
    let gap = values[count - 1..].windows(2).position(is_wide);
    if let Some(behind) = gap {
        let expected = count + behind;
        let bound = 0.5 * (values[expected - 1] + values[expected]);
        if symbolic.eigenvalues_roughly_below(matrix, bound, progress)? == Some(expected) {
            return Ok((Some(0), MissedCheck::Inertia));
        }
    }
    let zeros = problem.zero_modes();
    direct::missed_by_inertia(problem, symbolic, &values[zeros..values.len().min(count + 1)], progress)
}

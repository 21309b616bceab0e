//! Block Lanczos on `(A − sI)⁻¹` with full reorthogonalization and thick restarts, for operators that can be factored.
//!
//! Blocks find the multiplicities that single vectors miss; the null space is known and kept out of the iteration.

use faer::Mat;

use super::factor::Cholesky;
use super::inverse::{BLOCK, Nearest, Shifted};
use super::krylov::{Complement, Krylov, Ritz, expand, finish, fresh_block, restart};
use super::polish::polished;
use super::vectors::block::Block;
use super::vectors::scalar::Scalar;
use super::{Eigenpairs, Problem, SpectrumError};
use crate::progress::Progress;

/// Restarts before giving up.
const RESTARTS_MAX: usize = 60;

/// Blocks of room beside twice the pairs wanted around a shift inside of the spectrum. From the middle of evenly spaced
/// eigenvalues 50 take 192 vectors and 100 take 272; with room for these only, slices of double eigenvalues failed.
const ROOM_BLOCKS: usize = 6;

/// Blocks of room beside twice the pairs wanted from the end of the spectrum: 100 take about 370 vectors in all, of which
/// a restart needs fewer at a time. In single precision there is room for all of them.
const ROOM_BLOCKS_AT_END: usize = 6;
const ROOM_BLOCKS_AT_END_SINGLE: usize = 12;

/// Estimated residuals that are good enough, as a share of the tolerance: the last inverse iteration improves on them.
const FINISHED: f64 = 0.5;

/// Vectors of a Krylov space that is searched for `count` pairs around a shift inside of the spectrum, the next block
/// included.
#[must_use]
pub fn krylov_vectors(count: usize) -> usize {
    (2 * count + ROOM_BLOCKS * BLOCK).max(count + 11 * BLOCK) + BLOCK
}

/// The same of pairs at the end of the spectrum, of vectors in single precision or double.
#[must_use]
pub fn krylov_vectors_at_end(count: usize, single: bool) -> usize {
    let blocks = if single { ROOM_BLOCKS_AT_END_SINGLE } else { ROOM_BLOCKS_AT_END };
    2 * count + (blocks + 1) * BLOCK
}

/// The `count` smallest non-zero eigenpairs to a relative residual of `tolerance`, among those orthogonal to the
/// eigenvectors `beside`, from a factor of `A + sI`, s > 0.
///
/// `share` maps the iteration's own share of the work to progress.
///
/// # Errors
/// [`SpectrumError::NotConverged`], [`SpectrumError::Canceled`].
pub fn solve(
    problem: &Problem,
    factor: &Cholesky<'_>,
    beside: &Block,
    count: usize,
    tolerance: f64,
    progress: &Progress,
    share: impl Fn(f64) -> f64,
) -> Result<Eigenpairs, SpectrumError> {
    let shifted = Shifted { inverse: factor, shift: -factor.shift() };
    let nearest = Nearest { below: 0, above: count };
    let vectors = ritz_vectors(problem, shifted, beside, nearest, tolerance, progress, share)?;
    polished(problem, factor, beside, vectors, tolerance, progress)
}

/// Vectors that span the eigenvectors of the non-zero eigenvalues nearest to the shift, each with a relative residual
/// of at most `tolerance`: not orthonormal, in no order.
///
/// # Errors
/// [`SpectrumError::NotConverged`], [`SpectrumError::Canceled`].
pub fn ritz_vectors(
    problem: &Problem,
    shifted: Shifted<'_>,
    beside: &Block,
    nearest: Nearest,
    tolerance: f64,
    progress: &Progress,
    share: impl Fn(f64) -> f64,
) -> Result<Block, SpectrumError> {
    if shifted.inverse.is_single() {
        iterated::<f32>(problem, shifted, beside, nearest, tolerance, progress, share)
    } else {
        iterated::<f64>(problem, shifted, beside, nearest, tolerance, progress, share)
    }
}

/// The same with a Krylov space that is kept in the precision `V`.
fn iterated<V: Scalar>(
    problem: &Problem,
    shifted: Shifted<'_>,
    beside: &Block,
    nearest: Nearest,
    tolerance: f64,
    progress: &Progress,
    share: impl Fn(f64) -> f64,
) -> Result<Block, SpectrumError> {
    let (n, count) = (problem.size(), nearest.count());
    let complement = Complement { problem, beside };
    let at_end = nearest.below == 0;
    let vectors = if at_end {
        krylov_vectors_at_end(count, shifted.inverse.is_single())
    } else {
        krylov_vectors(count)
    };
    let room = (vectors - BLOCK).min(complement.dimension());
    let mut krylov = Krylov {
        basis: Block::<V>::zeros(n, room + BLOCK),
        processed: 0,
        projected: Mat::zeros(room + BLOCK, room + BLOCK),
        rest: Mat::zeros(0, 0),
        last: 0..0,
    };
    let mut work = Block::zeros(n, BLOCK);
    let mut hashed = 0;
    fresh_block(&complement, &mut krylov, &mut work, &mut hashed, progress)?;
    let mut worst = f64::INFINITY;
    let steps_expected = room.div_ceil(BLOCK) as f64;
    let mut steps = 0;
    for _ in 0..RESTARTS_MAX {
        while krylov.processed + BLOCK <= room || krylov.processed < count {
            progress.advance(share(1.0 - (-(f64::from(steps)) / steps_expected).exp()))?;
            steps += 1;
            expand(&complement, shifted.inverse, &mut krylov, &mut work, progress)?;
            if krylov.rest.nrows() == 0 {
                // an invariant space: whatever else there is needs a new direction
                if krylov.processed >= complement.dimension() {
                    return finish(&complement, krylov, nearest, progress);
                }
                fresh_block(&complement, &mut krylov, &mut work, &mut hashed, progress)?;
            }
            // a look at the Ritz values costs a part of a step; with fewer vectors they have never been good enough
            let due = krylov.processed >= count + count / 2 + 2 * BLOCK || krylov.processed + BLOCK > room;
            if due && krylov.processed >= count {
                let ritz = Ritz::of(&krylov)?;
                worst = ritz.worst_residual(&krylov, nearest, shifted.shift, problem.shift);
                if worst <= FINISHED * tolerance {
                    return finish(&complement, krylov, nearest, progress);
                }
            }
        }
        restart(&mut krylov, nearest, progress)?;
    }
    Err(SpectrumError::NotConverged { reached: worst, tolerance, iterations: steps as usize })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::spectrum::factor::Symbolic;
    use crate::spectrum::grid::{grid, grid_eigenvalues};

    #[test]
    fn a_grids_double_eigenvalues_are_all_found() {
        let side = 40;
        let problem = grid(side);
        let order: Vec<u32> = (0..(side * side) as u32).collect();
        let symbolic = Symbolic::analyze(&problem.matrix, order, &Progress::new()).unwrap();
        let factor = symbolic.factor_double(&problem.matrix, problem.shift, &Progress::new()).unwrap();
        let none = Block::zeros(problem.size(), 0);
        let pairs = solve(&problem, &factor, &none, 40, 1e-8, &Progress::new(), |share| share).unwrap();
        let exact = grid_eigenvalues(side);
        for (found, exact) in pairs.values.iter().zip(&exact[1..]) {
            assert!((found - exact).abs() < 1e-9 * exact, "{found} {exact}");
        }
        assert_eq!(
            symbolic
                .eigenvalues_below(&problem.matrix, 0.5 * (exact[40] + exact[41]), &Progress::new())
                .unwrap(),
            Some(41)
        );
    }
}

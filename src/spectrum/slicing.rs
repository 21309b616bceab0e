//! Many eigenpairs in slices of the spectrum, each from a shift in its middle: Krylov spaces stay small, and the signs
//! of every factor's pivots tell which eigenvalues its slice has to find (Grimes, Lewis and Simon 1994).

use super::certificates;
use super::factor::{Cholesky, Symbolic};
use super::inverse::{Nearest, Shifted};
use super::ritz::rayleigh_ritz;
use super::shift_invert::{krylov_vectors, krylov_vectors_at_end, ritz_vectors};
use super::vectors::block::Block;
use super::weyl::Weyl;
use super::{Eigenpairs, Problem, SpectrumError};
use crate::progress::Progress;

/// Most pairs of a slice: fewer make more factorizations, more make larger Krylov spaces.
pub const SLICE: usize = 120;

/// Pairs from which on the spectrum is solved in slices.
pub const SLICED_FROM: usize = 24;

/// Corrections of the guess where an eigenvalue lies, before slicing is given up.
const GUESSES: usize = 4;

/// How far from the middle of its slice a shift may be, as a share of the slice.
const MIDDLE: std::ops::RangeInclusive<f64> = 0.25..=0.75;

/// Vectors that are held at once for `count` pairs: the other slices' and a Krylov space, at the end all twice.
#[must_use]
pub fn vectors_held(count: usize) -> usize {
    if count < SLICED_FROM {
        return krylov_vectors_at_end(count, false);
    }
    let slice = count.div_ceil(count.div_ceil(SLICE).max(1));
    (count - slice + krylov_vectors(slice)).max(2 * count)
}

/// A factor, and how many non-zero eigenvalues are below its shift.
struct Cut<'a> {
    shift: f64,
    factor: Cholesky<'a>,
    below: usize,
}

/// The `count` smallest non-zero eigenpairs to a relative residual of `tolerance`, and the factor of the last slice; none
/// where the spectrum is not as expected, or a slice did not find what was counted.
///
/// # Errors
/// [`SpectrumError::Factorization`], [`SpectrumError::Canceled`].
pub fn solve<'a>(
    problem: &'a Problem,
    symbolic: &'a Symbolic,
    mut weyl: Weyl,
    count: usize,
    tolerance: f64,
    progress: &Progress,
) -> Result<Option<(Eigenpairs, Cholesky<'a>)>, SpectrumError> {
    let none = Block::zeros(problem.size(), 0);
    let mut found: Vec<Block> = Vec::new();
    let mut last = None;
    let mut start = 0;
    while start < count {
        // one factor at a time
        drop(last.take());
        let slices = (count - start).div_ceil(SLICE);
        let width = (count - start) as f64 / slices as f64;
        let Some(cut) = cut(problem, symbolic, &mut weyl, start, width, progress)? else {
            return Ok(None);
        };
        // as many above the shift as below
        let end = if slices == 1 { count.max(cut.below) } else { 2 * cut.below - start };
        let nearest = Nearest { below: cut.below - start, above: end - cut.below };
        let shifted = Shifted { inverse: &cut.factor, shift: cut.shift };
        let share = |part: f64| (start as f64 + part * (end - start) as f64) / end.max(count) as f64;
        match ritz_vectors(problem, shifted, &none, nearest, tolerance, progress, share) {
            Ok(vectors) => found.push(vectors),
            Err(SpectrumError::NotConverged { .. }) => return Ok(None),
            Err(error) => return Err(error),
        }
        last = Some(cut.factor);
        start = end;
    }
    let mut pairs = rayleigh_ritz(problem, side_by_side(problem.size(), found), progress)?;
    if pairs.values.len() < count {
        return Ok(None);
    }
    pairs.truncate(count);
    // slices that overlap because one of them missed a pair leave a vector that is none
    let converged = certificates::residuals(problem, &pairs, progress)?.iter().all(|r| *r <= tolerance);
    Ok(last.filter(|_| converged).map(|factor| (pairs, factor)))
}

fn side_by_side(rows: usize, mut blocks: Vec<Block>) -> Block {
    if blocks.len() == 1
        && let Some(only) = blocks.pop()
    {
        return only;
    }
    let mut all = Block::zeros(rows, blocks.iter().map(Block::columns).sum());
    let mut to = 0;
    for block in blocks {
        all.copy_columns(to, &block, 0, block.columns());
        to += block.columns();
    }
    all
}

/// A factor about in the middle of the slice of `width` eigenvalues from number `start` on; none when it cannot be found.
fn cut<'a>(
    problem: &'a Problem,
    symbolic: &'a Symbolic,
    weyl: &mut Weyl,
    start: usize,
    width: f64,
    progress: &Progress,
) -> Result<Option<Cut<'a>>, SpectrumError> {
    for _ in 0..GUESSES {
        progress.checkpoint()?;
        let shift = weyl.eigenvalue(start as f64 + 0.5 * width);
        if let Some(factor) = symbolic.factor_indefinite(&problem.matrix, -shift, progress)? {
            let below = factor.negative_eigenvalues().saturating_sub(problem.zero_modes());
            *weyl = weyl.through(shift, below);
            if MIDDLE.contains(&((below as f64 - start as f64) / width)) {
                return Ok(Some(Cut { shift, factor, below }));
            }
        } else {
            // a shift on an eigenvalue: any other will do
            weyl.first *= 1.01;
        }
    }
    Ok(None)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::spectrum::grid::{grid, grid_eigenvalues};
    use crate::spectrum::vectors::block::gram;

    fn solved(side: usize, count: usize, first: f64) -> Option<Eigenpairs> {
        let problem = grid(side);
        let order: Vec<u32> = (0..(side * side) as u32).collect();
        let symbolic = Symbolic::analyze(&problem.matrix, order, &Progress::new()).unwrap();
        let weyl = Weyl { first, dimension: 2, t: None };
        let solved = solve(&problem, &symbolic, weyl, count, 1e-7, &Progress::new()).unwrap();
        solved.map(|(pairs, _)| pairs)
    }

    /// Double eigenvalues, some of them where one slice ends and the next begins.
    #[test]
    fn slices_join_to_the_whole_spectrum() {
        let (side, count) = (60, 400);
        let weyl = 4.0 * std::f64::consts::PI / (side * side) as f64;
        // a law that is wrong by half is corrected by what is counted
        for first in [weyl, 1.5 * weyl, 0.5 * weyl] {
            let pairs = solved(side, count, first).unwrap();
            let exact = grid_eigenvalues(side);
            assert_eq!(pairs.values.len(), count);
            for (found, exact) in pairs.values.iter().zip(&exact[1..]) {
                assert!((found - exact).abs() < 1e-9 * exact, "{found} {exact}");
            }
            let defect = gram(&pairs.vectors, &pairs.vectors) - faer::Mat::<f64>::identity(count, count);
            assert!(defect.norm_max() < 1e-12, "{}", defect.norm_max());
        }
    }

    #[test]
    fn a_law_that_cannot_be_corrected_gives_nothing() {
        assert!(solved(30, 40, f64::NAN).is_none());
    }
}

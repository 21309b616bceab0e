//! Block Lanczos on `(A − sI)⁻¹` with full reorthogonalisation and thick restarts, for operators that can be factored.
//!
//! Blocks find the multiplicities that single vectors miss; the null space is known and kept out of the iteration.

use faer::Mat;

use super::block::{Block, add_product, gram, replace_by_product};
use super::cholesky::Cholesky;
use super::entry::Entry;
use super::orthogonal::{eigen, orthonormalize, orthonormalize_knowing};
use super::polish::polished;
use super::sparse_product::sparse_product;
use super::{Eigenpairs, Problem, SpectrumError, start};
use crate::progress::Progress;

/// Vectors multiplied together.
pub(super) const BLOCK: usize = 16;

/// Restarts before giving up.
const RESTARTS_MAX: usize = 60;

/// Blocks of room beside twice the pairs wanted around a shift inside of the spectrum. From the middle of evenly spaced
/// eigenvalues 50 take 192 vectors and 100 take 272; with room for so many only, slices of double eigenvalues failed.
const ROOM_BLOCKS: usize = 6;

/// Blocks of room beside twice the pairs wanted from the end of the spectrum: 100 take about 370 vectors in all, of which
/// a restart needs fewer at a time. In single precision there is room for all of them.
const ROOM_BLOCKS_AT_END: usize = 6;
const ROOM_BLOCKS_AT_END_SINGLE: usize = 12;

/// Estimated residuals that are good enough, as a share of the tolerance: the last inverse iteration improves on them.
const FINISHED: f64 = 0.5;

/// The eigenvalues nearest to a shift.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Nearest {
    /// How many below it.
    pub below: usize,
    /// How many above it.
    pub above: usize,
}

impl Nearest {
    /// How many in all.
    #[must_use]
    pub fn count(self) -> usize {
        self.below + self.above
    }
}

/// `(A − sI)⁻¹`, exactly or nearly.
pub trait Inverse {
    /// `X ← (A − sI)⁻¹ X`.
    fn solve(&self, x: &mut Block);

    /// Whether solutions come in single precision: a Krylov space of them needs no more either.
    fn is_single(&self) -> bool;
}

impl Inverse for Cholesky<'_> {
    fn solve(&self, x: &mut Block) {
        Cholesky::solve(self, x);
    }

    fn is_single(&self) -> bool {
        !self.is_exact()
    }
}

/// `(A − sI)⁻¹` and its shift.
#[derive(Clone, Copy)]
pub struct Shifted<'a> {
    /// The inverse.
    pub inverse: &'a dyn Inverse,
    /// s, negative for a positive definite matrix.
    pub shift: f64,
}

/// A basis of the Krylov space and the projection of the operator onto it.
struct Krylov<V> {
    /// Orthonormal vectors: `processed` of them multiplied, then the block that is next.
    basis: Block<V>,
    processed: usize,
    /// `Vᵀ (A−sI)⁻¹ V` over the processed vectors.
    projected: Mat<f64>,
    /// What the last product had outside the basis, in terms of the next block.
    rest: Mat<f64>,
    /// Columns that the last product belongs to.
    last: std::ops::Range<usize>,
}

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
fn iterated<V: Entry>(
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
    fresh_block(&complement, &mut krylov, &mut work, &mut hashed)?;
    let mut worst = f64::INFINITY;
    let steps_expected = room.div_ceil(BLOCK) as f64;
    let mut steps = 0;
    for _ in 0..RESTARTS_MAX {
        while krylov.processed + BLOCK <= room || krylov.processed < count {
            progress.advance(share(1.0 - (-(f64::from(steps)) / steps_expected).exp()))?;
            steps += 1;
            expand(&complement, shifted.inverse, &mut krylov, &mut work)?;
            if krylov.rest.nrows() == 0 {
                // an invariant space: whatever else there is needs a new direction
                if krylov.processed >= complement.dimension() {
                    return finish(&complement, krylov, nearest);
                }
                fresh_block(&complement, &mut krylov, &mut work, &mut hashed)?;
            }
            // a look at the Ritz values costs a part of a step; with fewer vectors they have never been good enough
            let due = krylov.processed >= count + count / 2 + 2 * BLOCK || krylov.processed + BLOCK > room;
            if due && krylov.processed >= count {
                let ritz = Ritz::of(&krylov)?;
                worst = ritz.worst_residual(&krylov, nearest, shifted.shift, problem.shift);
                if worst <= FINISHED * tolerance {
                    return finish(&complement, krylov, nearest);
                }
            }
        }
        restart(&mut krylov, nearest)?;
    }
    Err(SpectrumError::NotConverged { reached: worst, tolerance, iterations: steps as usize })
}

/// Where eigenvectors are looked for: orthogonal to the null space and to those that are known.
pub(super) struct Complement<'a> {
    pub(super) problem: &'a Problem,
    pub(super) beside: &'a Block,
}

impl Complement<'_> {
    fn dimension(&self) -> usize {
        self.problem.size() - self.problem.zero_modes() - self.beside.columns()
    }

    pub(super) fn project(&self, block: &mut Block) {
        self.problem.project_out_null(block);
        if self.beside.columns() > 0 {
            let along = gram(self.beside, block);
            add_product(block, -1.0, self.beside, along.as_ref());
        }
    }
}

/// Appends a block of hashed numbers, orthogonal to everything so far.
fn fresh_block<V: Entry>(
    complement: &Complement<'_>,
    krylov: &mut Krylov<V>,
    work: &mut Block,
    hashed: &mut usize,
) -> Result<(), SpectrumError> {
    let room = complement.dimension() - krylov.processed;
    work.set_columns(BLOCK.min(room));
    start::fill(work, complement.beside.columns() + *hashed);
    *hashed += BLOCK;
    complement.project(work);
    krylov.basis.set_columns(krylov.processed);
    orthonormalize(work, &krylov.basis)?;
    append(krylov, work);
    Ok(())
}

fn append<V: Entry>(krylov: &mut Krylov<V>, work: &Block) {
    krylov.basis.set_columns(krylov.processed + work.columns());
    krylov.basis.copy_columns(krylov.processed, work, 0, work.columns());
}

/// Multiplies the next block and orthogonalises the product.
fn expand<V: Entry>(
    complement: &Complement<'_>,
    inverse: &dyn Inverse,
    krylov: &mut Krylov<V>,
    work: &mut Block,
) -> Result<(), SpectrumError> {
    let (first, end) = (krylov.processed, krylov.basis.columns());
    work.set_columns(end - first);
    work.copy_columns(0, &krylov.basis, first, end - first);
    inverse.solve(work);
    complement.project(work);
    // a Lanczos product overlaps with its own block and the one before; after a restart, with all
    let taken = orthonormalize_knowing(work, &krylov.basis, krylov.last.start)?;
    for j in first..end {
        for i in 0..end {
            krylov.projected[(i, j)] = taken.along[(i, j - first)];
            krylov.projected[(j, i)] = taken.along[(i, j - first)];
        }
    }
    krylov.last = first..end;
    krylov.processed = end;
    krylov.rest = taken.rest;
    // what rounding leaves of an exhausted space is no direction
    let scale = (0..end).map(|k| krylov.projected[(k, k)].abs()).fold(0.0, f64::max);
    if krylov.rest.norm_max() < 100.0 * V::ROUNDING * scale || end == complement.dimension() {
        krylov.rest = Mat::zeros(0, 0);
    } else {
        append(krylov, work);
    }
    Ok(())
}

/// Ritz values θ of the inverse, ascending, and the coefficients of their vectors.
struct Ritz {
    values: Vec<f64>,
    coefficients: Mat<f64>,
}

impl Ritz {
    fn of<V>(krylov: &Krylov<V>) -> Result<Self, SpectrumError> {
        let m = krylov.processed;
        let projected = krylov.projected.as_ref().submatrix(0, 0, m, m);
        let symmetric = Mat::from_fn(m, m, |i, j| 0.5 * (projected[(i, j)] + projected[(j, i)]));
        let (values, coefficients) = eigen(symmetric.as_ref())?;
        Ok(Self { values, coefficients })
    }

    /// Places of the values farthest from zero: eigenvalues `s + 1/θ` below the shift have negative θ.
    fn nearest(&self, nearest: Nearest) -> impl Iterator<Item = usize> + use<> {
        let m = self.values.len();
        (0..nearest.below.min(m)).chain(m.saturating_sub(nearest.above)..m)
    }

    /// What `(A−sI)⁻¹ y − θ y` is for some of them, in terms of the next block.
    fn outside<V>(&self, krylov: &Krylov<V>, places: &[usize]) -> Mat<f64> {
        if krylov.rest.nrows() == 0 {
            return Mat::zeros(0, places.len());
        }
        let last = &krylov.last;
        let tail =
            Mat::from_fn(last.len(), places.len(), |i, j| self.coefficients[(last.start + i, places[j])]);
        &krylov.rest * tail
    }

    /// Largest relative residual of the vectors that [`finish`] makes: `(A − λ) (A−sI)⁻¹ y = (y θ − (A−sI)⁻¹ y)/θ`, over
    /// `‖(A−sI)⁻¹ y‖ = |θ|` and `λ + σ`.
    fn worst_residual<V>(&self, krylov: &Krylov<V>, nearest: Nearest, shift: f64, sigma: f64) -> f64 {
        if krylov.rest.nrows() == 0 {
            return f64::INFINITY;
        }
        let places: Vec<usize> = self.nearest(nearest).collect();
        let outside = self.outside(krylov, &places);
        let relative = places.iter().enumerate().map(|(j, &place)| {
            let theta = self.values[place];
            outside.as_ref().col(j).norm_l2() / (theta * theta * (shift + 1.0 / theta + sigma)).abs()
        });
        relative.fold(0.0, f64::max)
    }
}

/// Keeps the best Ritz vectors, a third of the others among them, and the next block.
fn restart<V: Entry>(krylov: &mut Krylov<V>, nearest: Nearest) -> Result<(), SpectrumError> {
    let ritz = Ritz::of(krylov)?;
    let (processed, next) = (krylov.processed, krylov.basis.columns() - krylov.processed);
    let more = (processed - nearest.count()) / 3;
    let below = more * nearest.below / nearest.count();
    let kept = Nearest { below: nearest.below + below, above: nearest.above + more - below };
    let places: Vec<usize> = ritz.nearest(kept).collect();
    let keep = places.len();
    // one product moves the next block along unchanged
    let total = processed + next;
    let change = Mat::from_fn(total, keep + next, |i, j| match (i < processed, j < keep) {
        (true, true) => ritz.coefficients[(i, places[j])],
        (false, false) => f64::from(u8::from(i - processed == j - keep)),
        _ => 0.0,
    });
    replace_by_product(&mut krylov.basis, change.as_ref());
    krylov.projected.fill(0.0);
    for (k, &place) in places.iter().enumerate() {
        krylov.projected[(k, k)] = ritz.values[place];
    }
    krylov.processed = keep;
    krylov.last = 0..keep;
    Ok(())
}

/// The Ritz vectors after one more inverse iteration, which takes the fine scales out that the inverse cannot see. No
/// solve is needed: of a Ritz vector, `(A−sI)⁻¹ y` is `θ y` and what the next block holds.
fn finish<V: Entry>(
    complement: &Complement<'_>,
    mut krylov: Krylov<V>,
    nearest: Nearest,
) -> Result<Block, SpectrumError> {
    let ritz = Ritz::of(&krylov)?;
    let places: Vec<usize> = ritz.nearest(nearest).collect();
    let outside = ritz.outside(&krylov, &places);
    let processed = krylov.processed;
    let next = outside.nrows();
    krylov.basis.set_columns(processed + next);
    let change = Mat::from_fn(processed + next, places.len(), |i, j| match i.checked_sub(processed) {
        None => ritz.coefficients[(i, places[j])],
        Some(i) => outside[(i, j)] / ritz.values[places[j]],
    });
    replace_by_product(&mut krylov.basis, change.as_ref());
    let basis = krylov.basis.into_first(places.len());
    let mut vectors = Block::zeros(basis.rows(), places.len());
    vectors.copy_columns(0, &basis, 0, places.len());
    drop(basis);
    // in a space that is nearly exhausted the last blocks are short, and rounding along the null space is not
    complement.project(&mut vectors);
    Ok(vectors)
}

/// Ritz pairs of `A` in the span of `vectors`, ascending.
///
/// # Errors
/// [`SpectrumError::Dense`].
pub fn rayleigh_ritz(problem: &Problem, mut vectors: Block) -> Result<Eigenpairs, SpectrumError> {
    orthonormalize(&mut vectors, &Block::<f64>::zeros(problem.size(), 0))?;
    let mut product = Block::zeros(problem.size(), vectors.columns());
    sparse_product(&mut product, &problem.matrix, &vectors);
    let (values, coefficients) = eigen(gram(&vectors, &product).as_ref())?;
    replace_by_product(&mut vectors, coefficients.as_ref());
    Ok(Eigenpairs::real(values, vectors))
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use crate::operator::{LaplaceBeltrami, Sparse};
    use crate::spectrum::cholesky::Symbolic;

    /// The 5-point stencil on a `side × side` grid with unit masses: eigenvalues
    /// `4 sin²(πa/2m) + 4 sin²(πb/2m)`, a, b = 0 … m−1 (the tensor product of paths).
    pub(in super::super) fn grid(side: usize) -> Problem {
        let weights = |i: usize, (): &mut (), row: &mut Vec<(u32, f64)>| {
            let (x, y) = (i % side, i / side);
            let mut push = |inside: bool, j: usize| {
                if inside {
                    row.push((j as u32, 1.0));
                }
            };
            push(y > 0, i.wrapping_sub(side));
            push(x > 0, i.wrapping_sub(1));
            push(x + 1 < side, i + 1);
            push(y + 1 < side, i + side);
        };
        let stiffness =
            Sparse::stiffness(side * side, || (), weights, |_| Ok::<_, std::convert::Infallible>(()))
                .unwrap();
        Problem::new(
            LaplaceBeltrami::narrow(stiffness, vec![1.0; side * side]),
            4.0 * std::f64::consts::PI / (side * side) as f64,
        )
    }

    /// Its eigenvalues, ascending.
    pub(in super::super) fn grid_eigenvalues(side: usize) -> Vec<f64> {
        let path = |a: usize| 4.0 * (std::f64::consts::PI * a as f64 / (2.0 * side as f64)).sin().powi(2);
        let mut exact: Vec<f64> = (0..side).flat_map(|a| (0..side).map(move |b| path(a) + path(b))).collect();
        exact.sort_by(f64::total_cmp);
        exact
    }

    #[test]
    fn a_grids_double_eigenvalues_are_all_found() {
        let side = 40;
        let problem = grid(side);
        let order: Vec<u32> = (0..(side * side) as u32).collect();
        let symbolic = Symbolic::analyze(&problem.matrix, order).unwrap();
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

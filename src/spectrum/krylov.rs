//! The Krylov space that block Lanczos iterates in: its growth, the Ritz values in it, thick restarts (Wu and Simon
//! 2000), and the vectors that come of it.

use faer::Mat;

use super::inverse::{BLOCK, Inverse, Nearest};
use super::orthogonal::{eigen, orthonormalize, orthonormalize_knowing};
use super::vectors::block::{Block, add_product, gram, replace_by_product};
use super::vectors::scalar::Scalar;
use super::vectors::start;
use super::{Problem, SpectrumError};
use crate::progress::Progress;

/// A basis of the Krylov space and the projection of the operator onto it.
pub(super) struct Krylov<V> {
    /// Orthonormal vectors: `processed` of them multiplied, then the block that is next.
    pub(super) basis: Block<V>,
    pub(super) processed: usize,
    /// `Vᵀ (A−sI)⁻¹ V` over the processed vectors.
    pub(super) projected: Mat<f64>,
    /// What the last product had outside the basis, in terms of the next block.
    pub(super) rest: Mat<f64>,
    /// Columns that the last product belongs to.
    pub(super) last: std::ops::Range<usize>,
}

/// Where eigenvectors are looked for: orthogonal to the null space and to those that are known.
pub(super) struct Complement<'a> {
    pub(super) problem: &'a Problem,
    pub(super) beside: &'a Block,
}

impl Complement<'_> {
    pub(super) fn dimension(&self) -> usize {
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
pub(super) fn fresh_block<V: Scalar>(
    complement: &Complement<'_>,
    krylov: &mut Krylov<V>,
    work: &mut Block,
    hashed: &mut usize,
    progress: &Progress,
) -> Result<(), SpectrumError> {
    let room = complement.dimension() - krylov.processed;
    work.set_columns(BLOCK.min(room));
    start::fill(work, complement.beside.columns() + *hashed);
    *hashed += BLOCK;
    complement.project(work);
    krylov.basis.set_columns(krylov.processed);
    orthonormalize(work, &krylov.basis, progress)?;
    progress.checkpoint()?;
    append(krylov, work);
    Ok(())
}

fn append<V: Scalar>(krylov: &mut Krylov<V>, work: &Block) {
    krylov.basis.set_columns(krylov.processed + work.columns());
    krylov.basis.copy_columns(krylov.processed, work, 0, work.columns());
}

/// Multiplies the next block and orthogonalizes the product.
pub(super) fn expand<V: Scalar>(
    complement: &Complement<'_>,
    inverse: &dyn Inverse,
    krylov: &mut Krylov<V>,
    work: &mut Block,
    progress: &Progress,
) -> Result<(), SpectrumError> {
    let (first, end) = (krylov.processed, krylov.basis.columns());
    work.set_columns(end - first);
    work.copy_columns(0, &krylov.basis, first, end - first);
    inverse.solve(work, progress)?;
    complement.project(work);
    // a Lanczos product overlaps with its own block and the one before; after a restart, with all
    let taken = orthonormalize_knowing(work, &krylov.basis, krylov.last.start, progress)?;
    for j in first..end {
        for i in 0..end {
            krylov.projected[(i, j)] = taken.along[(i, j - first)];
            krylov.projected[(j, i)] = taken.along[(i, j - first)];
        }
    }
    krylov.last = first..end;
    krylov.processed = end;
    krylov.rest = taken.rest;
    // what rounding leaves of an exhausted space is not a direction
    let scale = (0..end).map(|k| krylov.projected[(k, k)].abs()).fold(0.0, f64::max);
    if krylov.rest.norm_max() < 100.0 * V::ROUNDING * scale || end == complement.dimension() {
        krylov.rest = Mat::zeros(0, 0);
    } else {
        append(krylov, work);
    }
    Ok(())
}

/// Ritz values θ of the inverse, ascending, and the coefficients of their vectors.
pub(super) struct Ritz {
    values: Vec<f64>,
    coefficients: Mat<f64>,
}

impl Ritz {
    pub(super) fn of<V>(krylov: &Krylov<V>) -> Result<Self, SpectrumError> {
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
    pub(super) fn worst_residual<V>(
        &self,
        krylov: &Krylov<V>,
        nearest: Nearest,
        shift: f64,
        sigma: f64,
    ) -> f64 {
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
pub(super) fn restart<V: Scalar>(
    krylov: &mut Krylov<V>,
    nearest: Nearest,
    progress: &Progress,
) -> Result<(), SpectrumError> {
    progress.checkpoint()?;
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
pub(super) fn finish<V: Scalar>(
    complement: &Complement<'_>,
    mut krylov: Krylov<V>,
    nearest: Nearest,
    progress: &Progress,
) -> Result<Block, SpectrumError> {
    progress.checkpoint()?;
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
    progress.checkpoint()?;
    let basis = krylov.basis.into_first(places.len());
    let mut vectors = Block::zeros(basis.rows(), places.len());
    vectors.copy_columns(0, &basis, 0, places.len());
    drop(basis);
    progress.checkpoint()?;
    // in a space that is nearly exhausted the last blocks are short, and rounding along the null space is not
    complement.project(&mut vectors);
    Ok(vectors)
}

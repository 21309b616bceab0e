//! Block Lanczos on `(A + σI)⁻¹` with full reorthogonalisation and thick restarts, for operators that can be factored.
//!
//! Blocks find the multiplicities that single vectors miss; the null space is known and kept out of the iteration.

use faer::Mat;

use super::block::{Block, add_product, gram, replace_by_product};
use super::cholesky::Cholesky;
use super::orthogonal::{eigen, orthonormalize, orthonormalize_knowing};
use super::sparse_product::sparse_product;
use super::{Eigenpairs, Problem, SpectrumError, start};
use crate::progress::Progress;

/// Vectors multiplied together.
const BLOCK: usize = 16;

/// Restarts before giving up.
const RESTARTS_MAX: usize = 60;

/// A basis of the Krylov space and the projection of the operator onto it.
struct Krylov {
    /// Orthonormal vectors: `processed` of them multiplied, then the block that is next.
    basis: Block,
    processed: usize,
    /// `Vᵀ (A+σI)⁻¹ V` over the processed vectors.
    projected: Mat<f64>,
    /// What the last product had outside the basis, in terms of the next block.
    rest: Mat<f64>,
    /// Columns that the last product belongs to.
    last: std::ops::Range<usize>,
}

/// The `count` smallest non-zero eigenpairs to a relative residual of `tolerance`, among those orthogonal to the
/// eigenvectors `beside`.
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
    let n = problem.size();
    let complement = Complement { problem, beside };
    let room = (2 * count + 3 * BLOCK).max(count + 8 * BLOCK).min(complement.dimension());
    let mut krylov = Krylov {
        basis: Block::zeros(n, room + BLOCK),
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
            expand(&complement, factor, &mut krylov, &mut work)?;
            if krylov.rest.nrows() == 0 {
                // an invariant space: whatever else there is needs a new direction
                if krylov.processed >= complement.dimension() {
                    return finish(&complement, factor, krylov, count, progress);
                }
                fresh_block(&complement, &mut krylov, &mut work, &mut hashed)?;
            }
            if krylov.processed >= count + BLOCK / 2 || krylov.processed + BLOCK > room {
                let (values, vectors) = ritz(&krylov)?;
                worst = worst_residual(&krylov, &values, &vectors, count);
                // the last inverse iteration and Rayleigh–Ritz step only improve on this
                if worst <= 0.3 * tolerance {
                    return finish(&complement, factor, krylov, count, progress);
                }
            }
        }
        let keep = count + (krylov.processed - count) / 3;
        restart(&mut krylov, keep)?;
    }
    Err(SpectrumError::NotConverged { reached: worst, tolerance, iterations: steps as usize })
}

/// Where eigenvectors are looked for: orthogonal to the null space and to those that are known.
struct Complement<'a> {
    problem: &'a Problem,
    beside: &'a Block,
}

impl Complement<'_> {
    fn dimension(&self) -> usize {
        self.problem.size() - self.problem.zero_modes() - self.beside.columns()
    }

    fn project(&self, block: &mut Block) {
        self.problem.project_out_null(block);
        if self.beside.columns() > 0 {
            let along = gram(self.beside, block);
            add_product(block, -1.0, self.beside, along.as_ref());
        }
    }
}

/// Appends a block of hashed numbers, orthogonal to everything so far.
fn fresh_block(
    complement: &Complement<'_>,
    krylov: &mut Krylov,
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

fn append(krylov: &mut Krylov, work: &Block) {
    krylov.basis.set_columns(krylov.processed + work.columns());
    krylov.basis.copy_columns(krylov.processed, work, 0, work.columns());
}

/// Multiplies the next block and orthogonalises the product.
fn expand(
    complement: &Complement<'_>,
    factor: &Cholesky<'_>,
    krylov: &mut Krylov,
    work: &mut Block,
) -> Result<(), SpectrumError> {
    let (first, end) = (krylov.processed, krylov.basis.columns());
    work.set_columns(end - first);
    work.copy_columns(0, &krylov.basis, first, end - first);
    factor.solve(work);
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
    let scale = krylov.projected[(0, 0)].abs();
    if krylov.rest.norm_max() < 1e-14 * scale || end == complement.dimension() {
        krylov.rest = Mat::zeros(0, 0);
    } else {
        append(krylov, work);
    }
    Ok(())
}

/// Ritz values of the inverse, largest first, and their coefficients.
fn ritz(krylov: &Krylov) -> Result<(Vec<f64>, Mat<f64>), SpectrumError> {
    let m = krylov.processed;
    let projected = krylov.projected.as_ref().submatrix(0, 0, m, m);
    let symmetric = Mat::from_fn(m, m, |i, j| 0.5 * (projected[(i, j)] + projected[(j, i)]));
    let (values, vectors) = eigen(symmetric.as_ref())?;
    let reversed = Mat::from_fn(m, m, |i, j| vectors[(i, m - 1 - j)]);
    Ok((values.into_iter().rev().collect(), reversed))
}

/// Largest relative residual of the first `count` pairs after one more inverse iteration: `‖C y − θ y‖ / θ`.
fn worst_residual(krylov: &Krylov, values: &[f64], vectors: &Mat<f64>, count: usize) -> f64 {
    if krylov.rest.nrows() == 0 {
        return f64::INFINITY;
    }
    let tail = vectors.as_ref().subrows(krylov.last.start, krylov.last.len()).subcols(0, count);
    let outside = &krylov.rest * tail;
    (0..count).map(|j| outside.as_ref().col(j).norm_l2() / values[j]).fold(0.0, f64::max)
}

/// Keeps the best `keep` Ritz vectors and the next block.
fn restart(krylov: &mut Krylov, keep: usize) -> Result<(), SpectrumError> {
    let (values, vectors) = ritz(krylov)?;
    let (processed, next) = (krylov.processed, krylov.basis.columns() - krylov.processed);
    // one product moves the next block along unchanged
    let total = processed + next;
    let change = Mat::from_fn(total, keep + next, |i, j| match (i < processed, j < keep) {
        (true, true) => vectors[(i, j)],
        (false, false) => f64::from(u8::from(i - processed == j - keep)),
        _ => 0.0,
    });
    replace_by_product(&mut krylov.basis, change.as_ref());
    krylov.projected.fill(0.0);
    for (k, &value) in values[..keep].iter().enumerate() {
        krylov.projected[(k, k)] = value;
    }
    krylov.processed = keep;
    krylov.last = 0..keep;
    Ok(())
}

/// One inverse iteration on the Ritz vectors, then Rayleigh–Ritz with `A` itself: what the inverse cannot see, the
/// fine scales, is gone, and the values are those of `A`.
fn finish(
    complement: &Complement<'_>,
    factor: &Cholesky<'_>,
    mut krylov: Krylov,
    count: usize,
    progress: &Progress,
) -> Result<Eigenpairs, SpectrumError> {
    progress.checkpoint()?;
    let (_, vectors) = ritz(&krylov)?;
    krylov.basis.set_columns(krylov.processed);
    let wanted = vectors.as_ref().subcols(0, count);
    replace_by_product(&mut krylov.basis, wanted);
    let mut pairs = Block::zeros(complement.problem.size(), count);
    pairs.copy_columns(0, &krylov.basis, 0, count);
    drop(krylov);
    factor.solve(&mut pairs);
    progress.checkpoint()?;
    complement.project(&mut pairs);
    rayleigh_ritz(complement.problem, pairs)
}

/// Ritz pairs of `A` in the span of `vectors`, ascending.
///
/// # Errors
/// [`SpectrumError::Dense`].
pub fn rayleigh_ritz(problem: &Problem, mut vectors: Block) -> Result<Eigenpairs, SpectrumError> {
    orthonormalize(&mut vectors, &Block::zeros(problem.size(), 0))?;
    let mut product = Block::zeros(problem.size(), vectors.columns());
    sparse_product(&mut product, &problem.matrix, &vectors);
    let (values, coefficients) = eigen(gram(&vectors, &product).as_ref())?;
    replace_by_product(&mut vectors, coefficients.as_ref());
    Ok(Eigenpairs::real(values, vectors))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::operator::{LaplaceBeltrami, Sparse};
    use crate::spectrum::cholesky::Symbolic;

    /// The 5-point stencil on a `side × side` grid with unit masses: eigenvalues
    /// `4 sin²(πa/2m) + 4 sin²(πb/2m)`, a, b = 0 … m−1 (the tensor product of paths).
    fn grid(side: usize) -> Problem {
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

    #[test]
    fn a_grids_double_eigenvalues_are_all_found() {
        let side = 40;
        let problem = grid(side);
        let order: Vec<u32> = (0..(side * side) as u32).collect();
        let symbolic = Symbolic::analyze(&problem.matrix, order).unwrap();
        let factor = symbolic.factor(&problem.matrix, problem.shift).unwrap();
        let none = Block::zeros(problem.size(), 0);
        let pairs = solve(&problem, &factor, &none, 40, 1e-8, &Progress::new(), |share| share).unwrap();
        let path = |a: usize| 4.0 * (std::f64::consts::PI * a as f64 / (2.0 * side as f64)).sin().powi(2);
        let mut exact: Vec<f64> = (0..side).flat_map(|a| (0..side).map(move |b| path(a) + path(b))).collect();
        exact.sort_by(f64::total_cmp);
        for (found, exact) in pairs.values.iter().zip(&exact[1..]) {
            assert!((found - exact).abs() < 1e-9 * exact, "{found} {exact}");
        }
        assert_eq!(
            symbolic.eigenvalues_below(&problem.matrix, 0.5 * (exact[40] + exact[41])).unwrap(),
            Some(41)
        );
    }
}

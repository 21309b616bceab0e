//! Orthonormal bases of blocks.

use faer::{Mat, MatRef, Side};

use super::SpectrumError;
use super::vectors::block::{Block, add_product_from, gram, gram_from, replace_by_product};
use super::vectors::scalar::Scalar;
use crate::progress::Progress;

/// Directions whose squared length is below this share of the largest are rounding noise.
const RANK_TOLERANCE: f64 = 1e-13;

/// Eigenvalues, ascending, and eigenvectors of a small symmetric matrix (its lower triangle).
///
/// faer's divide and conquer compares with absolute thresholds: of 300 rows of norm 1e-12 it returns eigenvalues that are
/// off by 2e-3. It is given the matrix with its largest entry between 1 and 2, by a power of two.
///
/// # Errors
/// [`SpectrumError::Dense`].
pub fn eigen(matrix: MatRef<'_, f64>) -> Result<(Vec<f64>, Mat<f64>), SpectrumError> {
    let order = matrix.nrows();
    let lower = || (0..order).flat_map(|j| (j..order).map(move |i| matrix[(i, j)]));
    if !lower().all(f64::is_finite) {
        return Err(SpectrumError::Dense { order });
    }
    let largest = lower().fold(0.0, |largest: f64, entry| largest.max(entry.abs()));
    // halves of the exponent, because the inverse of the smallest power of two is infinite
    let exponent = if largest > 0.0 { largest.log2().floor() as i32 } else { 0 };
    let halves = [exponent / 2, exponent - exponent / 2].map(|half| 2.0_f64.powi(half));
    let scaled = Mat::from_fn(order, order, |i, j| matrix[(i, j)] / halves[0] / halves[1]);
    let eigen = scaled.self_adjoint_eigen(Side::Lower).map_err(|_| SpectrumError::Dense { order })?;
    let values = eigen.S().column_vector().iter().map(|value| value * halves[0] * halves[1]).collect();
    Ok((values, eigen.U().to_owned()))
}

/// Eigenvalues μ, ascending, and vectors of `H c = μ G c` for symmetric matrices, `G` positive semi-definite, with
/// `cᵀ G c = 1`; directions of no length have none.
///
/// # Errors
/// [`SpectrumError::Dense`].
pub fn pencil(h: MatRef<'_, f64>, g: MatRef<'_, f64>) -> Result<(Vec<f64>, Mat<f64>), SpectrumError> {
    let (whitening, _, _) = normalizer(g)?;
    let (values, vectors) = eigen((whitening.transpose() * h * &whitening).as_ref())?;
    Ok((values, whitening * vectors))
}

/// Columns of which every combination is at least this share of their squared lengths need no second round.
const INDEPENDENT: f64 = 0.1;

/// `M` and `R` with `(W M)ᵀ(W M) = I` and `W = (W M) R`, up to directions of no length, from `WᵀW`
/// (SVQB, Stathopoulos and Wu 2002), and how independent the columns are: the smallest eigenvalue of their angles'
/// cosines.
fn normalizer(gram: MatRef<'_, f64>) -> Result<(Mat<f64>, Mat<f64>, f64), SpectrumError> {
    let columns = gram.nrows();
    let lengths: Vec<f64> = (0..columns).map(|j| gram[(j, j)].max(0.0).sqrt()).collect();
    let inverse: Vec<f64> = lengths.iter().map(|&l| if l > 0.0 { 1.0 / l } else { 0.0 }).collect();
    let scaled = Mat::from_fn(columns, columns, |i, j| gram[(i, j)] * inverse[i] * inverse[j]);
    let (values, vectors) = eigen(scaled.as_ref())?;
    let largest = values.last().copied().unwrap_or(0.0);
    let kept: Vec<usize> =
        (0..columns).rev().filter(|&k| values[k] > RANK_TOLERANCE * largest && values[k] > 0.0).collect();
    let m =
        Mat::from_fn(columns, kept.len(), |i, k| inverse[i] * vectors[(i, kept[k])] / values[kept[k]].sqrt());
    let r =
        Mat::from_fn(kept.len(), columns, |k, j| values[kept[k]].sqrt() * vectors[(j, kept[k])] * lengths[j]);
    Ok((m, r, values.first().copied().unwrap_or(1.0)))
}

/// What [`orthonormalize`] took out of a block: `W = V H + W' R`.
pub struct Taken {
    /// `H`, `v.columns × w.columns`.
    pub along: Mat<f64>,
    /// `R`, `w'.columns × w.columns`.
    pub rest: Mat<f64>,
}

/// Makes `w` orthonormal, and orthogonal to the orthonormal columns of `v`; columns that depend on the others are
/// dropped. Block Gram–Schmidt, twice.
///
/// # Errors
/// [`SpectrumError::Dense`], [`SpectrumError::Canceled`].
pub fn orthonormalize<V: Scalar>(
    w: &mut Block,
    v: &Block<V>,
    progress: &Progress,
) -> Result<Taken, SpectrumError> {
    orthonormalize_knowing(w, v, 0, progress)
}

/// The same for a `w` that but for rounding is orthogonal to the columns of `v` before `from`: these are looked at in
/// the second round only.
///
/// # Errors
/// [`SpectrumError::Dense`], [`SpectrumError::Canceled`].
pub fn orthonormalize_knowing<V: Scalar>(
    w: &mut Block,
    v: &Block<V>,
    from: usize,
    progress: &Progress,
) -> Result<Taken, SpectrumError> {
    let mut along = Mat::zeros(v.columns(), w.columns());
    let mut rest = Mat::identity(w.columns(), w.columns());
    for from in [from, 0] {
        progress.checkpoint()?;
        if v.columns() > from {
            let h = gram_from(v, from, w);
            progress.checkpoint()?;
            add_product_from(w, -1.0, v, from, h.as_ref());
            let mut part = along.as_mut().subrows_mut(from, v.columns() - from);
            part += &h * &rest;
            progress.checkpoint()?;
        }
        let (m, r, independent) = normalizer(gram(w, w).as_ref())?;
        if m.ncols() == 0 {
            w.set_columns(0);
            return Ok(Taken { along, rest: Mat::zeros(0, rest.ncols()) });
        }
        replace_by_product(w, m.as_ref());
        rest = r * rest;
        if v.columns() == 0 && independent > INDEPENDENT {
            break;
        }
    }
    Ok(Taken { along, rest })
}

/// Makes the columns of a small matrix orthonormal and orthogonal to the orthonormal columns of `v`.
///
/// # Errors
/// [`SpectrumError::Dense`].
pub fn orthonormalize_small(mut w: Mat<f64>, v: MatRef<'_, f64>) -> Result<Mat<f64>, SpectrumError> {
    for _ in 0..2 {
        w = &w - v * (v.transpose() * &w);
        let (m, _, _) = normalizer((w.transpose() * &w).as_ref())?;
        w = w * m;
    }
    Ok(w)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::spectrum::vectors::start;

    #[test]
    fn eigenpairs_do_not_depend_on_the_size_of_the_entries() {
        // a path graph with a potential, whose divide and conquer deflates a part of the pairs
        let order = 300;
        let matrix = Mat::from_fn(order, order, |i, j| match i.abs_diff(j) {
            0 => 2.0 + (i as f64).sin(),
            1 => -1.0,
            _ => 0.0,
        });
        let (values, vectors) = eigen(matrix.as_ref()).unwrap();
        let defect = &matrix * &vectors - Mat::from_fn(order, order, |i, j| vectors[(i, j)] * values[j]);
        assert!(defect.norm_max() < 1e-13);
        for exponent in [-1000, -40, 70, 1000] {
            let scale = 2.0_f64.powi(exponent);
            let scaled = Mat::from_fn(order, order, |i, j| scale * matrix[(i, j)]);
            let (others, turned) = eigen(scaled.as_ref()).unwrap();
            assert!(values.iter().zip(&others).all(|(a, b)| (scale * a).to_bits() == b.to_bits()));
            assert!(vectors == turned);
        }
        let broken = Mat::from_fn(3, 3, |i, j| if i == 2 && j == 0 { f64::NAN } else { 1.0 });
        assert!(matches!(eigen(broken.as_ref()), Err(SpectrumError::Dense { order: 3 })));
    }

    #[test]
    fn dependent_columns_are_dropped_and_the_rest_is_orthonormal_and_complete() {
        let mut v = Block::zeros(3_000, 3);
        start::fill(&mut v, 0);
        orthonormalize(&mut v, &Block::<f64>::zeros(3_000, 0), &Progress::new()).unwrap();
        let mut w = Block::zeros(3_000, 4);
        start::fill(&mut w, 10);
        w.for_each_row(|_, row| row[3] = row[0] + 2.0 * row[1]);
        let before = w.clone();
        let taken = orthonormalize(&mut w, &v, &Progress::new()).unwrap();
        assert_eq!(w.columns(), 3);
        let defect = gram(&w, &w) - Mat::<f64>::identity(3, 3);
        assert!(defect.norm_max() < 1e-14);
        assert!(gram(&v, &w).norm_max() < 1e-14);
        for i in [0, 1_234, 2_999] {
            for j in 0..4 {
                let along: f64 = (0..3).map(|k| v.row(i)[k] * taken.along[(k, j)]).sum();
                let rest: f64 = (0..3).map(|k| w.row(i)[k] * taken.rest[(k, j)]).sum();
                assert!((along + rest - before.row(i)[j]).abs() < 1e-10);
            }
        }
    }
}

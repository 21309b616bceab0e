//! Products of a block with itself and with its image, in one pass that never stores the image.

use faer::linalg::matmul::triangular::{self, BlockStructure};
use faer::{Accum, Mat, MatRef, Par};
use rayon::prelude::*;

use super::block::{Block, Columns};
use super::sparse_product::{Rows, product_of_rows};
use crate::operator::Sparse;
use crate::progress::{Canceled, Progress};

/// Rows of a chunk: with 200 columns it stays in the second-level cache, and so does its image.
pub(super) const CHUNK_ROWS: usize = 128;

/// Partial sums; a fixed number, so that the result is independent of the threads.
pub(super) const PARTIAL_SUMS: usize = 16;

/// `XᵀX` and `XᵀAX` for a symmetric `A`.
///
/// # Errors
/// [`Canceled`].
pub fn gram_pair(a: &Sparse, x: &Block, progress: &Progress) -> Result<[Mat<f64>; 2], Canceled> {
    let m = x.columns();
    let nothing = || [Mat::zeros(m, m), Mat::zeros(m, m)];
    let parts = by_chunks(Some(a), x, progress, nothing, |sums: &mut [Mat<f64>; 2], _, own, image| {
        add_lower(&mut sums[0], own, own);
        add_lower(&mut sums[1], own, image);
    })?;
    let mut total = nothing();
    for part in parts {
        total.iter_mut().zip(part).for_each(|(total, part)| *total += part);
    }
    Ok(total.map(|lower| symmetric(&lower)))
}

/// Norms of the columns of `A X − X diag(values)`, and `XᵀX`. Where `partners` has an entry `(k, b)` for column `j`,
/// `b x_k` is added to its residual.
///
/// # Errors
/// [`Canceled`].
pub fn residuals_and_gram(
    a: &Sparse,
    x: &Block,
    values: &[f64],
    partners: &[Option<(usize, f64)>],
    progress: &Progress,
) -> Result<(Vec<f64>, Mat<f64>), Canceled> {
    let m = x.columns();
    let nothing = || (vec![0.0; m], Mat::zeros(m, m));
    let add = |sums: &mut (Vec<f64>, Mat<f64>),
               first: usize,
               own: MatRef<'_, f64>,
               image: MatRef<'_, f64>| {
        for k in 0..own.nrows() {
            let x = x.row(first + k);
            for (((sum, x), image), value) in sums.0.iter_mut().zip(x).zip(image.row(k).iter()).zip(values) {
                let rest = image - value * x;
                *sum += rest * rest;
            }
            for (j, &(partner, b)) in partners.iter().enumerate().filter_map(|(j, p)| Some((j, p.as_ref()?)))
            {
                let rest = image[(k, j)] - values[j] * x[j];
                let whole = rest + b * x[partner];
                sums.0[j] += whole * whole - rest * rest;
            }
        }
        add_lower(&mut sums.1, own, own);
    };
    let mut total = nothing();
    for (squares, gram) in by_chunks(Some(a), x, progress, nothing, add)? {
        total.0.iter_mut().zip(squares).for_each(|(total, square)| *total += square);
        total.1 += gram;
    }
    Ok((total.0.into_iter().map(|square| square.max(0.0).sqrt()).collect(), symmetric(&total.1)))
}

/// `XᵀX`.
///
/// # Errors
/// [`Canceled`].
pub fn own_gram(x: &Block, progress: &Progress) -> Result<Mat<f64>, Canceled> {
    let nothing = || Mat::<f64>::zeros(x.columns(), x.columns());
    let parts = by_chunks(None, x, progress, nothing, |sum, _, own, _| add_lower(sum, own, own))?;
    let mut total = nothing();
    for part in parts {
        total += part;
    }
    Ok(symmetric(&total))
}

/// Norms of the columns of `A X − X diag(values)`.
///
/// # Errors
/// [`Canceled`].
pub fn residual_norms(
    a: &Sparse,
    x: &Block,
    values: &[f64],
    progress: &Progress,
) -> Result<Vec<f64>, Canceled> {
    let nothing = || vec![0.0; x.columns()];
    let add = |sums: &mut Vec<f64>, _: usize, own: MatRef<'_, f64>, image: MatRef<'_, f64>| {
        for (own, image) in own.row_iter().zip(image.row_iter()) {
            let entries = own.iter().zip(image.iter()).zip(values);
            for (sum, ((x, image), value)) in sums.iter_mut().zip(entries) {
                let rest = image - value * x;
                *sum += rest * rest;
            }
        }
    };
    let squares = added(x.columns(), by_chunks(Some(a), x, progress, nothing, add)?);
    Ok(squares.into_iter().map(f64::sqrt).collect())
}

/// `A X − X diag(values)`, computed in double precision and rounded, and the squared norms of its columns before that.
pub fn rounded_residual(out: &mut Block<f32>, a: &Sparse, x: Columns<'_, f64>, values: &[f64]) -> Vec<f64> {
    let m = x.count();
    out.set_columns(m);
    let parts = out.map_stretches(PARTIAL_SUMS, |first, rows, width| {
        let mut sums = vec![0.0; m];
        let mut image = vec![0.0; CHUNK_ROWS * m];
        for (chunk, rows) in rows.chunks_mut(CHUNK_ROWS * width).enumerate() {
            let first = first + chunk * CHUNK_ROWS;
            let image = &mut image[..rows.len() / width * m];
            product_of_rows(Rows::of(a), x, first, image, m);
            for (k, (row, image)) in rows.chunks_mut(width).zip(image.chunks_exact(m)).enumerate() {
                let entries = image.iter().zip(x.row(first + k)).zip(values);
                for ((out, sum), ((image, x), value)) in row.iter_mut().zip(&mut sums).zip(entries) {
                    let rest = image - value * x;
                    *sum += rest * rest;
                    *out = rest as f32;
                }
            }
        }
        sums
    });
    added(m, parts)
}

/// Calls `add` with every chunk's first row, the chunk and its image, zeros without an `a`.
fn by_chunks<R: Send>(
    a: Option<&Sparse>,
    x: &Block,
    progress: &Progress,
    nothing: impl Fn() -> R + Sync + Send,
    add: impl Fn(&mut R, usize, MatRef<'_, f64>, MatRef<'_, f64>) + Sync + Send,
) -> Result<Vec<R>, Canceled> {
    let (n, m) = (x.rows(), x.columns());
    let share = n.div_ceil(PARTIAL_SUMS).max(CHUNK_ROWS);
    let starts: Vec<usize> = (0..n).step_by(share).collect();
    let all = x.columns_from(0, m);
    let of_part = |start: usize| {
        let mut sum = nothing();
        let mut image = vec![0.0; CHUNK_ROWS * m];
        let end = n.min(start + share);
        for first in (start..end).step_by(CHUNK_ROWS) {
            progress.checkpoint()?;
            let rows = CHUNK_ROWS.min(end - first);
            if let Some(a) = a {
                product_of_rows(Rows::of(a), all, first, &mut image[..rows * m], m);
            }
            let image = MatRef::from_row_major_slice(&image[..rows * m], rows, m);
            add(&mut sum, first, x.chunk(first..first + rows, 0), image);
        }
        Ok(sum)
    };
    starts.into_par_iter().map(of_part).collect()
}

/// Sums of columns, from those of their parts.
pub(crate) fn added(columns: usize, parts: Vec<Vec<f64>>) -> Vec<f64> {
    let mut total = vec![0.0; columns];
    for part in parts {
        total.iter_mut().zip(part).for_each(|(total, part)| *total += part);
    }
    total
}

/// `sum += aᵀb`, of which the lower triangle counts.
pub(super) fn add_lower(sum: &mut Mat<f64>, a: MatRef<'_, f64>, b: MatRef<'_, f64>) {
    let (lower, whole) = (BlockStructure::TriangularLower, BlockStructure::Rectangular);
    triangular::matmul(sum.as_mut(), lower, Accum::Add, a.transpose(), whole, b, whole, 1.0, Par::Seq);
}

pub(super) fn symmetric(lower: &Mat<f64>) -> Mat<f64> {
    Mat::from_fn(lower.nrows(), lower.ncols(), |i, j| lower[(i.max(j), i.min(j))])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::spectrum::grid::grid;
    use crate::spectrum::vectors::block::{column_norms, gram};
    use crate::spectrum::vectors::sparse_product::sparse_product;
    use crate::spectrum::vectors::start;

    #[test]
    fn one_pass_gives_what_products_by_themselves_give_on_any_number_of_threads() {
        let a = grid(50).matrix;
        let mut x = Block::zeros(2_500, 13);
        start::fill(&mut x, 0);
        let mut image = Block::zeros(2_500, 13);
        sparse_product(&mut image, &a, &x);
        let on = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| gram_pair(&a, &x, &Progress::new()).unwrap())
        };
        let [own, with_image] = on(1);
        assert!((&own - gram(&x, &x)).norm_max() < 1e-9);
        assert!((&with_image - gram(&x, &image)).norm_max() < 1e-9);
        assert_eq!([own, with_image], on(3));

        let values: Vec<f64> = (0..13).map(|j| 0.3 * f64::from(j)).collect();
        let mut partners = vec![None; 13];
        (partners[4], partners[5]) = (Some((5, 0.25)), Some((4, -0.25)));
        let (norms, _) = residuals_and_gram(&a, &x, &values, &partners, &Progress::new()).unwrap();
        image.for_each_row(|i, row| {
            for (j, rest) in row.iter_mut().enumerate() {
                let partner = partners[j].map_or(0.0, |(k, b): (usize, f64)| b * x.row(i)[k]);
                *rest += partner - values[j] * x.row(i)[j];
            }
        });
        assert!(
            norms.iter().zip(column_norms(&image)).all(|(norm, other)| (norm / other - 1.0).abs() < 1e-12)
        );
        let (norms, _) = residuals_and_gram(&a, &x, &values, &[], &Progress::new()).unwrap();
        let alone = residual_norms(&a, &x, &values, &Progress::new()).unwrap();
        let mut rounded = Block::<f32>::zeros(2_500, 13);
        let squares = rounded_residual(&mut rounded, &a, x.columns_from(0, 13), &values);
        for j in 0..13 {
            let of_rounded: f64 = rounded.column(j).iter().map(|&r| f64::from(r).powi(2)).sum();
            assert!((alone[j] / norms[j] - 1.0).abs() < 1e-13);
            assert!((squares[j].sqrt() / norms[j] - 1.0).abs() < 1e-12);
            assert!((of_rounded.sqrt() / norms[j] - 1.0).abs() < 1e-6);
        }
        assert!((own_gram(&x, &Progress::new()).unwrap() - gram(&x, &x)).norm_max() < 1e-9);
        let canceled = Progress::new();
        canceled.cancel();
        assert_eq!(gram_pair(&a, &x, &canceled).err(), Some(Canceled));
    }
}

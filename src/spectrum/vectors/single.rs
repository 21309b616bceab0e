//! Many vectors in single precision, of which all products are taken in double: half of the memory, and sums that do not
//! know of it.

use faer::linalg::matmul::matmul;
use faer::{Accum, Mat, MatMut, MatRef, Par};
use rayon::prelude::*;

use super::block::{Block, Columns};
use super::pair::{CHUNK_ROWS, PARTIAL_SUMS, add_lower, added, symmetric};
use super::shelf::{Shelf, View};
use crate::operator::Sparse;
use crate::progress::Progress;
use crate::spectrum::SpectrumError;

/// Rows that are looked at together: whole chunks.
const VIEWED_ROWS: usize = 32 * CHUNK_ROWS;

/// Rows of vectors in single precision.
pub trait SingleRows {
    /// Row `i`.
    fn row(&self, i: usize) -> &[f32];
}

impl SingleRows for Columns<'_, f32> {
    #[inline]
    fn row(&self, i: usize) -> &[f32] {
        Columns::row(self, i)
    }
}

impl SingleRows for View<'_> {
    #[inline]
    fn row(&self, i: usize) -> &[f32] {
        View::row(self, i)
    }
}

/// Vectors, row by row multiplied by the `scale` of the row; by 1 where that is empty.
#[derive(Debug, Clone, Copy)]
pub struct Scaled<'a, X> {
    /// The vectors before they are multiplied.
    pub vectors: X,
    /// One factor per row, or none.
    pub scale: &'a [f64],
}

impl<X: SingleRows> Scaled<'_, X> {
    fn factor(&self, i: usize) -> f64 {
        self.scale.get(i).copied().unwrap_or(1.0)
    }

    fn write_row(&self, i: usize, out: &mut [f64]) {
        let factor = self.factor(i);
        out.iter_mut().zip(self.vectors.row(i)).for_each(|(out, &x)| *out = factor * f64::from(x));
    }

    fn write_image(&self, a: &Sparse, i: usize, out: &mut [f64]) {
        out.fill(0.0);
        let (columns, values) = a.row(i);
        for (&j, &value) in columns.iter().zip(values) {
            let value = value * self.factor(j as usize);
            let row = self.vectors.row(j as usize);
            out.iter_mut().zip(row).for_each(|(out, &x)| *out += value * f64::from(x));
        }
    }
}

/// `XᵀX` and `XᵀAX` for a symmetric `A`, of vectors whose rows are multiplied by `scale`, if there is one; without an `A` the
/// second is zero.
///
/// # Errors
/// [`SpectrumError::Canceled`], [`SpectrumError::Scratch`].
pub fn gram_pair(
    a: Option<&Sparse>,
    x: &Shelf,
    scale: &[f64],
    progress: &Progress,
) -> Result<[Mat<f64>; 2], SpectrumError> {
    let (rows, m) = (x.rows(), x.columns());
    let nothing = || [Mat::<f64>::zeros(m, m), Mat::zeros(m, m)];
    let share = rows.div_ceil(PARTIAL_SUMS).max(CHUNK_ROWS);
    let starts: Vec<usize> = (0..rows).step_by(share).collect();
    let of_part = |start: usize| {
        let mut sums = nothing();
        let (mut own, mut image) = (vec![0.0; CHUNK_ROWS * m], vec![0.0; CHUNK_ROWS * m]);
        let end = rows.min(start + share);
        for from in (start..end).step_by(VIEWED_ROWS) {
            let viewed = from..end.min(from + VIEWED_ROWS);
            let coupled = |i: usize| a.into_iter().flat_map(move |a| a.row(i).0).map(|&j| j as usize);
            let x =
                Scaled { vectors: x.view(viewed.clone().chain(viewed.clone().flat_map(coupled)))?, scale };
            for first in viewed.clone().step_by(CHUNK_ROWS) {
                progress.checkpoint()?;
                let count = CHUNK_ROWS.min(viewed.end - first);
                let (own, image) = (&mut own[..count * m], &mut image[..count * m]);
                own.chunks_exact_mut(m).enumerate().for_each(|(k, row)| x.write_row(first + k, row));
                let left = MatRef::from_row_major_slice(&*own, count, m);
                add_lower(&mut sums[0], left, left);
                if let Some(a) = a {
                    image
                        .chunks_exact_mut(m)
                        .enumerate()
                        .for_each(|(k, row)| x.write_image(a, first + k, row));
                    add_lower(&mut sums[1], left, MatRef::from_row_major_slice(&*image, count, m));
                }
            }
        }
        Ok(sums)
    };
    let parts: Vec<[Mat<f64>; 2]> =
        starts.into_par_iter().map(of_part).collect::<Result<_, SpectrumError>>()?;
    let mut total = nothing();
    for part in parts {
        total.iter_mut().zip(part).for_each(|(total, part)| *total += part);
    }
    Ok(total.map(|lower| symmetric(&lower)))
}

/// `A X − X diag(values)`, rounded, and the squared norms of its columns before that.
pub fn residual(
    out: &mut Block<f32>,
    a: &Sparse,
    x: Scaled<'_, Columns<'_, f32>>,
    values: &[f64],
) -> Vec<f64> {
    let m = x.vectors.count();
    out.set_columns(m);
    let sums = out.map_stretches(PARTIAL_SUMS, |first, rows, width| {
        let (mut own, mut image, mut sums) = (vec![0.0; m], vec![0.0; m], vec![0.0; m]);
        for (k, row) in rows.chunks_mut(width).enumerate() {
            x.write_row(first + k, &mut own);
            x.write_image(a, first + k, &mut image);
            for (j, out) in row[..m].iter_mut().enumerate() {
                let rest = image[j] - values[j] * own[j];
                sums[j] += rest * rest;
                *out = rest as f32;
            }
        }
        sums
    });
    added(m, sums)
}

/// `X ← X M` in place for `M` with at most as many columns as rows; the shelf then has `M`'s columns.
///
/// # Errors
/// [`SpectrumError::Canceled`], [`SpectrumError::Scratch`].
pub fn replace_by_product(
    x: &mut Shelf,
    m: MatRef<'_, f64>,
    progress: &Progress,
) -> Result<(), SpectrumError> {
    let (before, after) = (x.columns(), m.ncols());
    x.for_each_stretch(progress, |_, rows, width| {
        let (mut own, mut product) = (vec![0.0; CHUNK_ROWS * before], vec![0.0; CHUNK_ROWS * after]);
        for rows in rows.chunks_mut(CHUNK_ROWS * width) {
            let count = rows.len() / width;
            let (own, product) = (&mut own[..count * before], &mut product[..count * after]);
            for (own, row) in own.chunks_exact_mut(before).zip(rows.chunks(width)) {
                own.iter_mut().zip(row).for_each(|(own, &x)| *own = f64::from(x));
            }
            let left = MatRef::from_row_major_slice(&*own, count, before);
            let target = MatMut::from_row_major_slice_mut(product, count, after);
            matmul(target, Accum::Replace, left, m, 1.0, Par::Seq);
            for (row, product) in rows.chunks_mut(width).zip(product.chunks_exact(after)) {
                row.iter_mut().zip(product).for_each(|(x, &p)| *x = p as f32);
            }
        }
    })?;
    x.set_columns(after);
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::spectrum::grid::grid;
    use crate::spectrum::vectors::Groups;
    use crate::spectrum::vectors::block::{gram, replace_by_product as replace_in_double};
    use crate::spectrum::vectors::sparse_product::sparse_product;
    use crate::spectrum::vectors::start;

    #[test]
    fn products_in_double_of_rounded_vectors_are_those_of_the_definition() {
        let a = grid(50).matrix;
        let (n, m) = (2_500, 11);
        let mut hashed = Block::zeros(n, m);
        start::fill(&mut hashed, 0);
        let mut single = Block::<f32>::zeros(n, m);
        single.copy_columns(0, &hashed, 0, m);
        let scale: Vec<f64> = (0..n).map(|i| 1.0 + 0.001 * i as f64).collect();
        let mut double = Block::zeros(n, m);
        double.copy_columns(0, &single, 0, m);
        let x = Scaled { vectors: single.columns_from(0, m), scale: &scale };
        double.for_each_row(|i, row| row.iter_mut().for_each(|x| *x *= scale[i]));
        let mut image = Block::zeros(n, m);
        sparse_product(&mut image, &a, &double);
        let groups = Groups { first: 1, width: 4 };
        let mut shelves =
            [Shelf::of(single.clone(), groups), Shelf::in_file(tempfile::tempfile().unwrap(), n, m, groups)];
        for group in shelves[0].groups() {
            let mut block = Block::<f32>::zeros(n, group.len());
            block.for_each_row(|i, row| row.copy_from_slice(&single.row(i)[group.clone()]));
            shelves[1].store(group, &block, &Progress::new()).unwrap();
        }
        let [[own, with_image], in_file] =
            [0, 1].map(|k| gram_pair(Some(&a), &shelves[k], &scale, &Progress::new()).unwrap());
        assert_eq!([&own, &with_image], [&in_file[0], &in_file[1]]);
        assert!((&own - gram(&double, &double)).norm_max() < 1e-9 * own.norm_max());
        assert!((&with_image - gram(&double, &image)).norm_max() < 1e-9 * with_image.norm_max());

        let values: Vec<f64> = (0..m).map(|j| 0.3 * j as f64).collect();
        let mut rest = Block::<f32>::zeros(n, m + 2);
        let squares = residual(&mut rest, &a, x, &values);
        for j in 0..m {
            let exact: Vec<f64> = (0..n).map(|i| image.row(i)[j] - values[j] * double.row(i)[j]).collect();
            let square: f64 = exact.iter().map(|x| x * x).sum();
            assert!((squares[j] / square - 1.0).abs() < 1e-12);
            assert!(
                (0..n).all(|i| (f64::from(rest.row(i)[j]) - exact[i]).abs() < 1e-6 * (1.0 + exact[i].abs()))
            );
        }

        let change = Mat::from_fn(m, 4, |i, j| (i + 3 * j) as f64 / 7.0 - 1.0);
        let mut plain = Block::<f64>::zeros(n, m);
        plain.copy_columns(0, &single, 0, m);
        replace_in_double(&mut plain, change.as_ref());
        let is_rounded = |(s, p): (&f32, &f64)| s.to_bits() == (*p as f32).to_bits();
        for shelf in &mut shelves {
            replace_by_product(shelf, change.as_ref(), &Progress::new()).unwrap();
            assert_eq!(shelf.columns(), 4);
            let view = shelf.view(0..n).unwrap();
            assert!((0..n).all(|i| view.row(i).iter().zip(plain.row(i)).all(is_rounded)));
        }
    }
}

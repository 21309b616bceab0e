//! Tall blocks of vectors and the products that the eigensolvers are made of.
//!
//! A block is row-major, so that a sparse row times a block reads whole cache lines. All sums run over a fixed
//! partition of the rows and are added in its order: the bits do not depend on the number of threads.

use faer::linalg::matmul::matmul;
use faer::{Accum, Mat, MatMut, MatRef, Par};
use rayon::prelude::*;

use super::scalar::Scalar;

/// Rows of one dense product: with 300 columns a chunk stays in the second-level cache.
const CHUNK_ROWS: usize = 512;

/// Partial sums of a Gram matrix; a fixed number, so that the result is independent of the threads.
const PARTIAL_SUMS: usize = 16;

/// `rows × columns` numbers, row-major, in a buffer `width ≥ columns` wide, in double or single precision. Small
/// matrices that blocks are multiplied by, and those that come of products of blocks, are always in double.
#[derive(Debug, Clone)]
pub struct Block<T = f64> {
    rows: usize,
    width: usize,
    columns: usize,
    values: Vec<T>,
}

impl<T: Scalar> Block<T> {
    /// A block of zeros with room for `width` columns, all in use.
    #[must_use]
    pub fn zeros(rows: usize, width: usize) -> Self {
        Self { rows, width, columns: width, values: vec![T::nearest(0.0); rows * width] }
    }

    /// Number of rows.
    #[must_use]
    pub fn rows(&self) -> usize {
        self.rows
    }

    /// Number of columns in use.
    #[must_use]
    pub fn columns(&self) -> usize {
        self.columns
    }

    /// Uses the first `columns` columns; those that come into use keep what the buffer holds.
    ///
    /// # Panics
    /// When the buffer is narrower.
    pub fn set_columns(&mut self, columns: usize) {
        assert!(columns <= self.width, "a block of width {} cannot hold {columns} columns", self.width);
        self.columns = columns;
    }

    /// Columns in use of row `i`.
    #[must_use]
    pub fn row(&self, i: usize) -> &[T] {
        &self.values[i * self.width..i * self.width + self.columns]
    }

    /// Column `j` as a vector.
    #[must_use]
    pub fn column(&self, j: usize) -> Vec<T> {
        (0..self.rows).map(|i| self.row(i)[j]).collect()
    }

    /// Changes every row in place, in parallel.
    pub fn for_each_row(&mut self, change: impl Fn(usize, &mut [T]) + Sync + Send) {
        let (width, columns) = (self.width, self.columns);
        self.values.par_chunks_mut(width * CHUNK_ROWS).enumerate().for_each(|(chunk, rows)| {
            for (k, row) in rows.chunks_mut(width).enumerate() {
                change(chunk * CHUNK_ROWS + k, &mut row[..columns]);
            }
        });
    }

    /// Changes every stretch of rows in place, in parallel: the number of its first row, and the rows, each
    /// `columns` numbers at the beginning of the block's width, which is passed on.
    pub(crate) fn for_each_stretch(&mut self, change: impl Fn(usize, &mut [T], usize) + Sync + Send) {
        let width = self.width;
        self.values
            .par_chunks_mut(width * CHUNK_ROWS)
            .enumerate()
            .for_each(|(chunk, rows)| change(chunk * CHUNK_ROWS, rows, width));
    }

    /// What `map` makes of `parts` stretches of rows, which it may change, in their order: the number of the first row, the
    /// rows, each `columns` numbers at the beginning of the block's width, which is passed on.
    pub(crate) fn map_stretches<R: Send>(
        &mut self,
        parts: usize,
        map: impl Fn(usize, &mut [T], usize) -> R + Sync + Send,
    ) -> Vec<R> {
        self.map_tiles(self.rows.div_ceil(parts).max(CHUNK_ROWS), map)
    }

    /// The same of stretches of so many rows.
    pub(super) fn map_tiles<R: Send>(
        &mut self,
        rows: usize,
        map: impl Fn(usize, &mut [T], usize) -> R + Sync + Send,
    ) -> Vec<R> {
        let width = self.width;
        let tiles = self.values.par_chunks_mut((width * rows).max(1)).enumerate();
        tiles.map(|(tile, values)| map(tile * rows, values, width)).collect()
    }

    /// What `change` makes of all rows, as long as the block is wide.
    pub(super) fn with_values<R>(&mut self, change: impl FnOnce(&mut [T]) -> R) -> R {
        change(&mut self.values)
    }

    /// Some rows, and how long they are: as long as the block is wide.
    pub(super) fn rows_from(&self, rows: std::ops::Range<usize>) -> (&[T], usize) {
        (&self.values[rows.start * self.width..rows.end * self.width], self.width)
    }

    /// Copies `count` columns of `source` from its column `from` to columns `to ..` of this block, rounded where it is of
    /// less precision.
    pub fn copy_columns<U: Scalar>(&mut self, to: usize, source: &Block<U>, from: usize, count: usize) {
        let width = self.width;
        self.values.par_chunks_mut(width * CHUNK_ROWS).enumerate().for_each(|(chunk, rows)| {
            for (k, row) in rows.chunks_mut(width).enumerate() {
                let source = &source.row(chunk * CHUNK_ROWS + k)[from..from + count];
                row[to..to + count].iter_mut().zip(source).for_each(|(x, &y)| *x = T::nearest(y.into()));
            }
        });
    }

    /// The first `columns` columns, in a buffer of their own width: what the others took is given back.
    ///
    /// # Panics
    /// When the block has fewer.
    #[must_use]
    pub fn into_first(mut self, columns: usize) -> Self {
        assert!(columns <= self.columns, "a block of {} columns has no first {columns}", self.columns);
        for i in 0..self.rows {
            self.values.copy_within(i * self.width..i * self.width + columns, i * columns);
        }
        self.values.truncate(self.rows * columns);
        // moves nothing: the end of a large buffer is unmapped
        self.values.shrink_to_fit();
        Self { width: columns, columns, ..self }
    }

    /// `count` columns from column `from` on.
    ///
    /// # Panics
    /// When the block has fewer.
    #[must_use]
    pub fn columns_from(&self, from: usize, count: usize) -> Columns<'_, T> {
        assert!(from + count <= self.columns, "no {count} columns from {from} of {}", self.columns);
        Columns { values: &self.values, width: self.width, from, count }
    }

    /// Columns `from ..` of some rows.
    pub(super) fn chunk(&self, rows: std::ops::Range<usize>, from: usize) -> MatRef<'_, T> {
        let values = &self.values[rows.start * self.width + from..];
        let columns = self.columns - from;
        MatRef::from_row_major_slice_with_stride(
            values_for(values, rows.len(), self.width, columns),
            rows.len(),
            columns,
            self.width,
        )
    }
}

/// Some neighboring columns of a block.
#[derive(Debug, Clone, Copy)]
pub struct Columns<'a, T> {
    values: &'a [T],
    width: usize,
    from: usize,
    count: usize,
}

impl<'a, T> Columns<'a, T> {
    /// How many there are.
    #[must_use]
    pub fn count(&self) -> usize {
        self.count
    }

    /// Row `i` of them.
    #[must_use]
    #[inline]
    pub fn row(&self, i: usize) -> &'a [T] {
        &self.values[i * self.width + self.from..][..self.count]
    }
}

/// The prefix of a row-major buffer that holds `rows` rows: the last row ends with its last column.
fn values_for<T>(values: &[T], rows: usize, width: usize, columns: usize) -> &[T] {
    &values[..(rows - 1) * width + columns]
}

/// A small matrix in the precision of a block.
fn rounded<T: Scalar>(m: MatRef<'_, f64>) -> Mat<T> {
    Mat::from_fn(m.nrows(), m.ncols(), |i, j| T::nearest(m[(i, j)]))
}

/// `AᵀB`, `a.columns × b.columns`.
#[must_use]
pub fn gram<T: Scalar>(a: &Block<T>, b: &Block) -> Mat<f64> {
    gram_from(a, 0, b)
}

/// The same with columns `from ..` of `A` only.
#[must_use]
pub fn gram_from<T: Scalar>(a: &Block<T>, from: usize, b: &Block) -> Mat<f64> {
    let n = a.rows;
    let share = n.div_ceil(PARTIAL_SUMS).max(CHUNK_ROWS);
    let starts: Vec<usize> = (0..n).step_by(share).collect();
    let partial: Vec<Mat<f64>> = starts
        .into_par_iter()
        .map(|start| {
            let mut sum = Mat::zeros(a.columns - from, b.columns);
            let mut product = Mat::<T>::zeros(a.columns - from, b.columns);
            let mut right = Vec::with_capacity(CHUNK_ROWS * b.columns);
            let end = n.min(start + share);
            for first in (start..end).step_by(CHUNK_ROWS) {
                let rows = first..end.min(first + CHUNK_ROWS);
                right.clear();
                for i in rows.clone() {
                    right.extend(b.row(i).iter().map(|&x| T::nearest(x)));
                }
                let left = a.chunk(rows.clone(), from);
                let right = MatRef::from_row_major_slice(&right, rows.len(), b.columns);
                matmul(&mut product, Accum::Replace, left.transpose(), right, T::nearest(1.0), Par::Seq);
                for j in 0..b.columns {
                    sum.col_mut(j).iter_mut().zip(product.col(j).iter()).for_each(|(s, &p)| *s += p.into());
                }
            }
            sum
        })
        .collect();
    let mut total = Mat::zeros(a.columns - from, b.columns);
    for sum in partial {
        total += sum;
    }
    total
}

/// `C += scale · A M` for a small matrix `M`, `a.columns × c.columns`.
pub fn add_product<T: Scalar>(c: &mut Block, scale: f64, a: &Block<T>, m: MatRef<'_, f64>) {
    add_product_from(c, scale, a, 0, m);
}

/// The same with columns `from ..` of `A` only.
pub fn add_product_from<T: Scalar>(c: &mut Block, scale: f64, a: &Block<T>, from: usize, m: MatRef<'_, f64>) {
    let (width, columns) = (c.width, c.columns);
    let m = rounded::<T>(m);
    c.values.par_chunks_mut(width * CHUNK_ROWS).enumerate().for_each_init(
        || vec![T::nearest(0.0); CHUNK_ROWS * columns],
        |product, (chunk, values)| {
            let rows = values.len() / width;
            let first = chunk * CHUNK_ROWS;
            let product = &mut product[..rows * columns];
            let target = MatMut::from_row_major_slice_mut(product, rows, columns);
            let left = a.chunk(first..first + rows, from);
            matmul(target, Accum::Replace, left, m.as_ref(), T::nearest(1.0), Par::Seq);
            for (row, product) in values.chunks_mut(width).zip(product.chunks_exact(columns)) {
                row.iter_mut().zip(product).for_each(|(x, &p)| *x += scale * p.into());
            }
        },
    );
}

/// `A ← A M` in place for `M` with at most as many columns as rows; the block then has `M`'s columns.
pub fn replace_by_product<T: Scalar>(a: &mut Block<T>, m: MatRef<'_, f64>) {
    let (width, columns) = (a.width, a.columns);
    let m = rounded::<T>(m);
    a.values.par_chunks_mut(width * CHUNK_ROWS).for_each_init(
        || vec![T::nearest(0.0); CHUNK_ROWS * m.ncols()],
        |product, values| {
            let rows = values.len() / width;
            let length = (rows - 1) * width + columns;
            let source = MatRef::from_row_major_slice_with_stride(&values[..length], rows, columns, width);
            let product = &mut product[..rows * m.ncols()];
            let target = MatMut::from_row_major_slice_mut(product, rows, m.ncols());
            matmul(target, Accum::Replace, source, m.as_ref(), T::nearest(1.0), Par::Seq);
            for (row, product) in values.chunks_mut(width).zip(product.chunks_exact(m.ncols())) {
                row[..m.ncols()].copy_from_slice(product);
            }
        },
    );
    a.set_columns(m.ncols());
}

/// Euclidean norms of the columns.
#[must_use]
pub fn column_norms(a: &Block) -> Vec<f64> {
    column_products(a, a).into_iter().map(f64::sqrt).collect()
}

/// Inner product of every column with the same of `b`.
#[must_use]
pub fn column_products(a: &Block, b: &Block) -> Vec<f64> {
    let share = a.rows.div_ceil(PARTIAL_SUMS).max(CHUNK_ROWS);
    let starts: Vec<usize> = (0..a.rows).step_by(share).collect();
    let partial: Vec<Vec<f64>> = starts
        .into_par_iter()
        .map(|start| {
            let mut sums = vec![0.0; a.columns];
            for i in start..a.rows.min(start + share) {
                for ((sum, x), y) in sums.iter_mut().zip(a.row(i)).zip(b.row(i)) {
                    *sum += x * y;
                }
            }
            sums
        })
        .collect();
    let mut total = vec![0.0; a.columns];
    for sums in partial {
        for (t, s) in total.iter_mut().zip(sums) {
            *t += s;
        }
    }
    total
}

#[cfg(test)]
mod tests {
    use super::*;

    fn block(rows: usize, columns: usize) -> Block {
        let mut block = Block::zeros(rows, columns);
        block.for_each_row(|i, row| {
            for (j, x) in row.iter_mut().enumerate() {
                *x = ((i * 31 + j * 17 + 7) % 101) as f64 / 50.0 - 1.0;
            }
        });
        block
    }

    #[test]
    fn the_first_columns_keep_their_numbers() {
        let whole = block(1_100, 7);
        let first = whole.clone().into_first(3);
        assert_eq!((first.rows(), first.columns()), (1_100, 3));
        assert!((0..1_100).all(|i| first.row(i) == &whole.row(i)[..3]));
    }

    #[test]
    fn the_gram_matrix_has_the_same_bits_on_one_thread_and_on_three() {
        let (a, b) = (block(20_011, 7), block(20_011, 5));
        let on = |threads| {
            rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap().install(|| gram(&a, &b))
        };
        let (one, three) = (on(1), on(3));
        assert_eq!(one, three);
        let expected: f64 = (0..a.rows()).map(|i| a.row(i)[3] * b.row(i)[2]).sum();
        assert!((one[(3, 2)] - expected).abs() < 1e-9 * expected.abs().max(1.0));
    }

    #[test]
    fn products_with_a_block_in_single_precision_are_those_of_its_rounded_numbers() {
        let (whole, b) = (block(1_300, 4), block(1_300, 2));
        let mut a = Block::<f32>::zeros(1_300, 4);
        a.copy_columns(0, &whole, 0, 4);
        let mut back = Block::<f64>::zeros(1_300, 4);
        back.copy_columns(0, &a, 0, 4);
        assert!((0..1_300).all(|i| back.row(i).iter().zip(whole.row(i)).all(|(x, y)| (x - y).abs() < 1e-7)));
        let (single, double) = (gram_from(&a, 1, &b), gram_from(&back, 1, &b));
        assert!((&single - &double).norm_max() < 1e-5 * double.norm_max() && single != double);
        let m = Mat::from_fn(4, 2, |i, j| (i + 2 * j) as f64 - 1.5);
        let (mut one, mut other) = (b.clone(), b);
        add_product(&mut one, 2.0, &a, m.as_ref());
        add_product(&mut other, 2.0, &back, m.as_ref());
        replace_by_product(&mut a, m.as_ref());
        replace_by_product(&mut back, m.as_ref());
        for i in [0, 511, 512, 1_299] {
            for j in 0..2 {
                assert!((one.row(i)[j] - other.row(i)[j]).abs() < 1e-5);
                assert!((f64::from(a.row(i)[j]) - back.row(i)[j]).abs() < 1e-5);
            }
        }
    }

    #[test]
    fn products_agree_with_their_definition() {
        let a = block(1_300, 4);
        let m = Mat::from_fn(4, 2, |i, j| (i + 2 * j) as f64 - 1.5);
        let mut c = Block::zeros(1_300, 2);
        add_product(&mut c, 2.0, &a, m.as_ref());
        let mut replaced = a.clone();
        replace_by_product(&mut replaced, m.as_ref());
        for i in [0, 511, 512, 1_299] {
            for j in 0..2 {
                let expected: f64 = (0..4).map(|k| a.row(i)[k] * m[(k, j)]).sum();
                assert!((replaced.row(i)[j] - expected).abs() < 1e-14);
                assert!((c.row(i)[j] - 2.0 * expected).abs() < 1e-14);
            }
        }
    }
}

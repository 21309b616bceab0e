//! The product of a sparse matrix with a block of vectors, and what solvers do with it while it is at hand.

#![expect(clippy::inline_always, reason = "functions of another instruction set are not inlined otherwise")]

use pulp::{Arch, Simd, WithSimd};

use super::block::{Block, Columns};
use super::scalar::Scalar;
use crate::operator::Sparse;

/// A sparse matrix that vectors are multiplied by, its values in either precision.
pub trait Matrix<T>: Copy + Sync {
    /// Columns and values of the entries of row `i`.
    fn row(&self, i: usize) -> (&[u32], &[T]);
}

/// The rows of a sparse matrix, its values in either precision.
#[derive(Debug, Clone, Copy)]
pub struct Rows<'a, T> {
    /// Where every row begins, and the last one ends.
    pub offsets: &'a [usize],
    /// Columns of all entries.
    pub columns: &'a [u32],
    /// Values of all entries.
    pub values: &'a [T],
}

impl<'a> Rows<'a, f64> {
    /// Those of a matrix.
    #[must_use]
    pub fn of(matrix: &'a Sparse) -> Self {
        Self { offsets: matrix.offsets(), columns: matrix.columns(), values: matrix.values() }
    }
}

impl<T: Scalar> Matrix<T> for Rows<'_, T> {
    #[inline(always)]
    fn row(&self, i: usize) -> (&[u32], &[T]) {
        let span = self.offsets[i]..self.offsets[i + 1];
        (&self.columns[span.clone()], &self.values[span])
    }
}

/// What becomes of a product `A x`.
#[derive(Debug, Clone, Copy)]
pub enum Finish<'a, T> {
    /// `A x`.
    Product,
    /// `A x − μ x`, with a `μ` for every column.
    Residual(&'a [T]),
    /// `r − A x`.
    Defect(Columns<'a, T>),
    /// `x + s (r − A x)`, with an `s` for every row.
    Relaxed(Columns<'a, T>, &'a [T]),
}

/// `Y = A X` for a sparse `A`; `Y` takes `X`'s number of columns.
pub fn sparse_product(y: &mut Block, a: &Sparse, x: &Block) {
    finished_product(y, Rows::of(a), x.columns_from(0, x.columns()), Finish::Product);
}

/// The same of columns of a block, in either precision, finished as told.
pub fn finished_product<T: Scalar>(
    y: &mut Block<T>,
    a: impl Matrix<T>,
    x: Columns<'_, T>,
    finish: Finish<'_, T>,
) {
    y.set_columns(x.count());
    let arch = Arch::new();
    y.for_each_stretch(|first, rows, width| {
        arch.dispatch(Stretch { a, x, finish, first, rows, width });
    });
}

/// Rows `first ..` of `A X`, as many as `rows` has room for, each at the beginning of `width` numbers.
pub(super) fn product_of_rows<T: Scalar>(
    a: Rows<'_, T>,
    x: Columns<'_, T>,
    first: usize,
    rows: &mut [T],
    width: usize,
) {
    Arch::new().dispatch(Stretch { a, x, finish: Finish::Product, first, rows, width });
}

/// Some rows of a product, the first of them number `first`, every one at the beginning of `width` numbers.
struct Stretch<'a, 'y, A, T> {
    a: A,
    x: Columns<'a, T>,
    finish: Finish<'a, T>,
    first: usize,
    rows: &'y mut [T],
    width: usize,
}

impl<T: Scalar, A: Matrix<T>> WithSimd for Stretch<'_, '_, A, T> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { a, x, finish, first, rows, width } = self;
        for (k, row) in rows.chunks_mut(width).enumerate() {
            let product = Product { simd, x, finish, row: first + k, entries: a.row(first + k) };
            let row = &mut row[..x.count()];
            let whole = row.len() / T::lanes::<S>();
            let (vectors, rest) = row.split_at_mut(whole * T::lanes::<S>());
            let vectors = T::vectors_mut::<S>(vectors);
            // sums of many columns stay in registers while the row's entries pass by
            let mut p = 0;
            while p + 8 <= whole {
                product.columns::<8>(&mut vectors[p..], p);
                p += 8;
            }
            if p + 4 <= whole {
                product.columns::<4>(&mut vectors[p..], p);
                p += 4;
            }
            if p + 2 <= whole {
                product.columns::<2>(&mut vectors[p..], p);
                p += 2;
            }
            if p < whole {
                product.columns::<1>(&mut vectors[p..], p);
            }
            product.rest(rest, whole * T::lanes::<S>());
        }
    }
}

/// One row of a product.
struct Product<'a, T, S> {
    simd: S,
    x: Columns<'a, T>,
    finish: Finish<'a, T>,
    row: usize,
    entries: (&'a [u32], &'a [T]),
}

impl<T: Scalar, S: Simd> Product<'_, T, S> {
    /// `P` vectors of columns, from the `p`-th on.
    #[inline(always)]
    fn columns<const P: usize>(&self, out: &mut [T::Vector<S>], p: usize) {
        let Self { simd, x, finish, row, entries } = *self;
        let vectors = |columns: Columns<'_, T>, i: usize| -> [T::Vector<S>; P] {
            let row = &T::vectors::<S>(columns.row(i))[p..p + P];
            std::array::from_fn(|k| row[k])
        };
        let mut sums = [T::splat(simd, T::nearest(0.0)); P];
        for (&j, &value) in entries.0.iter().zip(entries.1) {
            let value = T::splat(simd, value);
            let row = &T::vectors::<S>(x.row(j as usize))[p..p + P];
            for (sum, x) in sums.iter_mut().zip(row) {
                *sum = T::mul_add(simd, value, *x, *sum);
            }
        }
        match finish {
            Finish::Product => {}
            Finish::Residual(mu) => {
                let (x, mu) = (vectors(x, row), &T::vectors::<S>(mu)[p..p + P]);
                for ((sum, x), mu) in sums.iter_mut().zip(x).zip(mu) {
                    *sum = T::minus(simd, *sum, T::times(simd, *mu, x));
                }
            }
            Finish::Defect(right) => {
                for (sum, r) in sums.iter_mut().zip(vectors(right, row)) {
                    *sum = T::minus(simd, r, *sum);
                }
            }
            Finish::Relaxed(right, scale) => {
                let scale = T::splat(simd, scale[row]);
                for ((sum, r), x) in sums.iter_mut().zip(vectors(right, row)).zip(vectors(x, row)) {
                    *sum = T::mul_add(simd, scale, T::minus(simd, r, *sum), x);
                }
            }
        }
        out[..P].copy_from_slice(&sums);
    }

    /// Columns that fill no vector, from column `from` on, together as far as they can be.
    #[inline(always)]
    fn rest(&self, out: &mut [T], from: usize) {
        let (eights, others) = out.as_chunks_mut::<8>();
        let next = from + 8 * eights.len();
        for (k, out) in eights.iter_mut().enumerate() {
            self.some(out, from + 8 * k);
        }
        for (k, out) in others.iter_mut().enumerate() {
            self.some(std::array::from_mut(out), next + k);
        }
    }

    /// `P` columns, from column `from` on.
    #[inline(always)]
    fn some<const P: usize>(&self, out: &mut [T; P], from: usize) {
        let Self { x, finish, row, entries, .. } = *self;
        let some = |columns: Columns<'_, T>, i: usize| -> [T; P] {
            let row = &columns.row(i)[from..from + P];
            std::array::from_fn(|k| row[k])
        };
        let mut sums = [T::nearest(0.0); P];
        for (&i, &value) in entries.0.iter().zip(entries.1) {
            for (sum, x) in sums.iter_mut().zip(some(x, i as usize)) {
                *sum += value * x;
            }
        }
        *out = match finish {
            Finish::Product => sums,
            Finish::Residual(mu) => {
                let own = some(x, row);
                std::array::from_fn(|k| sums[k] - mu[from + k] * own[k])
            }
            Finish::Defect(right) => {
                let right = some(right, row);
                std::array::from_fn(|k| right[k] - sums[k])
            }
            Finish::Relaxed(right, scale) => {
                let (own, right) = (some(x, row), some(right, row));
                std::array::from_fn(|k| own[k] + scale[row] * (right[k] - sums[k]))
            }
        };
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::spectrum::vectors::start;

    const N: usize = 1_100;

    fn matrix() -> Sparse {
        let weights = |i: usize, (): &mut (), row: &mut Vec<(u32, f64)>| {
            row.extend([i / 3, i, (i * 7 + 5) % N].map(|j| (j as u32, (i + j) as f64 / N as f64)));
            row.sort_unstable_by_key(|&(j, _)| j);
            row.dedup_by_key(|(j, _)| *j);
        };
        Sparse::from_rows(N, || (), weights, |_| Ok::<_, std::convert::Infallible>(())).unwrap()
    }

    #[test]
    fn every_number_of_columns_gives_the_sums_of_the_definition() {
        let a = matrix();
        for columns in [1, 3, 8, 31, 64, 121] {
            let mut x = Block::zeros(N, columns);
            start::fill(&mut x, 0);
            let mut y = Block::zeros(N, columns + 2);
            sparse_product(&mut y, &a, &x);
            assert_eq!(y.columns(), columns);
            for j in [0, columns / 2, columns - 1] {
                let expected = a.product(&x.column(j));
                assert!(y.column(j).iter().zip(&expected).all(|(y, e)| (y - e).abs() < 1e-13));
            }
        }
    }

    #[test]
    fn products_of_some_columns_are_finished_as_told_in_single_precision() {
        let a = matrix();
        let (count, from) = (43, 5);
        let [mut x, mut r] = [0, 100].map(|_| Block::<f32>::zeros(N, count + 9));
        let mut hashed = Block::zeros(N, count + 9);
        start::fill(&mut hashed, 0);
        x.copy_columns(0, &hashed, 0, count + 9);
        start::fill(&mut hashed, 100);
        r.copy_columns(0, &hashed, 0, count + 9);
        let values: Vec<f32> = a.values().iter().map(|&value| value as f32).collect();
        let rows = Rows { offsets: a.offsets(), columns: a.columns(), values: &values };
        let mu: Vec<f32> = (0..count).map(|j| 0.1 * j as f32).collect();
        let scale: Vec<f32> = (0..N).map(|i| 1.0 / (1.0 + i as f32)).collect();
        let mut y = Block::<f32>::zeros(N, count);
        let (some, right) = (x.columns_from(from, count), r.columns_from(from, count));
        for (which, finish) in
            [Finish::Residual(&mu), Finish::Defect(right), Finish::Relaxed(right, &scale)].iter().enumerate()
        {
            finished_product(&mut y, rows, some, *finish);
            for j in [0, 17, count - 1] {
                let column: Vec<f64> = x.column(from + j).into_iter().map(f64::from).collect();
                for (i, product) in a.product(&column).into_iter().enumerate() {
                    let (x, r) = (column[i], f64::from(r.row(i)[from + j]));
                    let expected = match which {
                        0 => product - f64::from(mu[j]) * x,
                        1 => r - product,
                        _ => x + f64::from(scale[i]) * (r - product),
                    };
                    assert!((f64::from(y.row(i)[j]) - expected).abs() < 1e-5, "{which} {i} {j}");
                }
            }
        }
    }
}

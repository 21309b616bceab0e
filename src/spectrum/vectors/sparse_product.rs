//! The product of a sparse matrix with a block of vectors.

#![expect(clippy::inline_always, reason = "functions of another instruction set are not inlined otherwise")]

use pulp::{Arch, Simd, WithSimd};

use super::block::Block;
use crate::operator::Sparse;

/// `Y = A X` for a sparse `A`; `Y` takes `X`'s number of columns.
pub fn sparse_product(y: &mut Block, a: &Sparse, x: &Block) {
    y.set_columns(x.columns());
    let arch = Arch::new();
    y.for_each_stretch(|first, rows, width| arch.dispatch(Stretch { a, x, first, rows, width }));
}

/// Some rows of a product, the first of them number `first`, every one at the beginning of `width` numbers.
struct Stretch<'a> {
    a: &'a Sparse,
    x: &'a Block,
    first: usize,
    rows: &'a mut [f64],
    width: usize,
}

impl WithSimd for Stretch<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        for (k, row) in self.rows.chunks_mut(self.width).enumerate() {
            let entries = self.a.row(self.first + k);
            let (vectors, rest) = S::as_mut_simd_f64s(&mut row[..self.x.columns()]);
            // sums of many columns stay in registers while the row's entries pass by
            let mut p = 0;
            while p + 8 <= vectors.len() {
                columns_of_product::<S, 8>(simd, &mut vectors[p..], entries, self.x, p);
                p += 8;
            }
            if p + 4 <= vectors.len() {
                columns_of_product::<S, 4>(simd, &mut vectors[p..], entries, self.x, p);
                p += 4;
            }
            if p + 2 <= vectors.len() {
                columns_of_product::<S, 2>(simd, &mut vectors[p..], entries, self.x, p);
                p += 2;
            }
            if p < vectors.len() {
                columns_of_product::<S, 1>(simd, &mut vectors[p..], entries, self.x, p);
            }
            let done = self.x.columns() - rest.len();
            for (j, y) in (done..).zip(rest) {
                *y = 0.0;
                for (&i, &value) in entries.0.iter().zip(entries.1) {
                    *y += value * self.x.row(i as usize)[j];
                }
            }
        }
    }
}

/// `P` vectors of columns of one row of a product, from the `p`-th on.
#[inline(always)]
fn columns_of_product<S: Simd, const P: usize>(
    simd: S,
    out: &mut [S::f64s],
    (columns, values): (&[u32], &[f64]),
    x: &Block,
    p: usize,
) {
    let mut sums = [simd.splat_f64s(0.0); P];
    for (&j, &value) in columns.iter().zip(values) {
        let value = simd.splat_f64s(value);
        let row = &S::as_simd_f64s(x.row(j as usize)).0[p..p + P];
        for (sum, x) in sums.iter_mut().zip(row) {
            *sum = simd.mul_add_f64s(value, *x, *sum);
        }
    }
    out[..P].copy_from_slice(&sums);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::spectrum::vectors::start;

    #[test]
    fn every_number_of_columns_gives_the_sums_of_the_definition() {
        let n = 1_100;
        let weights = |i: usize, (): &mut (), row: &mut Vec<(u32, f64)>| {
            row.extend([i / 3, i, (i * 7 + 5) % n].map(|j| (j as u32, (i + j) as f64 / n as f64)));
            row.sort_unstable_by_key(|&(j, _)| j);
            row.dedup_by_key(|(j, _)| *j);
        };
        let a = Sparse::from_rows(n, || (), weights, |_| Ok::<_, std::convert::Infallible>(())).unwrap();
        for columns in [1, 3, 8, 31, 64, 121] {
            let mut x = Block::zeros(n, columns);
            start::fill(&mut x, 0);
            let mut y = Block::zeros(n, columns + 2);
            sparse_product(&mut y, &a, &x);
            assert_eq!(y.columns(), columns);
            for j in [0, columns / 2, columns - 1] {
                let expected = a.product(&x.column(j));
                assert!(y.column(j).iter().zip(&expected).all(|(y, e)| (y - e).abs() < 1e-13));
            }
        }
    }
}

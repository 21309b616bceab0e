//! Forward and backward substitution with a supernodal Cholesky factor, many right-hand sides in one pass.
//!
//! Most supernodes of a surface's operator have a few columns, where the calls of a dense library cost more than their
//! arithmetic. Here the right-hand sides lie side by side, and the factor is read once for all of them.

#![expect(clippy::inline_always, reason = "functions of another instruction set are not inlined otherwise")]

use faer::sparse::linalg::cholesky::supernodal::SymbolicSupernodalCholesky;
use pulp::{Arch, Simd, WithSimd};

/// Most right-hand sides of one pass: the more, the fewer readings of the factor, as long as they stay in cache.
pub(super) const WIDTH_MAX: usize = 16;

/// Widths are multiples of this, the longest vector of any processor.
pub(super) const WIDTH_MIN: usize = 8;

/// Columns of a supernode that are eliminated before the rest of it is brought up to date.
const STRETCH: usize = 16;

/// A factor's values, and the places of the negative signs in `L S Lᵀ`.
#[derive(Clone, Copy)]
pub(super) struct Signed<'a> {
    pub(super) values: &'a [f64],
    pub(super) negative: &'a [u32],
}

/// `X ← (L S Lᵀ)⁻¹ X`; `x` has `width` numbers for every row, in elimination order.
///
/// # Panics
/// Unless `width` is [`WIDTH_MIN`] or [`WIDTH_MAX`].
pub(super) fn solve(
    symbolic: &SymbolicSupernodalCholesky<u32>,
    factor: Signed<'_>,
    x: &mut [f64],
    width: usize,
) {
    assert!([WIDTH_MIN, WIDTH_MAX].contains(&width), "{width} right-hand sides are no whole vectors");
    Arch::new().dispatch(Substitution { symbolic, factor, x, width });
}

struct Substitution<'a> {
    symbolic: &'a SymbolicSupernodalCholesky<u32>,
    factor: Signed<'a>,
    x: &'a mut [f64],
    width: usize,
}

impl WithSimd for Substitution<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        // as many sums as hide the latency of an addition, and fit the registers: 32 with the longest vectors, else 16
        match (S::F64_LANES, self.width / S::F64_LANES) {
            (_, 1) => self.tiled::<S, 8, 1>(simd),
            (8, _) => self.tiled::<S, 8, 2>(simd),
            _ => self.tiled::<S, 4, 2>(simd),
        }
    }
}

impl Substitution<'_> {
    /// By tiles of `TILE` rows, or columns, of the factor times `PANEL` vectors of right-hand sides.
    #[inline(always)]
    fn tiled<S: Simd, const TILE: usize, const PANEL: usize>(self, simd: S) {
        let (x, _) = S::as_mut_simd_f64s(self.x);
        let lanes = Lanes { simd, v: self.width / S::F64_LANES };
        let nodes = self.symbolic.n_supernodes();
        for s in 0..nodes {
            forward::<S, TILE, PANEL>(lanes, &Supernode::of(self.symbolic, self.factor.values, s), x);
        }
        for &place in self.factor.negative {
            for x in &mut x[place as usize * lanes.v..][..lanes.v] {
                *x = simd.neg_f64s(*x);
            }
        }
        for s in (0..nodes).rev() {
            backward::<S, TILE, PANEL>(lanes, &Supernode::of(self.symbolic, self.factor.values, s), x);
        }
    }
}

/// The instruction set, and how many of its vectors make a row of right-hand sides.
#[derive(Clone, Copy)]
struct Lanes<S> {
    simd: S,
    v: usize,
}

/// Some consecutive columns of the factor that share the rows of their entries.
struct Supernode<'a> {
    /// First of its columns.
    start: usize,
    /// Number of its columns.
    width: usize,
    /// Rows of the entries below its own columns.
    below: &'a [u32],
    /// Entries of its own columns, then those below, column by column.
    values: &'a [f64],
}

impl<'a> Supernode<'a> {
    fn of(symbolic: &'a SymbolicSupernodalCholesky<u32>, factor: &'a [f64], s: usize) -> Self {
        let span = |bounds: &[u32]| bounds[s] as usize..bounds[s + 1] as usize;
        let start = symbolic.supernode_begin()[s] as usize;
        let below = &symbolic.row_idx()[symbolic.col_ptr_for_row_idx()[s] as usize..];
        Self {
            start,
            width: symbolic.supernode_end()[s] as usize - start,
            below: &below[..symbolic.nnz_per_super()[s] as usize],
            values: &factor[span(symbolic.col_ptr_for_val())],
        }
    }

    fn end(&self) -> usize {
        self.start + self.width
    }

    /// Entries of its `k`-th column.
    #[inline(always)]
    fn column(&self, k: usize) -> &'a [f64] {
        let height = self.width + self.below.len();
        &self.values[k * height..(k + 1) * height]
    }
}

/// Eliminates the columns of a supernode from the rows after them.
#[inline(always)]
fn forward<S: Simd, const TILE: usize, const PANEL: usize>(
    lanes: Lanes<S>,
    node: &Supernode<'_>,
    x: &mut [S::f64s],
) {
    let Lanes { simd, v } = lanes;
    let (head, below) = x.split_at_mut(node.end() * v);
    let own = &mut head[node.start * v..];
    for first in (0..node.width).step_by(STRETCH) {
        let end = node.width.min(first + STRETCH);
        for j in first..end {
            let column = node.column(j);
            let (solved, rest) = own.split_at_mut((j + 1) * v);
            let pivot = &mut solved[j * v..];
            let inverse = simd.splat_f64s(1.0 / column[j]);
            for x in pivot.iter_mut() {
                *x = simd.mul_f64s(inverse, *x);
            }
            for (row, &l) in rest.chunks_exact_mut(v).zip(&column[j + 1..end]) {
                let l = simd.splat_f64s(-l);
                for (x, p) in row.iter_mut().zip(&*pivot) {
                    *x = simd.mul_add_f64s(l, *p, *x);
                }
            }
        }
        let (solved, rest) = own.split_at_mut(end * v);
        subtract::<S, TILE, PANEL>(
            lanes,
            node,
            first..end,
            &solved[first * v..],
            end..node.width,
            rest,
            |i| i - end,
        );
    }
    let places = |i: usize| node.below[i - node.width] as usize - node.end();
    subtract::<S, TILE, PANEL>(
        lanes,
        node,
        0..node.width,
        own,
        node.width..node.width + node.below.len(),
        below,
        places,
    );
}

/// `sum += l x`.
#[inline(always)]
fn add<S: Simd, const PANEL: usize>(simd: S, sum: &mut [S::f64s; PANEL], l: f64, x: &[S::f64s]) {
    let l = simd.splat_f64s(l);
    for (sum, x) in sum.iter_mut().zip(x) {
        *sum = simd.mul_add_f64s(l, *x, *sum);
    }
}

/// `target[place(i)] −= Σ L[i, k] · solved[k]` over the columns `columns`, for the rows `rows` of a supernode.
#[inline(always)]
fn subtract<S: Simd, const TILE: usize, const PANEL: usize>(
    lanes: Lanes<S>,
    node: &Supernode<'_>,
    columns: std::ops::Range<usize>,
    solved: &[S::f64s],
    rows: std::ops::Range<usize>,
    target: &mut [S::f64s],
    place: impl Fn(usize) -> usize,
) {
    let Lanes { simd, v } = lanes;
    let mut i = rows.start;
    while i + TILE <= rows.end {
        for panel in (0..v).step_by(PANEL) {
            let mut sums = [[simd.splat_f64s(0.0); PANEL]; TILE];
            for (k, x) in columns.clone().zip(solved.chunks_exact(v)) {
                let entries = &node.column(k)[i..i + TILE];
                for (sum, &l) in sums.iter_mut().zip(entries) {
                    add(simd, sum, l, &x[panel..panel + PANEL]);
                }
            }
            for (r, sum) in sums.iter().enumerate() {
                let row = &mut target[place(i + r) * v + panel..][..PANEL];
                for (x, s) in row.iter_mut().zip(sum) {
                    *x = simd.sub_f64s(*x, *s);
                }
            }
        }
        i += TILE;
    }
    for i in i..rows.end {
        for panel in (0..v).step_by(PANEL) {
            let row = &mut target[place(i) * v + panel..][..PANEL];
            let mut sum: [S::f64s; PANEL] = std::array::from_fn(|p| row[p]);
            for (k, x) in columns.clone().zip(solved.chunks_exact(v)) {
                add(simd, &mut sum, -node.column(k)[i], &x[panel..panel + PANEL]);
            }
            row.copy_from_slice(&sum);
        }
    }
}

/// Solves for the rows of a supernode, given those after them.
#[inline(always)]
fn backward<S: Simd, const TILE: usize, const PANEL: usize>(
    lanes: Lanes<S>,
    node: &Supernode<'_>,
    x: &mut [S::f64s],
) {
    let Lanes { simd, v } = lanes;
    let (head, below) = x.split_at_mut(node.end() * v);
    let own = &mut head[node.start * v..];
    let places = |i: usize| node.below[i - node.width] as usize - node.end();
    subtract_transposed::<S, TILE, PANEL>(
        lanes,
        node,
        0..node.width,
        own,
        node.width..node.width + node.below.len(),
        below,
        places,
    );
    for first in (0..node.width).step_by(STRETCH).rev() {
        let end = node.width.min(first + STRETCH);
        let (part, solved) = own.split_at_mut(end * v);
        let part = &mut part[first * v..];
        subtract_transposed::<S, TILE, PANEL>(lanes, node, first..end, part, end..node.width, solved, |i| {
            i - end
        });
        for j in (first..end).rev() {
            let column = node.column(j);
            let (before, solved) = part.split_at_mut((j + 1 - first) * v);
            let pivot = &mut before[(j - first) * v..];
            for (row, &l) in solved.chunks_exact(v).zip(&column[j + 1..end]) {
                let l = simd.splat_f64s(-l);
                for (p, x) in pivot.iter_mut().zip(row) {
                    *p = simd.mul_add_f64s(l, *x, *p);
                }
            }
            let inverse = simd.splat_f64s(1.0 / column[j]);
            for x in pivot.iter_mut() {
                *x = simd.mul_f64s(inverse, *x);
            }
        }
    }
}

/// `target[k] −= Σ L[i, k] · solved[place(i)]` over the rows `rows`, for the columns `columns` of a supernode.
#[inline(always)]
fn subtract_transposed<S: Simd, const TILE: usize, const PANEL: usize>(
    lanes: Lanes<S>,
    node: &Supernode<'_>,
    columns: std::ops::Range<usize>,
    target: &mut [S::f64s],
    rows: std::ops::Range<usize>,
    solved: &[S::f64s],
    place: impl Fn(usize) -> usize,
) {
    let Lanes { simd, v } = lanes;
    let mut tiles = target.chunks_exact_mut(TILE * v);
    let mut k = columns.start;
    for tile in &mut tiles {
        let entries: [&[f64]; TILE] = std::array::from_fn(|c| &node.column(k + c)[rows.clone()]);
        for panel in (0..v).step_by(PANEL) {
            let mut sums = [[simd.splat_f64s(0.0); PANEL]; TILE];
            for (n, i) in rows.clone().enumerate() {
                let x = &solved[place(i) * v + panel..][..PANEL];
                for (sum, entries) in sums.iter_mut().zip(&entries) {
                    add(simd, sum, entries[n], x);
                }
            }
            for (row, sum) in tile.chunks_exact_mut(v).zip(&sums) {
                let row = &mut row[panel..panel + PANEL];
                for (x, s) in row.iter_mut().zip(sum) {
                    *x = simd.sub_f64s(*x, *s);
                }
            }
        }
        k += TILE;
    }
    for (k, row) in (k..columns.end).zip(tiles.into_remainder().chunks_exact_mut(v)) {
        let entries = &node.column(k)[rows.clone()];
        for panel in (0..v).step_by(PANEL) {
            let row = &mut row[panel..panel + PANEL];
            let mut sum: [S::f64s; PANEL] = std::array::from_fn(|p| row[p]);
            for (&l, i) in entries.iter().zip(rows.clone()) {
                add(simd, &mut sum, -l, &solved[place(i) * v + panel..][..PANEL]);
            }
            row.copy_from_slice(&sum);
        }
    }
}

#[cfg(test)]
mod tests {
    use crate::operator::Sparse;
    use crate::spectrum::block::Block;
    use crate::spectrum::cholesky::Symbolic;
    use crate::spectrum::sparse_product::sparse_product;
    use crate::spectrum::start;

    /// Every point of a ring coupled to the next `reach`: with few points and many couplings one supernode of many
    /// columns, otherwise many narrow ones.
    fn ring(n: usize, reach: usize) -> Sparse {
        let weights = |i: usize, (): &mut (), row: &mut Vec<(u32, f64)>| {
            row.extend((1..=reach).flat_map(|d| [(i + d) % n, (i + n - d) % n]).map(|j| (j as u32, 1.0)));
            row.sort_unstable_by_key(|&(j, _)| j);
            row.dedup_by_key(|(j, _)| *j);
        };
        Sparse::stiffness(n, || (), weights, |_| Ok::<_, std::convert::Infallible>(())).unwrap()
    }

    #[test]
    fn solutions_satisfy_their_equations_for_any_number_of_right_hand_sides() {
        for (n, reach) in [(5, 1), (40, 19), (123, 30), (700, 2), (700, 45)] {
            let matrix = ring(n, reach);
            let symbolic = Symbolic::analyze(&matrix, (0..n as u32).rev().collect()).unwrap();
            let factor = symbolic.factor(&matrix, 0.5).unwrap();
            for columns in [1, 8, 13, 16, 17, 40] {
                let mut b = Block::zeros(n, columns);
                start::fill(&mut b, 0);
                let mut x = b.clone();
                factor.solve(&mut x);
                let mut product = Block::zeros(n, columns);
                sparse_product(&mut product, &matrix, &x);
                for i in 0..n {
                    for j in 0..columns {
                        let found = product.row(i)[j] + 0.5 * x.row(i)[j];
                        assert!((found - b.row(i)[j]).abs() < 1e-11, "{n} {reach} {columns}: {i} {j}");
                    }
                }
            }
        }
    }
}

//! Passes through the supernodes of a factor with many right-hand sides.
//!
//! Most supernodes of a surface's operator have a few columns, where the calls of a dense library cost more than their
//! arithmetic. Here the right-hand sides lie side by side, and the factor is read once for all of them.

#![expect(clippy::inline_always, reason = "functions of another instruction set are not inlined otherwise")]

use std::marker::PhantomData;
use std::ops::Range;

use pulp::{Arch, Simd, WithSimd};

use super::factorization::Factor;
use super::supernodes::{Supernode, Supernodes};
use crate::spectrum::vectors::scalar::Scalar;

/// Columns of a supernode that are eliminated before the rest of it is brought up to date.
const STRETCH: usize = 16;

/// Numbers of a vector of this processor.
pub(super) fn lanes<T: Scalar>() -> usize {
    Arch::new().dispatch(LanesOf::<T>(PhantomData))
}

struct LanesOf<T>(PhantomData<T>);

impl<T: Scalar> WithSimd for LanesOf<T> {
    type Output = usize;

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> usize {
        T::lanes::<S>()
    }
}

#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Direction {
    /// `X ← S L⁻¹ X`.
    Forward,
    /// `X ← L⁻ᵀ X`.
    Backward,
}

/// Some supernodes' share of a substitution.
pub(super) struct Stage<'a, T> {
    pub(super) nodes: &'a Supernodes,
    pub(super) factor: &'a Factor<T>,
    /// First row of the part, or none for the supernodes in none of them.
    pub(super) first: Option<usize>,
    /// Right-hand sides.
    pub(super) width: usize,
}

impl<T: Scalar> Stage<'_, T> {
    /// `x` are the rows of these supernodes. Forward, what they take from the rows that all parts have in common is
    /// added to `above`; backward, `top` are these rows, solved.
    pub(super) fn run(
        &self,
        supernodes: impl DoubleEndedIterator<Item = usize>,
        direction: Direction,
        x: &mut [T],
        above: &mut [T],
        top: &[T],
    ) {
        Arch::new().dispatch(Pass { stage: self, supernodes, direction, x, above, top });
    }

    /// Where row `row` of the matrix is in `x`.
    #[inline(always)]
    fn place(&self, row: usize) -> usize {
        self.first.map_or_else(|| self.nodes.top_place(row), |first| row - first)
    }

    /// Rows below a supernode's own that are in `x` too.
    #[inline(always)]
    fn rows_in(&self, below: &[u32], rows: usize) -> usize {
        match self.first {
            Some(first) => below.partition_point(|&row| (row as usize) < first + rows),
            None => below.len(),
        }
    }
}

struct Pass<'a, T, I> {
    stage: &'a Stage<'a, T>,
    supernodes: I,
    direction: Direction,
    x: &'a mut [T],
    above: &'a mut [T],
    top: &'a [T],
}

impl<T: Scalar, I: DoubleEndedIterator<Item = usize>> WithSimd for Pass<'_, T, I> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        // as many sums as hide the latency of an addition, and fit the registers: 32 with the longest vectors, else 16
        match (S::F64_LANES, self.stage.width / T::lanes::<S>()) {
            (_, 1) => self.tiled::<S, 8, 1>(simd),
            (8, 4) => self.tiled::<S, 4, 4>(simd),
            (8, _) => self.tiled::<S, 8, 2>(simd),
            _ => self.tiled::<S, 4, 2>(simd),
        }
    }
}

impl<T: Scalar, I: DoubleEndedIterator<Item = usize>> Pass<'_, T, I> {
    /// By tiles of `TILE` rows, or columns, of the factor times `PANEL` vectors of right-hand sides.
    #[inline(always)]
    fn tiled<S: Simd, const TILE: usize, const PANEL: usize>(self, simd: S) {
        let Self { stage, supernodes, direction, x, above, top } = self;
        let x = T::vectors_mut::<S>(x);
        let above = T::vectors_mut::<S>(above);
        let top = T::vectors::<S>(top);
        let lanes = Lanes { simd, v: stage.width / T::lanes::<S>() };
        // loops, for closures passed on would lose the instruction set
        match direction {
            Direction::Forward => {
                for s in supernodes {
                    forward::<T, S, TILE, PANEL>(lanes, stage, s, x, above);
                }
            }
            Direction::Backward => {
                for s in supernodes.rev() {
                    backward::<T, S, TILE, PANEL>(lanes, stage, s, x, top);
                }
            }
        }
    }
}

/// The instruction set, and how many of its vectors make a row of right-hand sides.
#[derive(Clone, Copy)]
struct Lanes<S> {
    simd: S,
    v: usize,
}

/// A supernode and its entries.
struct Entries<'a, T> {
    node: Supernode<'a>,
    values: &'a [T],
}

impl<'a, T> Entries<'a, T> {
    fn of(nodes: &'a Supernodes, factor: &'a Factor<T>, s: usize) -> Self {
        Self { node: nodes.node(s), values: &factor.values[nodes.values(s)] }
    }

    /// Entries of its `k`-th column.
    #[inline(always)]
    fn column(&self, k: usize) -> &'a [T] {
        let height = self.node.height();
        &self.values[k * height..(k + 1) * height]
    }
}

/// Eliminates the columns of a supernode from the rows after them.
#[inline(always)]
fn forward<T: Scalar, S: Simd, const TILE: usize, const PANEL: usize>(
    lanes: Lanes<S>,
    stage: &Stage<'_, T>,
    s: usize,
    x: &mut [T::Vector<S>],
    above: &mut [T::Vector<S>],
) {
    let Lanes { simd, v } = lanes;
    let entries = &Entries::of(stage.nodes, stage.factor, s);
    let Supernode { start, width, below } = entries.node;
    let inside = width + stage.rows_in(below, x.len() / v);
    let first_row = stage.place(start);
    let (head, rest) = x.split_at_mut((first_row + width) * v);
    let own = &mut head[first_row * v..];
    for first in (0..width).step_by(STRETCH) {
        let end = width.min(first + STRETCH);
        for j in first..end {
            let column = entries.column(j);
            let (solved, rest) = own.split_at_mut((j + 1) * v);
            let pivot = &mut solved[j * v..];
            let inverse = T::splat(simd, T::nearest(1.0 / column[j].into()));
            for x in pivot.iter_mut() {
                *x = T::times(simd, inverse, *x);
            }
            for (row, &l) in rest.chunks_exact_mut(v).zip(&column[j + 1..end]) {
                let l = T::splat(simd, -l);
                for (x, p) in row.iter_mut().zip(&*pivot) {
                    *x = T::mul_add(simd, l, *p, *x);
                }
            }
        }
        let (solved, rest) = own.split_at_mut(end * v);
        let (columns, solved) = (first..end, &solved[first * v..]);
        subtract::<T, S, TILE, PANEL>(lanes, entries, columns, solved, end..width, rest, |i| i - end);
    }
    let place = |i: usize| stage.place(below[i - width] as usize) - first_row - width;
    subtract::<T, S, TILE, PANEL>(lanes, entries, 0..width, own, width..inside, rest, place);
    let place = |i: usize| stage.nodes.top_place(below[i - width] as usize);
    subtract::<T, S, TILE, PANEL>(lanes, entries, 0..width, own, inside..width + below.len(), above, place);
    let negative = &stage.factor.negative;
    let first = negative.partition_point(|&place| (place as usize) < start);
    for &place in negative[first..].iter().take_while(|&&place| (place as usize) < start + width) {
        for x in &mut own[(place as usize - start) * v..][..v] {
            *x = T::negated(simd, *x);
        }
    }
}

/// `sum += l x`.
#[inline(always)]
fn add<T: Scalar, S: Simd, const PANEL: usize>(
    simd: S,
    sum: &mut [T::Vector<S>; PANEL],
    l: T,
    x: &[T::Vector<S>],
) {
    let l = T::splat(simd, l);
    for (sum, x) in sum.iter_mut().zip(x) {
        *sum = T::mul_add(simd, l, *x, *sum);
    }
}

/// `target[place(i)] −= Σ L[i, k] · solved[k]` over the columns `columns`, for the rows `rows` of a supernode.
#[inline(always)]
fn subtract<T: Scalar, S: Simd, const TILE: usize, const PANEL: usize>(
    lanes: Lanes<S>,
    factor: &Entries<'_, T>,
    columns: Range<usize>,
    solved: &[T::Vector<S>],
    rows: Range<usize>,
    target: &mut [T::Vector<S>],
    place: impl Fn(usize) -> usize,
) {
    let Lanes { simd, v } = lanes;
    let mut i = rows.start;
    while i + TILE <= rows.end {
        for panel in (0..v).step_by(PANEL) {
            let mut sums = [[T::splat(simd, T::nearest(0.0)); PANEL]; TILE];
            for (k, x) in columns.clone().zip(solved.chunks_exact(v)) {
                let entries = &factor.column(k)[i..i + TILE];
                for (sum, &l) in sums.iter_mut().zip(entries) {
                    add(simd, sum, l, &x[panel..panel + PANEL]);
                }
            }
            for (r, sum) in sums.iter().enumerate() {
                let row = &mut target[place(i + r) * v + panel..][..PANEL];
                for (x, s) in row.iter_mut().zip(sum) {
                    *x = T::minus(simd, *x, *s);
                }
            }
        }
        i += TILE;
    }
    for i in i..rows.end {
        for panel in (0..v).step_by(PANEL) {
            let row = &mut target[place(i) * v + panel..][..PANEL];
            let mut sum: [T::Vector<S>; PANEL] = std::array::from_fn(|p| row[p]);
            for (k, x) in columns.clone().zip(solved.chunks_exact(v)) {
                add(simd, &mut sum, -factor.column(k)[i], &x[panel..panel + PANEL]);
            }
            row.copy_from_slice(&sum);
        }
    }
}

/// Solves for the rows of a supernode, given those after them.
#[inline(always)]
fn backward<T: Scalar, S: Simd, const TILE: usize, const PANEL: usize>(
    lanes: Lanes<S>,
    stage: &Stage<'_, T>,
    s: usize,
    x: &mut [T::Vector<S>],
    top: &[T::Vector<S>],
) {
    let Lanes { simd, v } = lanes;
    let entries = &Entries::of(stage.nodes, stage.factor, s);
    let Supernode { start, width, below } = entries.node;
    let inside = width + stage.rows_in(below, x.len() / v);
    let first_row = stage.place(start);
    let (head, rest) = x.split_at_mut((first_row + width) * v);
    let own = &mut head[first_row * v..];
    let place = |i: usize| stage.place(below[i - width] as usize) - first_row - width;
    subtract_transposed::<T, S, TILE, PANEL>(lanes, entries, 0..width, own, width..inside, rest, place);
    let place = |i: usize| stage.nodes.top_place(below[i - width] as usize);
    let outside = inside..width + below.len();
    subtract_transposed::<T, S, TILE, PANEL>(lanes, entries, 0..width, own, outside, top, place);
    for first in (0..width).step_by(STRETCH).rev() {
        let end = width.min(first + STRETCH);
        let (part, solved) = own.split_at_mut(end * v);
        let part = &mut part[first * v..];
        let columns = first..end;
        subtract_transposed::<T, S, TILE, PANEL>(lanes, entries, columns, part, end..width, solved, |i| {
            i - end
        });
        for j in (first..end).rev() {
            let column = entries.column(j);
            let (before, solved) = part.split_at_mut((j + 1 - first) * v);
            let pivot = &mut before[(j - first) * v..];
            for (row, &l) in solved.chunks_exact(v).zip(&column[j + 1..end]) {
                let l = T::splat(simd, -l);
                for (p, x) in pivot.iter_mut().zip(row) {
                    *p = T::mul_add(simd, l, *x, *p);
                }
            }
            let inverse = T::splat(simd, T::nearest(1.0 / column[j].into()));
            for x in pivot.iter_mut() {
                *x = T::times(simd, inverse, *x);
            }
        }
    }
}

/// `target[k] −= Σ L[i, k] · solved[place(i)]` over the rows `rows`, for the columns `columns` of a supernode.
#[inline(always)]
fn subtract_transposed<T: Scalar, S: Simd, const TILE: usize, const PANEL: usize>(
    lanes: Lanes<S>,
    factor: &Entries<'_, T>,
    columns: Range<usize>,
    target: &mut [T::Vector<S>],
    rows: Range<usize>,
    solved: &[T::Vector<S>],
    place: impl Fn(usize) -> usize,
) {
    let Lanes { simd, v } = lanes;
    let mut tiles = target.chunks_exact_mut(TILE * v);
    let mut k = columns.start;
    for tile in &mut tiles {
        let entries: [&[T]; TILE] = std::array::from_fn(|c| &factor.column(k + c)[rows.clone()]);
        for panel in (0..v).step_by(PANEL) {
            let mut sums = [[T::splat(simd, T::nearest(0.0)); PANEL]; TILE];
            for (n, i) in rows.clone().enumerate() {
                let x = &solved[place(i) * v + panel..][..PANEL];
                for (sum, entries) in sums.iter_mut().zip(&entries) {
                    add(simd, sum, entries[n], x);
                }
            }
            for (row, sum) in tile.chunks_exact_mut(v).zip(&sums) {
                let row = &mut row[panel..panel + PANEL];
                for (x, s) in row.iter_mut().zip(sum) {
                    *x = T::minus(simd, *x, *s);
                }
            }
        }
        k += TILE;
    }
    for (k, row) in (k..columns.end).zip(tiles.into_remainder().chunks_exact_mut(v)) {
        let entries = &factor.column(k)[rows.clone()];
        for panel in (0..v).step_by(PANEL) {
            let row = &mut row[panel..panel + PANEL];
            let mut sum: [T::Vector<S>; PANEL] = std::array::from_fn(|p| row[p]);
            for (&l, i) in entries.iter().zip(rows.clone()) {
                add(simd, &mut sum, -l, &solved[place(i) * v + panel..][..PANEL]);
            }
            row.copy_from_slice(&sum);
        }
    }
}

//! Supernodal factorization `L S Lᵀ`, looking left (Ng and Peyton 1993): the parts of the elimination order that do not
//! touch each other side by side, then what they have in common, its rows side by side.
//!
//! Every part is a task, and rows are split by their number alone: the bits do not depend on the number of threads.

use std::ops::Range;

use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::cholesky::ldlt::factor::{
    LdltRegularization, cholesky_in_place, cholesky_in_place_scratch,
};
use faer::linalg::matmul::matmul;
use faer::linalg::matmul::triangular::{self, BlockStructure};
use faer::linalg::triangular_solve::solve_lower_triangular_in_place;
use faer::{Accum, MatMut, MatRef, Par};
use rayon::prelude::*;

use super::supernodes::Supernodes;
use crate::operator::Sparse;
use crate::progress::{Canceled, Progress};
use crate::spectrum::vectors::scalar::Scalar;

/// Diagonal blocks of fewer columns are multiplied whole: their upper halves cost less than the calls that spare them.
const TRIANGLE_MIN: usize = 32;

/// Supernodes of more entries are worked on by rows.
const SHARED_MIN: usize = 1 << 16;

/// Rows of one task in such a supernode, at the least.
const SHARED_ROWS: usize = 128;

/// `A + shift·I` in elimination order.
#[derive(Clone, Copy)]
pub(super) struct Reordered<'a> {
    pub(super) matrix: &'a Sparse,
    pub(super) shift: f64,
    /// The row eliminated k-th.
    pub(super) order: &'a [u32],
    /// When row i is eliminated.
    pub(super) place: &'a [u32],
}

/// Entries of `L`, and the places of the negative signs, ascending.
pub(super) struct Factor<T> {
    pub(super) values: Vec<T>,
    pub(super) negative: Vec<u32>,
}

/// Factors; none when a pivot is zero.
///
/// # Errors
/// [`Canceled`].
pub(super) fn factorize<T: Scalar>(
    nodes: &Supernodes,
    matrix: Reordered<'_>,
    progress: &Progress,
) -> Result<Option<Factor<T>>, Canceled> {
    let mut values = vec![T::nearest(0.0); nodes.entries()];
    let eliminated: Vec<Result<Option<Vec<u32>>, Canceled>> = nodes
        .by_parts(&mut values, |part| nodes.values_of(part))
        .into_par_iter()
        .with_max_len(1)
        .map(|(part, own)| {
            let base = nodes.values_of(&part).start;
            let mut task = Task::new(nodes, matrix);
            for s in part {
                progress.checkpoint()?;
                let span = nodes.values(s);
                let (before, own) = own.split_at_mut(span.start - base);
                if !task.eliminate(s, before, base, &mut own[..span.len()]) {
                    return Ok(None);
                }
            }
            Ok(Some(task.negative))
        })
        .collect();
    let mut task = Task::new(nodes, matrix);
    for part in eliminated {
        let Some(negative) = part? else { return Ok(None) };
        task.negative.extend(negative);
    }
    for &s in nodes.top() {
        progress.checkpoint()?;
        let span = nodes.values(s);
        let (before, own) = values.split_at_mut(span.start);
        if !task.eliminate(s, before, 0, &mut own[..span.len()]) {
            return Ok(None);
        }
        // some parts come after this one
        task.negative.sort_unstable();
    }
    Ok(Some(Factor { values, negative: task.negative }))
}

/// What one thread works with.
struct Task<'a, T> {
    nodes: &'a Supernodes,
    matrix: Reordered<'a>,
    /// Places of negative pivots so far, ascending within what the task updates from.
    negative: Vec<u32>,
    /// Where a row of the matrix is in the supernode at hand; of others, anything.
    local: Vec<u32>,
    scratch: Scratch<T>,
    memory: MemBuffer,
}

/// Buffers that grow to what is needed.
struct Scratch<T> {
    product: Vec<T>,
    signed: Vec<T>,
    places: Vec<u32>,
}

impl<T> Scratch<T> {
    fn new() -> Self {
        Self { product: Vec::new(), signed: Vec::new(), places: Vec::new() }
    }
}

impl<'a, T: Scalar> Task<'a, T> {
    fn new(nodes: &'a Supernodes, matrix: Reordered<'a>) -> Self {
        let local = vec![0; nodes.rows()];
        let size = cholesky_in_place_scratch::<T>(nodes.widest(), Par::Seq, faer::Spec::default());
        let memory = MemBuffer::new(size);
        Self { nodes, matrix, negative: Vec::new(), local, scratch: Scratch::new(), memory }
    }

    /// Computes the entries of supernode `s`, all zero, from those of the earlier ones, which begin at `base`; false when
    /// a pivot is zero.
    fn eliminate(&mut self, s: usize, before: &[T], base: usize, own: &mut [T]) -> bool {
        let node = self.nodes.node(s);
        let (width, height) = (node.width, node.height());
        for (i, &row) in node.below.iter().enumerate() {
            self.local[row as usize] = (width + i) as u32;
        }
        for (k, column) in own.chunks_exact_mut(height).enumerate() {
            self.read(node.start, width, node.start + k, column);
        }
        let earlier = Earlier { nodes: self.nodes, negative: &self.negative, values: before, base };
        let mut entries = MatMut::from_column_major_slice_mut(own, height, width);
        if width * height < SHARED_MIN {
            earlier.update(s, 0..height, entries.as_mut(), &self.local, &mut self.scratch);
        } else {
            let local = &self.local;
            by_rows(entries.as_mut(), 0, width).into_par_iter().with_max_len(1).for_each_init(
                Scratch::new,
                |scratch, (rows, entries)| {
                    earlier.update(s, rows, entries, local, scratch);
                },
            );
        }
        let (mut block, below) = entries.split_at_row_mut(width);
        let factored = cholesky_in_place(
            block.as_mut(),
            LdltRegularization::default(),
            Par::Seq,
            MemStack::new(&mut self.memory),
            faer::Spec::default(),
        );
        if factored.is_err() {
            return false;
        }
        let known = self.negative.len();
        for k in 0..width {
            let pivot: f64 = block[(k, k)].into();
            if pivot < 0.0 {
                self.negative.push((node.start + k) as u32);
            }
            let root = pivot.abs().sqrt();
            block[(k, k)] = T::nearest(root);
            for i in k + 1..width {
                let l: f64 = block[(i, k)].into();
                block[(i, k)] = T::nearest(root * l);
            }
        }
        // X S Rᵀ = B below
        let block = block.as_ref();
        let solve = |mut rows: MatMut<'_, T>| {
            solve_lower_triangular_in_place(block, rows.as_mut().transpose_mut(), Par::Seq);
            for &place in &self.negative[known..] {
                let column = rows.as_mut().col_mut(place as usize - node.start);
                column.iter_mut().for_each(|x| *x = -*x);
            }
        };
        if width * height < SHARED_MIN {
            solve(below);
        } else {
            by_rows(below, width, width).into_par_iter().with_max_len(1).for_each(|(_, rows)| solve(rows));
        }
        true
    }

    /// Reads the entries of `column` at and below the diagonal of the supernode that begins at `start`.
    fn read(&self, start: usize, width: usize, column: usize, entries: &mut [T]) {
        let Reordered { matrix, shift, order, place } = self.matrix;
        let row = order[column] as usize;
        let span = matrix.offsets()[row]..matrix.offsets()[row + 1];
        for (&j, &value) in matrix.columns()[span.clone()].iter().zip(&matrix.values()[span]) {
            let place = place[j as usize] as usize;
            if place >= column {
                let i = if place < start + width { place - start } else { self.local[place] as usize };
                entries[i] = T::nearest(if place == column { value + shift } else { value });
            }
        }
    }
}

/// Splits the rows of a supernode into stretches of about as many entries at and below the diagonal; the first is row
/// `first`.
fn by_rows<T>(mut entries: MatMut<'_, T>, first: usize, width: usize) -> Vec<(Range<usize>, MatMut<'_, T>)> {
    let mut parts = Vec::new();
    let mut row = first;
    while entries.nrows() > 0 {
        // rows of the diagonal block are cut short by the diagonal
        let share = if row < width {
            ((row * row + 2 * SHARED_ROWS * width) as f64).sqrt() as usize - row
        } else {
            SHARED_ROWS
        };
        let rows = if entries.nrows() < 2 * share { entries.nrows() } else { share };
        let (part, rest) = entries.split_at_row_mut(rows);
        parts.push((row..row + rows, part));
        (entries, row) = (rest, row + rows);
    }
    parts
}

/// The supernodes that are finished.
struct Earlier<'a, T> {
    nodes: &'a Supernodes,
    negative: &'a [u32],
    values: &'a [T],
    base: usize,
}

impl<T: Scalar> Earlier<'_, T> {
    /// Subtracts from the rows `rows` of supernode `s`, which are `entries`, what the earlier supernodes take.
    fn update(
        &self,
        s: usize,
        rows: Range<usize>,
        mut entries: MatMut<'_, T>,
        local: &[u32],
        scratch: &mut Scratch<T>,
    ) {
        let (start, end) = (self.nodes.node(s).start, self.nodes.node(s).end());
        let Scratch { product, signed, places } = scratch;
        for update in self.nodes.updates(s) {
            let source = update.source as usize;
            let node = self.nodes.node(source);
            let touched = &node.below[update.first as usize..];
            let place = |&row: &u32| {
                if (row as usize) < end { row as usize - start } else { local[row as usize] as usize }
            };
            let first = touched.partition_point(|row| place(row) < rows.start);
            let last = touched.partition_point(|row| place(row) < rows.end);
            // of a row in the diagonal block, only what is left of the diagonal
            let columns = last.min((update.end - update.first) as usize);
            if first == last || columns == 0 {
                continue;
            }
            let span = self.nodes.values(source);
            let values = &self.values[span.start - self.base..span.end - self.base];
            let l = MatRef::from_column_major_slice(values, node.height(), node.width)
                .subrows(node.width + update.first as usize, touched.len());
            let left = l.subrows(first, last - first);
            let mut right = l.subrows(0, columns);
            let negative = self.negative_in(node.start, node.end());
            if !negative.is_empty() {
                signed.clear();
                for k in 0..node.width {
                    let flip = negative.contains(&((node.start + k) as u32));
                    signed.extend(right.col(k).iter().map(|&x| if flip { -x } else { x }));
                }
                right = MatRef::from_column_major_slice(signed, columns, node.width);
            }
            let count = last - first;
            product.resize(product.len().max(count * columns), T::nearest(0.0));
            multiply(&mut product[..count * columns], first, left, right);
            places.clear();
            places.extend(touched[first..last].iter().map(|row| (place(row) - rows.start) as u32));
            for (j, (product, row)) in product.chunks_exact(count).zip(&touched[..columns]).enumerate() {
                let Some(column) = entries.as_mut().col_mut(*row as usize - start).try_as_col_major_mut()
                else {
                    unreachable!("columns of a supernode are stretches of the factor")
                };
                let column = column.as_slice_mut();
                let above = j.saturating_sub(first);
                for (&place, &x) in places[above..].iter().zip(&product[above..]) {
                    column[place as usize] -= x;
                }
            }
        }
    }

    fn negative_in(&self, start: usize, end: usize) -> &[u32] {
        let place = |bound: usize| self.negative.partition_point(|&place| (place as usize) < bound);
        &self.negative[place(start)..place(end)]
    }
}

/// `left · rightᵀ`, whose row 0 is row `first` of the symmetric whole: what is right of its diagonal may be left out.
fn multiply<T: Scalar>(product: &mut [T], first: usize, left: MatRef<'_, T>, right: MatRef<'_, T>) {
    let (rows, columns) = (left.nrows(), right.nrows());
    let product = MatMut::from_column_major_slice_mut(product, rows, columns);
    let one = T::nearest(1.0);
    if columns < first + TRIANGLE_MIN {
        matmul(product, Accum::Replace, left, right.transpose(), one, Par::Seq);
        return;
    }
    let (whole, corner) = product.split_at_col_mut(first);
    let (beside, right) = right.split_at_row(first);
    if first > 0 {
        matmul(whole, Accum::Replace, left, beside.transpose(), one, Par::Seq);
    }
    let (triangle, below) = corner.split_at_row_mut(columns - first);
    let (left, left_below) = left.split_at_row(columns - first);
    triangular::matmul(
        triangle,
        BlockStructure::TriangularLower,
        Accum::Replace,
        left,
        BlockStructure::Rectangular,
        right.transpose(),
        BlockStructure::Rectangular,
        one,
        Par::Seq,
    );
    matmul(below, Accum::Replace, left_below, right.transpose(), one, Par::Seq);
}

//! Forward and backward substitution with a supernodal Cholesky factor, many right-hand sides at a time.

use std::ops::Range;

use rayon::prelude::*;

use super::factorization::Factor;
use super::substitution_kernels::{Direction, Stage, lanes};
use super::supernodes::Supernodes;
use crate::progress::Progress;
use crate::spectrum::vectors::scalar::Scalar;

/// Right-hand sides of one pass, at least and at most: a multiple of the longest vector of any processor, doubled as long
/// as there are as many. One reading of the factor serves them all: with 64 a right-hand side takes about half the time
/// that it takes with 16.
pub(super) const WIDTH: usize = 16;
pub(super) const WIDTH_MAX: usize = 64;

/// Of so many right-hand sides those that the next pass takes.
pub(super) fn width(columns: usize) -> usize {
    let mut width = WIDTH_MAX;
    while width > WIDTH && width > columns.next_multiple_of(WIDTH) {
        width /= 2;
    }
    width
}

/// `X ← (L S Lᵀ)⁻¹ X`; `x` has `width` numbers for every row, in elimination order.
///
/// The parts of the order are tasks, each of which reads its part of the factor once; what they have in common is done
/// by right-hand sides. A cancellation leaves `x` unfinished.
pub(super) fn solve<T: Scalar>(
    nodes: &Supernodes,
    factor: &Factor<T>,
    x: &mut [T],
    width: usize,
    progress: &Progress,
) {
    let rows_of = |rows: Range<usize>| rows.start * width..rows.end * width;
    let top_rows = || nodes.top().iter().map(|&s| nodes.columns_of(&(s..s + 1)));
    let in_parts = |x: &mut [T], direction: Direction, top: &[T]| -> Vec<Vec<T>> {
        let pass = |(part, x): (Range<usize>, &mut [T])| {
            let first = Some(nodes.columns_of(&part).start);
            let mut above = match direction {
                Direction::Forward => vec![T::nearest(0.0); top.len()],
                Direction::Backward => Vec::new(),
            };
            let stage = Stage { nodes, factor, first, width };
            if !progress.is_canceled() {
                stage.run(part, direction, x, &mut above, top);
            }
            above
        };
        let parts = nodes.by_parts(x, |part| rows_of(nodes.columns_of(part)));
        parts.into_par_iter().with_max_len(1).map(pass).collect()
    };
    let mut top = vec![T::nearest(0.0); nodes.top_rows() * width];
    // what the parts take from the rows that they have in common
    let taken = in_parts(x, Direction::Forward, &top);
    let mut to = 0;
    for rows in top_rows().map(rows_of) {
        top[to..to + rows.len()].copy_from_slice(&x[rows.clone()]);
        to += rows.len();
    }
    for taken in taken {
        top.iter_mut().zip(taken).for_each(|(x, t)| *x += t);
    }
    if !progress.is_canceled() {
        solve_top(nodes, factor, &mut top, width);
    }
    in_parts(x, Direction::Backward, &top);
    let mut from = 0;
    for rows in top_rows().map(rows_of) {
        x[rows.clone()].copy_from_slice(&top[from..from + rows.len()]);
        from += rows.len();
    }
}

/// Forward and back through the supernodes in none of the parts.
fn solve_top<T: Scalar>(nodes: &Supernodes, factor: &Factor<T>, top: &mut [T], all: usize) {
    // halves run side by side
    let width = (all / 2).max(lanes::<T>());
    let groups: Vec<usize> = (0..all).step_by(width).collect();
    let source = &*top;
    let pass = |&group: &usize| {
        let mut x: Vec<T> =
            source.chunks_exact(all).flat_map(|row| &row[group..group + width]).copied().collect();
        let stage = Stage { nodes, factor, first: None, width };
        for direction in [Direction::Forward, Direction::Backward] {
            stage.run(nodes.top().iter().copied(), direction, &mut x, &mut [], &[]);
        }
        x
    };
    let solved: Vec<Vec<T>> = groups.par_iter().with_max_len(1).map(pass).collect();
    for (group, solved) in groups.iter().zip(&solved) {
        for (row, x) in top.chunks_exact_mut(all).zip(solved.chunks_exact(width)) {
            row[*group..group + width].copy_from_slice(x);
        }
    }
}

#[cfg(test)]
mod tests {
    use crate::operator::Sparse;
    use crate::progress::Progress;
    use crate::spectrum::factor::Symbolic;
    use crate::spectrum::vectors::block::Block;
    use crate::spectrum::vectors::sparse_product::sparse_product;
    use crate::spectrum::vectors::start;

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
            let symbolic =
                Symbolic::analyze(&matrix, (0..n as u32).rev().collect::<Vec<_>>(), &Progress::new())
                    .unwrap();
            let single = symbolic.factor(&matrix, 0.5, &Progress::new()).unwrap();
            let double = symbolic.factor_double(&matrix, 0.5, &Progress::new()).unwrap();
            let both = [(&single, 1e-4), (&double, 1e-11)];
            for (columns, (factor, bound)) in [1, 8, 13, 16, 17, 40, 64, 97]
                .into_iter()
                .flat_map(|columns| both.map(|factor| (columns, factor)))
            {
                let mut b = Block::zeros(n, columns);
                start::fill(&mut b, 0);
                let mut x = b.clone();
                factor.solve(&mut x, &Progress::new()).unwrap();
                let mut product = Block::zeros(n, columns);
                sparse_product(&mut product, &matrix, &x);
                for i in 0..n {
                    for j in 0..columns {
                        let found = product.row(i)[j] + 0.5 * x.row(i)[j];
                        assert!((found - b.row(i)[j]).abs() < bound, "{n} {reach} {columns}: {i} {j}");
                    }
                }
            }
        }
    }
}

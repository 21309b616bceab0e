//! A problem with known eigenvalues, for the tests of this room.

use super::Problem;
use crate::operator::{LaplaceBeltrami, Sparse};
use crate::progress::Progress;

/// The 5-point stencil on a `side × side` grid with unit masses: eigenvalues
/// `4 sin²(πa/2m) + 4 sin²(πb/2m)`, a, b = 0 … m−1 (the tensor product of paths).
pub(super) fn grid(side: usize) -> Problem {
    let weights = |i: usize, (): &mut (), row: &mut Vec<(u32, f64)>| {
        let (x, y) = (i % side, i / side);
        let mut push = |inside: bool, j: usize| {
            if inside {
                row.push((j as u32, 1.0));
            }
        };
        push(y > 0, i.wrapping_sub(side));
        push(x > 0, i.wrapping_sub(1));
        push(x + 1 < side, i + 1);
        push(y + 1 < side, i + side);
    };
    let stiffness =
        Sparse::stiffness(side * side, || (), weights, |_| Ok::<_, std::convert::Infallible>(())).unwrap();
    let first = 4.0 * std::f64::consts::PI / (side * side) as f64;
    let mass = vec![1.0; side * side];
    Problem::new(LaplaceBeltrami::narrow(stiffness, mass), first, &Progress::new()).unwrap()
}

/// Its eigenvalues, ascending.
pub(super) fn grid_eigenvalues(side: usize) -> Vec<f64> {
    let path = |a: usize| 4.0 * (std::f64::consts::PI * a as f64 / (2.0 * side as f64)).sin().powi(2);
    let mut exact: Vec<f64> = (0..side).flat_map(|a| (0..side).map(move |b| path(a) + path(b))).collect();
    exact.sort_by(f64::total_cmp);
    exact
}

//! Lengths that a heat kernel has to span around every point of a surface.
//!
//! Ours. The covering radius ε is that of 99 % of the points: the largest cells of an adaptive mesh, and a few stretched ones, are
//! larger, and a kernel that does not reach beyond them sees next to nothing of the surface there. Its calibrated moment is right
//! all the same, but comes from whichever one or two neighbors are the nearest.

use rayon::prelude::*;

use super::Sparse;
use super::pb_mhb::t_factor_of_stretched;
use crate::geometry::cells::CellKind;
use crate::geometry::survey::stretch_of;
use crate::geometry::{Cells, Frames, Points, Stars};

/// Rounds in which the stretch is averaged with that of the neighbors: that of one star is a matter of chance.
const ROUNDS: usize = 4;

/// Stretch where no star tells: that of random points.
const UNKNOWN: f64 = 1.4;

/// Lengths whose square times `t_factor` is the time that resolves the cell of a point; 0 for cells on rims, which are cut off.
/// With `by_stretch` it is longer where points are farther apart in one direction than in the other.
#[must_use]
pub fn lengths(
    points: &Points,
    frames: &Frames,
    stars: &Stars,
    cells: &Cells,
    walls: &Sparse,
    t_factor: f64,
    by_stretch: bool,
) -> Vec<f64> {
    let stretches = if by_stretch { stretches(points, frames, stars, walls) } else { Vec::new() };
    let length = |i: usize| {
        let own = stretches.get(i).map_or(t_factor, |&stretch| t_factor_of_stretched(stretch));
        match cells.kind[i] {
            CellKind::Closed => cells.radius[i] * (own / t_factor).sqrt(),
            _ => 0.0,
        }
    };
    (0..points.len()).into_par_iter().with_min_len(1024).map(length).collect()
}

/// Ratio of the principal lengths of the stars, averaged over a few rings.
fn stretches(points: &Points, frames: &Frames, stars: &Stars, walls: &Sparse) -> Vec<f64> {
    let all = || (0..points.len()).into_par_iter().with_min_len(1024);
    let mut logarithms: Vec<f64> =
        all().map(|i| stretch_of(points, frames, stars, i).unwrap_or(UNKNOWN).ln()).collect();
    for _ in 0..ROUNDS {
        let around = |i: usize| {
            let own = (2.0 * logarithms[i], 2.0);
            let (sum, count) =
                walls.neighbors(i).fold(own, |(sum, count), j| (sum + logarithms[j as usize], count + 1.0));
            sum / count
        };
        logarithms = all().map(around).collect();
    }
    logarithms.into_iter().map(f64::exp).collect()
}

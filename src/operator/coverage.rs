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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::stars::tests::stars_of;
    use crate::operator::voronoi;
    use crate::progress::Progress;

    /// Lengths around the middle of a lattice of 20 × 20 points, so far apart, with a factor of 0.4.
    fn of_lattice(apart: [f64; 2], by_stretch: bool) -> f64 {
        let rows: Vec<[f64; 3]> =
            (0..400).map(|i| [apart[0] * f64::from(i % 20), apart[1] * f64::from(i / 20), 0.0]).collect();
        let (points, frames, stars) = stars_of(&rows);
        let cells = stars.cells(&points, &Progress::new()).unwrap();
        let walls = voronoi::stiffness(&cells, &Progress::new()).unwrap();
        let lengths = lengths(&points, &frames, &stars, &cells, &walls, 0.4, by_stretch);
        assert!(lengths[points.of_row(0).unwrap()] == 0.0, "a rim tells nothing");
        lengths[points.of_row(210).unwrap()]
    }

    #[test]
    fn lengths_are_the_radii_of_cells_and_longer_where_points_are_stretched() {
        assert!((of_lattice([1.0, 1.0], true) - 0.5_f64.sqrt()).abs() < 1e-9);
        let radius = 0.5 * 10.0_f64.sqrt();
        assert!((of_lattice([3.0, 1.0], false) - radius).abs() < 1e-9);
        // the time is twice as long
        let longer = of_lattice([3.0, 1.0], true) / (radius * 2.0_f64.sqrt());
        assert!((longer - 1.0).abs() < 1e-9, "{longer}");
    }
}

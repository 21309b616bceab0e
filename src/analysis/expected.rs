//! What error to expect of every eigenvalue, by where its mode lives; ours.
//!
//! Three things are known of a discrete eigenvalue beside its value: how large the cells are where its mode lives, how much of
//! the mode's energy flows through walls that their two sides see differently, and how much of it is at rims whose place is
//! not known. Each is a perturbation of the Rayleigh quotient; their sum is an estimate, not a bound.

use rayon::prelude::*;

use crate::geometry::Cells;
use crate::geometry::cells::CellKind;
use crate::geometry::survey::Surveyed;

/// Relative error of a piecewise linear mode over `λ h²`, h² being the area of a cell times the stretch of the sampling. Measured
/// are 0.05 to 0.06 on regular spheres, 0.074 on scan lines from 1 : 1 to 24 : 1, 0.08 to 0.14 on random points.
const RESOLUTION: f64 = 0.12;

/// Of the energy that flows through disputed walls so much is an error.
const DISPUTED: f64 = 1.0;

/// Share of a rim's cells that its place is uncertain by, at most so many times the share of the surface that was opened: rims
/// from which no triangle was taken are where the points end.
const OPENED: f64 = 8.0;

/// Walls that differ by less than this share are seen alike.
const ALIKE: f64 = 1e-9;

/// Points that one task adds up; sums run over the same parts whatever the number of threads.
const PART: usize = 4_096;

/// What speaks against the eigenvalues, at every point.
pub(super) struct Doubts {
    /// Pairs of points with half the difference of what they see of their wall.
    apart: Vec<([u32; 2], f64)>,
    rim: Vec<bool>,
    /// Area of a cell times this is the square of the largest distance between points.
    stretch: f64,
    opened: f64,
}

impl Doubts {
    /// Of a triangulated surface and its cells; `place` says which point of the operator a cell is, if any.
    pub(super) fn of(surveyed: &Surveyed, cells: &Cells, place: impl Fn(usize) -> Option<u32>) -> Self {
        let mut apart = Vec::new();
        for (p, walls) in cells.conductance.iter().enumerate() {
            for &(q, wall) in walls {
                let back = &cells.conductance[q as usize];
                let found = back.binary_search_by_key(&(p as u32), |&(r, _)| r);
                let difference = (wall - found.map_or(0.0, |k| back[k].1)).abs();
                // walls that both see are met twice
                let named = found.is_err() || p < q as usize;
                if let (true, Some(p), Some(q)) =
                    (named && difference > ALIKE * wall.abs(), place(p), place(q as usize))
                {
                    apart.push(([p, q], 0.5 * difference));
                }
            }
        }
        let rim = (0..cells.kind.len())
            .filter(|&i| place(i).is_some())
            .map(|i| cells.kind[i] != CellKind::Closed)
            .collect();
        Self { apart, rim, stretch: surveyed.stretch, opened: surveyed.opened }
    }

    /// Relative error to expect of each eigenvalue. `row(i)` are the modes at point `i` times the root of its mass, of norm 1
    /// over all points.
    pub(super) fn expected<'a>(
        &self,
        eigenvalues: &[f64],
        root_mass: &[f64],
        row: impl Fn(usize) -> &'a [f64] + Sync,
    ) -> Vec<f64> {
        let modes = eigenvalues.len();
        let add = |mut a: Vec<f64>, b: Vec<f64>| {
            a.iter_mut().zip(b).for_each(|(a, b)| *a += b);
            a
        };
        let sums = |count: usize, of: &(dyn Fn(usize, &mut [f64]) + Sync)| -> Vec<f64> {
            let parts: Vec<Vec<f64>> = (0..count.div_ceil(PART))
                .into_par_iter()
                .map(|part| {
                    let mut sum = vec![0.0; modes];
                    (part * PART..count.min((part + 1) * PART)).for_each(|k| of(k, &mut sum));
                    sum
                })
                .collect();
            parts.into_iter().fold(vec![0.0; modes], add)
        };
        let area = sums(root_mass.len(), &|i, sum| {
            let mass = root_mass[i] * root_mass[i];
            sum.iter_mut().zip(row(i)).for_each(|(sum, y)| *sum += y * y * mass);
        });
        let rim = sums(root_mass.len(), &|i, sum| {
            if self.rim[i] {
                sum.iter_mut().zip(row(i)).for_each(|(sum, y)| *sum += y * y);
            }
        });
        let apart = sums(self.apart.len(), &|k, sum| {
            let ([p, q], wall) = self.apart[k];
            let (p, q) = (p as usize, q as usize);
            let ends = row(p).iter().zip(row(q));
            sum.iter_mut().zip(ends).for_each(|(sum, (a, b))| {
                *sum += wall * (a / root_mass[p] - b / root_mass[q]).powi(2);
            });
        });
        (0..modes)
            .map(|mode| {
                let lambda = eigenvalues[mode];
                if lambda <= 0.0 {
                    return 0.0;
                }
                let resolution = RESOLUTION * self.stretch * lambda * area[mode];
                let all = resolution + DISPUTED * apart[mode] / lambda + rim[mode].min(OPENED * self.opened);
                // nothing is known of a mode that is off by all of its eigenvalue
                all.min(1.0)
            })
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Four points of mass 0.25; the first two see their wall differently by 0.2, the last lies on a rim.
    fn doubts(opened: f64) -> Doubts {
        Doubts { apart: vec![([0, 1], 0.1)], rim: vec![false, false, false, true], stretch: 1.5, opened }
    }

    #[test]
    fn modes_in_large_cells_across_disputed_walls_and_on_opened_rims_are_doubtful() {
        let root_mass = [0.5; 4];
        // the constant, one that changes across the disputed wall, one on the rim
        let rows = [[0.5, 0.6, 0.0], [0.5, -0.6, 0.0], [0.5, 0.2, 0.6], [0.5, 0.1, 0.8]];
        let expected = |opened: f64| doubts(opened).expected(&[0.0, 0.4, 0.8], &root_mass, |i| &rows[i]);
        let squares = |mode: usize| rows.iter().map(|row| row[mode] * row[mode]).sum::<f64>();
        let [constant, across, rim] = expected(1.0)[..] else { panic!("three modes") };
        assert!(constant == 0.0);
        // by hand: λ h² times the stretch, the wall's part of the energy, the square on the rim
        let by_hand = RESOLUTION * 1.5 * 0.4 * squares(1) * 0.25 + 0.1 * 2.4_f64.powi(2) / 0.4 + 0.01;
        assert!((across - by_hand.min(1.0)).abs() < 1e-12, "{across} {by_hand}");
        let by_hand = RESOLUTION * 1.5 * 0.8 * squares(2) * 0.25 + 0.64;
        assert!((rim - by_hand).abs() < 1e-12, "{rim} {by_hand}");
        // a rim from which nothing was taken is where the points end
        let closed = expected(0.0)[2];
        assert!((closed - (rim - 0.64)).abs() < 1e-12, "{closed}");
    }
}

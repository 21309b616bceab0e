//! Times of a heat kernel that follow the sampling: short where points are dense, long where they are sparse.
//!
//! Ours. With one t for all points a Gaussian that reaches across the gaps of the sparsest part couples thousands of points
//! in the densest and smooths away what it could resolve. A kernel between points of times `t_i` and `t_j` has the time
//! `√(t_i t_j)`: it is symmetric, and what it is too wide on one side it is too narrow on the other, so that its second
//! moment, with which Δ is measured, stays right to first order. (Variable bandwidth kernels: Berry and Harlim 2016; there the
//! limit is another operator, here the areas of the cells and the calibrated moments keep Δ.)

use rayon::prelude::*;

use super::{HeatKernel, Sparse};
use crate::geometry::cells::CellKind;
use crate::geometry::{Cells, Points};
use crate::progress::{Canceled, Progress};

/// Rounds in which the logarithms of cell volumes are averaged with those of the neighbors.
const ROUNDS: usize = 12;

/// Most that a length may change per length along the surface: where the density has a step, the denser side keeps the
/// wider kernel for a while. A kernel that is too narrow is wrong, one that is too wide is only dear.
const SLOPE_MAX: f64 = 0.2;

/// Rounds in which that is spread from neighbor to neighbor.
const SPREAD_MAX: usize = 200;

/// Cells that are larger than the covering radius by at most this share ask for nothing, where none are larger.
const WIDER: f64 = 0.25;

/// Quantile of the cells' radii that is the covering radius, as for the whole cloud.
const COVERED: f64 = 0.99;

/// Time of a heat kernel at every point, relative to its mean over the surface.
#[derive(Debug, Clone, PartialEq)]
pub struct Bandwidth {
    /// `t_i/t`; their mean, weighted by volume, is 1.
    relative: Vec<f64>,
    /// What the covering radius is where `t_i = t`.
    epsilon: f64,
}

impl Bandwidth {
    /// Follows the volumes of the cells, averaged along `walls`. Cells on a rim are cut off there and tell nothing. No time is
    /// longer than that of the covering radius `epsilon_max`.
    #[must_use]
    pub fn of_cells(
        points: &Points,
        cells: &Cells,
        walls: &Sparse,
        intrinsic: usize,
        epsilon_max: f64,
    ) -> Self {
        let to_length = 1.0 / intrinsic as f64;
        let lengths = smoothed(cells, walls).into_iter().map(|log| (log * to_length).exp()).collect();
        let mut lengths = graded(lengths, points, walls);
        let ratios = |kind: fn(CellKind) -> bool| -> Vec<f64> {
            (0..lengths.len())
                .filter(|&i| kind(cells.kind[i]))
                .map(|i| cells.radius[i] / lengths[i])
                .collect()
        };
        let mut covering = ratios(|kind| kind == CellKind::Closed);
        if covering.is_empty() {
            covering = ratios(|kind| kind != CellKind::Invalid);
        }
        let covering = if covering.is_empty() {
            1.0
        } else {
            let place = ((covering.len() - 1) as f64 * COVERED).round() as usize;
            *covering.select_nth_unstable_by(place, f64::total_cmp).1
        };
        let most = epsilon_max / covering;
        for length in &mut lengths {
            *length = length.min(most);
        }
        let total: f64 = cells.volume.iter().sum();
        let mean = lengths.iter().zip(&cells.volume).map(|(h, volume)| h * h * volume).sum::<f64>() / total;
        let relative = lengths.iter().map(|h| h * h / mean).collect();
        Self { relative, epsilon: covering * mean.sqrt() }
    }

    /// The same time everywhere, but longer where `lengths` (of [`coverage`](super::coverage)) are more than the covering radius, up
    /// to `longest` times it.
    #[must_use]
    pub fn wide_enough(
        points: &Points,
        cells: &Cells,
        walls: &Sparse,
        lengths: &[f64],
        epsilon: f64,
        longest: f64,
    ) -> Self {
        if lengths.iter().all(|&length| length <= (1.0 + WIDER) * epsilon) {
            return Self::even(points.len(), epsilon);
        }
        let lengths =
            lengths.iter().map(|length| length.clamp(epsilon, longest.max(1.0) * epsilon)).collect();
        let lengths = graded(lengths, points, walls);
        let total: f64 = cells.volume.iter().sum();
        let mean = lengths.iter().zip(&cells.volume).map(|(h, volume)| h * h * volume).sum::<f64>() / total;
        Self { relative: lengths.iter().map(|h| h * h / mean).collect(), epsilon: mean.sqrt() }
    }

    /// The same time everywhere.
    #[must_use]
    pub fn even(points: usize, epsilon: f64) -> Self {
        Self { relative: vec![1.0; points], epsilon }
    }

    fn varies(&self) -> bool {
        self.relative.iter().any(|relative| relative.to_bits() != 1.0_f64.to_bits())
    }

    /// The covering radius where the time is the mean one.
    #[must_use]
    pub fn epsilon(&self) -> f64 {
        self.epsilon
    }

    /// The kernel whose mean time is that of `mean`, and whose cut-off follows its time.
    #[must_use]
    pub fn of_kernel(&self, mean: HeatKernel) -> LocalKernel<'_> {
        LocalKernel { mean, bandwidth: self }
    }
}

/// A heat kernel whose time and cut-off follow the sampling.
#[derive(Debug, Clone, Copy)]
pub struct LocalKernel<'a> {
    /// With the mean time.
    pub mean: HeatKernel,
    bandwidth: &'a Bandwidth,
}

impl LocalKernel<'_> {
    /// Time at every point.
    #[must_use]
    pub fn times(&self) -> Vec<f64> {
        self.bandwidth.relative.iter().map(|relative| self.mean.t * relative).collect()
    }

    /// Whether times differ.
    #[must_use]
    pub fn varies(&self) -> bool {
        self.bandwidth.varies()
    }

    /// Cut-off radius at point `i`.
    #[must_use]
    pub fn reach(&self, i: usize) -> f64 {
        self.mean.delta * self.bandwidth.relative[i].sqrt()
    }
}

/// Logarithms of the cells' volumes, replaced [`ROUNDS`] times by the mean of the own one and those of the neighbors; only
/// closed cells have one to begin with.
fn smoothed(cells: &Cells, walls: &Sparse) -> Vec<f64> {
    // sums of logarithms and of cells
    let mut sums: Vec<[f64; 2]> = cells
        .volume
        .iter()
        .zip(&cells.kind)
        .map(|(volume, &kind)| if kind == CellKind::Closed { [volume.ln(), 1.0] } else { [0.0; 2] })
        .collect();
    for _ in 0..ROUNDS {
        sums = (0..sums.len())
            .into_par_iter()
            .with_min_len(1024)
            .map(|i| {
                let ([mut logs, mut cells], mut count) = (sums[i], 1.0);
                for j in walls.neighbors(i) {
                    logs += sums[j as usize][0];
                    cells += sums[j as usize][1];
                    count += 1.0;
                }
                [logs / count, cells / count]
            })
            .collect();
    }
    // of what has no closed cell nearby nothing is known but its own volume, of an unmeasured cell not even that
    let of_all = sums.iter().fold([0.0, 0.0], |[a, b], [logs, cells]| [a + logs, b + cells]);
    let otherwise = if of_all[1] > 0.0 { of_all[0] / of_all[1] } else { 0.0 };
    let mean = |(&[logs, cells], &volume): (&[f64; 2], &f64)| match (cells > 0.0, volume > 0.0) {
        (true, _) => logs / cells,
        (false, true) => volume.ln(),
        (false, false) => otherwise,
    };
    sums.iter().zip(&cells.volume).map(mean).collect()
}

/// The least lengths that are as large as `lengths` and grow by at most [`SLOPE_MAX`] of the way between neighbors.
fn graded(mut lengths: Vec<f64>, points: &Points, walls: &Sparse) -> Vec<f64> {
    for _ in 0..SPREAD_MAX {
        let least = |i: usize| {
            let of = |j: u32| {
                let squared = points.squared_distance(i, j as usize);
                lengths[j as usize] - SLOPE_MAX * squared.sqrt()
            };
            walls.neighbors(i).map(of).fold(lengths[i], f64::max)
        };
        let next: Vec<f64> = (0..lengths.len()).into_par_iter().with_min_len(1024).map(least).collect();
        let is_settled = next == lengths;
        lengths = next;
        if is_settled {
            break;
        }
    }
    lengths
}

/// Times are told apart in so many steps of their logarithm: over a hundredfold density a step is 4 % of t.
const STEPS: usize = 128;

/// Points of one partial sum.
const PART: usize = 1 << 14;

/// Steps of Newton's method at the most; four do unless λ is near the end of what μ tells.
const NEWTON_MAX: usize = 60;

/// λ of the eigenvalues `mu` of an operator whose times differ: with which `(1 − exp(−t_i λ))/t_i`, averaged over the mode, is
/// μ. Infinite where μ says nothing about λ any more. `row(i)` are the values of all modes at point `i`, of norm 1 over
/// all points.
///
/// Where t is the same everywhere this is [`HeatKernel::corrected`].
///
/// # Errors
/// [`Canceled`].
pub fn corrected(
    times: &[f64],
    mu: &[f64],
    row: impl Fn(usize, &mut [f64]) + Sync,
    progress: &Progress,
) -> Result<Vec<f64>, Canceled> {
    let (least, most) = times.iter().fold((f64::INFINITY, 0.0_f64), |(a, b), &t| (a.min(t), b.max(t)));
    let width = ((most / least).ln() / STEPS as f64).max(f64::MIN_POSITIVE);
    let step = |t: f64| (((t / least).ln() / width) as usize).min(STEPS - 1);
    let modes = mu.len();
    // what stands for a step: the geometric mean of its times
    let mut logarithms = vec![[0.0, 0.0]; STEPS];
    for &t in times {
        let [sum, count] = &mut logarithms[step(t)];
        *sum += (t / least).ln();
        *count += 1.0;
    }
    let of_part = |part: usize| {
        let (mut shares, mut y) = (vec![0.0; STEPS * modes], vec![0.0; modes]);
        let places = part * PART..times.len().min((part + 1) * PART);
        for i in places.take_while(|_| !progress.is_canceled()) {
            row(i, &mut y);
            let own = &mut shares[step(times[i]) * modes..][..modes];
            own.iter_mut().zip(&y).for_each(|(share, y)| *share += y * y);
        }
        shares
    };
    let parts: Vec<Vec<f64>> = (0..times.len().div_ceil(PART)).into_par_iter().map(of_part).collect();
    progress.checkpoint()?;
    let shares = parts.into_iter().fold(vec![0.0; STEPS * modes], |mut all, part| {
        all.iter_mut().zip(part).for_each(|(all, part)| *all += part);
        all
    });
    let of_mode = |mode: usize| {
        let spread: Vec<(f64, f64)> = (0..STEPS)
            .map(|step| (logarithms[step], shares[step * modes + mode]))
            .filter(|&(_, share)| share > 0.0)
            .map(|([sum, count], share)| (least * (sum / count).exp(), share))
            .collect();
        corrected_over(&spread, mu[mode])
    };
    Ok((0..modes).map(of_mode).collect())
}

/// λ of one mode: Newton's method from below, where the mean is concave.
fn corrected_over(spread: &[(f64, f64)], mu: f64) -> f64 {
    let all: f64 = spread.iter().map(|&(_, share)| share).sum();
    if mu <= 0.0 || all <= 0.0 {
        return mu;
    }
    let most: f64 = spread.iter().map(|(t, share)| share / t).sum();
    if mu * all >= most {
        return f64::INFINITY;
    }
    let mut lambda = mu;
    for _ in 0..NEWTON_MAX {
        let (mut value, mut slope) = (0.0, 0.0);
        for &(t, share) in spread {
            value -= share * (-t * lambda).exp_m1() / t;
            slope += share * (-t * lambda).exp();
        }
        let change = (mu * all - value) / slope;
        lambda += change;
        if change <= 1e-13 * lambda {
            break;
        }
    }
    lambda
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::stars::tests::{jitter, stars_of};
    use crate::operator::voronoi;

    fn bandwidth(rows: &[[f64; 3]]) -> (Bandwidth, Vec<f64>) {
        let (points, _, stars) = stars_of(rows);
        let cells = stars.cells(&points, &Progress::new()).unwrap();
        let walls = voronoi::stiffness(&cells, &Progress::new()).unwrap();
        let bandwidth = Bandwidth::of_cells(&points, &cells, &walls, 2, f64::MAX);
        let kernel = HeatKernel { t: 1.0, delta: 1.0, truncation_compensation: false, dimension: 2 };
        let times = bandwidth.of_kernel(kernel).times();
        let by_row = (0..rows.len()).map(|row| times[points.of_row(row).unwrap()]).collect();
        (bandwidth, by_row)
    }

    #[test]
    fn on_a_lattice_times_are_alike_up_to_the_rim() {
        let rows: Vec<[f64; 3]> = (0..900).map(|i| [f64::from(i % 30), f64::from(i / 30), 0.0]).collect();
        let (bandwidth, times) = bandwidth(&rows);
        assert!(times.iter().all(|t| (t - 1.0).abs() < 1e-9));
        // every place of a square is within half of its diagonal of a corner
        assert!((bandwidth.epsilon() - 0.5_f64.sqrt()).abs() < 1e-9, "{}", bandwidth.epsilon());
    }

    #[test]
    fn where_points_are_three_times_as_far_apart_times_are_nine_times_as_long() {
        // columns of spacing 1, then of spacing 3, in rows of the same spacings
        let mut rows: Vec<[f64; 3]> = Vec::new();
        for (from, spacing) in [(0.0, 1.0), (60.0, 3.0)] {
            let count = (60.0 / spacing) as usize;
            for i in 0..count * count {
                let seed = (2 * i) as u64 + spacing as u64;
                let [x, y] = [i % count, i / count].map(|k| k as f64);
                rows.push([
                    from + spacing * (x + 0.5 + 0.3 * jitter(seed)),
                    spacing * (y + 0.5 + 0.3 * jitter(seed + 1)),
                    0.0,
                ]);
            }
        }
        let (_, times) = bandwidth(&rows);
        let near = |x: f64| {
            let found =
                rows.iter().zip(&times).filter(|(p, _)| (p[0] - x).abs() < 6.0 && (p[1] - 30.0).abs() < 12.0);
            let times: Vec<f64> = found.map(|(_, t)| *t).collect();
            times.iter().sum::<f64>() / times.len() as f64
        };
        let ratio = near(105.0) / near(20.0);
        assert!((ratio / 9.0 - 1.0).abs() < 0.1, "{ratio}");
    }

    #[test]
    fn no_time_is_longer_than_that_of_the_largest_radius() {
        // from left to right four times as far apart
        let rows: Vec<[f64; 3]> = (0..40)
            .flat_map(|i| {
                let x = 10.0 * (f64::from(i) / 40.0 * 4.0_f64.ln()).exp();
                (0..40).map(move |j| [x, f64::from(j) * 0.4, 0.0])
            })
            .collect();
        let (points, _, stars) = stars_of(&rows);
        let cells = stars.cells(&points, &Progress::new()).unwrap();
        let walls = voronoi::stiffness(&cells, &Progress::new()).unwrap();
        let longest = |epsilon_max: f64| {
            let bandwidth = Bandwidth::of_cells(&points, &cells, &walls, 2, epsilon_max);
            bandwidth.epsilon() * bandwidth.relative.iter().copied().fold(0.0, f64::max).sqrt()
        };
        let free = longest(f64::MAX);
        assert!((longest(0.7 * free) / (0.7 * free) - 1.0).abs() < 1e-9);
        assert!((longest(2.0 * free) / free - 1.0).abs() < 1e-9);
    }

    #[test]
    fn times_are_longer_around_the_cells_that_ask_for_it_alone() {
        let rows: Vec<[f64; 3]> = (0..400).map(|i| [f64::from(i % 20), f64::from(i / 20), 0.0]).collect();
        let (points, _, stars) = stars_of(&rows);
        let cells = stars.cells(&points, &Progress::new()).unwrap();
        let walls = voronoi::stiffness(&cells, &Progress::new()).unwrap();
        let lengths = |length: f64| {
            let mut lengths = vec![0.7; rows.len()];
            lengths[points.of_row(210).unwrap()] = length;
            let found = Bandwidth::wide_enough(&points, &cells, &walls, &lengths, 0.7, 3.0);
            let places: Vec<usize> = (0..rows.len()).map(|row| points.of_row(row).unwrap()).collect();
            move |row: usize| found.epsilon * found.relative[places[row]].sqrt()
        };
        let even = lengths(0.8);
        assert!([210, 211, 399].into_iter().all(|row| even(row) == 0.7));
        let wide = lengths(1.4);
        for (row, expected) in [(210, 1.4), (211, 1.2), (213, 0.8), (399, 0.7)] {
            assert!((wide(row) - expected).abs() < 1e-9, "{row}: {}", wide(row));
        }
        let too_wide = lengths(7.0);
        assert!((too_wide(210) - 2.1).abs() < 1e-9);
    }

    #[test]
    fn a_cell_that_could_not_be_measured_has_a_time_too() {
        let rows: Vec<[f64; 3]> = (0..100).map(|i| [f64::from(i % 10), f64::from(i / 10), 0.0]).collect();
        let (points, _, stars) = stars_of(&rows);
        let mut cells = stars.cells(&points, &Progress::new()).unwrap();
        let walls = Sparse::from_rows(
            rows.len(),
            || (),
            |i, (), row| row.push((i as u32, 0.0)),
            |_| Progress::new().checkpoint(),
        )
        .unwrap();
        cells.kind[50] = CellKind::Invalid;
        cells.volume[50] = 0.0;
        let bandwidth = Bandwidth::of_cells(&points, &cells, &walls, 2, f64::MAX);
        assert!(bandwidth.relative.iter().all(|t| t.is_finite() && *t > 0.0), "{bandwidth:?}");
    }

    #[test]
    fn with_one_time_the_correction_is_that_of_the_heat_kernel() {
        let kernel = HeatKernel { t: 0.01, delta: 1.0, truncation_compensation: false, dimension: 2 };
        let mu = [0.0, 1.0, 50.0, 99.0, 101.0];
        let modes: Vec<Vec<f64>> = vec![vec![0.5; 5]; 4];
        let found =
            corrected(&[0.01; 4], &mu, |i, y| y.copy_from_slice(&modes[i]), &Progress::new()).unwrap();
        for (mu, found) in mu.iter().zip(found) {
            let expected = kernel.corrected(*mu);
            let is_same = found.to_bits() == expected.to_bits() || (found / expected - 1.0).abs() < 1e-9;
            assert!(is_same, "{mu}: {found} {expected}");
        }
    }

    #[test]
    fn a_mode_over_two_times_has_the_eigenvalue_with_which_their_mean_is_right() {
        let (times, lambda) = ([0.01, 0.04], 30.0_f64);
        // three quarters of the first mode are where the time is short, all of the second where it is long
        let modes = [[0.75_f64.sqrt(), 0.0], [0.5, 1.0]];
        let of = |t: f64| -(-t * lambda).exp_m1() / t;
        let mu = [0.75 * of(times[0]) + 0.25 * of(times[1]), of(times[1])];
        let row = |i: usize, y: &mut [f64]| y.copy_from_slice(&modes[i]);
        for found in corrected(&times, &mu, row, &Progress::new()).unwrap() {
            assert!((found / lambda - 1.0).abs() < 1e-12, "{found}");
        }
    }
}

//! Point-Based Manifold Harmonics: the symmetrizable Voronoi-weighted heat-kernel operator [PBMHB §3.3–3.4].

use std::ops::Range;

use rayon::prelude::*;

use super::bandwidth::LocalKernel;
use super::rims::Rims;
use super::sheets::Sheets;
use super::unfolding::Atlas;
use super::{HeatKernel, LaplaceBeltrami, Sparse};
use crate::geometry::{Cells, Points, SearchTree};
use crate::progress::{Canceled, Progress};

/// Default `t/ε²` on surfaces, with distances along the surface and calibrated moments.
///
/// Worst relative error of the first eigenvalues at 0.35, 0.4 and 0.5 (with `δ = 4√(2t)`): regular sphere of 4,000
/// points 0.13, 0.05 and 0.07 %, four iid-random spheres at most 2.6, 2.1 and 1.6 %, spot 1.6, 1.6 and 1.8 %, fandisk
/// 0.3, 0.4 and 0.5 %, bunny at 0.4 and 0.5 0.9 and 1.1 %.
const T_FACTOR_CALIBRATED: f64 = 0.4;

/// The same where points are `stretch` times as far apart in one direction as in the other: a Gaussian that is as coarse for
/// the lattice in both directions can be calibrated by one number per point, one that is coarse in one direction cannot.
/// Worst error of 29 eigenvalues at 0.4 and 0.8: scan lines 2 : 1 on a square 8.6 and 1.1 %, 4 : 1 14.8 and 1.7 %, on a
/// flat torus 2 : 1 7.8 and 0.2 %. Random points have stretches of 1.4, hexagons and scans of meshes up to 1.65.
const T_FACTOR_STRETCHED: f64 = 0.8;

/// Stretches from which on t grows, and where it has grown.
const STRETCH: [f64; 2] = [1.65, 1.95];

/// The same without: a regular lattice needs it (2.5 % at 0.35 and 0.27 % at 0.5).
const T_FACTOR_SURFACE: f64 = 0.5;

/// The same on curves, where ε is but half the spacing.
const T_FACTOR_CURVE: f64 = 2.0;

/// The same in volumes, where a Gaussian of the same width reaches many more neighbors: flat three-torus of 4,000
/// points, worst of 18 eigenvalues 5.5 % with 111 neighbors a row, at 0.5 9.5 % with 190 (uncalibrated).
const T_FACTOR_VOLUME: f64 = 0.35;

/// Default `t/ε²` in intrinsic dimension k.
#[must_use]
pub const fn t_factor(dimension: usize, calibrated: bool) -> f64 {
    match dimension {
        1 => T_FACTOR_CURVE,
        2 if calibrated => T_FACTOR_CALIBRATED,
        2 => T_FACTOR_SURFACE,
        _ => T_FACTOR_VOLUME,
    }
}

/// Default `δ/√(2t)`. On a regular sphere of 4,000 points with `t = 0.7ε²` the worst error of 25 eigenvalues is
/// 0.59 % with 3.5 and 25 neighbors a row, 0.19 % with 4 and 35.
pub const DELTA_FACTOR: f64 = 4.0;

/// Default `δ/√(2t)` of the paper's own operator, which has no compensation: the share of the second moment lost is
/// `exp(−12.5)·13.5`, 5·10⁻⁵.
pub const DELTA_FACTOR_PAPER: f64 = 5.0;

/// Rounds in which the moments are calibrated; eight change the eigenvalues by less than 0.1 %.
const ROUNDS: usize = 4;

/// Rows of the matrix that one task works on.
const ROWS_PER_TASK: usize = 512;

/// Most that one round changes a moment by.
const CHANGE_MAX: f64 = 10.0;

/// Default `t/ε²` on surfaces whose points are `stretch` times as far apart in one direction as in the other.
#[must_use]
pub fn t_factor_of_stretched(stretch: f64) -> f64 {
    let grown = ((stretch - STRETCH[0]) / (STRETCH[1] - STRETCH[0])).clamp(0.0, 1.0);
    T_FACTOR_CALIBRATED + grown * (T_FACTOR_STRETCHED - T_FACTOR_CALIBRATED)
}

/// Which pairs the kernel couples, and at which distance.
#[derive(Debug)]
pub enum Coupling<'a> {
    /// All in the Euclidean ball of radius δ, as in the paper.
    Ball,
    /// Those of the ball on the same sheet.
    Sheet(&'a Sheets),
    /// Those within δ along the surface, at that distance.
    Surface(&'a Atlas<'a>),
}

/// Assembles the operator: mass `a_i`, stiffness `s_ij = −a_i a_j · factor · exp(−d_ij²/4t)` for `d_ij ≤ δ`
/// [PBMHB eq. 3.5–3.7], zero row sums; if `calibrated` scaled on both sides by positive numbers (see
/// `calibration`), with the moments that rims leave.
///
/// # Errors
/// [`Canceled`].
pub fn build(
    points: &Points,
    tree: &SearchTree,
    cells: &Cells,
    coupling: &Coupling<'_>,
    local: LocalKernel<'_>,
    calibrated: Option<&Rims>,
    progress: &Progress,
) -> Result<LaplaceBeltrami, Canceled> {
    let kernel = local.mean;
    let reach = |i: usize| local.reach(i);
    let mut stiffness = match coupling {
        Coupling::Ball => in_ball(points, tree, local, |_, _| true, progress)?,
        Coupling::Sheet(sheets) => in_ball(points, tree, local, |i, j| sheets.same(i, j), progress)?,
        Coupling::Surface(atlas) => atlas.squared_distances(reach, progress)?,
    };
    let times = local.times();
    // the factor and the exponent of a pair are the products of what its ends have
    let narrowness: Vec<f64> = times.iter().map(|t| 0.5 / t.sqrt()).collect();
    let mut weights: Vec<f64> = times
        .iter()
        .zip(&cells.volume)
        .map(|(&t, area)| {
            area * HeatKernel { t, delta: kernel.delta * (t / kernel.t).sqrt(), ..kernel }.factor().sqrt()
        })
        .collect();
    // exponentials are dear: they are taken once
    let gaussian = gaussian(&stiffness, &narrowness);
    if let Some(rims) = calibrated {
        let mut moments = rims.moments(&stiffness, &times);
        moments.iter_mut().zip(&cells.volume).for_each(|(moment, area)| *moment *= area);
        let scale = calibration(&stiffness, &gaussian, &moments, &weights, kernel.dimension, progress)?;
        weights.iter_mut().zip(scale).for_each(|(weight, scale)| *weight *= scale);
    }
    let offsets = stiffness.offsets().to_vec();
    stiffness.rewrite(|i, columns, values| {
        let mut sum = 0.0;
        let gaussian = &gaussian[offsets[i]..offsets[i + 1]];
        for ((&j, value), gaussian) in columns.iter().zip(values.iter_mut()).zip(gaussian) {
            if j as usize != i {
                let weight = weights[i] * weights[j as usize] * gaussian;
                sum += weight;
                *value = -weight;
            }
        }
        if let Ok(diagonal) = columns.binary_search(&(i as u32)) {
            values[diagonal] = sum;
        }
    });
    let times = local.varies().then_some(times);
    Ok(LaplaceBeltrami { times, ..LaplaceBeltrami::diffusive(stiffness, cells.volume.clone(), kernel) })
}

/// `exp(−d²/4t)` of every entry d² of a matrix, `1/4t` being the product of the `narrowness` of both ends.
fn gaussian(squared_distances: &Sparse, narrowness: &[f64]) -> Vec<f64> {
    let (n, offsets) = (squared_distances.rows(), squared_distances.offsets());
    let mut gaussian = vec![0.0; squared_distances.nonzeros()];
    let mut rest = gaussian.as_mut_slice();
    let mut tasks: Vec<(Range<usize>, &mut [f64])> = Vec::with_capacity(n.div_ceil(ROWS_PER_TASK));
    for first in (0..n).step_by(ROWS_PER_TASK) {
        let rows = first..n.min(first + ROWS_PER_TASK);
        let (own, behind) = rest.split_at_mut(offsets[rows.end] - offsets[first]);
        tasks.push((rows, own));
        rest = behind;
    }
    tasks.into_par_iter().for_each(|(rows, own)| {
        let entries = rows.flat_map(|i| {
            let (columns, squared) = squared_distances.row(i);
            columns
                .iter()
                .zip(squared)
                .map(move |(&j, squared)| narrowness[i] * narrowness[j as usize] * squared)
        });
        own.iter_mut().zip(entries).for_each(|(gaussian, exponent)| *gaussian = (-exponent).exp());
    });
    gaussian
}

/// Squared Euclidean distances up to the geometric mean of the cut-off radii of both ends, between those that are coupled; the
/// diagonal zero.
fn in_ball(
    points: &Points,
    tree: &SearchTree,
    local: LocalKernel<'_>,
    couples: impl Fn(usize, usize) -> bool + Sync + Send,
    progress: &Progress,
) -> Result<Sparse, Canceled> {
    let n = points.len();
    let radius = |i: usize| local.reach(i);
    let seen = Sparse::from_rows(
        n,
        Vec::new,
        |i, neighbors, row| {
            if progress.is_canceled() {
                return;
            }
            // a pair's end of the larger radius reaches the other one
            tree.within(points, i, radius(i), neighbors);
            let near = |j: usize, squared: f64| squared <= radius(i) * radius(j);
            let coupled = neighbors
                .iter()
                .filter(|q| near(q.index as usize, q.squared_distance) && couples(i, q.index as usize));
            row.extend(coupled.map(|q| (q.index, q.squared_distance)));
            let place = row.partition_point(|&(j, _)| (j as usize) < i);
            row.insert(place, (i as u32, 0.0));
        },
        |rows| progress.advance(0.6 * rows as f64 / n as f64),
    )?;
    if !local.varies() {
        return Ok(seen);
    }
    let unseen = seen.seen_from_elsewhere();
    Sparse::from_rows(
        n,
        || (),
        |i, (), row| {
            let (columns, squared) = seen.row(i);
            row.extend(columns.iter().copied().zip(squared.iter().copied()).chain(unseen[i].iter().copied()));
            row.sort_unstable_by_key(|&(j, _)| j);
        },
        |rows| progress.advance(0.6 + 0.1 * rows as f64 / n as f64),
    )
}

/// Positive numbers s with which `s_i s_j q_ij` has the second moment of the heat kernel around every point:
/// `Σ_j s_i s_j q_ij d_ij² = 2k·m_i`, with `m_i` the area `a_i` or, near rims, the share of it that [`Rims::moments`] says: the diagonal of the carré du champ of the coordinates (k the intrinsic dimension);
/// `q_ij` are the products of the `weights` of both ends with the entries of `gaussian`.
///
/// Ours. A lattice that is coarse for the Gaussian, uneven sampling, and rims, beyond which there are no points, each
/// give the sum another value; scaling both sides restores it and keeps symmetry, signs and zero row sums. Every round
/// multiplies by the root of what is missing, like Sinkhorn's iteration for symmetric matrices.
fn calibration(
    squared_distances: &Sparse,
    gaussian: &[f64],
    moments: &[f64],
    weights: &[f64],
    dimension: usize,
    progress: &Progress,
) -> Result<Vec<f64>, Canceled> {
    let offsets = squared_distances.offsets();
    let target = 2.0 * dimension as f64;
    let mut scaled = weights.to_vec();
    let mut scale = vec![1.0; moments.len()];
    for round in 0..ROUNDS {
        progress.advance(0.7 + 0.3 * round as f64 / ROUNDS as f64)?;
        let next = (0..moments.len()).into_par_iter().with_min_len(512).map(|i| {
            let (columns, squared) = squared_distances.row(i);
            let found: f64 = columns
                .iter()
                .zip(squared)
                .zip(&gaussian[offsets[i]..offsets[i + 1]])
                .map(|((&j, &squared), gaussian)| scaled[j as usize] * gaussian * squared)
                .sum();
            let missing = target * moments[i] / (scaled[i] * found);
            // nothing is known of a point without neighbors
            let missing = if found > 0.0 { missing.clamp(1.0 / CHANGE_MAX, CHANGE_MAX) } else { 1.0 };
            scale[i] * missing.sqrt()
        });
        scale = next.collect();
        scaled = scale.iter().zip(weights).map(|(scale, weight)| scale * weight).collect();
    }
    Ok(scale)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn t_grows_with_the_stretch_of_the_sampling_between_two_plateaus() {
        let [isotropic, between, lines] = [1.42, 1.8, 4.0].map(t_factor_of_stretched);
        assert!(isotropic.to_bits() == T_FACTOR_CALIBRATED.to_bits());
        assert!(isotropic < between && between < lines);
        assert!((lines - T_FACTOR_STRETCHED).abs() < 1e-12);
    }

    #[test]
    fn calibrated_moments_are_those_of_the_heat_kernel_on_a_coarse_uneven_lattice() {
        // unit squares, the right half stretched to twice the width, with rims; areas as they are
        let place = |i: usize| if i < 10 { i as f64 } else { 2.0 * i as f64 - 9.0 };
        let width = |i: usize| if i < 10 { 1.0 } else { 2.0 };
        let squared = |a: usize, b: usize| {
            let (x, y) = (place(a % 20) - place(b % 20), (a / 20) as f64 - (b / 20) as f64);
            x * x + y * y
        };
        let kernel = HeatKernel { t: 0.5, delta: 4.0, truncation_compensation: true, dimension: 2 };
        let areas: Vec<f64> = (0..400).map(|i| width(i % 20)).collect();
        let near = Sparse::from_rows(
            400,
            || (),
            |i, (), row| {
                row.extend((0..400).map(|j| (j as u32, squared(i, j))).filter(|&(_, d)| d <= 16.0));
            },
            |_| Ok::<(), Canceled>(()),
        )
        .unwrap();
        let gaussian: Vec<f64> = near.values().iter().map(|squared| (-0.5 * squared).exp()).collect();
        let weights: Vec<f64> = areas.iter().map(|area| area * kernel.factor().sqrt()).collect();
        let scale = calibration(&near, &gaussian, &areas, &weights, 2, &Progress::new()).unwrap();
        let moment = |scale: &[f64], i: usize| {
            let (columns, squared) = near.row(i);
            let sum: f64 = columns
                .iter()
                .zip(squared)
                .map(|(&j, d)| areas[j as usize] * scale[j as usize] * (-0.5 * d).exp() * d)
                .sum();
            scale[i] * kernel.factor() * sum / 4.0
        };
        let off = |scale: &[f64]| (0..400).map(|i| (moment(scale, i) - 1.0).abs()).fold(0.0, f64::max);
        assert!(off(&[1.0; 400]) > 0.5);
        assert!(off(&scale) < 0.05, "{}", off(&scale));
        assert!(scale.iter().all(|&s| s > 0.0));
    }
}

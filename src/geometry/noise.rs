//! How far points lie off a smooth surface, and where it is: moving least squares (Levin 2003; Alexa et al. 2003).
//!
//! Noise along the normals lengthens every distance, so that areas come out too large and eigenvalues too small: by 9 % at
//! a quarter of the spacing. On the surface through the middle of the points lengths are right again.

use nalgebra::{Matrix6, Vector6};
use rayon::prelude::*;

use super::frames::axes_in_space;
use super::neighborhoods::{NearestNeighbors, Neighbor, SearchTree};
use super::points::{GeometryError, Points};
use crate::progress::Progress;

/// Neighbors of a fit; twice as many where the noise is more than [`STRONG`].
const NEIGHBORS: usize = 20;

/// Noise over spacing from which on fits take more neighbors.
const STRONG: f64 = 0.3;

/// Share of the points that are taken for the quietest, and how far the deviation of 15 degrees of freedom at that quantile
/// is below the true one.
const QUIET: f64 = 0.1;
const QUIET_DEVIATION: f64 = 0.755;

/// Noise is alike everywhere: where the quietest points have less than this share of the middle's deviation, what deviates
/// is the surface, too coarsely sampled.
const EVEN_MIN: f64 = 0.7;

/// Noise is as large among half of the neighbors: where fits deviate there by less than this share, a surface deviates that is
/// too coarse or too thin for a quadric. Of noise the median of 5 degrees of freedom is 0.95 times that of 15; of a
/// cubic surface a third.
const HALF_MIN: f64 = 0.7;

/// Points at which the noise is estimated.
const SAMPLES: usize = 2_000;

/// Noise of points in space about a surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Noise {
    /// Standard deviation from a quadratic surface through the neighbors over the local spacing, as it is around the
    /// quietest points: creases and thin parts are off such surfaces too, noise is everywhere.
    pub share: f64,
}

impl Noise {
    /// Estimates the noise; zero for points that are not in space.
    #[must_use]
    pub fn estimate(points: &Points, nearest: &NearestNeighbors) -> Self {
        if points.dimension() != 3 || nearest.count() < NEIGHBORS {
            return Self { share: 0.0 };
        }
        let stride = points.len().div_ceil(SAMPLES);
        let mut fits: Vec<(f64, f64)> = (0..points.len())
            .step_by(stride)
            .collect::<Vec<_>>()
            .into_par_iter()
            .filter_map(|i| {
                let fit = |count: usize| Fit::around(points, i, nearest.of(i)[..count].iter().copied());
                let (all, half) = (fit(NEIGHBORS)?, fit(NEIGHBORS / 2)?);
                Some((all.share(), half.deviation / all.deviation))
            })
            .collect();
        if fits.is_empty() {
            return Self { share: 0.0 };
        }
        fits.sort_unstable_by(|a, b| a.1.total_cmp(&b.1));
        if fits[fits.len() / 2].1 < HALF_MIN {
            return Self { share: 0.0 };
        }
        let mut shares: Vec<f64> = fits.into_iter().map(|fit| fit.0).collect();
        shares.sort_unstable_by(f64::total_cmp);
        let share = shares[(shares.len() as f64 * QUIET) as usize] / QUIET_DEVIATION;
        let middle = shares[shares.len() / 2];
        Self { share: if share < EVEN_MIN * middle { 0.0 } else { share } }
    }

    /// The points moved onto the quadratic surfaces through their neighbors.
    ///
    /// # Errors
    /// [`GeometryError::Canceled`].
    pub fn smoothed(
        self,
        points: &Points,
        tree: &SearchTree,
        progress: &Progress,
    ) -> Result<Points, GeometryError> {
        let count = if self.share > STRONG { 2 * NEIGHBORS } else { NEIGHBORS };
        let moved: Vec<[f64; 3]> = (0..points.len())
            .into_par_iter()
            .with_min_len(64)
            .map_init(Vec::new, |found: &mut Vec<Neighbor>, i| {
                let p = [0, 1, 2].map(|axis| points.point(i)[axis]);
                if progress.is_canceled() {
                    return p;
                }
                tree.nearest(points, i, count, found);
                Fit::around(points, i, found.iter().map(|q| q.index)).map_or(p, |fit| fit.foot)
            })
            .collect();
        progress.checkpoint()?;
        Ok(points.moved(moved.concat()))
    }
}

/// A quadratic surface through the neighbors of a point.
struct Fit {
    /// The point of the surface above or below the point.
    foot: [f64; 3],
    /// Standard deviation of the neighbors.
    deviation: f64,
    /// Local spacing.
    spacing: f64,
}

impl Fit {
    fn share(&self) -> f64 {
        self.deviation / self.spacing
    }

    /// Least squares in the principal axes of point `i` and its neighbors; `None` where they do not determine a surface.
    fn around(points: &Points, i: usize, neighbors: impl Iterator<Item = u32>) -> Option<Self> {
        let p = points.point(i);
        let mut offsets: Vec<[f64; 3]> = vec![[0.0; 3]];
        offsets
            .extend(neighbors.map(|q| std::array::from_fn(|axis| points.point(q as usize)[axis] - p[axis])));
        let count = offsets.len() as f64;
        let mean: [f64; 3] = std::array::from_fn(|axis| offsets.iter().map(|x| x[axis]).sum::<f64>() / count);
        let axes = axes_in_space(offsets.iter().map(|x| std::array::from_fn(|axis| x[axis] - mean[axis])))?;
        let reach = offsets.iter().map(|x| x.iter().map(|x| x * x).sum::<f64>()).fold(0.0, f64::max).sqrt();
        let local: Vec<[f64; 3]> = offsets
            .iter()
            .map(|offset| {
                std::array::from_fn(|axis| {
                    let along = axes.vectors[3 * axis..3 * axis + 3].iter().zip(offset);
                    along.map(|(a, x)| a * x).sum::<f64>() / reach
                })
            })
            .collect();
        let terms = |[u, v, _]: [f64; 3]| Vector6::new(1.0, u, v, u * u, u * v, v * v);
        let (mut normal, mut right) = (Matrix6::zeros(), Vector6::zeros());
        for &at in &local {
            normal += terms(at) * terms(at).transpose();
            right += terms(at) * at[2];
        }
        let fitted = normal.cholesky()?.solve(&right);
        let height = fitted[0];
        let squares: f64 = local.iter().map(|&at| (at[2] - terms(at).dot(&fitted)).powi(2)).sum();
        let deviation = reach * (squares / (count - 6.0).max(1.0)).sqrt();
        let foot = std::array::from_fn(|axis| p[axis] + reach * height * axes.vectors[6 + axis]);
        let spacing = reach * (std::f64::consts::PI / count).sqrt();
        (height.is_finite() && height.abs() < 1.0).then_some(Self { foot, deviation, spacing })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cloud::{NonFinite, PointCloud};
    use crate::geometry::stars::tests::jitter;

    fn height(x: f64, y: f64) -> f64 {
        0.01 * (x * x + 0.5 * y * y)
    }

    /// A paraboloid over a jittered lattice of unit squares, moved along z by uniform noise of this deviation.
    fn paraboloid(deviation: f64) -> Vec<[f64; 3]> {
        (0..1_600)
            .map(|i| {
                let at = |k: u64, axis: u64| k as f64 - 20.0 + 0.6 * jitter(2 * i + axis);
                let (x, y) = (at(i % 40, 0), at(i / 40, 1));
                [x, y, height(x, y) + deviation * 12.0_f64.sqrt() * jitter(50_000 + i)]
            })
            .collect()
    }

    #[test]
    fn noise_is_estimated_in_spacings_and_taken_away() {
        for deviation in [0.0, 0.1, 0.25, 0.5] {
            let rows = paraboloid(deviation);
            let cloud = PointCloud::new(3, rows.concat(), NonFinite::Reject).unwrap();
            let points = Points::prepare(&cloud, 2).unwrap();
            let (tree, progress) = (SearchTree::new(&points), Progress::new());
            let nearest = NearestNeighbors::find(&tree, &points, 20, &progress).unwrap();
            let noise = Noise::estimate(&points, &nearest);
            assert!((noise.share - deviation).abs() < 0.02 + 0.2 * deviation, "{deviation}: {noise:?}");
            let smoothed = noise.smoothed(&points, &tree, &progress).unwrap();
            // points are recentered, all by the same offset
            let first = rows[points.row(0)];
            let offset: [f64; 3] = std::array::from_fn(|axis| first[axis] - points.point(0)[axis]);
            let mut off: Vec<f64> = Vec::new();
            for i in 0..points.len() {
                let [x, y, z] = std::array::from_fn(|axis| smoothed.point(i)[axis] + offset[axis]);
                if x.abs() < 15.0 && y.abs() < 15.0 {
                    off.push((z - height(x, y)).powi(2));
                }
            }
            let rms = (off.iter().sum::<f64>() / off.len() as f64).sqrt();
            assert!(rms < 0.01 + 0.6 * deviation, "{deviation}: {rms}");
        }
    }
}

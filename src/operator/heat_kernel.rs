//! The kernel part that PB-MHB shares with the other heat-kernel operators: points, weights, t, δ.

use serde::{Deserialize, Serialize};

use super::Sparse;
use crate::geometry::{Points, SearchTree};
use crate::progress::{Canceled, Progress};

/// Time and cut-off of a Gaussian heat kernel.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "server", derive(utoipa::ToSchema))]
pub struct HeatKernel {
    /// Diffusion time t in length².
    pub t: f64,
    /// Cut-off radius δ in length. For `pcd` that of the neighborhood that is triangulated; the Gaussian is cut at
    /// half of it.
    pub delta: f64,
    /// Whether the second moment that the cut-off loses is made up for.
    pub truncation_compensation: bool,
    /// Intrinsic dimension k of the manifold.
    #[serde(default = "surface")]
    pub dimension: usize,
}

/// The intrinsic dimension of reports that do not state one.
fn surface() -> usize {
    2
}

impl HeatKernel {
    /// `1/((4πt)^{k/2} t)` [PBMHB eq. 3.5; PCD eq. 2.1], compensated if asked for.
    ///
    /// Ours: cutting the Gaussian at `δ = c·√(2t)` loses a share of its second moment, which is what Δ is measured with.
    #[must_use]
    pub fn factor(&self) -> f64 {
        let lost = if self.truncation_compensation {
            second_moment_beyond(self.delta * self.delta / (4.0 * self.t), self.dimension)
        } else {
            0.0
        };
        let norm = (4.0 * std::f64::consts::PI * self.t).powf(0.5 * self.dimension as f64);
        1.0 / (norm * self.t * (1.0 - lost))
    }

    /// λ of a raw eigenvalue: `L = (K_t − I)/t` with `K_t ≈ exp(tΔ)`, so that `μ = (1 − exp(−tλ))/t`.
    ///
    /// Infinite from `tμ = 1` on, where μ says nothing about λ any more.
    #[must_use]
    pub fn corrected(&self, mu: f64) -> f64 {
        if self.t * mu >= 1.0 { f64::INFINITY } else { -(-self.t * mu).ln_1p() / self.t }
    }

    /// The same for a complex eigenvalue `mu + i·part`: real and imaginary part of `−ln(1 − t(μ + ib))/t`.
    #[must_use]
    pub fn corrected_complex(&self, mu: f64, part: f64) -> (f64, f64) {
        if part == 0.0 || self.t * mu >= 1.0 {
            return (self.corrected(mu), part);
        }
        let (x, y) = (self.t * mu, self.t * part);
        (-0.5 * (x * (x - 2.0) + y * y).ln_1p() / self.t, y.atan2(1.0 - x) / self.t)
    }
}

/// Share of the second moment of a k-dimensional Gaussian beyond the radius δ, `x = δ²/4t`: the regularized upper
/// incomplete gamma function `Q(k/2 + 1, x)`, for k = 2 `exp(−x)(1 + x)`.
fn second_moment_beyond(x: f64, dimension: usize) -> f64 {
    let decay = (-x).exp();
    let odd = || libm::erfc(x.sqrt()) + 2.0 * (x / std::f64::consts::PI).sqrt() * decay;
    match dimension {
        1 => odd(),
        2 => decay * (1.0 + x),
        _ => odd() + 4.0 / 3.0 * x * (x / std::f64::consts::PI).sqrt() * decay,
    }
}

/// `S` with `s_ij = −a_i a_j · factor · exp(−|p_i−p_j|²/4t)` for `|p_i−p_j| ≤ δ` and `couples(i, j)`, which must be
/// symmetric [PBMHB eq. 3.5–3.7]. Points of weight 0 are coupled to nothing.
///
/// # Errors
/// [`Canceled`].
pub fn stiffness(
    points: &Points,
    tree: &SearchTree,
    weights: &[f64],
    kernel: HeatKernel,
    couples: impl Fn(usize, usize) -> bool + Sync + Send,
    progress: &Progress,
) -> Result<Sparse, Canceled> {
    let n = points.len();
    let (factor, exponent) = (kernel.factor(), -0.25 / kernel.t);
    Sparse::stiffness(
        n,
        Vec::new,
        |i, neighbors, row| {
            if weights[i] == 0.0 || progress.is_canceled() {
                return;
            }
            tree.within(points, i, kernel.delta, neighbors);
            let coupled = |q: usize| weights[q] > 0.0 && couples(i, q);
            row.extend(neighbors.iter().filter(|q| coupled(q.index as usize)).map(|q| {
                let weight = (weights[i] * weights[q.index as usize]) * factor;
                (q.index, weight * (exponent * q.squared_distance).exp())
            }));
        },
        |rows| progress.advance(rows as f64 / n as f64),
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_correction_inverts_the_heat_kernels_eigenvalue() {
        let kernel = HeatKernel { t: 0.01, delta: 1.0, truncation_compensation: false, dimension: 2 };
        for lambda in [0.0, 2.0, 110.0] {
            let mu = -f64::exp_m1(-kernel.t * lambda) / kernel.t;
            assert!((kernel.corrected(mu) - lambda).abs() < 1e-12 * (1.0 + lambda));
        }
        assert!(kernel.corrected(100.0).is_infinite());
        // 1 − t(μ + ib) = exp(−t(3 + 4i)) at t = 0.01
        let (size, angle) = ((-0.03_f64).exp(), -0.04_f64);
        let (mu, part) = ((1.0 - size * angle.cos()) / 0.01, -size * angle.sin() / 0.01);
        let (lambda, imaginary) = kernel.corrected_complex(mu, part);
        assert!((lambda - 3.0).abs() < 1e-12 && (imaginary - 4.0).abs() < 1e-12);
    }

    #[test]
    fn compensation_restores_the_second_moment_of_the_cut_gaussian_in_every_dimension() {
        // ∫ over the ball of radius δ of r²/2k · exp(−r²/4t)/((4πt)^{k/2} t) dx = 1 when nothing is lost
        for (dimension, sphere) in
            [(1, 2.0), (2, 2.0 * std::f64::consts::PI), (3, 4.0 * std::f64::consts::PI)]
        {
            let kernel = HeatKernel { t: 0.3, delta: 1.2, truncation_compensation: true, dimension };
            let steps = 200_000;
            let dr = kernel.delta / f64::from(steps);
            let moment: f64 = (0..steps)
                .map(|step| {
                    let r = (f64::from(step) + 0.5) * dr;
                    let shell = sphere * r.powf(dimension as f64 - 1.0) * dr;
                    r * r / (2 * dimension) as f64 * (-0.25 * r * r / kernel.t).exp() * shell
                })
                .sum();
            assert!((moment * kernel.factor() - 1.0).abs() < 1e-8, "k = {dimension}");
        }
    }
}

//! The kernel part that PB-MHB shares with the other heat-kernel operators: points, weights, t, δ.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::SymmetricSparse;
use crate::geometry::{Points, SearchTree};
use crate::progress::{Canceled, Progress};

/// Time and cut-off of a Gaussian heat kernel on a surface (intrinsic dimension k = 2).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct HeatKernel {
    /// Diffusion time t in length².
    pub t: f64,
    /// Cut-off radius δ in length.
    pub delta: f64,
    /// Whether the second moment that the cut-off loses is made up for.
    pub truncation_compensation: bool,
}

impl HeatKernel {
    /// `1/((4πt)^{k/2} t)` for k = 2 [PBMHB eq. 3.5; PCD eq. 2.1], compensated if asked for.
    ///
    /// Ours: cutting the Gaussian at `δ = c·√(2t)` loses the share `exp(−c²/2)(1+c²/2)` of its second moment, which
    /// is what Δ is measured with.
    #[must_use]
    pub fn factor(&self) -> f64 {
        let half_square = self.delta * self.delta / (4.0 * self.t);
        let lost =
            if self.truncation_compensation { (-half_square).exp() * (1.0 + half_square) } else { 0.0 };
        1.0 / (4.0 * std::f64::consts::PI * self.t * self.t * (1.0 - lost))
    }

    /// λ of a raw eigenvalue: `L = (K_t − I)/t` with `K_t ≈ exp(tΔ)`, so that `μ = (1 − exp(−tλ))/t`.
    ///
    /// Infinite from `tμ = 1` on, where μ says nothing about λ any more.
    #[must_use]
    pub fn corrected(&self, mu: f64) -> f64 {
        if self.t * mu >= 1.0 { f64::INFINITY } else { -(-self.t * mu).ln_1p() / self.t }
    }
}

/// `S` with `s_ij = −a_i a_j · factor · exp(−|p_i−p_j|²/4t)` for `|p_i−p_j| ≤ δ` and `couples(i, j)`, which must be
/// symmetric [PBMHB eq. 3.5–3.7].
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
) -> Result<SymmetricSparse, Canceled> {
    let n = points.len();
    let (factor, exponent) = (kernel.factor(), -0.25 / kernel.t);
    SymmetricSparse::stiffness(
        n,
        Vec::new,
        |i, neighbors, row| {
            tree.within(points, i, kernel.delta, neighbors);
            row.extend(neighbors.iter().filter(|q| couples(i, q.index as usize)).map(|q| {
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
        let kernel = HeatKernel { t: 0.01, delta: 1.0, truncation_compensation: false };
        for lambda in [0.0, 2.0, 110.0] {
            let mu = -f64::exp_m1(-kernel.t * lambda) / kernel.t;
            assert!((kernel.corrected(mu) - lambda).abs() < 1e-12 * (1.0 + lambda));
        }
        assert!(kernel.corrected(100.0).is_infinite());
    }

    #[test]
    fn compensation_restores_the_second_moment_of_the_cut_gaussian() {
        // ∫ over the disc of radius δ of r²/4 · exp(−r²/4t)/(4πt²) · 2πr dr = 1 when nothing is lost
        let kernel = HeatKernel { t: 0.3, delta: 1.2, truncation_compensation: true };
        let steps = 200_000;
        let dr = kernel.delta / f64::from(steps);
        let moment: f64 = (0..steps)
            .map(|step| {
                let r = (f64::from(step) + 0.5) * dr;
                0.25 * r * r * (-0.25 * r * r / kernel.t).exp() * 2.0 * std::f64::consts::PI * r * dr
            })
            .sum();
        assert!((moment * kernel.factor() - 1.0).abs() < 1e-8);
    }
}

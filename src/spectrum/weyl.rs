//! Where eigenvalues are expected before any is known.

use std::f64::consts::PI;

/// Where the eigenvalues are expected: Weyl's law, corrected by what is counted.
#[derive(Debug, Clone, Copy)]
pub struct Weyl {
    /// Size of the first non-zero eigenvalue λ.
    pub first: f64,
    /// Intrinsic dimension k: the j-th is about `first · j^{2/k}`.
    pub dimension: usize,
    /// t of a heat kernel, whose eigenvalues are `μ = (1 − exp(−tλ))/t`.
    pub t: Option<f64>,
}

impl Weyl {
    /// The size of the first non-zero eigenvalues of a manifold: `(2π/length)²` of a curve, `4π/area` of a surface,
    /// `(6π²/volume)^{2/3}` in three dimensions.
    #[must_use]
    pub fn first_of(volume: f64, dimension: usize) -> f64 {
        match dimension {
            1 => (2.0 * PI / volume).powi(2),
            2 => 4.0 * PI / volume,
            _ => (6.0 * PI * PI / volume).powf(2.0 / 3.0),
        }
    }

    /// The `index`-th non-zero eigenvalue.
    #[must_use]
    pub fn eigenvalue(&self, index: f64) -> f64 {
        let lambda = self.first * index.powf(2.0 / self.dimension as f64);
        self.t.map_or(lambda, |t| -(-t * lambda).exp_m1() / t)
    }

    /// The law that has `count` non-zero eigenvalues below `mu`.
    pub(super) fn through(self, mu: f64, count: usize) -> Self {
        let lambda = self.t.map_or(mu, |t| -(-t * mu).ln_1p() / t);
        Self { first: lambda / (count.max(1) as f64).powf(2.0 / self.dimension as f64), ..self }
    }
}

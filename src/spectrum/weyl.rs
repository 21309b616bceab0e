//! Where eigenvalues are expected before any is known.

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
    /// The `index`-th non-zero eigenvalue.
    pub(super) fn eigenvalue(&self, index: f64) -> f64 {
        let lambda = self.first * index.powf(2.0 / self.dimension as f64);
        self.t.map_or(lambda, |t| -(-t * lambda).exp_m1() / t)
    }

    /// The law that has `count` non-zero eigenvalues below `mu`.
    pub(super) fn through(self, mu: f64, count: usize) -> Self {
        let lambda = self.t.map_or(mu, |t| -(-t * mu).ln_1p() / t);
        Self { first: lambda / (count.max(1) as f64).powf(2.0 / self.dimension as f64), ..self }
    }
}

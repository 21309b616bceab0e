//! Distances that the spectrum gives, from one point to all.

use super::{Block, Modes};
use crate::arguments::{arguments, words};

words! {
    /// Which distance.
    #[derive(Default)]
    #[non_exhaustive]
    pub enum DistanceKind {
        /// `d² = Σ (H_i(p) − H_i(q))² / λ_i²` over the non-zero modes [Lipman, Rustamov, Funkhouser 2010]; a length.
        #[default]
        Biharmonic,
        /// `d² = Σ exp(−2 t λ_i) (H_i(p) − H_i(q))²` [Coifman, Lafon 2006]; in 1/length.
        Diffusion,
    }
}

arguments! {
    /// Which distance, from where.
    #[derive(Debug, Clone, Copy, PartialEq)]
    pub struct DistanceRequest {
        /// Row of the upload to measure from, counting from 0.
        from: usize = integer(0, usize::MAX), default 0;
        /// Biharmonic distance (a length), or diffusion distance (in 1/length).
        kind: DistanceKind = word(DistanceKind), default DistanceKind::Biharmonic;
        /// Time of the diffusion, in squared units of the cloud.
        time: Option<f64> = positive, absent "1/√(λ₁ λ_max)";
    }
}

/// A time for a distance that has none.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("`time` belongs to kind=diffusion")]
pub struct UnusedTime;

impl DistanceRequest {
    /// Refuses a time for the biharmonic distance, which would ignore it.
    ///
    /// # Errors
    /// [`UnusedTime`].
    pub fn check(&self) -> Result<(), UnusedTime> {
        if self.time.is_some() && self.kind == DistanceKind::Biharmonic { Err(UnusedTime) } else { Ok(()) }
    }
}

/// A distance from one point.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct Distance {
    kind: DistanceKind,
    /// Time t of the diffusion, in length².
    pub time: Option<f64>,
    weights: Vec<f64>,
    /// The bases at the point.
    origin: Vec<f64>,
    zero_modes: usize,
}

impl Distance {
    /// From a point where the bases have the values `origin`. The default time, `1/√(λ_min λ_max)` over the non-zero
    /// modes, lies midway between the scales that the bases resolve.
    ///
    /// `None` when the point has no result, or no mode is neither zero nor without information.
    #[must_use]
    pub fn from(kind: DistanceKind, origin: Vec<f64>, time: Option<f64>, modes: &Modes) -> Option<Self> {
        let known = modes.informative();
        if known.is_empty() || origin.iter().any(|h| h.is_nan()) {
            return None;
        }
        let lambda = modes.eigenvalues();
        let middle = || 1.0 / (lambda[known.start] * lambda[known.end - 1]).sqrt();
        let time = (kind == DistanceKind::Diffusion).then(|| time.unwrap_or_else(middle));
        let weight = |i: usize| match (kind, time) {
            (DistanceKind::Biharmonic, _) if known.contains(&i) => lambda[i].powi(-2),
            (DistanceKind::Diffusion, Some(time)) => (-2.0 * time * lambda[i]).exp(),
            _ => 0.0,
        };
        let weights = (0..modes.len()).map(weight).collect();
        Some(Self { kind, time, weights, origin, zero_modes: modes.zero_modes() })
    }

    /// Distances of a block's rows: NaN without a result, infinite (biharmonic) in another component.
    #[must_use]
    pub fn values<C: AsRef<[f64]>>(&self, block: &Block<C>) -> Vec<f64> {
        let mut squares = vec![0.0; block.rows()];
        for (j, (weight, origin)) in self.weights.iter().zip(&self.origin).enumerate() {
            for (sum, h) in squares.iter_mut().zip(block.column(j)) {
                *sum += weight * (h - origin).powi(2);
            }
        }
        if self.kind == DistanceKind::Biharmonic {
            for (row, square) in squares.iter_mut().enumerate() {
                if self.is_elsewhere(block, row) {
                    *square = f64::INFINITY;
                }
            }
        }
        squares.iter().map(|square| square.sqrt()).collect()
    }

    /// Whether a row lies in another component: there the projection to the null space, whatever its basis, does not reach
    /// from the one to the other.
    fn is_elsewhere<C: AsRef<[f64]>>(&self, block: &Block<C>, row: usize) -> bool {
        let between = |p: &dyn Fn(usize) -> f64, q: &dyn Fn(usize) -> f64| -> f64 {
            (0..self.zero_modes).map(|j| p(j) * q(j)).sum()
        };
        let (here, there) = (|j: usize| self.origin[j], |j: usize| block.column(j)[row]);
        let size = (between(&here, &here) * between(&there, &there)).sqrt();
        size > 0.0 && between(&here, &there) < 1e-6 * size
    }
}

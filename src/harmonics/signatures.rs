//! Heat and wave kernel signatures: what a point sees of the surface, at several scales.

use super::{Block, Modes};
use crate::arguments::{arguments, words};

words! {
    /// Which signature.
    #[derive(Default)]
    #[non_exhaustive]
    pub enum SignatureKind {
        /// Heat kernel signature [Sun, Ovsjanikov, Guibas 2009]: `Σ exp(−λ_i t) H_i(p)²`, in 1/length².
        #[default]
        Hks,
        /// Wave kernel signature [Aubry, Schlickewei, Cremers 2011]: `Σ w_i H_i(p)²` with log-normal weights in energy
        /// that sum to 1, in 1/length².
        Wks,
    }
}

arguments! {
    /// Which signature, at how many scales.
    #[derive(Debug, Clone, Copy, PartialEq, Eq)]
    pub struct SignatureRequest {
        /// Heat kernel signature, `Σ exp(−λt) H²`, or wave kernel signature, `Σ w H²` with log-normal weights around an
        /// energy.
        kind: SignatureKind = word(SignatureKind), default SignatureKind::Hks;
        /// Number of scales, spread evenly in the logarithm over what the bases resolve.
        #[alias = "scales"]
        count: usize = integer(1, 256), default 16;
        /// Divide every scale of the heat kernel signature by its integral over the surface. The wave kernel signature
        /// always is.
        scaled: bool = switch, default false;
    }
}

/// A signature at several scales: weights of the squared bases.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct Signature {
    /// Time t of every scale in length² (HKS), or energy ln λ (WKS).
    pub scales: Vec<f64>,
    /// Weight of every mode, per scale.
    weights: Vec<Vec<f64>>,
}

/// Range of times: `4 ln 10 / λ`, where a mode has fallen to 10⁻⁴ [Sun et al. 2009, §5].
const DECAY: f64 = 4.0 * std::f64::consts::LN_10;

/// Width of a wave signature's weights, in steps between energies [Aubry et al. 2011, §5].
const WAVE_WIDTH: f64 = 7.0;

impl Signature {
    /// What is asked for. `None` as for [`Self::new`].
    #[must_use]
    pub fn of(request: SignatureRequest, modes: &Modes) -> Option<Self> {
        let signature = Self::new(request.kind, request.count, modes)?;
        Some(if request.scaled { signature.scaled() } else { signature })
    }

    /// `count` scales, spread evenly in the logarithm over what the modes resolve. `None` when no mode is neither zero
    /// nor without information.
    #[must_use]
    pub fn new(kind: SignatureKind, count: usize, modes: &Modes) -> Option<Self> {
        let known = modes.informative();
        let lambda = modes.eigenvalues();
        if known.is_empty() || count == 0 {
            return None;
        }
        let (lowest, highest) = (lambda[known.start].ln(), lambda[known.end - 1].ln());
        let place = |s: usize| if count == 1 { 0.5 } else { s as f64 / (count - 1) as f64 };
        let scales = (0..count).map(|s| match kind {
            SignatureKind::Hks => DECAY * (-(highest + place(s) * (lowest - highest))).exp(),
            SignatureKind::Wks => lowest + place(s) * (highest - lowest),
        });
        // a single energy sees all modes alike
        let step = (highest - lowest) / (count.max(2) - 1) as f64;
        Some(Self::weighted(kind, scales.collect(), step, modes))
    }

    /// At given scales: times t in length² (HKS), or energies ln λ (WKS), whose mean distance tells how wide the weights
    /// are. `None` as for [`Self::new`], and for scales that are not finite or times that are not above 0.
    #[must_use]
    pub fn at(kind: SignatureKind, scales: Vec<f64>, modes: &Modes) -> Option<Self> {
        let known = modes.informative();
        let fits = |scale: &f64| scale.is_finite() && (kind == SignatureKind::Wks || *scale > 0.0);
        if known.is_empty() || scales.is_empty() || !scales.iter().all(fits) {
            return None;
        }
        let step = if scales.len() > 1 {
            let low = scales.iter().copied().fold(f64::INFINITY, f64::min);
            let high = scales.iter().copied().fold(f64::NEG_INFINITY, f64::max);
            (high - low) / (scales.len() - 1) as f64
        } else {
            (modes.eigenvalues()[known.end - 1] / modes.eigenvalues()[known.start]).ln()
        };
        Some(Self::weighted(kind, scales, step, modes))
    }

    /// `step` is the distance between energies.
    fn weighted(kind: SignatureKind, scales: Vec<f64>, step: f64, modes: &Modes) -> Self {
        let (lambda, known) = (modes.eigenvalues(), modes.informative());
        let sigma = (WAVE_WIDTH * step).max(f64::MIN_POSITIVE.sqrt());
        let weights = scales.iter().map(|&scale| match kind {
            SignatureKind::Hks => lambda.iter().map(|lambda| (-lambda * scale).exp()).collect(),
            SignatureKind::Wks => wave_weights(scale, sigma, lambda, known.clone()),
        });
        Self { weights: weights.collect(), scales }
    }

    /// Divides every scale by its sum over the surface, so that scales can be compared [Sun et al. 2009, §5].
    #[must_use]
    pub fn scaled(mut self) -> Self {
        for weights in &mut self.weights {
            // ∫ H_i² = 1: the integral over the surface is the sum of the weights
            let integral: f64 = weights.iter().sum();
            for weight in weights.iter_mut() {
                *weight /= integral;
            }
        }
        self
    }

    /// Values in a block's rows, one column per scale; NaN without a result.
    #[must_use]
    pub fn values<C: AsRef<[f64]>>(&self, block: &Block<C>) -> Vec<Vec<f64>> {
        let mut columns = vec![vec![0.0; block.rows()]; self.scales.len()];
        for j in 0..block.bases() {
            for (column, weights) in columns.iter_mut().zip(&self.weights) {
                let weight = weights[j];
                for (sum, h) in column.iter_mut().zip(block.column(j)) {
                    *sum += weight * h * h;
                }
            }
        }
        columns
    }
}

fn wave_weights(energy: f64, sigma: f64, lambda: &[f64], known: std::ops::Range<usize>) -> Vec<f64> {
    let weight = |i: usize| {
        if known.contains(&i) { (-((energy - lambda[i].ln()) / sigma).powi(2) / 2.0).exp() } else { 0.0 }
    };
    let weights: Vec<f64> = (0..lambda.len()).map(weight).collect();
    let sum: f64 = weights.iter().sum();
    weights.iter().map(|weight| weight / sum).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn modes() -> Modes {
        Modes::new(vec![0.0, 2.0, 2.0, 2.0, 6.0, 12.0], 1)
    }

    #[test]
    fn scales_reach_from_the_finest_to_the_coarsest_mode() {
        let heat = Signature::new(SignatureKind::Hks, 5, &modes()).unwrap();
        assert!(
            (heat.scales[0] - DECAY / 12.0).abs() < 1e-12 && (heat.scales[4] - DECAY / 2.0).abs() < 1e-12
        );
        let wave = Signature::new(SignatureKind::Wks, 5, &modes()).unwrap();
        assert!(
            (wave.scales[0] - 2.0_f64.ln()).abs() < 1e-12 && (wave.scales[4] - 12.0_f64.ln()).abs() < 1e-12
        );
    }

    #[test]
    fn the_weights_of_waves_and_of_scaled_heat_sum_to_one() {
        let heat = Signature::new(SignatureKind::Hks, 5, &modes()).unwrap().scaled();
        let wave = Signature::new(SignatureKind::Wks, 5, &modes()).unwrap();
        for weights in heat.weights.iter().chain(&wave.weights) {
            assert!((weights.iter().sum::<f64>() - 1.0).abs() < 1e-12, "{weights:?}");
        }
        assert!(wave.weights.iter().all(|weights| weights[0] == 0.0), "the zero mode has no energy");
    }

    #[test]
    fn scales_that_are_given_weigh_as_those_that_are_spread() {
        for kind in [SignatureKind::Hks, SignatureKind::Wks] {
            let spread = Signature::new(kind, 5, &modes()).unwrap();
            let given = Signature::at(kind, spread.scales.clone(), &modes()).unwrap();
            for (one, other) in spread.weights.concat().iter().zip(given.weights.concat()) {
                assert!((one - other).abs() < 1e-12, "{one} {other}");
            }
            assert_eq!(Signature::at(kind, vec![f64::NAN], &modes()), None);
        }
        assert_eq!(Signature::at(SignatureKind::Hks, vec![0.0], &modes()), None);
    }

    #[test]
    fn one_scale_and_one_mode_are_enough_and_none_is_not() {
        let single = Modes::new(vec![0.0, 2.0], 1);
        for kind in [SignatureKind::Hks, SignatureKind::Wks] {
            let signature = Signature::new(kind, 1, &single).unwrap();
            assert!(signature.weights[0].iter().all(|weight| weight.is_finite()), "{signature:?}");
            assert_eq!(Signature::new(kind, 4, &Modes::new(vec![0.0, 0.0], 2)), None);
        }
    }
}

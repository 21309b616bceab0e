//! Area from the heat trace [PCD §4].
//!
//! `Z(τ) = Σ exp(−λ_i τ) = A/(4πτ) + ℓ/(8√(πτ)) + χ/6 + …` for a surface of area A with natural (Neumann) boundary of
//! length ℓ and Euler characteristic χ.

use nalgebra::{DMatrix, DVector};
use serde::Serialize;

/// Fewer eigenvalues do not determine the fit.
const EIGENVALUES_MIN: usize = 10;

/// `λ_max τ` at the lower end of a window: what the missing eigenvalues would add, `exp(−λ_max τ)` of the whole by
/// Weyl's law, is then small and is made up for.
pub(super) const WINDOW_START: f64 = 8.0;

/// What is fitted to `4πτ Z(τ)`, and where.
struct Fit {
    /// `λ_max τ` at the lower end of the window.
    start: f64,
    /// The window's upper end over its lower end.
    ratio: f64,
    /// Powers of `√τ`.
    powers: &'static [i32],
    /// Those of a fit that should agree.
    others: &'static [i32],
}

/// The terms of length and characteristic.
const OPEN: Fit = Fit { start: WINDOW_START, ratio: 4.0, powers: &[0, 1, 2], others: &[0, 1] };

/// Without rims there are whole powers only, so that smaller times are enough, at which the features of a surface matter
/// less: 200 eigenvalues of the sphere, of flat tori and of a fine mesh of the two-hole torus give the area to 0.3 %; with
/// the term of the rims, that of the two-hole torus comes 14 % too large.
const CLOSED: Fit = Fit { start: 5.0, ratio: 3.0, powers: &[0, 2], others: &[0, 2, 4] };

/// Times in the window.
const SAMPLES: usize = 24;

/// First time of the later window over that of the main one.
const LATER: f64 = 1.5;

/// A number and how far fits that should agree on it are apart.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[cfg_attr(feature = "server", derive(utoipa::ToSchema))]
pub struct Estimate {
    /// The number.
    pub value: f64,
    /// Sum of the distances to the other fits; see the module on what else is part of it.
    pub uncertainty: f64,
}

/// Area of the surface in length², the intercept of `4πτ Z(τ)` at `τ = 0`, from its smallest eigenvalues λ (1/length²,
/// ascending, the zero modes included). Other fits have another number of terms or a later window.
///
/// The papers extrapolate the zero order from 200 eigenvalues; we fit `4πτ Z(τ)` by a polynomial, in `√τ` for an open
/// surface and in `τ` for a closed one. `None` for fewer than 10 eigenvalues or when the last is zero.
#[must_use]
pub fn area(eigenvalues: &[f64], is_open: bool) -> Option<Estimate> {
    let largest = *eigenvalues.last()?;
    if eigenvalues.len() < EIGENVALUES_MIN || !largest.is_finite() || largest <= 0.0 {
        return None;
    }
    let fit = if is_open { OPEN } else { CLOSED };
    let fitted = |start: f64, powers: &[i32]| {
        let place = |k: usize| fit.ratio.powf(k as f64 / (SAMPLES - 1) as f64);
        let times: Vec<f64> = (0..SAMPLES).map(|k| start / largest * place(k)).collect();
        let traces: Vec<f64> =
            times.iter().map(|&tau| 4.0 * std::f64::consts::PI * tau * trace(eigenvalues, tau)).collect();
        intercept(&times, &traces, powers)
    };
    let area = fitted(fit.start, fit.powers)?;
    let others = [fitted(fit.start, fit.others)?, fitted(LATER * fit.start, fit.powers)?];
    Some(Estimate { value: area, uncertainty: others.iter().map(|other| (area - other).abs()).sum() })
}

/// `Z(τ)`, with what the eigenvalues beyond the last would add by Weyl's law.
pub(super) fn trace(eigenvalues: &[f64], tau: f64) -> f64 {
    let largest = eigenvalues.last().copied().unwrap_or(0.0);
    let known: f64 = eigenvalues.iter().map(|lambda| (-lambda * tau).exp()).sum();
    known / (1.0 - (-largest * tau).exp())
}

/// Constant term of the least-squares polynomial in `√τ`.
fn intercept(times: &[f64], values: &[f64], powers: &[i32]) -> Option<f64> {
    let scale = times.last()?.sqrt();
    let terms = DMatrix::from_fn(times.len(), powers.len(), |i, j| (times[i].sqrt() / scale).powi(powers[j]));
    let fitted = terms.svd(true, true).solve(&DVector::from_column_slice(values), f64::EPSILON).ok()?;
    fitted.get(0).copied()
}

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

    use super::*;

    fn smallest_200(all: impl Iterator<Item = f64>) -> Vec<f64> {
        let mut all: Vec<f64> = all.collect();
        all.sort_by(f64::total_cmp);
        all.truncate(200);
        all
    }

    fn is_within(share: f64, estimate: Option<Estimate>, exact: f64) {
        let estimate = estimate.unwrap();
        assert!((estimate.value / exact - 1.0).abs() < share, "{estimate:?} {exact}");
        assert!(estimate.uncertainty < 4.0 * share * exact, "{estimate:?}");
    }

    #[test]
    fn the_spheres_spectrum_l_l_plus_1_gives_4_pi() {
        let levels = (0..15).flat_map(|l| std::iter::repeat_n(f64::from(l * (l + 1)), 2 * l as usize + 1));
        is_within(0.003, area(&smallest_200(levels), false), 4.0 * PI);
    }

    #[test]
    fn flat_tori_of_any_proportion_give_the_product_of_their_lengths() {
        for stretch in [1, 2, 3] {
            let lattice =
                (-60..61).flat_map(|a| (-60..61).map(move |b| f64::from(a * a + stretch * stretch * b * b)));
            is_within(0.002, area(&smallest_200(lattice), false), 4.0 * PI * PI / f64::from(stretch));
        }
    }

    #[test]
    fn the_unit_square_with_natural_rims_has_area_1() {
        let lattice = (0..30).flat_map(|a| (0..30).map(move |b| PI * PI * f64::from(a * a + b * b)));
        is_within(0.006, area(&smallest_200(lattice), true), 1.0);
    }

    #[test]
    fn too_few_or_only_zero_eigenvalues_give_no_area() {
        assert_eq!(area(&[0.0; 20], false), None);
        assert_eq!(area(&[0.0, 2.0, 2.0, 2.0], true), None);
    }
}

//! Area from the heat trace [PCD §4].
//!
//! `Z(τ) = Σ exp(−λ_i τ) = A/(4πτ) + ℓ/(8√(πτ)) + χ/6 + …` for a surface of area A with natural (Neumann) boundary of
//! length ℓ and Euler characteristic χ.

use nalgebra::{DMatrix, DVector};

/// Fewer eigenvalues do not determine the fit.
const EIGENVALUES_MIN: usize = 10;

/// `λ_max τ` at the lower end of the window: what the missing eigenvalues would add, `exp(−λ_max τ)` of the whole by
/// Weyl's law, is then small and is made up for.
pub(super) const WINDOW_START: f64 = 8.0;

/// The window's upper end over its lower end.
const WINDOW_RATIO: f64 = 4.0;

/// Times in the window.
const SAMPLES: usize = 24;

/// An area in length², and how far two fits of different order are apart.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AreaEstimate {
    /// The intercept of `4πτ Z(τ)` at `τ = 0`.
    pub area: f64,
    /// Difference to the intercept of a fit with one term fewer.
    pub uncertainty: f64,
}

/// Area of the surface from its smallest eigenvalues λ (1/length², ascending, the zero modes included).
///
/// The papers extrapolate the zero order from 200 eigenvalues; we fit `4πτ Z(τ)` by a polynomial in `√τ`, of which
/// they are the first terms. `None` for fewer than 10 eigenvalues or when the last is zero.
#[must_use]
pub fn area(eigenvalues: &[f64]) -> Option<AreaEstimate> {
    let largest = *eigenvalues.last()?;
    if eigenvalues.len() < EIGENVALUES_MIN || !largest.is_finite() || largest <= 0.0 {
        return None;
    }
    let start = WINDOW_START / largest;
    let times: Vec<f64> =
        (0..SAMPLES).map(|k| start * WINDOW_RATIO.powf(k as f64 / (SAMPLES - 1) as f64)).collect();
    let traces: Vec<f64> =
        times.iter().map(|&tau| 4.0 * std::f64::consts::PI * tau * trace(eigenvalues, tau)).collect();
    let (area, coarser) = (intercept(&times, &traces, 2)?, intercept(&times, &traces, 1)?);
    Some(AreaEstimate { area, uncertainty: (area - coarser).abs() })
}

/// `Z(τ)`, with what the eigenvalues beyond the last would add by Weyl's law.
pub(super) fn trace(eigenvalues: &[f64], tau: f64) -> f64 {
    let largest = eigenvalues.last().copied().unwrap_or(0.0);
    let known: f64 = eigenvalues.iter().map(|lambda| (-lambda * tau).exp()).sum();
    known / (1.0 - (-largest * tau).exp())
}

/// Constant term of the least-squares polynomial in `√τ`.
fn intercept(times: &[f64], values: &[f64], degree: u8) -> Option<f64> {
    let scale = times.last()?.sqrt();
    let powers = DMatrix::from_fn(times.len(), usize::from(degree) + 1, |i, j| {
        (times[i].sqrt() / scale).powf(j as f64)
    });
    let fitted = powers.svd(true, true).solve(&DVector::from_column_slice(values), f64::EPSILON).ok()?;
    fitted.get(0).copied()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_spheres_spectrum_l_l_plus_1_gives_4_pi() {
        let spectrum: Vec<f64> =
            (0..15).flat_map(|l| std::iter::repeat_n(f64::from(l * (l + 1)), 2 * l as usize + 1)).collect();
        let estimate = area(&spectrum).unwrap();
        let exact = 4.0 * std::f64::consts::PI;
        assert!((estimate.area / exact - 1.0).abs() < 0.02, "{estimate:?}");
    }

    #[test]
    fn the_unit_square_with_natural_rims_has_area_1() {
        let pi_squared = std::f64::consts::PI.powi(2);
        let mut spectrum: Vec<f64> =
            (0..30).flat_map(|a| (0..30).map(move |b| pi_squared * f64::from(a * a + b * b))).collect();
        spectrum.sort_by(f64::total_cmp);
        spectrum.truncate(200);
        let estimate = area(&spectrum).unwrap();
        assert!((estimate.area - 1.0).abs() < 0.05, "{estimate:?}");
    }

    #[test]
    fn too_few_or_only_zero_eigenvalues_give_no_area() {
        assert_eq!(area(&[0.0; 20]), None);
        assert_eq!(area(&[0.0, 2.0, 2.0, 2.0]), None);
    }
}

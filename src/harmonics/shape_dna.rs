//! Shapes compared by their spectra: ShapeDNA [Reuter, Wolter, Peinecke 2006].
//!
//! By Weyl's law `λ_i A / 4π → i` on a surface of area A. A spectrum times `A/4π` does not depend on the shape's size or
//! place, and its i-th number over i does not grow: so every mode weighs the same.

use serde::Serialize;

use super::Modes;
use crate::arguments::arguments;

arguments! {
    /// How two shapes are compared.
    #[derive(Debug, Clone, Copy, PartialEq, Eq)]
    pub struct Comparison {
        /// Number of non-zero modes to compare, at most; as many as both jobs have.
        modes: usize = integer(1, usize::MAX), default 50;
        /// Tell the same shape in two sizes apart.
        sized: bool = switch, default false;
    }
}

/// Two spectra side by side.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[cfg_attr(feature = "server", derive(utoipa::ToSchema))]
pub struct Similarity {
    /// Root mean square over the compared modes of `(a_i − b_i) / i`: 0 for equal spectra, dimensionless.
    pub distance: f64,
    /// Number of non-zero modes compared.
    pub modes: usize,
    /// Spectrum of the first, `λ_i A / 4π`, zero modes left out.
    pub first: Vec<f64>,
    /// Spectrum of the second.
    pub second: Vec<f64>,
}

/// Compares the first non-zero modes of two shapes, at most `modes_max` and as many as both have.
///
/// `areas` are those of the shapes, in length². With `sized` both are scaled by the same area, their geometric mean: then
/// the same shape in two sizes is not the same. `None` when one of them has no non-zero mode.
#[must_use]
pub fn compare(modes: [&Modes; 2], areas: [f64; 2], sized: bool, modes_max: usize) -> Option<Similarity> {
    let mean = (areas[0] * areas[1]).sqrt();
    let normalized = |shape: usize| -> Vec<f64> {
        let scale = if sized { mean } else { areas[shape] } / (4.0 * std::f64::consts::PI);
        modes[shape].eigenvalues()[modes[shape].informative()].iter().map(|lambda| lambda * scale).collect()
    };
    let (mut first, mut second) = (normalized(0), normalized(1));
    let count = first.len().min(second.len()).min(modes_max);
    if count == 0 {
        return None;
    }
    first.truncate(count);
    second.truncate(count);
    let squares = first.iter().zip(&second).zip(1..).map(|((a, b), i)| ((a - b) / f64::from(i)).powi(2));
    let distance = (squares.sum::<f64>() / count as f64).sqrt();
    Some(Similarity { distance, modes: count, first, second })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// l(l+1)/r², 2l+1 times each.
    fn sphere(radius: f64) -> (Modes, f64) {
        let levels = (0..6).flat_map(|l| std::iter::repeat_n(f64::from(l * (l + 1)), 2 * l as usize + 1));
        let eigenvalues = levels.map(|lambda| lambda / (radius * radius)).collect();
        (Modes::new(eigenvalues, 1), 4.0 * std::f64::consts::PI * radius * radius)
    }

    #[test]
    fn size_counts_only_when_asked_for() {
        let ((small, small_area), (large, large_area)) = (sphere(1.0), sphere(3.0));
        let compare =
            |sized| compare([&small, &large], [small_area, large_area], sized, 20).unwrap().distance;
        assert!(compare(false) < 1e-12);
        assert!(compare(true) > 0.5);
    }

    #[test]
    fn only_what_both_have_is_compared() {
        let ((sphere, area), short) = (sphere(1.0), Modes::new(vec![0.0, 2.0, 2.0], 1));
        let compared = compare([&sphere, &short], [area, area], false, 20).unwrap();
        assert_eq!((compared.modes, compared.first.len(), compared.second.len()), (2, 2, 2));
        assert_eq!(compare([&sphere, &Modes::new(vec![0.0], 1)], [area, area], false, 20), None);
    }
}

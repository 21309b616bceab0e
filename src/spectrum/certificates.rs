//! What is checked about returned eigenpairs, from the pairs themselves.

use faer::Mat;
use serde::{Deserialize, Serialize};

use super::vectors::block::Block;
use super::vectors::pair::{own_gram, residual_norms, residuals_and_gram};
use super::{Eigenpairs, Problem};
use crate::progress::{Canceled, Progress};

/// Relative gap below which eigenvectors are an arbitrary basis of a common space.
const CLUSTER_GAP: f64 = 1e-6;

/// How it was checked that no eigenvalue was missed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "server", derive(utoipa::ToSchema))]
#[serde(rename_all = "lowercase")]
#[non_exhaustive]
pub enum MissedCheck {
    /// All eigenvalues were computed.
    Dense,
    /// The inertia of `S − sB` at a gap `s` above the last pair counts all eigenvalues below it.
    Inertia,
    /// On the thinned sample that was solved, by its own check.
    Thinned,
    /// A random block orthogonal to the found space was driven towards small eigenvalues.
    Probe,
    /// The check itself could not be made.
    None,
}

/// How far the eigenpairs can be trusted.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "server", derive(utoipa::ToSchema))]
#[non_exhaustive]
pub struct Certificates {
    /// `max |HᵀBH − I|`.
    pub orthogonality: f64,
    /// Largest relative residual.
    pub residual: f64,
    /// Largest of the bounds ρ: every eigenvalue μ has one λ of the matrix pencil near it, `|λ − μ|/(λ + σ) ≤ ρ`. Absent
    /// for operators without symmetry, and in reports of versions that did not tell it.
    #[serde(default)]
    pub dual_residual: Option<f64>,
    /// Zero eigenvalues returned.
    pub zero_modes: usize,
    /// Eigenvalues below the last one that are not among those returned, of the thinned sample where that was solved;
    /// absent when that could not be checked.
    pub missed: Option<usize>,
    /// How that was checked.
    pub missed_check: MissedCheck,
    /// Largest tμ of a heat-kernel operator: towards 1 the eigenvalues carry no information. Absent for others.
    pub saturation: Option<f64>,
}

/// What is computed from pairs.
#[derive(Debug, Clone)]
pub struct Measured {
    /// `‖A y − μ y‖ / (μ + σ)` of every pair.
    pub residuals: Vec<f64>,
    /// `max |YᵀY − I|`.
    pub orthogonality: f64,
}

impl Measured {
    /// Largest residual.
    #[must_use]
    pub fn residual(&self) -> f64 {
        self.residuals.iter().copied().fold(0.0, f64::max)
    }
}

/// Residuals and orthogonality of pairs, in one pass.
///
/// The residual of a conjugate pair mixes its two columns: `A(u + iv) = (a + ib)(u + iv)` is `A u = a u − b v`,
/// `A v = a v + b u`.
///
/// # Errors
/// [`Canceled`].
pub fn measure(problem: &Problem, pairs: &Eigenpairs, progress: &Progress) -> Result<Measured, Canceled> {
    // b is positive for the first of a pair, whose partner follows, and negative for the second
    let partner = |(j, &b): (usize, &f64)| match b {
        b if b > 0.0 => Some((j + 1, b)),
        b if b < 0.0 => Some((j - 1, b)),
        _ => None,
    };
    let partners: Vec<Option<(usize, f64)>> = pairs.imaginary.iter().enumerate().map(partner).collect();
    let (norms, gram) =
        residuals_and_gram(&problem.matrix, &pairs.vectors, &pairs.values, &partners, progress)?;
    let relative = norms.iter().zip(&pairs.values).map(|(norm, value)| norm / (value + problem.shift));
    let columns = gram.ncols();
    Ok(Measured {
        residuals: relative.collect(),
        orthogonality: (gram - Mat::<f64>::identity(columns, columns)).norm_max(),
    })
}

/// The residuals alone, of pairs whose eigenvalues are real.
///
/// # Errors
/// [`Canceled`].
pub fn residuals(problem: &Problem, pairs: &Eigenpairs, progress: &Progress) -> Result<Vec<f64>, Canceled> {
    let norms = residual_norms(&problem.matrix, &pairs.vectors, &pairs.values, progress)?;
    Ok(norms.iter().zip(&pairs.values).map(|(norm, value)| norm / (value + problem.shift)).collect())
}

/// `max |YᵀY − I|`.
///
/// # Errors
/// [`Canceled`].
pub fn orthogonality(vectors: &Block, progress: &Progress) -> Result<f64, Canceled> {
    let columns = vectors.columns();
    Ok((own_gram(vectors, progress)? - Mat::<f64>::identity(columns, columns)).norm_max())
}

/// Ranges `[first, last]` of consecutive values closer than 10⁻⁶, relative to value plus `shift`.
#[must_use]
pub fn clusters(values: &[f64], shift: f64) -> Vec<[usize; 2]> {
    clusters_within(values, shift, CLUSTER_GAP)
}

/// Ranges `[first, last]` of consecutive values closer than `gap`, relative to value plus `shift`.
#[must_use]
pub fn clusters_within(values: &[f64], shift: f64, gap: f64) -> Vec<[usize; 2]> {
    let mut found: Vec<[usize; 2]> = Vec::new();
    for (i, pair) in values.windows(2).enumerate() {
        if pair[1] - pair[0] <= gap * (pair[1].abs() + shift) {
            match found.last_mut() {
                Some(last) if last[1] == i => last[1] = i + 1,
                _ => found.push([i, i + 1]),
            }
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn close_values_form_clusters_and_a_gap_ends_them() {
        assert_eq!(clusters(&[0.0, 0.0, 2.0, 2.000_000_1, 2.000_000_2, 6.0], 0.3), [[0, 1], [2, 4]]);
        assert!(clusters(&[0.0, 1.0, 2.0], 0.3).is_empty());
    }
}

//! What is checked about returned eigenpairs, from the pairs themselves.

use faer::Mat;
use serde::{Deserialize, Serialize};

use super::vectors::block::{Block, column_norms, gram};
use super::vectors::sparse_product::sparse_product;
use super::{Eigenpairs, Problem};
use crate::progress::{Canceled, Progress};

/// Relative gap below which eigenvectors are an arbitrary basis of a common space.
const CLUSTER_GAP: f64 = 1e-6;

/// Columns whose residuals are computed together.
const COLUMNS: usize = 32;

/// How it was checked that no eigenvalue was missed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "server", derive(utoipa::ToSchema))]
#[serde(rename_all = "lowercase")]
pub enum MissedCheck {
    /// All eigenvalues were computed.
    Dense,
    /// The inertia of `S − sB` at a gap `s` above the last pair counts all eigenvalues below it.
    Inertia,
    /// A random block orthogonal to the found space was driven towards small eigenvalues.
    Probe,
    /// The check itself could not be made.
    None,
}

/// How far the eigenpairs can be trusted.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "server", derive(utoipa::ToSchema))]
pub struct Certificates {
    /// `max |HᵀBH − I|`.
    pub orthogonality: f64,
    /// Largest relative residual.
    pub residual: f64,
    /// Zero eigenvalues returned.
    pub zero_modes: usize,
    /// Eigenvalues below the last one that are not among those returned; absent when that could not be checked.
    pub missed: Option<usize>,
    /// How that was checked.
    pub missed_check: MissedCheck,
    /// Largest tμ of a heat-kernel operator: towards 1 the eigenvalues carry no information. Absent for others.
    pub saturation: Option<f64>,
}

/// `‖A y − μ y‖ / (μ + σ)` of every pair.
///
/// # Errors
/// [`Canceled`].
pub fn residuals(problem: &Problem, pairs: &Eigenpairs, progress: &Progress) -> Result<Vec<f64>, Canceled> {
    let mut all = Vec::with_capacity(pairs.values.len());
    let mut some = Block::zeros(problem.size(), COLUMNS);
    let mut product = Block::zeros(problem.size(), COLUMNS);
    for first in (0..pairs.values.len()).step_by(COLUMNS) {
        progress.checkpoint()?;
        let count = COLUMNS.min(pairs.values.len() - first);
        some.set_columns(count);
        some.copy_columns(0, &pairs.vectors, first, count);
        sparse_product(&mut product, &problem.matrix, &some);
        let values = &pairs.values[first..first + count];
        product.for_each_row(|i, row| {
            for ((r, x), value) in row.iter_mut().zip(some.row(i)).zip(values) {
                *r -= value * x;
            }
        });
        subtract_partners(&mut product, pairs, first, count);
        all.extend(
            column_norms(&product).iter().zip(values).map(|(norm, value)| norm / (value + problem.shift)),
        );
    }
    Ok(all)
}

/// The part of the residual that mixes the two columns of a conjugate pair: `A(u + iv) = (a + ib)(u + iv)` is
/// `A u = a u − b v`, `A v = a v + b u`.
fn subtract_partners(product: &mut Block, pairs: &Eigenpairs, first: usize, count: usize) {
    let parts: Vec<(usize, f64)> = (first..first + count)
        .filter_map(|j| pairs.imaginary.get(j).filter(|b| **b != 0.0).map(|b| (j, *b)))
        .collect();
    if parts.is_empty() {
        return;
    }
    product.for_each_row(|i, row| {
        let y = pairs.vectors.row(i);
        for &(j, b) in &parts {
            // b is positive for the first of a pair, whose partner follows, and negative for the second
            let partner = if b > 0.0 { j + 1 } else { j - 1 };
            row[j - first] += b * y[partner];
        }
    });
}

/// `max |YᵀY − I|`.
#[must_use]
pub fn orthogonality(pairs: &Eigenpairs) -> f64 {
    let columns = pairs.vectors.columns();
    (gram(&pairs.vectors, &pairs.vectors) - Mat::<f64>::identity(columns, columns)).norm_max()
}

/// Ranges `[first, last]` of consecutive values closer than 10⁻⁶, relative to value plus `shift`.
#[must_use]
pub fn clusters(values: &[f64], shift: f64) -> Vec<[usize; 2]> {
    let mut found: Vec<[usize; 2]> = Vec::new();
    for (i, pair) in values.windows(2).enumerate() {
        if pair[1] - pair[0] <= CLUSTER_GAP * (pair[1].abs() + shift) {
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

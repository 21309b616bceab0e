//! The bases as they are used: `H = B^-½ Y`.

use rayon::prelude::*;

use super::{Eigenpairs, Problem};

/// Manifold harmonics on the analysed points.
#[derive(Debug)]
pub struct Eigenbasis {
    pairs: Eigenpairs,
    /// `±1/√b_i` is applied column by column on the way out: the sign of each column.
    signs: Vec<f64>,
    inverse_root_mass: Vec<f64>,
}

impl Eigenbasis {
    /// Takes the eigenpairs; the sign of every basis is such that its largest component is positive.
    #[must_use]
    pub fn new(problem: &Problem, pairs: Eigenpairs) -> Self {
        let inverse_root_mass: Vec<f64> = problem.root_mass.iter().map(|m| 1.0 / m).collect();
        let mut signs: Vec<f64> = (0..pairs.values.len())
            .into_par_iter()
            .map(|j| {
                let largest = (0..inverse_root_mass.len())
                    .map(|i| pairs.vectors.row(i)[j] * inverse_root_mass[i])
                    // the first of equals, so that the sign is determined
                    .fold(0.0, |largest: f64, h| if h.abs() > largest.abs() { h } else { largest });
                if largest < 0.0 { -1.0 } else { 1.0 }
            })
            .collect();
        // the two parts of a complex eigenvector turn together
        for j in 1..signs.len() {
            if pairs.imaginary.get(j).is_some_and(|b| *b < 0.0) {
                signs[j] = signs[j - 1];
            }
        }
        Self { pairs, signs, inverse_root_mass }
    }

    /// Number of bases.
    #[must_use]
    #[allow(clippy::len_without_is_empty)] // never empty
    pub fn len(&self) -> usize {
        self.signs.len()
    }

    /// μ, ascending.
    #[must_use]
    pub fn values(&self) -> &[f64] {
        &self.pairs.values
    }

    /// Basis `j` at point `i`, in 1/length; `H_iᵀ B H_j = δ_ij`.
    #[must_use]
    pub fn at(&self, i: usize, j: usize) -> f64 {
        self.signs[j] * self.pairs.vectors.row(i)[j] * self.inverse_root_mass[i]
    }
}

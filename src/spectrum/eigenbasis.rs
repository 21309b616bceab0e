//! The bases as they are used: `H = B^-½ Y`.

use rayon::prelude::*;

use super::{Eigenpairs, Problem};

/// Bases that are taken out of the rows of eigenvectors together: as many as lie in a cache line.
const TOGETHER: usize = 8;

/// Manifold harmonics on the analyzed points.
#[derive(Debug)]
pub struct Eigenbasis {
    /// Basis by basis: eigenvectors are stored point by point, where a basis is spread over all of the memory.
    bases: Vec<Vec<f64>>,
}

impl Eigenbasis {
    /// Takes the eigenpairs; the sign of every basis is such that its largest component is positive.
    #[must_use]
    pub fn new(problem: &Problem, pairs: Eigenpairs) -> Self {
        let Eigenpairs { values, imaginary, vectors } = pairs;
        let inverse_root_mass: Vec<f64> = problem.root_mass.iter().map(|m| 1.0 / m).collect();
        let columns = |first: usize| {
            let mut columns: Vec<Vec<f64>> = (first..values.len().min(first + TOGETHER))
                .map(|_| Vec::with_capacity(inverse_root_mass.len()))
                .collect();
            for (i, inverse) in inverse_root_mass.iter().enumerate() {
                for (column, y) in columns.iter_mut().zip(&vectors.row(i)[first..]) {
                    column.push(y * inverse);
                }
            }
            columns
        };
        let firsts: Vec<usize> = (0..values.len()).step_by(TOGETHER).collect();
        let mut bases: Vec<Vec<f64>> =
            firsts.into_par_iter().with_max_len(1).flat_map_iter(columns).collect();
        let mut negative: Vec<bool> = bases.par_iter().map(|basis| largest(basis) < 0.0).collect();
        // the two parts of a complex eigenvector turn together
        for j in 1..negative.len() {
            if imaginary.get(j).is_some_and(|b| *b < 0.0) {
                negative[j] = negative[j - 1];
            }
        }
        let wrong = bases.par_iter_mut().zip(negative).filter(|(_, negative)| *negative);
        wrong.for_each(|(basis, _)| basis.iter_mut().for_each(|h| *h = -*h));
        Self { bases }
    }

    /// Multiplies all bases by `factor`.
    pub fn scale(&mut self, factor: f64) {
        self.bases.par_iter_mut().for_each(|basis| basis.iter_mut().for_each(|h| *h *= factor));
    }

    /// Number of bases.
    #[must_use]
    #[allow(clippy::len_without_is_empty)] // never empty
    pub fn len(&self) -> usize {
        self.bases.len()
    }

    /// Basis `j` at every point, in 1/length; `H_iᵀ B H_j = δ_ij`.
    #[must_use]
    pub fn basis(&self, j: usize) -> &[f64] {
        &self.bases[j]
    }
}

/// The component that is farthest from zero: the first of equals, so that the sign is determined.
fn largest(basis: &[f64]) -> f64 {
    basis.iter().fold(0.0, |largest: f64, &h| if h.abs() > largest.abs() { h } else { largest })
}

//! Eigenpairs as the solvers return them.

use super::vectors::block::{self, Block};

/// Eigenpairs of `A`, ascending.
#[derive(Debug, Clone)]
pub struct Eigenpairs {
    /// μ, or its real part.
    pub values: Vec<f64>,
    /// Imaginary parts of μ for operators without symmetry; otherwise empty. The pair `(j, j+1)` with the parts `b` and
    /// `−b` has the eigenvectors `y_j ± i y_{j+1}`.
    pub imaginary: Vec<f64>,
    /// `y`, one column each; orthonormal for symmetric operators.
    pub vectors: Block,
}

impl Eigenpairs {
    /// Eigenpairs of a symmetric matrix.
    #[must_use]
    pub fn real(values: Vec<f64>, vectors: Block) -> Self {
        Self { values, imaginary: Vec::new(), vectors }
    }

    /// Keeps the first `count`.
    pub(super) fn truncate(&mut self, count: usize) {
        self.values.truncate(count);
        self.imaginary.truncate(count);
        self.vectors.set_columns(count);
    }

    /// Gives every column norm 1; the two of a conjugate pair, which belong together, on average.
    pub(super) fn normalize(&mut self) {
        let mut norms = block::column_norms(&self.vectors);
        for j in 0..norms.len().saturating_sub(1) {
            if self.imaginary.get(j).is_some_and(|b| *b > 0.0) {
                let mean = (0.5 * (norms[j] * norms[j] + norms[j + 1] * norms[j + 1])).sqrt();
                (norms[j], norms[j + 1]) = (mean, mean);
            }
        }
        self.vectors.for_each_row(|_, row| row.iter_mut().zip(&norms).for_each(|(x, norm)| *x /= norm));
    }
}

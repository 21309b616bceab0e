//! Eigenpairs and their certificates.
//!
//! All solvers work on `A = B^-½ S B^-½`, whose eigenvectors `y = B^½ h` are orthonormal in the plain sense and whose
//! residual `‖A y − μ y‖ / (μ + σ)` is the relative residual of the pencil.

pub mod block;
pub mod certificates;
pub mod chebyshev;
pub mod cholesky;
pub mod dense;
mod direct;
pub mod eigenbasis;
mod entry;
mod factorization;
pub mod general;
pub mod invariant;
mod iterative;
mod krylov;
pub mod lobpcg;
pub mod order;
pub mod orthogonal;
mod passes;
mod polish;
mod probe;
pub mod problem;
pub mod shift_invert;
pub mod slicing;
pub mod solver;
mod sparse_product;
pub mod start;
mod substitution;
mod supernodes;

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

pub use certificates::{Certificates, MissedCheck};
pub use eigenbasis::Eigenbasis;
pub use problem::Problem;
pub use solver::{Method, solve};

use crate::progress::Canceled;

/// Eigenvalues with everything that tells how far to trust them.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Spectrum {
    /// λ in 1/length² (of graph operators without unit), ascending, heat-corrected where the operator is a heat kernel. A value that carries no
    /// information (tμ ≥ 1) is absent (null).
    pub eigenvalues: Vec<Option<f64>>,
    /// μ in 1/length², ascending: the eigenvalues of the matrix pencil.
    pub raw_eigenvalues: Vec<f64>,
    /// Imaginary parts of λ, present for an operator whose eigenvalues need not be real; `eigenvalues` and
    /// `raw_eigenvalues` are then the real parts, and the two bases of a conjugate pair are the real and the imaginary
    /// part of its eigenvector.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub imaginary_parts: Option<Vec<f64>>,
    /// `‖B^-½(S x − μ B x)‖₂ / (μ + σ)` of every returned pair.
    pub residuals: Vec<f64>,
    /// Index ranges `[first, last]` of eigenvalues that are too close to tell their vectors apart.
    pub clusters: Vec<[usize; 2]>,
    /// Number of connected components, each with one zero eigenvalue.
    pub components: usize,
    /// What was checked.
    pub certificates: Certificates,
    /// How the eigenpairs were computed.
    pub method: Method,
}

/// Why there are no eigenpairs.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum SpectrumError {
    /// A factorisation failed or was found wrong.
    #[error("Cholesky factorisation: {0}")]
    Factorization(String),
    /// A small dense eigenproblem did not converge.
    #[error("a dense eigenproblem of order {order} did not converge")]
    Dense {
        /// Its order.
        order: usize,
    },
    /// The iteration ended short of the tolerance.
    #[error(
        "the eigensolver reached a residual of {reached:e} instead of {tolerance:e} after {iterations} iterations"
    )]
    NotConverged {
        /// Largest relative residual of the wanted pairs.
        reached: f64,
        /// The tolerance.
        tolerance: f64,
        /// Iterations made.
        iterations: usize,
    },
    /// Canceled by the caller.
    #[error(transparent)]
    Canceled(#[from] Canceled),
}

/// Eigenpairs of `A`, ascending.
#[derive(Debug, Clone)]
pub struct Eigenpairs {
    /// μ, or its real part.
    pub values: Vec<f64>,
    /// Imaginary parts of μ for operators without symmetry; otherwise empty. The pair `(j, j+1)` with the parts `b` and
    /// `−b` has the eigenvectors `y_j ± i y_{j+1}`.
    pub imaginary: Vec<f64>,
    /// `y`, one column each; orthonormal for symmetric operators.
    pub vectors: block::Block,
}

impl Eigenpairs {
    /// Eigenpairs of a symmetric matrix.
    #[must_use]
    pub fn real(values: Vec<f64>, vectors: block::Block) -> Self {
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

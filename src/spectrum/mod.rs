//! Eigenpairs and their certificates.
//!
//! All solvers work on `A = B^-½ S B^-½`, whose eigenvectors `y = B^½ h` are orthonormal in the plain sense and whose
//! residual `‖A y − μ y‖ / (μ + σ)` is the relative residual of the pencil.

pub mod block;
pub mod certificates;
pub mod cholesky;
pub mod dense;
pub mod eigenbasis;
pub mod lobpcg;
pub mod order;
pub mod orthogonal;
pub mod problem;
pub mod shift_invert;
pub mod solver;
pub mod start;

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
    /// λ in 1/length², ascending, heat-corrected where the operator is a heat kernel. A value that carries no
    /// information (tμ ≥ 1) is absent (null).
    pub eigenvalues: Vec<Option<f64>>,
    /// μ in 1/length², ascending: the eigenvalues of the matrix pencil.
    pub raw_eigenvalues: Vec<f64>,
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
    /// μ.
    pub values: Vec<f64>,
    /// Orthonormal `y`, one column each.
    pub vectors: block::Block,
}

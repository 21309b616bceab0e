//! Eigenpairs and their certificates.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// Eigenvalues with everything that tells how far to trust them.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Spectrum {
    /// λ in 1/length², ascending, heat-corrected where the operator is a heat kernel.
    pub eigenvalues: Vec<f64>,
    /// μ, the eigenvalues of the matrix pencil.
    pub raw_eigenvalues: Vec<f64>,
    /// `‖B^-½(S x − μ B x)‖₂ / (μ + σ)` of every returned pair.
    pub residuals: Vec<f64>,
    /// Index ranges `[first, last]` of eigenvalues too close to tell their vectors apart.
    pub clusters: Vec<[usize; 2]>,
}

//! Discrete Laplace–Beltrami operators.
//!
//! Every operator is a pair of stiffness `S` and mass `B`: `L = −B⁻¹ S` approximates the Laplace–Beltrami operator Δ,
//! and `S h = μ B h` is its eigenproblem. The papers' `Q` is `−S`.

pub mod heat_kernel;
pub mod pb_mhb;
pub mod sheets;
pub mod sparse;
pub mod voronoi;

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

pub use heat_kernel::HeatKernel;
pub use sparse::SymmetricSparse;

/// The operators that can be asked for by name.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "kebab-case")]
pub enum OperatorKind {
    /// Symmetrizable Voronoi-weighted heat-kernel operator [PBMHB §3.3–3.4].
    #[default]
    PbMhb,
    /// Finite volumes on tangent-plane Voronoi cells.
    Voronoi,
}

impl OperatorKind {
    /// All operators.
    pub const ALL: [Self; 2] = [Self::PbMhb, Self::Voronoi];

    /// Name in the interface.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::PbMhb => "pb-mhb",
            Self::Voronoi => "voronoi",
        }
    }
}

/// A symmetrizable discrete Laplace–Beltrami operator.
#[derive(Debug, Clone, PartialEq)]
pub struct LaplaceBeltrami {
    /// `S`, n×n: symmetric, positive semi-definite, zero row sums, off-diagonals ≤ 0. Dimensionless for surfaces.
    pub stiffness: SymmetricSparse,
    /// Diagonal of `B`, n positive areas in length².
    pub mass: Vec<f64>,
    /// Present when `μ = (1 − exp(−tλ))/t` rather than λ are the eigenvalues.
    pub heat_kernel: Option<HeatKernel>,
}

impl LaplaceBeltrami {
    /// The operator on the points of `keep` (ascending), which must be a union of connected components.
    #[must_use]
    pub fn restricted_to(&self, keep: &[u32]) -> Self {
        Self {
            stiffness: self.stiffness.restricted_to(keep),
            mass: keep.iter().map(|&i| self.mass[i as usize]).collect(),
            heat_kernel: self.heat_kernel,
        }
    }
}

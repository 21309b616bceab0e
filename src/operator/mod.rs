//! Discrete Laplace–Beltrami operators.
//!
//! Every operator is a pair of stiffness `S` and mass `B`: `L = −B⁻¹ S` approximates the Laplace–Beltrami operator Δ,
//! and `S h = μ B h` is its eigenproblem. The papers' `Q` is `−S`.

pub mod bandwidth;
pub mod cotangent;
pub mod coverage;
pub mod graph;
pub mod heat_kernel;
mod kind;
pub mod mesh;
pub mod pb_mhb;
pub mod pcd;
pub mod rims;
pub mod sheets;
pub mod sparse;
pub mod unfolding;
pub mod voronoi;

pub use heat_kernel::HeatKernel;
pub use kind::{Distance, OperatorKind, Parameterization};
pub use sparse::Sparse;

/// What is known about a stiffness matrix from its definition.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Structure {
    /// Symmetric positive semi-definite; on every connected component one function is mapped to zero.
    SemiDefinite,
    /// Symmetric, but neither definite nor with a known null space.
    Symmetric,
    /// Not symmetric: real eigenvalues and orthogonal eigenvectors are not guaranteed.
    General,
}

/// A discrete Laplace–Beltrami operator.
#[derive(Debug, Clone, PartialEq)]
pub struct LaplaceBeltrami {
    /// `S`, n×n, in `length^(k−2)` (k the intrinsic dimension): row sums zero unless `harmonic` or the operator says
    /// otherwise.
    pub stiffness: Sparse,
    /// Diagonal of `B`, n positive masses in `length^k`; of graph operators without unit.
    pub mass: Vec<f64>,
    /// What `stiffness` is.
    pub structure: Structure,
    /// The function that `S` maps to zero, where it is not the constant.
    pub harmonic: Option<Vec<f64>>,
    /// Present when `μ = (1 − exp(−tλ))/t` rather than λ are the eigenvalues.
    pub heat_kernel: Option<HeatKernel>,
    /// The kernel's time at every point, where it is not the same everywhere.
    pub times: Option<Vec<f64>>,
    /// Whether times follow the density of the points, beyond what large cells need.
    pub follows_density: bool,
    /// `1/μ` at the upper end of the spectrum of an operator with long rows, which is flat there: t of a heat kernel.
    pub plateau: Option<f64>,
}

impl LaplaceBeltrami {
    /// An operator with narrow rows, symmetric, positive semi-definite, zero on constants.
    #[must_use]
    pub fn narrow(stiffness: Sparse, mass: Vec<f64>) -> Self {
        Self {
            stiffness,
            mass,
            structure: Structure::SemiDefinite,
            harmonic: None,
            heat_kernel: None,
            times: None,
            follows_density: false,
            plateau: None,
        }
    }

    /// A heat-kernel operator, symmetric, positive semi-definite, zero on constants.
    #[must_use]
    pub fn diffusive(stiffness: Sparse, mass: Vec<f64>, kernel: HeatKernel) -> Self {
        Self { heat_kernel: Some(kernel), plateau: Some(kernel.t), ..Self::narrow(stiffness, mass) }
    }

    /// The operator on the points of `keep` (ascending), which must be a union of connected components.
    #[must_use]
    pub fn restricted_to(&self, keep: &[u32]) -> Self {
        let select = |values: &Vec<f64>| keep.iter().map(|&i| values[i as usize]).collect();
        Self {
            stiffness: self.stiffness.restricted_to(keep),
            mass: select(&self.mass),
            harmonic: self.harmonic.as_ref().map(select),
            times: self.times.as_ref().map(select),
            ..*self
        }
    }
}

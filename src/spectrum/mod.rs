//! Eigenpairs and their certificates.
//!
//! All solvers work on `A = B^-½ S B^-½`, whose eigenvectors `y = B^½ h` are orthonormal in the plain sense and whose
//! residual `‖A y − μ y‖ / (μ + σ)` is the relative residual of the pencil.

pub mod certificates;
pub mod chebyshev;
mod coarse_to_fine;
pub mod dense;
mod direct;
mod dual;
pub mod eigenbasis;
mod eigenpairs;
mod error;
pub mod factor;
pub mod general;
#[cfg(test)]
mod grid;
mod indefinite;
pub mod invariant;
mod inverse;
mod iterative;
mod krylov;
pub mod lobpcg;
mod narrow;
pub mod orthogonal;
mod polish;
pub mod preconditioner;
mod probe;
pub mod problem;
mod ritz;
pub mod shift_invert;
mod shifted_system;
pub mod slicing;
mod solution;
mod solver;
mod trial_space;
pub mod vectors;
mod weyl;

pub use certificates::{Certificates, MissedCheck};
pub use coarse_to_fine::prolonged::{
    BESIDE_BYTES as PROLONGED_BYTES, BESIDE_KERNEL_BYTES as PROLONGED_KERNEL_BYTES, GUARDS,
};
pub use eigenbasis::Eigenbasis;
pub use eigenpairs::Eigenpairs;
pub use error::SpectrumError;
pub use problem::Problem;
pub use shifted_system::{HELD as GROUPS_HELD, width as group_width};
pub use solution::{Method, Request, Solution, Spectrum, Vectors};
pub use solver::solve;
pub use weyl::Weyl;

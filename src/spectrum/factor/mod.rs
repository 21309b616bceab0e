//! Sparse Cholesky factors `A + sI = L S Lᵀ` of narrow symmetric matrices, and solutions with them: a library of its own
//! that knows matrices and blocks of vectors, not eigenproblems.
//!
//! Elimination order (nested dissection) → symbolic analysis → supernodal factorization → substitution, each in a file.

mod cholesky;
pub mod elimination;
mod error;
mod factorization;
mod substitution;
mod substitution_kernels;
mod supernodes;
mod symbolic;

pub use cholesky::Cholesky;
pub use elimination::{Elimination, nested_dissection};
pub use error::FactorError;
pub use symbolic::Symbolic;

//! Sparse Cholesky factors `A + sI = L S Lᵀ` of narrow symmetric matrices, and solutions with them: a library of its own
//! that knows matrices and blocks of vectors, not eigenproblems.
//!
//! Elimination order (nested dissection) → symbolic analysis → supernodal factorization → substitution, each in a file.
//!
//! # Why not faer's sparse Cholesky
//!
//! Elimination tree and column counts are faer's. Everything behind is ours for the sake of the solutions: an eigensolver
//! factors a few times and solves for hundreds of vectors, and faer's substitution takes two to four times as long on the
//! narrow supernodes of a surface. Milliseconds, the least of seven rounds side by side, of a
//! 7-point stencil with the same elimination order, on one thread (faer 0.24.4):
//!
//! | rows    |                     | faer, double | ours, double | ours, single |
//! |--------:|---------------------|-------------:|-------------:|-------------:|
//! |  90,000 | factorization       |          195 |          354 |          381 |
//! |         | solution, 64 vectors |        1,075 |          473 |          244 |
//! | 250,000 | factorization       |          587 |        1,353 |        1,621 |
//! |         | solution, 64 vectors |        3,017 |        1,144 |          766 |
//!
//! Ours include the probe of the factor, which is a solution too; faer's has none. A hundred eigenpairs take about 370
//! vectors: at 90,000 rows 6.4 s with faer, 1.8 s with ours in single precision. The factor in single precision takes half
//! of the memory besides, the bits do not depend on the number of threads, and a cancellation ends it within a second.
//! `cargo bench -- factor` times the three on the operator of a surface.

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

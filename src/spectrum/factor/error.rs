//! Errors of a factorization.

use crate::progress::Canceled;

/// An error of the factorization.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum FactorError {
    /// The matrix has none, or the factor failed its probe.
    #[error("{0}")]
    Matrix(String),
    /// Canceled by the caller.
    #[error(transparent)]
    Canceled(#[from] Canceled),
}

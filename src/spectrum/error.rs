//! Errors of the eigensolvers.

use std::io;

use super::factor::FactorError;
use crate::progress::Canceled;

/// An error of the eigensolver.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum SpectrumError {
    /// A factorization failed or was found wrong.
    #[error("Cholesky factorization: {0}")]
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
    /// The file for eigenvectors that there is no memory for could not be made, written or read.
    #[error("{0}")]
    Scratch(String),
    /// Canceled by the caller.
    #[error(transparent)]
    Canceled(#[from] Canceled),
}

impl From<FactorError> for SpectrumError {
    fn from(error: FactorError) -> Self {
        match error {
            FactorError::Matrix(message) => Self::Factorization(message),
            FactorError::Canceled(canceled) => Self::Canceled(canceled),
        }
    }
}

impl From<io::Error> for SpectrumError {
    fn from(error: io::Error) -> Self {
        Self::Scratch(format!("the file for eigenvectors that do not fit into memory: {error}"))
    }
}

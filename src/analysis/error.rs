//! Errors of an analysis.

use crate::geometry::points::GeometryError;
use crate::progress::Canceled;
use crate::spectrum::SpectrumError;

/// An error of an analysis.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum AnalysisError {
    /// A parameter out of range.
    #[error("parameter `{name}`: {reason}")]
    Parameter {
        /// As in the interface.
        name: &'static str,
        /// What is wrong, and what would be accepted.
        reason: String,
    },
    /// The cloud cannot carry the analysis.
    #[error("{0}")]
    Cloud(String),
    /// The operator needs something that the cloud does not have.
    #[error("{0}")]
    Unsupported(String),
    /// A numerical failure: a bug, or a cloud beyond double precision.
    #[error("{0}")]
    Numerical(String),
    /// The disk refused a file for what does not fit into memory.
    #[error("{0}")]
    Scratch(String),
    /// Canceled by the caller.
    #[error(transparent)]
    Canceled(#[from] Canceled),
}

impl From<GeometryError> for AnalysisError {
    fn from(error: GeometryError) -> Self {
        match error {
            GeometryError::Canceled(canceled) => Self::Canceled(canceled),
            other => Self::Cloud(other.to_string()),
        }
    }
}

impl From<SpectrumError> for AnalysisError {
    fn from(error: SpectrumError) -> Self {
        match error {
            SpectrumError::Canceled(canceled) => Self::Canceled(canceled),
            SpectrumError::Scratch(reason) => Self::Scratch(reason),
            other => Self::Numerical(other.to_string()),
        }
    }
}

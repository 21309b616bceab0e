//! Cloud → operator → spectrum: all stages on one screen.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use crate::cloud::PointCloud;
use crate::operator::OperatorKind;
use crate::progress::{Canceled, Progress};
use crate::spectrum::Spectrum;

/// Whether only the operator is built, or its eigenpairs too.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "lowercase")]
pub enum JobKind {
    /// Builds and diagnoses the operator; its matrices Q and B can be fetched.
    Operator,
    /// Builds the operator, then computes bases and spectrum.
    #[default]
    Eigen,
}

/// What a caller may choose. Absent numbers are derived from the cloud; absent switches follow `paper`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(default, deny_unknown_fields)]
pub struct Parameters {
    /// The discrete Laplace–Beltrami operator.
    pub operator: OperatorKind,
    /// Number of eigenpairs, the zero modes included.
    pub bases: usize,
    /// Largest relative residual of an eigenpair.
    pub tolerance: f64,
    /// Time of the heat kernel, in squared units of the cloud.
    pub t: Option<f64>,
    /// The same as a multiple of ε².
    pub t_factor: Option<f64>,
    /// Cut-off radius of the heat kernel, in units of the cloud.
    pub delta: Option<f64>,
    /// The same as a multiple of √(2t).
    pub delta_factor: Option<f64>,
    /// Covering radius ε, in units of the cloud, instead of the estimate.
    pub epsilon: Option<f64>,
    /// Exactly the paper's operator: switches all additions off that are not set themselves.
    pub paper: bool,
    /// Scale projected neighbours back to their true distance before cells are clipped.
    pub isometric_cells: Option<bool>,
    /// Make up for the Gaussian's share beyond the cut-off.
    pub truncation_compensation: Option<bool>,
    /// Couple only neighbours on the same sheet of the surface.
    pub sheet_aware: Option<bool>,
    /// Report λ = −ln(1−tμ)/t beside the raw μ.
    pub heat_correction: Option<bool>,
}

impl Default for Parameters {
    fn default() -> Self {
        Self {
            operator: OperatorKind::default(),
            bases: 100,
            tolerance: 1e-4,
            t: None,
            t_factor: None,
            delta: None,
            delta_factor: None,
            epsilon: None,
            paper: false,
            isometric_cells: None,
            truncation_compensation: None,
            sheet_aware: None,
            heat_correction: None,
        }
    }
}

impl Parameters {
    /// Refuses what can be refused without a cloud: ranges, and pairs that exclude each other.
    ///
    /// # Errors
    /// [`AnalysisError::Parameter`] with the field's name.
    pub fn check(&self) -> Result<(), AnalysisError> {
        unimplemented!()
    }
}

/// What an analysis found out, without its arrays. Serialised as it is shown.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Report {
    /// Rows of the upload.
    pub rows: usize,
    /// Rows that carry a result of their own.
    pub points_used: usize,
    /// Rows that repeat an earlier row's position.
    pub duplicates: usize,
    /// Rows with a non-finite coordinate.
    pub nonfinite: usize,
    /// What the caller should know before trusting the result.
    pub warnings: Vec<String>,
    /// Present for eigen jobs.
    pub spectrum: Option<Spectrum>,
}

/// An operator and, for [`JobKind::Eigen`], its eigenbasis; arrays are handed out in rows of the upload.
#[derive(Debug)]
pub struct Analysis {
    /// Everything but the arrays.
    pub report: Report,
}

/// A symmetric sparse matrix in rows of the upload, compressed by rows, columns ascending.
#[derive(Debug, Clone, PartialEq)]
pub struct SparseMatrix {
    /// n+1 offsets.
    pub offsets: Vec<u64>,
    /// Column of every entry.
    pub columns: Vec<u32>,
    /// Value of every entry.
    pub values: Vec<f64>,
}

impl Analysis {
    /// Mass B of every row, in `length^k`: 0 for a duplicate (its first occurrence carries the mass), NaN for a
    /// row without a result.
    #[must_use]
    pub fn mass(&self) -> Vec<f64> {
        unimplemented!()
    }

    /// Number of bases.
    #[must_use]
    pub fn bases(&self) -> usize {
        unimplemented!()
    }

    /// Basis `j`, one value per row: duplicates repeat their first occurrence, NaN without a result.
    #[must_use]
    pub fn basis(&self, j: usize) -> Vec<f64> {
        unimplemented!()
    }

    /// Q = −S: symmetric, zero row sums, negative semi-definite. Empty rows for duplicates and rows without a
    /// result.
    #[must_use]
    pub fn operator_matrix(&self) -> SparseMatrix {
        unimplemented!()
    }
}

/// Why an analysis did not happen.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
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
    /// Canceled by the caller.
    #[error(transparent)]
    Canceled(#[from] Canceled),
}

/// Cheap checks before a cloud is accepted: enough distinct points, not all on a line, enough for the bases.
/// Linear in the number of points.
///
/// # Errors
/// [`AnalysisError`] that says what is missing.
pub fn admit(_cloud: &PointCloud, _parameters: &Parameters) -> Result<(), AnalysisError> {
    unimplemented!()
}

/// Runs all stages on the calling thread and the current rayon pool.
///
/// # Errors
/// [`AnalysisError`].
pub fn analyze(
    _cloud: &PointCloud,
    _kind: JobKind,
    _parameters: &Parameters,
    _progress: &Progress,
) -> Result<Analysis, AnalysisError> {
    unimplemented!()
}

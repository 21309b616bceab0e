//! The first call: points → operator → eigenpairs.

use super::{Analysis, AnalysisError, JobKind, Parameters, SparseMatrix, admit, analyze};
use crate::cloud::PointCloud;
use crate::operator::OperatorKind;
use crate::progress::Progress;

/// The discrete Laplace–Beltrami operator of a cloud, described and not yet computed.
///
/// Computes on the calling thread and the current rayon pool. [`analyze`] takes a [`Progress`] to watch and to cancel.
#[derive(Debug, Clone, PartialEq)]
pub struct Laplacian<'a> {
    cloud: &'a PointCloud,
    parameters: Parameters,
}

impl<'a> Laplacian<'a> {
    /// With the parameters' defaults.
    #[must_use]
    pub fn of(cloud: &'a PointCloud) -> Self {
        Self { cloud, parameters: Parameters::default() }
    }

    /// Another operator.
    #[must_use]
    pub fn operator(mut self, operator: OperatorKind) -> Self {
        self.parameters.operator = operator;
        self
    }

    /// Other parameters, the operator among them.
    #[must_use]
    pub fn parameters(self, parameters: Parameters) -> Self {
        Self { parameters, ..self }
    }

    /// `Q = −S` in rows of the cloud, and the diagonal of the mass `B`: `S h = λ B h`. `S` is positive semi-definite for
    /// the operators that [`crate::operator::Structure`] says so of.
    ///
    /// # Errors
    /// [`AnalysisError`].
    pub fn matrices(&self) -> Result<(SparseMatrix, Vec<f64>), AnalysisError> {
        let analysis = self.analysis(JobKind::Operator, &self.parameters)?;
        let matrix = analysis.operator_matrix();
        let matrix = matrix.ok_or_else(|| AnalysisError::Numerical("the operator has no matrix".into()))?;
        Ok((matrix, analysis.mass()))
    }

    /// The `count` smallest eigenpairs, zero modes included: λ in the report, bases column by column.
    ///
    /// # Errors
    /// [`AnalysisError`].
    pub fn eigenpairs(&self, count: usize) -> Result<Analysis, AnalysisError> {
        self.analysis(JobKind::Eigen, &Parameters { bases: count, ..self.parameters.clone() })
    }

    fn analysis(&self, kind: JobKind, parameters: &Parameters) -> Result<Analysis, AnalysisError> {
        admit(self.cloud, parameters)?;
        analyze(self.cloud, kind, parameters, &Progress::new())
    }
}

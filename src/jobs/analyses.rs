//! What a worker computes, as it sees it: a function, and results that it can store.

use std::sync::Arc;

use crate::analysis::{self, Analysis, AnalysisError, JobKind, Parameters, Report, SparseMatrix};
use crate::cloud::PointCloud;
use crate::progress::Progress;

/// What comes out of an analysis, array by array in rows of the upload.
pub trait Results: Send + Sync {
    /// Everything but the arrays.
    fn report(&self) -> &Report;
    /// Mass B of every row.
    fn mass(&self) -> Vec<f64>;
    /// Number of bases.
    fn bases(&self) -> usize;
    /// Basis `j`, one value per row.
    fn basis(&self, j: usize) -> Vec<f64>;
    /// Q of every row.
    fn matrix(&self) -> Option<SparseMatrix>;
}

impl Results for Analysis {
    fn report(&self) -> &Report {
        &self.report
    }

    fn mass(&self) -> Vec<f64> {
        Analysis::mass(self)
    }

    fn bases(&self) -> usize {
        Analysis::bases(self)
    }

    fn basis(&self, j: usize) -> Vec<f64> {
        Analysis::basis(self, j)
    }

    fn matrix(&self) -> Option<SparseMatrix> {
        self.operator_matrix()
    }
}

/// The signature of [`analysis::analyze`], with any results.
pub type Analyze = dyn Fn(&PointCloud, JobKind, &Parameters, &Progress) -> Result<Box<dyn Results>, AnalysisError>
    + Send
    + Sync;

/// [`analysis::analyze`].
#[must_use]
pub fn default_analysis() -> Arc<Analyze> {
    Arc::new(|cloud, kind, parameters, progress| {
        Ok(Box::new(analysis::analyze(cloud, kind, parameters, progress)?))
    })
}

//! Why an attempt ended without a result, and what follows from it.

use std::time::Duration;

use super::compute::ComputeError;
use crate::analysis::AnalysisError;
use crate::progress::Canceled;
use crate::store::{JobFailure, Order, StoreError};

/// Why an attempt did not end with a result.
#[derive(Debug, thiserror::Error)]
pub(super) enum AttemptError {
    #[error(transparent)]
    Analysis(#[from] AnalysisError),
    #[error(transparent)]
    Compute(#[from] ComputeError),
    #[error(transparent)]
    Store(#[from] StoreError),
    #[error("inconsistent result: {0}")]
    Inconsistent(&'static str),
    #[error("the heartbeat thread could not be started: {0}")]
    Heartbeat(#[from] std::io::Error),
    #[error("ordered to end: {0:?}")]
    Ordered(Order),
    #[error("it took longer than {} seconds", .0.as_secs())]
    OutOfTime(Duration),
    #[error("it turned out to need {need} bytes of memory")]
    Memory { need: u64 },
    #[error("the service is stopping")]
    Halted,
}

/// When another attempt may fare better.
#[derive(Debug, Clone, Copy)]
pub(super) enum Retry {
    Never,
    AtOnce,
    Later,
}

/// What the job's owner is told, and when another attempt may fare better.
pub(super) fn failure(error: &AttemptError) -> (JobFailure, Retry) {
    let told = |code: &str, detail: String| JobFailure { code: code.to_owned(), detail };
    match error {
        AttemptError::Analysis(error) => match error {
            AnalysisError::Parameter { .. } => (told("parameter", error.to_string()), Retry::Never),
            AnalysisError::Cloud(_) => (told("cloud", error.to_string()), Retry::Never),
            AnalysisError::Unsupported(_) => (told("unsupported", error.to_string()), Retry::Never),
            AnalysisError::Numerical(_) => (told("numerical", error.to_string()), Retry::Never),
            AnalysisError::Scratch(_) => (told("disk", error.to_string()), Retry::Later),
            // The order to cancel that led here arrives otherwise: this one nobody gave.
            AnalysisError::Canceled(Canceled) => {
                (told("internal", "the computation ended without a reason".to_owned()), Retry::AtOnce)
            }
        },
        AttemptError::Compute(_) => {
            (told("crashed", "the computation crashed in every attempt".to_owned()), Retry::AtOnce)
        }
        AttemptError::OutOfTime(limit) => {
            let seconds = limit.as_secs();
            let detail = format!(
                "the computation took longer than the {seconds} seconds that a job may take (`--job-seconds`); ask for \
                 fewer bases or thin the cloud out"
            );
            (told("time", detail), Retry::Never)
        }
        AttemptError::Inconsistent(_) => {
            (told("internal", "the analysis gave an inconsistent result".to_owned()), Retry::Never)
        }
        AttemptError::Store(StoreError::Damaged(_)) => {
            (told("internal", "the stored cloud or the result is damaged".to_owned()), Retry::Never)
        }
        AttemptError::Store(_)
        | AttemptError::Heartbeat(_)
        | AttemptError::Ordered(_)
        | AttemptError::Memory { .. }
        | AttemptError::Halted => {
            (told("internal", "the result could not be stored".to_owned()), Retry::Later)
        }
    }
}

//! Waiting for the end of jobs.

use std::time::Duration;

use axum::http::{HeaderMap, header};
use uuid::Uuid;

use super::wire::notation::parse_id;
use super::wire::problem::{Kind, Problem};
use super::wire::retry;
use super::wire::service::Service;
use crate::arguments::arguments;
use crate::store::{JobRecord, JobState};

/// Longest `?wait=`, in seconds.
pub const WAIT_SECONDS_MAX: u64 = 60;

arguments! {
    /// Waiting for the end of a job.
    #[derive(Debug, Clone, Copy)]
    pub(crate) struct Wait {
        /// Seconds to wait for the job's end before answering.
        wait: usize = integer(0, WAIT_SECONDS_MAX as usize), default 0;
    }
}

impl Wait {
    /// How long to wait.
    pub(crate) fn time(self) -> Duration {
        Duration::from_secs(self.wait as u64)
    }
}

/// The job once it has ended, or as it is after `wait`, or when the service stops; as it is at once where its owner has no
/// place left to wait in.
pub(crate) async fn wait_until_ended(
    service: &Service,
    id: Uuid,
    wait: Duration,
) -> Result<JobRecord, Problem> {
    if wait.is_zero() {
        return Ok(service.store.job(id).await?);
    }
    let mut job = service.store.follow(id).await?;
    let owner = job.borrow().owner.clone();
    let Some(_place) = service.waiting.take(&owner) else { return Ok(service.store.job(id).await?) };
    let is_deleted = tokio::select! {
        ended = job.wait_for(|job| job.state.is_terminal()) => ended.is_err(),
        () = tokio::time::sleep(wait) => false,
        () = service.stopping.cancelled() => false,
    };
    if is_deleted {
        return Ok(service.store.job(id).await?);
    }
    let job = job.borrow();
    Ok(JobRecord::clone(&job))
}

/// A job once it has succeeded, waited for at most `wait`.
///
/// # Errors
/// A problem that tells the state of a job without a result.
pub(crate) async fn finished(service: &Service, id: &str, wait: Duration) -> Result<JobRecord, Problem> {
    let job = wait_until_ended(service, parse_id(id)?, wait).await?;
    match without_result(&job) {
        Some(problem) => Err(problem),
        None => Ok(job),
    }
}

/// Why a job that has not succeeded has no results; `None` for one that has.
fn without_result(job: &JobRecord) -> Option<Problem> {
    let problem = match job.state {
        JobState::Succeeded => return None,
        JobState::Queued | JobState::Running => Problem::new(
            Kind::NotFinished,
            format!(
                "job {} is {}; ask again when GET /jobs/{}?wait=60 says succeeded",
                job.id,
                job.state.name(),
                job.id
            ),
        )
        .with_header(header::RETRY_AFTER, retry::JOB_SECONDS.to_string())
        .with("progress", job.progress),
        JobState::Failed => job.failure.as_ref().map_or_else(
            || Problem::new(Kind::JobFailed, format!("job {} failed", job.id)),
            |failure| {
                Problem::new(Kind::JobFailed, format!("job {} failed: {}", job.id, failure.detail))
                    .with("code", failure.code.clone())
            },
        ),
        JobState::Canceled => {
            Problem::new(Kind::JobCanceled, format!("job {} was canceled before it had a result", job.id))
        }
    };
    Some(problem.with("state", job.state.name()))
}

/// Seconds of `Prefer: wait=N` (RFC 7240 §4.3).
pub(crate) fn preferred_wait(headers: &HeaderMap) -> Option<Duration> {
    let preferences = headers.get_all("prefer");
    let mut preferences =
        preferences.iter().filter_map(|value| value.to_str().ok()).flat_map(|value| value.split(','));
    let seconds =
        preferences.find_map(|preference| preference.trim().strip_prefix("wait=")?.parse::<u64>().ok())?;
    Some(Duration::from_secs(seconds.min(WAIT_SECONDS_MAX)))
}

#[cfg(test)]
mod tests {
    use axum::http::{HeaderName, HeaderValue};

    use super::*;

    #[test]
    fn a_preferred_wait_is_bounded() {
        let wait = |value| {
            preferred_wait(&HeaderMap::from_iter([(
                HeaderName::from_static("prefer"),
                HeaderValue::from_static(value),
            )]))
        };
        assert_eq!(wait("respond-async, wait=7"), Some(Duration::from_secs(7)));
        assert_eq!(wait("wait=7000"), Some(Duration::from_secs(WAIT_SECONDS_MAX)));
        assert_eq!(wait("wait=soon"), None);
    }
}

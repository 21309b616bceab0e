//! Deletes jobs and clouds that are older than they are kept.

use std::time::Duration;

use tokio_util::sync::CancellationToken;

use crate::store::{Milliseconds, Store, StoreError};

/// Time between two looks for expired jobs and clouds.
const EVERY: Duration = Duration::from_hours(1);

/// How long jobs and clouds are kept; forever when not set.
#[derive(Debug, Clone, Copy, Default)]
pub struct Retention {
    /// Jobs and their results, from their end.
    pub jobs: Option<Duration>,
    /// Clouds without jobs, from their upload.
    pub clouds: Option<Duration>,
}

impl Retention {
    /// Deletes at once and then every hour, until `stop`.
    pub(super) async fn keep(self, store: Store, stop: CancellationToken) {
        if self.jobs.is_none() && self.clouds.is_none() {
            return;
        }
        while !stop.is_cancelled() {
            match self.sweep(&store, &stop).await {
                Ok((0, 0)) => {}
                Ok((jobs, clouds)) => tracing::info!(jobs, clouds, "deleted expired jobs and clouds"),
                Err(error) => tracing::error!(%error, "expired jobs and clouds could not be deleted"),
            }
            tokio::select! {
                () = tokio::time::sleep(EVERY) => {}
                () = stop.cancelled() => {}
            }
        }
    }

    async fn sweep(self, store: &Store, stop: &CancellationToken) -> Result<(u64, u64), StoreError> {
        let (mut jobs, mut clouds) = (0, 0);
        if let Some(age) = self.jobs {
            while !stop.is_cancelled() && store.expire_job(milliseconds(age)).await? {
                jobs += 1;
            }
        }
        if let Some(age) = self.clouds {
            while !stop.is_cancelled() && store.expire_cloud(milliseconds(age)).await? {
                clouds += 1;
            }
        }
        Ok((jobs, clouds))
    }
}

fn milliseconds(age: Duration) -> Milliseconds {
    age.as_millis().try_into().unwrap_or(Milliseconds::MAX)
}

//! A worker: claims a job, sees it through, claims the next.

use std::pin::pin;
use std::sync::Arc;

use tokio::sync::Notify;
use tokio_util::sync::CancellationToken;
use uuid::Uuid;

use super::JobsSettings;
use super::analyses::{Analyze, Results};
use super::attempt_error::{AttemptError, Retry, failure};
use super::compute::Compute;
use super::heartbeat::Heartbeat;
use super::memory_gate::{MemoryGate, Reservation};
use super::storing::store_arrays;
use super::task::Task;
use crate::store::{Claim, JobRecord, JobState, Milliseconds, Order, Store, StoreError};

pub(super) struct Worker {
    pub(super) store: Store,
    pub(super) compute: Compute,
    pub(super) analyze: Arc<Analyze>,
    pub(super) settings: JobsSettings,
    pub(super) process: Uuid,
    pub(super) wake: Arc<Notify>,
    pub(super) stop: CancellationToken,
    pub(super) halt: CancellationToken,
    pub(super) gate: Arc<MemoryGate>,
}

impl Worker {
    /// Works until the service stops.
    pub(super) async fn work(self) {
        let mut told = false;
        while !self.stop.is_cancelled() {
            match self.claim().await {
                Ok(Some((claim, reservation))) => {
                    told = false;
                    self.run_to_end(&claim, &reservation).await;
                    drop(reservation);
                }
                Ok(None) => self.rest().await,
                Err(error) => {
                    // It is asked again every second: once is enough for the log.
                    if !std::mem::replace(&mut told, true) {
                        tracing::error!(%error, "no job can be claimed");
                    }
                    self.rest().await;
                }
            }
        }
    }

    /// The next job, unless there is no room for its result on the disk, or for itself in memory.
    async fn claim(&self) -> Result<Option<(Claim, Arc<Reservation>)>, StoreError> {
        self.store.refuse_when_disk_full().await?;
        self.gate.claim(&self.store, self.process).await
    }

    async fn rest(&self) {
        tokio::select! {
            () = self.wake.notified() => {}
            () = tokio::time::sleep(self.settings.poll) => {}
            () = self.stop.cancelled() => {}
        }
    }

    /// From the claim to the job's end, whatever end that is.
    async fn run_to_end(&self, claim: &Claim, reservation: &Arc<Reservation>) {
        let task = Task::begin(reservation);
        let job = claim.job.id;
        let parameters = &claim.job.parameters;
        let (operator, bases) = (parameters.operator.name(), parameters.bases);
        let owner = claim.job.owner.name();
        tracing::info!(%job, owner, operator, bases, attempt = claim.job.attempt, points = claim.job.points, "job begins");
        if let (1, Some(started)) = (claim.job.attempt, claim.job.started) {
            self.settings.metrics.claimed((started - claim.job.created) as f64 / 1e3);
        }
        let mut attempt = pin!(self.attempt(claim, &task));
        let mut heartbeat =
            match Heartbeat::start(self.store.clone(), claim.clone(), task.clone(), &self.settings) {
                Ok(heartbeat) => heartbeat,
                Err(error) => return self.settle(claim, error.into()).await,
            };
        let error = tokio::select! {
            // An order first: the attempt may have ended because of it, and then says only that it was canceled.
            biased;
            order = heartbeat.order() => AttemptError::Ordered(order),
            () = self.halt.cancelled() => AttemptError::Halted,
            () = tokio::time::sleep(self.settings.time_max) => AttemptError::OutOfTime(self.settings.time_max),
            ended = &mut attempt => match ended {
                Ok(state) => return self.record(&claim.job, state, &task),
                Err(error) => return self.settle(claim, error).await,
            },
        };
        // The job ends now, for everybody who waits for it; the computation ends at its next checkpoint, and may not get
        // there soon. Until then this worker claims nothing: the memory of two jobs was not asked for.
        task.progress.cancel();
        self.settle(claim, error).await;
        tokio::select! {
            _ = attempt => {}
            () = self.halt.cancelled() => {}
        }
    }

    fn record(&self, job: &JobRecord, state: JobState, task: &Task) {
        let seconds: f64 = task.vitals().phase_seconds.iter().map(|(_, seconds)| seconds).sum();
        tracing::info!(job = %job.id, owner = job.owner.name(), state = state.name(), seconds, "job ends");
        self.settings.metrics.ended(state.name());
        if state == JobState::Succeeded {
            for (phase, seconds) in task.vitals().phase_seconds {
                self.settings.metrics.phase(phase.name(), seconds);
            }
        }
    }

    async fn attempt(&self, claim: &Claim, task: &Task) -> Result<JobState, AttemptError> {
        let cloud = Arc::new(self.store.load_cloud(claim.job.cloud_id).await?);
        let (kind, parameters) = (claim.job.kind, claim.job.parameters.clone());
        let (analyze, progress) = (Arc::clone(&self.analyze), Arc::clone(&task.progress));
        let analyzed = Arc::clone(&cloud);
        let computed = self.compute.run(move || analyze(&analyzed, kind, &parameters, &progress)).await?;
        let results = computed.map_err(|error| match task.progress.denied() {
            Some(need) => AttemptError::Memory { need },
            None => error.into(),
        })?;
        let vitals = task.vitals();
        let results: Arc<dyn Results> = Arc::from(results);
        store_arrays(&self.store, &self.compute, claim, &cloud, &results).await?;
        Ok(self.store.finish(claim, results.report(), &vitals).await?)
    }

    /// Milliseconds to wait before another attempt; twice as long after every further one.
    fn delay(&self, retry: Retry, attempt: u32) -> Option<Milliseconds> {
        match retry {
            Retry::Never => None,
            Retry::AtOnce => Some(0),
            Retry::Later => {
                let delay = self.settings.backoff * 2_u32.saturating_pow(attempt.saturating_sub(1));
                Some(delay.as_millis() as Milliseconds)
            }
        }
    }

    /// Gives a job that has no result its end, or its place in the queue back.
    async fn settle(&self, claim: &Claim, cause: AttemptError) {
        let job = claim.job.id;
        let settled = match &cause {
            // Not ours any more: whoever took it decides.
            AttemptError::Ordered(Order::Lost) | AttemptError::Store(StoreError::LostClaim) => {
                tracing::warn!(%job, "the claim was lost");
                return;
            }
            AttemptError::Ordered(Order::Cancel) => {
                self.store.cancel_claimed(claim).await.map(|()| JobState::Canceled)
            }
            AttemptError::Halted => self.store.release(claim).await,
            &AttemptError::Memory { need } => self.store.release_for_memory(claim, need).await,
            _ => {
                let (failure, retry) = failure(&cause);
                self.store.fail(claim, failure, self.delay(retry, claim.job.attempt)).await
            }
        };
        match settled {
            Ok(state) => {
                tracing::warn!(%job, owner = claim.job.owner.name(), state = state.name(), %cause, "job ends without a result");
                self.settings.metrics.ended(state.name());
            }
            // It had just ended by itself.
            Err(StoreError::LostClaim) => {}
            // Its lease runs out, and then it is put back.
            Err(error) => tracing::error!(%job, %error, %cause, "a job's end could not be stored"),
        }
    }
}

//! A worker: claims a job, sees it through, claims the next.

use std::pin::pin;
use std::sync::Arc;
use std::time::{Duration, Instant};

use tokio::sync::{Notify, watch};
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
use crate::cloud::PointCloud;
use crate::progress::Progress;
use crate::store::{Claim, JobRecord, JobState, Milliseconds, Order, Store, StoreError, Vitals};

/// How long a database that cannot be reached is waited for, and between two attempts to reach it.
const PATIENCE: Duration = Duration::from_secs(45);
const RETRY: Duration = Duration::from_millis(500);

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
        let mut arrivals = self.store.arrivals();
        while !self.stop.is_cancelled() {
            match self.claim().await {
                Ok(Some((claim, reservation))) => {
                    told = false;
                    self.run_to_end(&claim, &reservation).await;
                    drop(reservation);
                }
                Ok(None) => self.rest(&mut arrivals).await,
                Err(error) => {
                    // It is asked again every second: once is enough for the log.
                    if !std::mem::replace(&mut told, true) {
                        tracing::error!(%error, "no job can be claimed");
                    }
                    self.rest(&mut arrivals).await;
                }
            }
        }
    }

    /// The next job, unless there is no room for its result on the disk, or for itself in memory.
    async fn claim(&self) -> Result<Option<(Claim, Arc<Reservation>)>, StoreError> {
        self.store.refuse_when_disk_full().await?;
        self.gate.claim(&self.store, self.process).await
    }

    /// Until there may be something to do: room for a job, a job, or a lease that ran out.
    async fn rest(&self, arrivals: &mut watch::Receiver<u64>) {
        tokio::select! {
            () = self.wake.notified() => {}
            _ = arrivals.changed() => {}
            () = tokio::time::sleep(self.settings.poll) => {}
            () = self.stop.cancelled() => {}
        }
    }

    /// From the claim to the job's end, whatever end that is.
    async fn run_to_end(&self, claim: &Claim, reservation: &Arc<Reservation>) {
        let store = self.store.clone();
        let task = Task::begin(reservation, move |bytes| store.scratch_file(bytes));
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
                Err(error) => return self.record_failure(claim, error.into()).await,
            };
        let error = tokio::select! {
            // An order first: the attempt may have ended because of it, and then says only that it was canceled.
            biased;
            order = heartbeat.order() => AttemptError::Ordered(order),
            () = self.halt.cancelled() => AttemptError::Halted,
            () = tokio::time::sleep(self.settings.time_max) => AttemptError::OutOfTime(self.settings.time_max),
            ended = &mut attempt => match ended {
                Ok(state) => return self.record(&claim.job, state, &task),
                Err(error) => return self.record_failure(claim, error).await,
            },
        };
        // The job ends now, for everybody who waits for it; the computation ends at its next checkpoint, and may not get
        // there soon. Until then this worker claims nothing: the memory of two jobs was not asked for.
        task.progress.cancel();
        self.record_failure(claim, error).await;
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
        let cloud = self.cloud(claim.job.cloud_id).await?;
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
        let until = Instant::now() + PATIENCE;
        loop {
            // Stored again from its beginning: what a lost connection had stored of it is cleared first.
            match self.keep(claim, &cloud, &results, &vitals, &task.progress).await {
                Err(error) => self.wait_for_database(error, until).await?,
                ended => return ended,
            }
        }
    }

    async fn cloud(&self, id: Uuid) -> Result<Arc<PointCloud>, AttemptError> {
        let until = Instant::now() + PATIENCE;
        loop {
            match self.store.load_cloud(id).await {
                Err(error) => self.wait_for_database(error.into(), until).await?,
                Ok(cloud) => return Ok(Arc::new(cloud)),
            }
        }
    }

    async fn keep(
        &self,
        claim: &Claim,
        cloud: &Arc<PointCloud>,
        results: &Arc<dyn Results>,
        vitals: &Vitals,
        progress: &Arc<Progress>,
    ) -> Result<JobState, AttemptError> {
        store_arrays(&self.store, &self.compute, claim, cloud, results, progress).await?;
        Ok(self.store.finish(claim, results.report(), vitals).await?)
    }

    /// Waits a moment when the database cannot be reached, for less than the time of a lease in all: then the job may be
    /// another node's. A result that took hours is not thrown away because a server was restarted. Any other error is given
    /// back.
    async fn wait_for_database(&self, error: AttemptError, until: Instant) -> Result<(), AttemptError> {
        match error {
            AttemptError::Store(StoreError::Unreachable(cause)) if Instant::now() < until => {
                tracing::warn!(%cause, "the database cannot be reached; will retry");
            }
            error => return Err(error),
        }
        tokio::select! {
            () = tokio::time::sleep(RETRY) => Ok(()),
            () = self.halt.cancelled() => Err(AttemptError::Halted),
        }
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
    async fn record_failure(&self, claim: &Claim, cause: AttemptError) {
        let job = claim.job.id;
        if let AttemptError::Ordered(Order::Lost) | AttemptError::Store(StoreError::LostClaim) = &cause {
            // Not ours any more: whoever took it decides.
            tracing::warn!(%job, "the claim was lost");
            return;
        }
        let until = Instant::now() + PATIENCE;
        let mut stored = self.end(claim, &cause).await;
        while matches!(stored, Err(StoreError::Unreachable(_)))
            && Instant::now() < until
            && !self.halt.is_cancelled()
        {
            tokio::time::sleep(RETRY).await;
            stored = self.end(claim, &cause).await;
        }
        match stored {
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

    async fn end(&self, claim: &Claim, cause: &AttemptError) -> Result<JobState, StoreError> {
        match cause {
            AttemptError::Ordered(Order::Cancel) => {
                self.store.cancel_claimed(claim).await.map(|()| JobState::Canceled)
            }
            AttemptError::Halted => self.store.release(claim).await,
            &AttemptError::Memory { need } => self.store.release_for_memory(claim, need).await,
            _ => {
                let (failure, retry) = failure(cause);
                self.store.fail(claim, failure, self.delay(retry, claim.job.attempt)).await
            }
        }
    }
}

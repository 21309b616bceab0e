//! Workers: they claim jobs, compute them apart from tokio, and store the results.
//!
//! One worker runs one job at a time, from its claim to its end. While it does, a plain thread beats for it: neither a
//! computation that fills every core nor a busy tokio can make a living job look dead. The computation itself runs on
//! a rayon pool ([`Compute`]), the only bridge between the two worlds.

mod analyses;
mod attempt_error;
mod compute;
mod heartbeat;
mod memory_gate;
mod own_coefficients;
mod retention;
mod shrinking;
mod stored_bases;
mod storing;
mod task;
mod worker;

use std::sync::Arc;
use std::time::Duration;

use tokio::sync::Notify;
use tokio_util::sync::CancellationToken;
use tokio_util::task::TaskTracker;

pub use analyses::{Analyze, Results, default_analysis};
pub use compute::{Compute, ComputeError, Urgency, Wanted, WantedWriter};
pub use retention::Retention;
pub use stored_bases::{BasesError, StoredBases};

use memory_gate::MemoryGate;

use crate::metrics::Metrics;
use crate::store::{Store, StoreError};

/// How the workers go about it.
#[derive(Debug, Clone)]
pub struct JobsSettings {
    /// Jobs that run at once. Each may use the whole pool. 0 where other nodes compute.
    pub concurrent: usize,
    /// Bytes of memory that they may be estimated to take together.
    pub memory: u64,
    /// How often a running job's phase and progress are written and its lease renewed.
    pub heartbeat: Duration,
    /// How often a running job looks whether somebody asked to cancel it.
    pub order_poll: Duration,
    /// How often an idle worker looks at the queue without being woken: for leases that ran out.
    pub poll: Duration,
    /// How long a job whose result could not be stored waits for its second attempt, and twice as long for its third: the
    /// disk may have room again by then.
    pub backoff: Duration,
    /// How long one attempt at a job may take.
    pub time_max: Duration,
    /// How often the database file is looked at for free pages to give back to the disk.
    pub shrinking: Duration,
    /// How long jobs and clouds are kept.
    pub retention: Retention,
    /// Where it is counted.
    pub metrics: Arc<Metrics>,
}

impl Default for JobsSettings {
    fn default() -> Self {
        Self {
            concurrent: 1,
            memory: u64::MAX,
            heartbeat: Duration::from_secs(1),
            order_poll: Duration::from_millis(200),
            poll: Duration::from_secs(1),
            backoff: Duration::from_mins(1),
            time_max: Duration::from_hours(6),
            shrinking: Duration::from_secs(10),
            retention: Retention::default(),
            metrics: Arc::default(),
        }
    }
}

/// The running workers.
#[derive(Debug)]
pub struct Jobs {
    wake: Arc<Notify>,
    /// Claim nothing more.
    stop: CancellationToken,
    /// End what runs.
    halt: CancellationToken,
    workers: TaskTracker,
    gate: Arc<MemoryGate>,
    settings: JobsSettings,
}

impl Jobs {
    /// Puts the jobs of dead processes back into the queue, then starts the workers.
    ///
    /// # Errors
    /// [`StoreError::Database`].
    pub async fn start(
        store: Store,
        compute: Compute,
        analyze: Arc<Analyze>,
        settings: JobsSettings,
    ) -> Result<Self, StoreError> {
        let process = store.node();
        let orphans = store.requeue_orphans(process).await?;
        if orphans > 0 {
            tracing::warn!(orphans, "requeued jobs of a dead process");
        }
        end_too_large(&store).await?;
        let wake = Arc::new(Notify::new());
        let jobs = Self {
            gate: Arc::new(MemoryGate::new(settings.memory, Arc::clone(&wake))),
            wake,
            stop: CancellationToken::new(),
            halt: CancellationToken::new(),
            workers: TaskTracker::new(),
            settings: settings.clone(),
        };
        tokio::spawn(settings.retention.keep(store.clone(), jobs.stop.clone()));
        tokio::spawn(keep_ending_too_large(store.clone(), jobs.stop.clone()));
        tokio::spawn(shrinking::keep_small(store.clone(), settings.shrinking, jobs.stop.clone()));
        for _ in 0..settings.concurrent {
            let worker = worker::Worker {
                store: store.clone(),
                compute: compute.clone(),
                analyze: Arc::clone(&analyze),
                settings: settings.clone(),
                process,
                wake: Arc::clone(&jobs.wake),
                stop: jobs.stop.clone(),
                halt: jobs.halt.clone(),
                gate: Arc::clone(&jobs.gate),
            };
            jobs.workers.spawn(worker.work());
        }
        Ok(jobs)
    }

    /// Whether every worker is there: one that panicked claims nothing more.
    #[must_use]
    pub fn are_alive(&self) -> bool {
        self.workers.len() == self.settings.concurrent
    }

    /// Bytes of memory that running jobs are estimated to take together.
    #[must_use]
    pub fn memory_taken(&self) -> u64 {
        self.settings.memory.saturating_sub(self.gate.free())
    }

    /// Tells an idle worker that a job was queued.
    pub fn wake(&self) {
        self.wake.notify_one();
    }

    /// Claims nothing more, gives running jobs `grace` to end, then gives them back to the queue with their attempt not
    /// counted. When it returns, no worker writes any more.
    pub async fn stop(&self, grace: Duration) {
        self.stop.cancel();
        self.workers.close();
        if tokio::time::timeout(grace, self.workers.wait()).await.is_err() {
            self.halt.cancel();
            self.workers.wait().await;
        }
    }
}

/// Between two looks for jobs that no node can run any more.
const TOO_LARGE: Duration = Duration::from_mins(10);

async fn end_too_large(store: &Store) -> Result<(), StoreError> {
    let too_large = store.fail_over_budget().await?;
    if too_large > 0 {
        tracing::warn!(too_large, "ended jobs that need more memory than the budget");
    }
    Ok(())
}

/// The largest node may have gone for good, and nobody else can take what was left to it.
async fn keep_ending_too_large(store: Store, stop: CancellationToken) {
    loop {
        tokio::select! {
            () = tokio::time::sleep(TOO_LARGE) => {}
            () = stop.cancelled() => return,
        }
        if let Err(error) = end_too_large(&store).await {
            tracing::warn!(%error, "could not end jobs that no node can run; will retry");
        }
    }
}

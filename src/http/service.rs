//! The state that all handlers share, and its limits.

use std::sync::Arc;
use std::time::Duration;

use axum::http::HeaderValue;
use tokio_util::sync::CancellationToken;

use super::wire::guard::Hosts;
use super::wire::keys::Keys;
use super::wire::memory::MemoryBudget;
use crate::cloud::reader;
use crate::jobs::{Compute, Jobs};
use crate::metrics::Metrics;
use crate::store::Store;

/// What the interface accepts at most.
#[derive(Debug, Clone)]
pub struct Limits {
    /// Bytes of a request's body as it is sent.
    pub body_bytes: u64,
    /// Bytes of a compressed body once it is decompressed.
    pub decoded_bytes: u64,
    /// Times as much that may come out of a compressed body as went in, beyond the first megabyte.
    pub decoded_ratio_max: u64,
    /// Time for a request's body.
    pub body_time: Duration,
    /// Bytes per second that a body brings at least, on average over the time of `stall`; 0 for none.
    pub body_rate_min: u64,
    /// Pause in a body, or in the taking of an answer, after which the client is given up.
    pub stall: Duration,
    /// Time for a request's head.
    pub header_time: Duration,
    /// Connections that are open.
    pub connections_max: usize,
    /// Bytes of memory for bodies and what they are parsed into; half as many again for large answers.
    pub body_memory: u64,
    /// Bytes of memory that the analyses running at one time may be estimated to take.
    pub memory_budget: u64,
    /// Bytes that stay free on the disk.
    pub disk_floor: u64,
    /// Jobs that run.
    pub jobs_at_once: usize,
    /// Days that jobs are kept after their end.
    pub keep_jobs_days: Option<u64>,
    /// Days that clouds without jobs are kept.
    pub keep_clouds_days: Option<u64>,
    /// Bases of a job.
    pub bases_max: usize,
    /// Jobs that wait.
    pub queue_max: u64,
    /// Jobs of one key that wait.
    pub queue_max_per_key: Option<u64>,
    /// Bytes that the clouds and results of one key take.
    pub stored_bytes_max_per_key: Option<u64>,
    /// Bytes of the database file.
    pub database_bytes_max: Option<u64>,
    /// Time of one attempt at a job.
    pub job_time: Duration,
    /// What is read from a file.
    pub reader: reader::Limits,
}

/// Threads for what takes too long for tokio's: a pool for each kind of work, so that none queues behind another.
#[derive(Debug, Clone)]
pub struct Pools {
    /// Parses what is sent.
    pub reading: Compute,
    /// Makes answers.
    pub answering: Compute,
    /// Compresses answers piece by piece.
    pub compressing: Compute,
}

/// What the handlers work with.
pub struct Service {
    /// The database.
    pub(super) store: Store,
    /// Threads that parse what is sent, apart from those that make answers.
    pub(super) reading: Compute,
    /// Threads that make answers, apart from those that analyze.
    pub(super) compute: Compute,
    /// Threads that compress answers piece by piece.
    pub(super) compressing: Compute,
    /// The workers, to be woken when a job was queued.
    pub(super) jobs: Arc<Jobs>,
    /// Limits.
    pub(super) limits: Limits,
    /// What bodies and large answers share.
    pub(super) memory: MemoryBudget,
    /// Origins of pages that may use the service from browsers; `*` is any.
    pub(super) origins: Vec<HeaderValue>,
    /// Names under which it answers where no key is asked for; `None` is any.
    pub(super) hosts: Option<Hosts>,
    /// Accepted keys; `None` when none is asked for.
    pub(super) keys: Option<Keys>,
    /// Canceled when the service stops: waiting requests then answer at once.
    pub(super) stopping: CancellationToken,
    /// What is counted.
    pub(super) metrics: Arc<Metrics>,
}

impl Service {
    /// What the handlers work with.
    #[must_use]
    pub fn new(
        store: Store,
        pools: Pools,
        jobs: Arc<Jobs>,
        limits: Limits,
        keys: Option<Keys>,
        metrics: Arc<Metrics>,
        stopping: CancellationToken,
    ) -> Self {
        let memory = MemoryBudget::new(limits.body_memory, limits.stall);
        let Pools { reading, answering: compute, compressing } = pools;
        let (origins, hosts) = (Vec::new(), None);
        Self {
            store,
            reading,
            compute,
            compressing,
            jobs,
            limits,
            memory,
            origins,
            hosts,
            keys,
            stopping,
            metrics,
        }
    }

    /// The same, open to pages of these origins (`*` is any), and under these names only where no key is asked for.
    #[must_use]
    pub fn allowing(self, origins: Vec<HeaderValue>, hosts: Hosts) -> Self {
        Self { origins, hosts: Some(hosts), ..self }
    }
}

/// The state of every handler.
pub(crate) type Shared = Arc<Service>;

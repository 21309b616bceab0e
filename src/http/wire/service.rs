//! The state that all handlers share, and its limits.

use std::sync::Arc;
use std::time::Duration;

use axum::http::HeaderValue;
use serde::Serialize;
use tokio_util::sync::CancellationToken;
use utoipa::ToSchema;

use super::guard::Hosts;
use super::keys::Keys;
use super::memory::MemoryBudget;
use super::waiting_places::WaitingPlaces;
use crate::cloud::reader;
use crate::jobs::{Compute, Jobs};
use crate::metrics::Metrics;
use crate::store::Store;

/// Limits of this service.
#[derive(Debug, Clone, Serialize, ToSchema)]
#[schema(as = LimitsView)]
pub struct Limits {
    /// Bytes of a request's body, as it is sent.
    pub body_bytes: u64,
    /// Bytes of a compressed body once it is decompressed.
    pub decoded_bytes: u64,
    /// Largest ratio of decompressed to compressed size beyond the first megabyte.
    pub decoded_ratio_max: u64,
    /// Seconds for a body.
    pub body_seconds: u64,
    /// Bytes per second that a body brings at least, on average over `stall_seconds`; 0 for none.
    pub body_rate_min_bytes: u64,
    /// Seconds without progress in sending a body or reading an answer before the connection is dropped.
    pub stall_seconds: u64,
    /// Seconds for the head of a request.
    pub header_seconds: u64,
    /// Open connections; further ones wait to be accepted.
    pub connections_max: usize,
    /// Bytes of memory for bodies and what they are parsed into, a fifth of it for the largest; half as many again for
    /// large answers and what they are made of.
    pub body_memory_bytes: u64,
    /// Points of a cloud.
    pub points_max: usize,
    /// Coordinates per point.
    pub dimension_max: usize,
    /// Per-point scalars of a cloud.
    pub fields_max: usize,
    /// Triangles of a cloud.
    pub faces_max: usize,
    /// Bases of a job.
    pub bases_max: usize,
    /// Jobs that wait.
    pub queue_max: u64,
    /// Jobs of one key that wait; null for `queue_max`.
    pub queue_max_per_key: Option<u64>,
    /// Bytes that the clouds and results of one key take; null for no limit.
    pub stored_bytes_max_per_key: Option<u64>,
    /// Bytes beyond which the database file does not grow; null for no limit.
    pub database_bytes_max: Option<u64>,
    /// Seconds that one attempt at a job may take.
    pub job_seconds: u64,
    /// Jobs that run at one time.
    pub jobs_at_once: usize,
    /// Bytes of memory that the analyses running at one time may be estimated to take.
    pub memory_budget_bytes: u64,
    /// Bytes that stay free on the disk.
    pub disk_floor_bytes: u64,
    /// Days after their end at which jobs are deleted; null keeps them.
    pub keep_jobs_days: Option<u64>,
    /// Days after their upload at which clouds without jobs are deleted; null keeps them.
    pub keep_clouds_days: Option<u64>,
    /// Largest JSON answer in bytes; request npy for more.
    pub json_bytes: u64,
    /// Seconds of `?wait=`.
    pub wait_seconds_max: u64,
    /// Entries of a page of a listing.
    pub page_max: u64,
    /// Bytes of memory for what is read from a file.
    #[serde(skip)]
    pub reader_memory_max: usize,
}

impl Limits {
    /// Time for a request's body.
    pub(crate) fn body_time(&self) -> Duration {
        Duration::from_secs(self.body_seconds)
    }

    /// Time without progress after which a client's connection is dropped.
    pub(crate) fn stall(&self) -> Duration {
        Duration::from_secs(self.stall_seconds)
    }

    /// Those of a file.
    pub(crate) fn reader(&self) -> reader::Limits {
        let &Self { points_max, dimension_max, fields_max, faces_max, reader_memory_max, .. } = self;
        reader::Limits { points_max, fields_max, dimension_max, faces_max, memory_max: reader_memory_max }
    }
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
    pub(crate) store: Store,
    /// Threads for work.
    pub(crate) pools: Pools,
    /// The workers, to be woken when a job was queued.
    pub(crate) jobs: Arc<Jobs>,
    /// Limits.
    pub(crate) limits: Limits,
    /// What bodies and large answers share.
    pub(crate) memory: MemoryBudget,
    /// What those share who wait for jobs.
    pub(crate) waiting: WaitingPlaces,
    /// Origins of pages that may use the service from browsers; `*` is any.
    pub(crate) origins: Vec<HeaderValue>,
    /// Names under which it answers where no key is asked for; `None` is any.
    pub(crate) hosts: Option<Hosts>,
    /// Accepted keys; `None` when none is asked for.
    pub(crate) keys: Option<Keys>,
    /// Canceled when the service stops: waiting requests then answer at once.
    pub(crate) stopping: CancellationToken,
    /// What is counted.
    pub(crate) metrics: Arc<Metrics>,
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
        let memory = MemoryBudget::new(limits.body_memory_bytes, limits.stall());
        let waiting = WaitingPlaces::new(limits.connections_max);
        let (origins, hosts) = (Vec::new(), None);
        Self { store, pools, jobs, limits, memory, waiting, origins, hosts, keys, stopping, metrics }
    }

    /// The same, open to pages of these origins (`*` is any), and under these names only where no key is asked for.
    #[must_use]
    pub fn allowing(self, origins: Vec<HeaderValue>, hosts: Hosts) -> Self {
        Self { origins, hosts: Some(hosts), ..self }
    }
}

/// The state of every handler.
pub(crate) type Shared = Arc<Service>;

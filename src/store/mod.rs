//! The embedded database: clouds, jobs and results. The only module that writes SQL.
//!
//! No SQLite type appears in a signature: a second engine can take this one's place.

use std::path::Path;

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;
use uuid::Uuid;

use crate::analysis::{JobKind, Parameters, Report, SparseMatrix};
use crate::cloud::{PointCloud, ScalarType};
use crate::progress::Phase;

/// Points per chunk: every array of n numbers is stored as rows of this many little-endian numbers.
pub const CHUNK_POINTS: usize = 8192;

/// Milliseconds since the Unix epoch.
pub type Milliseconds = i64;

/// Name and type of a per-point scalar.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct FieldRecord {
    /// Name as in the upload.
    pub name: String,
    /// Type as in the upload.
    #[schema(value_type = String)]
    pub kind: ScalarType,
}

/// A stored cloud, without its points.
#[derive(Debug, Clone, PartialEq)]
pub struct CloudRecord {
    /// UUIDv7.
    pub id: Uuid,
    /// When it was stored.
    pub created: Milliseconds,
    /// SHA-256, hex, of coordinates, fields and faces: the same content has the same digest, whatever the format.
    pub digest: String,
    /// Rows n.
    pub points: u64,
    /// Ambient dimension d.
    pub dimension: usize,
    /// Rows with a non-finite coordinate.
    pub nonfinite: u64,
    /// Rows that repeat an earlier position.
    pub duplicates: u64,
    /// `(minimum, maximum)` over the finite points.
    pub bounding_box: (Vec<f64>, Vec<f64>),
    /// Type of the coordinates in the upload.
    pub coordinate_type: ScalarType,
    /// Per-point scalars.
    pub fields: Vec<FieldRecord>,
    /// Number of triangles.
    pub faces: u64,
}

/// Where a job is in its life.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "lowercase")]
pub enum JobState {
    /// Waiting for a worker.
    Queued,
    /// Computing.
    Running,
    /// Ended with a result.
    Succeeded,
    /// Ended with an error.
    Failed,
    /// Ended because somebody asked for it.
    Canceled,
}

/// Why a job failed, in words for its owner.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct JobFailure {
    /// Stable word: `parameter`, `cloud`, `unsupported`, `numerical`, `crashed`, `internal`.
    pub code: String,
    /// A sentence.
    pub detail: String,
}

/// A job, without its arrays.
#[derive(Debug, Clone, PartialEq)]
pub struct JobRecord {
    /// UUIDv7.
    pub id: Uuid,
    /// The cloud it analyses.
    pub cloud_id: Uuid,
    /// Rows of that cloud.
    pub points: u64,
    /// What it computes.
    pub kind: JobKind,
    /// Where it is.
    pub state: JobState,
    /// The phase it is in or ended in; absent before its first claim.
    pub phase: Option<Phase>,
    /// 0 to 1, never decreasing within an attempt.
    pub progress: f64,
    /// Claims so far.
    pub attempt: u32,
    /// Somebody asked to cancel it.
    pub cancel_requested: bool,
    /// Jobs queued before it, when queued.
    pub queue_position: Option<u64>,
    /// When it was submitted.
    pub created: Milliseconds,
    /// When its last attempt began.
    pub started: Option<Milliseconds>,
    /// When it ended.
    pub finished: Option<Milliseconds>,
    /// Seconds spent in each phase of the last attempt, in order.
    pub phase_seconds: Vec<(Phase, f64)>,
    /// As submitted.
    pub parameters: Parameters,
    /// Present when succeeded.
    pub report: Option<Report>,
    /// Present when failed.
    pub failure: Option<JobFailure>,
}

/// What a submission came to.
#[derive(Debug, Clone, PartialEq)]
pub struct Submitted {
    /// The cloud.
    pub cloud: CloudRecord,
    /// The job, when one was asked for.
    pub job: Option<JobRecord>,
    /// Whether the cloud is new (false: the same content was there).
    pub cloud_created: bool,
    /// Whether the job is new (false: the same analysis was there, not failed and not canceled).
    pub job_created: bool,
}

/// A page of a listing, newest first.
#[derive(Debug, Clone, PartialEq)]
pub struct Page<T> {
    /// The records.
    pub items: Vec<T>,
    /// Pass this to get the next page; absent on the last.
    pub next: Option<Uuid>,
}

/// Why the store did not do it.
#[derive(Debug, thiserror::Error)]
pub enum StoreError {
    /// No such cloud or job.
    #[error("not found")]
    NotFound,
    /// The cloud still has queued or running jobs.
    #[error("the cloud has jobs that are queued or running")]
    CloudInUse,
    /// The queue is full.
    #[error("the queue already holds {limit} jobs")]
    QueueFull {
        /// The limit.
        limit: u64,
    },
    /// The writer's claim is no longer the current one.
    #[error("the claim was lost")]
    LostClaim,
    /// The job has no result (yet), or not of that kind.
    #[error("the job has no such result")]
    NoResult,
    /// Stored bytes do not match their digest.
    #[error("stored data is damaged: {0}")]
    Damaged(String),
    /// The database file, its version or its disk.
    #[error("database: {0}")]
    Database(String),
}

/// What the claimant of a job holds: every later write is fenced by `lease`.
#[derive(Debug, Clone)]
pub struct Claim {
    /// The job as claimed, in state running.
    pub job: JobRecord,
    /// Fencing number, new with every claim.
    pub lease: i64,
}

/// What a heartbeat learns.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Heartbeat {
    /// Go on.
    Continue,
    /// Somebody asked to cancel: end, then [`Store::cancel_claimed`].
    Cancel,
    /// The claim was lost: end, write nothing.
    Lost,
}

/// Handle to the database; cheap to clone.
#[derive(Debug, Clone)]
pub struct Store {}

impl Store {
    /// Opens or creates the database, runs the migrations, checks the engine's version.
    ///
    /// # Errors
    /// [`StoreError::Database`].
    pub async fn open(_path: &Path, _queue_max: u64) -> Result<Self, StoreError> {
        unimplemented!()
    }

    /// Stores a cloud and, if asked, queues a job on it: one transaction, so that neither is there without the other.
    ///
    /// # Errors
    /// [`StoreError`].
    pub async fn submit(
        &self,
        _cloud: &PointCloud,
        _job: Option<(JobKind, Parameters)>,
    ) -> Result<Submitted, StoreError> {
        unimplemented!()
    }

    /// Queues a job on a stored cloud.
    ///
    /// # Errors
    /// [`StoreError`].
    pub async fn submit_job(
        &self,
        _cloud: Uuid,
        _kind: JobKind,
        _parameters: Parameters,
    ) -> Result<Submitted, StoreError> {
        unimplemented!()
    }

    /// A cloud's record.
    ///
    /// # Errors
    /// [`StoreError::NotFound`], [`StoreError::Database`].
    pub async fn cloud(&self, _id: Uuid) -> Result<CloudRecord, StoreError> {
        unimplemented!()
    }

    /// A cloud with its points, fields and faces.
    ///
    /// # Errors
    /// [`StoreError`].
    pub async fn load_cloud(&self, _id: Uuid) -> Result<PointCloud, StoreError> {
        unimplemented!()
    }

    /// Clouds, newest first, after `cursor`.
    ///
    /// # Errors
    /// [`StoreError::Database`].
    pub async fn clouds(&self, _cursor: Option<Uuid>, _limit: u32) -> Result<Page<CloudRecord>, StoreError> {
        unimplemented!()
    }

    /// Deletes a cloud with its terminal jobs and their results.
    ///
    /// # Errors
    /// [`StoreError::CloudInUse`], [`StoreError::NotFound`], [`StoreError::Database`].
    pub async fn delete_cloud(&self, _id: Uuid) -> Result<(), StoreError> {
        unimplemented!()
    }

    /// A job's record.
    ///
    /// # Errors
    /// [`StoreError::NotFound`], [`StoreError::Database`].
    pub async fn job(&self, _id: Uuid) -> Result<JobRecord, StoreError> {
        unimplemented!()
    }

    /// Jobs, newest first, after `cursor`.
    ///
    /// # Errors
    /// [`StoreError::Database`].
    pub async fn jobs(
        &self,
        _state: Option<JobState>,
        _cloud: Option<Uuid>,
        _cursor: Option<Uuid>,
        _limit: u32,
    ) -> Result<Page<JobRecord>, StoreError> {
        unimplemented!()
    }

    /// Asks to cancel: a queued job ends at once, a running one at its next heartbeat. Returns the record after.
    ///
    /// # Errors
    /// [`StoreError::NotFound`], [`StoreError::Database`].
    pub async fn request_cancel(&self, _id: Uuid) -> Result<JobRecord, StoreError> {
        unimplemented!()
    }

    /// Deletes a terminal job with its result; asks a live one to cancel and returns false.
    ///
    /// # Errors
    /// [`StoreError::NotFound`], [`StoreError::Database`].
    pub async fn delete_job(&self, _id: Uuid) -> Result<bool, StoreError> {
        unimplemented!()
    }

    /// Values of basis `index` of a succeeded eigen job, all rows, digest checked.
    ///
    /// # Errors
    /// [`StoreError::NoResult`], [`StoreError`].
    pub async fn basis(&self, _job: Uuid, _index: usize) -> Result<Vec<f64>, StoreError> {
        unimplemented!()
    }

    /// Values of bases `first .. first + count` in the rows of chunk `chunk` (see [`CHUNK_POINTS`]): one vector per
    /// basis.
    ///
    /// # Errors
    /// [`StoreError::NoResult`], [`StoreError`].
    pub async fn bases_chunk(
        &self,
        _job: Uuid,
        _first: usize,
        _count: usize,
        _chunk: usize,
    ) -> Result<Vec<Vec<f64>>, StoreError> {
        unimplemented!()
    }

    /// Mass B of every row of a succeeded job.
    ///
    /// # Errors
    /// [`StoreError::NoResult`], [`StoreError`].
    pub async fn mass(&self, _job: Uuid) -> Result<Vec<f64>, StoreError> {
        unimplemented!()
    }

    /// Q of a succeeded operator job.
    ///
    /// # Errors
    /// [`StoreError::NoResult`], [`StoreError`].
    pub async fn operator_matrix(&self, _job: Uuid) -> Result<SparseMatrix, StoreError> {
        unimplemented!()
    }

    /// A write that proves the database takes writes.
    ///
    /// # Errors
    /// [`StoreError::Database`].
    pub async fn probe(&self) -> Result<(), StoreError> {
        unimplemented!()
    }
}

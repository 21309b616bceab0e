//! Records of the store: clouds and jobs without their arrays.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;
use uuid::Uuid;

use super::{Milliseconds, Owner};
use crate::analysis::{Examined, JobKind, Parameters, Report};
use crate::arguments::words;
use crate::cloud::{Grid, Origin, ScalarType, bytes_in_memory};
use crate::progress::Phase;

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
    /// A `UUIDv7`.
    pub id: Uuid,
    /// Whose it is.
    pub owner: Owner,
    /// What its file was called, if the client said.
    pub name: Option<String>,
    /// When it was stored.
    pub created: Milliseconds,
    /// SHA-256, hex, of all that is kept of the upload: two uploads are the same cloud if it is equal.
    pub digest: String,
    /// Rows n.
    pub points: u64,
    /// Ambient dimension d.
    pub dimension: usize,
    /// Rows with a non-finite coordinate.
    pub nonfinite: u64,
    /// Rows that repeat an earlier position.
    pub duplicates: u64,
    /// What admission looks at; none of clouds that an older version stored.
    pub examined: Option<Examined>,
    /// `(minimum, maximum)` over the finite points; both empty when there are none.
    pub bounding_box: (Vec<f64>, Vec<f64>),
    /// Type of the coordinates in the upload.
    pub coordinate_type: ScalarType,
    /// Grids of x, y and z in the upload, if it was a file of scaled integers.
    pub grids: Option<[Grid; 3]>,
    /// What the file said beside its points.
    pub origin: Origin,
    /// Per-point scalars.
    pub fields: Vec<FieldRecord>,
    /// Number of triangles.
    pub faces: u64,
}

impl CloudRecord {
    /// Bytes of memory that the cloud takes when it is loaded.
    #[must_use]
    pub fn bytes(&self) -> u64 {
        bytes_in_memory(self.points, self.dimension + self.fields.len(), self.faces)
    }
}

words! {
    /// Where a job is in its life.
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
}

/// Why a job failed, in words for its owner.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct JobFailure {
    /// Stable word: `parameter`, `cloud`, `unsupported`, `numerical`, `memory`, `disk`, `time`, `crashed`, `internal`.
    pub code: String,
    /// A sentence.
    pub detail: String,
}

/// A job, without its arrays.
#[derive(Debug, Clone, PartialEq)]
pub struct JobRecord {
    /// A `UUIDv7`.
    pub id: Uuid,
    /// Whose it is.
    pub owner: Owner,
    /// The cloud it analyzes.
    pub cloud_id: Uuid,
    /// What the cloud's file was called.
    pub cloud_name: Option<String>,
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
    /// Bytes that the analysis is estimated to take.
    pub memory: u64,
    /// Rows per chunk of its bases.
    pub chunk_points: usize,
    /// Claims so far, except those that an orderly stop gave back.
    pub attempt: u32,
    /// Somebody asked to cancel it.
    pub cancel_requested: bool,
    /// Jobs that are served before it, when queued.
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
    /// Present when succeeded; its spectrum is left out in listings.
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
pub enum Order {
    /// Go on.
    Continue,
    /// Somebody asked to cancel: end, then [`super::Store::cancel_claimed`].
    Cancel,
    /// The claim was lost: end, write nothing.
    Lost,
}

impl<T> Page<T> {
    /// The first `limit` of `items`, of which one more than that was asked for.
    pub(super) fn cut(mut items: Vec<T>, limit: u32, id: impl Fn(&T) -> Uuid) -> Self {
        let limit = limit.max(1) as usize;
        let more = items.len() > limit;
        items.truncate(limit);
        let next = if more { items.last().map(id) } else { None };
        Self { items, next }
    }
}

/// How a running job is doing.
#[derive(Debug, Clone, PartialEq)]
pub struct Vitals {
    /// The phase it is in.
    pub phase: Phase,
    /// 0 to 1.
    pub progress: f64,
    /// Seconds spent in each phase so far, in order.
    pub phase_seconds: Vec<(Phase, f64)>,
    /// Bytes of memory that are reserved for it.
    pub memory: u64,
}

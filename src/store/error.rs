//! Errors of the store.

/// What can go wrong between a caller and the database.
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
    /// As many jobs of this owner wait as may.
    #[error("{limit} jobs of this key are queued, which is as many as may be")]
    OwnerQueueFull {
        /// The limit.
        limit: u64,
    },
    /// The owner's clouds and results would take more than they may.
    #[error(
        "the clouds and results of this key take {stored} bytes, and this needs {more}; they may take {limit}"
    )]
    OwnerStorageFull {
        /// Bytes that they take, those of results that are still to come included.
        stored: u64,
        /// Bytes that were to be added.
        more: u64,
        /// The limit.
        limit: u64,
    },
    /// The analysis would take more memory than all analyses together may.
    #[error("the analysis needs about {need} bytes of memory; the budget is {budget} bytes")]
    OverBudget {
        /// Bytes it is estimated to take.
        need: u64,
        /// Bytes that the analyses running at one time may take.
        budget: u64,
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
    /// The disk is full, or as full as it may get.
    #[error("no space left for the database")]
    StorageFull,
    /// Another process holds the database's write lock, or all connections were taken, for longer than is waited.
    #[error("the database is busy; try again")]
    Busy,
    /// Another process serves or rewrites the database.
    #[error(
        "it is in use by another chladni{}; stop that one first, or serve another file",
        holder.map(|pid| format!(" (process {pid})")).unwrap_or_default()
    )]
    InUse {
        /// Its process, if known.
        holder: Option<u32>,
    },
    /// The database file, its version or its disk.
    #[error("database: {0}")]
    Database(String),
}

/// Primary result codes, <https://www.sqlite.org/rescode.html>; the extended ones carry them in the low byte.
const BUSY: u32 = 5;
const LOCKED: u32 = 6;
const CORRUPT: u32 = 11;
const FULL: u32 = 13;
const NOT_A_DATABASE: u32 = 26;

impl From<sqlx::Error> for StoreError {
    fn from(error: sqlx::Error) -> Self {
        if matches!(error, sqlx::Error::PoolTimedOut) {
            return Self::Busy;
        }
        let code = error
            .as_database_error()
            .and_then(sqlx::error::DatabaseError::code)
            .and_then(|code| code.parse::<u32>().ok());
        match code.map(|code| code & 0xff) {
            Some(BUSY | LOCKED) => Self::Busy,
            Some(FULL) => Self::StorageFull,
            Some(CORRUPT | NOT_A_DATABASE) => Self::Damaged(error.to_string()),
            _ => Self::Database(error.to_string()),
        }
    }
}

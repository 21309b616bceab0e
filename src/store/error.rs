//! Why the store did not do it.

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
    /// The database file, its version or its disk.
    #[error("database: {0}")]
    Database(String),
}

/// Primary result codes, <https://www.sqlite.org/rescode.html>; the extended ones carry them in the low byte.
const CORRUPT: u32 = 11;
const FULL: u32 = 13;
const NOT_A_DATABASE: u32 = 26;

impl From<sqlx::Error> for StoreError {
    fn from(error: sqlx::Error) -> Self {
        let code = error
            .as_database_error()
            .and_then(sqlx::error::DatabaseError::code)
            .and_then(|code| code.parse::<u32>().ok());
        match code.map(|code| code & 0xff) {
            Some(FULL) => Self::StorageFull,
            Some(CORRUPT | NOT_A_DATABASE) => Self::Damaged(error.to_string()),
            _ => Self::Database(error.to_string()),
        }
    }
}

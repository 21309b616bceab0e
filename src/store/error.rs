//! Errors of the store, and those of the engines as such.

use sqlx::Error;
use sqlx::error::DatabaseError;
use sqlx::migrate::MigrateError;
use sqlx::postgres::PgDatabaseError;

/// An error of the store.
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
    #[error("this key already has {limit} queued jobs, its limit")]
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
    /// The connection to the server is lost, or the server is going down or coming up.
    #[error("the database cannot be reached: {0}")]
    Unreachable(String),
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

impl StoreError {
    /// Why the tables could not be brought up to date.
    pub(super) fn not_migrated(error: MigrateError) -> Self {
        match error {
            MigrateError::VersionMissing(version) => Self::Database(format!(
                "it was written by a newer chladni (it has migration {version}); start that version, or restore a backup \
                 that this one wrote"
            )),
            MigrateError::VersionMismatch(version) => Self::Database(format!(
                "it was written by another build of chladni (its migration {version} is not this one's); start that build, \
                 or restore a backup that this one wrote"
            )),
            MigrateError::Execute(error) | MigrateError::ExecuteMigration(error, _) => error.into(),
            other => Self::Database(other.to_string()),
        }
    }
}

impl From<Error> for StoreError {
    fn from(error: Error) -> Self {
        match &error {
            Error::PoolTimedOut => Self::Busy,
            Error::Io(cause) => Self::Unreachable(cause.to_string()),
            Error::Database(cause) => match cause.try_downcast_ref::<PgDatabaseError>() {
                Some(cause) => of_postgres(cause),
                None => of_sqlite(&**cause),
            }
            .unwrap_or_else(|| Self::Database(error.to_string())),
            _ => Self::Database(error.to_string()),
        }
    }
}

/// Primary result codes, <https://www.sqlite.org/rescode.html>; the extended ones carry them in the low byte.
const BUSY: u32 = 5;
const LOCKED: u32 = 6;
const CORRUPT: u32 = 11;
const FULL: u32 = 13;
const NOT_A_DATABASE: u32 = 26;

fn of_sqlite(error: &dyn DatabaseError) -> Option<StoreError> {
    let code = error.code()?.parse::<u32>().ok()?;
    match code & 0xff {
        BUSY | LOCKED => Some(StoreError::Busy),
        FULL => Some(StoreError::StorageFull),
        CORRUPT | NOT_A_DATABASE => Some(StoreError::Damaged(error.to_string())),
        _ => None,
    }
}

/// <https://www.postgresql.org/docs/current/errcodes-appendix.html>
fn of_postgres(error: &PgDatabaseError) -> Option<StoreError> {
    match error.code() {
        "53100" => Some(StoreError::StorageFull),
        // too many connections; a serialization failure, a deadlock, a lock that was waited for too long
        "53300" | "40001" | "40P01" | "55P03" => Some(StoreError::Busy),
        // the server ends, crashed, or starts; the transaction was idle for too long, so that its connection was closed
        "57P01" | "57P02" | "57P03" | "25P03" => Some(StoreError::Unreachable(error.message().to_owned())),
        // what a row refers to was deleted in another node meanwhile
        "23503" => Some(StoreError::NotFound),
        "XX001" | "XX002" => Some(StoreError::Damaged(error.message().to_owned())),
        code if code.starts_with("08") => Some(StoreError::Unreachable(error.message().to_owned())),
        _ => None,
    }
}

//! The embedded database: clouds, jobs and results. The only module that writes SQL.
//!
//! No SQLite type appears in a signature: a second engine can take this one's place.
//!
//! One connection writes, so writers queue in this process instead of failing at the file's lock; many read, each from
//! the snapshot at which its reading began, records and arrays by connections of their own. A write that has begun runs to its end even if whoever asked for it goes
//! away, because a handler's future is dropped when its client disconnects.

mod arrays;
mod claims;
mod clouds;
mod coefficients;
mod content;
mod copies;
mod database;
mod error;
mod followed;
mod idempotency;
mod jobs;
mod line;
mod lock;
mod owner;
mod queue;
mod reading;
mod records;
mod results;
mod retention;
mod rows;
mod settings;
mod space;
mod write;

use std::future::Future;
use std::path::Path;
use std::sync::Arc;

use sqlx::{Sqlite, SqlitePool, Transaction};
use tokio::sync::watch;

pub use coefficients::StoredCoefficients;
pub use error::StoreError;
pub use idempotency::{REMEMBERED, Remembered};
pub use lock::DatabaseLock;
pub use owner::Owner;
pub use records::{
    Claim, CloudRecord, FieldRecord, JobFailure, JobRecord, JobState, Order, Page, Submitted, Vitals,
};
pub use results::{ArrayName, BasisValues, Numbers};
pub use settings::{Clock, StoreSettings};
pub use space::Space;

/// Points per chunk: every array of n numbers is stored as rows of this many little-endian numbers; bases of fewer, when
/// there are many of them (see [`JobRecord::chunk_points`]).
pub const CHUNK_POINTS: usize = 8192;

/// Milliseconds since the Unix epoch.
pub type Milliseconds = i64;

/// Handle to the database; cheap to clone.
#[derive(Debug, Clone)]
pub struct Store {
    writer: SqlitePool,
    /// For records.
    readers: SqlitePool,
    /// For clouds and results.
    arrays: SqlitePool,
    settings: Arc<StoreSettings>,
    disk: space::Disk,
    last_commit: write::LastCommit,
    changes: watch::Sender<u64>,
    followed: followed::Followed,
}

impl Store {
    /// Opens or creates the database, runs the migrations, checks the engine's version.
    ///
    /// # Errors
    /// [`StoreError::Database`].
    pub async fn open(path: &Path, queue_max: u64) -> Result<Self, StoreError> {
        Self::open_with(path, StoreSettings { queue_max, ..StoreSettings::default() }).await
    }

    /// As [`Self::open`], with every setting.
    ///
    /// # Errors
    /// [`StoreError::Database`].
    pub async fn open_with(path: &Path, settings: StoreSettings) -> Result<Self, StoreError> {
        let (writer, readers, arrays) = database::open(path, &settings).await?;
        let disk = space::Disk::of(path, settings.disk_floor);
        Ok(Self {
            writer,
            readers,
            arrays,
            settings: Arc::new(settings),
            disk,
            last_commit: write::LastCommit::default(),
            changes: watch::Sender::new(0),
            followed: followed::Followed::default(),
        })
    }

    /// Ends all connections and merges the write-ahead log into the file.
    pub async fn close(&self) {
        self.readers.close().await;
        self.arrays.close().await;
        self.writer.close().await;
    }

    /// Counts up whenever a job may have changed, for whoever waits for one.
    #[must_use]
    pub fn changes(&self) -> watch::Receiver<u64> {
        self.changes.subscribe()
    }

    /// Writes a compacted copy of the database at `path`, as of one moment, to the new file `copy`. Services that have it
    /// open go on meanwhile; it is neither made nor migrated.
    ///
    /// # Errors
    /// [`StoreError::Database`], also when `copy` exists.
    pub async fn backup(path: &Path, copy: &Path) -> Result<(), StoreError> {
        copies::copy(path, copy).await
    }

    /// Rewrites the database at `path` without its free pages, and so that it can be made shorter while it is served.
    /// Nobody may have it open: the caller proves it by the lock.
    ///
    /// # Errors
    /// [`StoreError::Database`]; [`StoreError::StorageFull`] when there is no room for the rewritten file beside the old
    /// one. The database is unchanged then.
    pub async fn compact(path: &Path, lock: &DatabaseLock) -> Result<(), StoreError> {
        copies::compact(path, lock).await
    }

    fn now(&self) -> Milliseconds {
        self.settings.clock.now()
    }

    /// Begins a transaction in which several statements read arrays from one snapshot.
    async fn read(&self) -> Result<Transaction<'static, Sqlite>, StoreError> {
        Ok(self.arrays.begin().await?)
    }

    fn announce(&self) {
        self.changes.send_modify(|count| *count += 1);
    }
}

/// Runs a write to its end even if the caller's future is dropped.
async fn detached<T: Send + 'static>(
    write: impl Future<Output = Result<T, StoreError>> + Send + 'static,
) -> Result<T, StoreError> {
    tokio::spawn(write).await.unwrap_or_else(|ended| Err(StoreError::Database(ended.to_string())))
}

/// Runs hashing and decoding, which take milliseconds, away from the threads that serve requests.
async fn off_thread<T: Send + 'static>(
    work: impl FnOnce() -> Result<T, StoreError> + Send + 'static,
) -> Result<T, StoreError> {
    tokio::task::spawn_blocking(work)
        .await
        .unwrap_or_else(|ended| Err(StoreError::Database(ended.to_string())))
}

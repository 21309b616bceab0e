//! The database: clouds, jobs and results. The only module that writes SQL.
//!
//! Two engines hold it: an SQLite file that one process serves (`sqlite/`), or a PostgreSQL database that many nodes share
//! (`postgres/`). `connection.rs` makes one text of a statement do for both; no engine's type appears in a public
//! signature.
//!
//! A write that has begun runs to its end even if whoever asked for it goes away, because a handler's future is dropped when
//! its client disconnects.

mod address;
mod arrays;
mod bulk;
mod claims;
mod clouds;
mod coefficients;
mod columns;
mod connection;
mod content;
mod engine;
mod error;
mod followed;
mod idempotency;
mod jobs;
mod line;
mod moving;
mod owner;
mod postgres;
mod queue;
mod reading;
mod records;
mod results;
mod retention;
mod rows;
mod settings;
mod shrinking;
mod space;
mod sqlite;
mod write;

use std::fs::File;
use std::future::Future;
use std::io;
use std::path::Path;
use std::sync::Arc;

use tokio::sync::watch;
use uuid::Uuid;

use connection::Connection;
use engine::Engine;
use settings::Time;

pub use address::DatabaseAddress;
pub use coefficients::StoredCoefficients;
pub use error::StoreError;
pub use idempotency::{REMEMBERED, Remembered};
pub use moving::Moved;
pub use owner::Owner;
pub use records::{
    Claim, CloudRecord, FieldRecord, JobFailure, JobRecord, JobState, Order, Page, Submitted, Vitals,
};
pub use results::{ArrayName, BasisValues, Numbers};
pub use settings::{Clock, NodeSettings, StoreSettings};
pub use space::Space;
pub use sqlite::DatabaseLock;

/// Points per chunk: every array of n numbers is stored as rows of this many little-endian numbers; bases of fewer, when
/// there are many of them (see [`JobRecord::chunk_points`]).
pub const CHUNK_POINTS: usize = 8192;

/// Milliseconds since the Unix epoch.
pub type Milliseconds = i64;

/// Handle to the database; cheap to clone.
#[derive(Debug, Clone)]
pub struct Store {
    engine: Engine,
    /// This process, as it stands at the jobs that it runs.
    node: Uuid,
    settings: Arc<StoreSettings>,
    last_commit: write::LastCommit,
    news: News,
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
        Self::open_at(&DatabaseAddress::file(path), settings).await
    }

    /// Opens the database in a file, which is made when it is not there, or on a PostgreSQL server; runs the migrations and
    /// checks the engine's version.
    ///
    /// # Errors
    /// [`StoreError::Database`], [`StoreError::Unreachable`].
    pub async fn open_at(address: &DatabaseAddress, settings: StoreSettings) -> Result<Self, StoreError> {
        let (node, news) = (Uuid::now_v7(), News::default());
        let engine = if let Some(path) = address.path() {
            Engine::Sqlite(sqlite::Database::open(path, &settings).await?)
        } else {
            Engine::Postgres(postgres::Database::open(address, &settings, node, news.clone()).await?)
        };
        Ok(Self {
            engine,
            node,
            settings: Arc::new(settings),
            last_commit: write::LastCommit::default(),
            news,
            followed: followed::Followed::default(),
        })
    }

    /// Ends all connections; SQLite then merges its write-ahead log into the file.
    pub async fn close(&self) {
        self.engine.close().await;
    }

    /// This process's name at the jobs that it runs, new with every start.
    #[must_use]
    pub fn node(&self) -> Uuid {
        self.node
    }

    /// Counts up whenever a job may have changed, for whoever waits for one.
    #[must_use]
    pub fn changes(&self) -> watch::Receiver<u64> {
        self.news.changes.subscribe()
    }

    /// Counts up whenever a job may have been queued, here or by another node.
    #[must_use]
    pub fn arrivals(&self) -> watch::Receiver<u64> {
        self.news.arrivals.subscribe()
    }

    /// A file without a name for `bytes` bytes that do not fit into memory: beside the database, whose disk is there for large
    /// results, or where the system has its temporary files.
    ///
    /// # Errors
    /// Those of the file system; [`io::ErrorKind::StorageFull`] where the disk would have less left than its floor.
    pub fn scratch_file(&self, bytes: u64) -> io::Result<File> {
        match &self.engine {
            Engine::Sqlite(database) => database.scratch_file(bytes),
            Engine::Postgres(_) => tempfile::tempfile(),
        }
    }

    /// Writes a compacted copy of the database at `path`, as of one moment, to the new file `copy`. Services that have it
    /// open go on meanwhile; it is neither made nor migrated.
    ///
    /// # Errors
    /// [`StoreError::Database`], also when `copy` exists.
    pub async fn backup(path: &Path, copy: &Path) -> Result<(), StoreError> {
        sqlite::copies::copy(path, copy).await
    }

    /// Rewrites the database at `path` without its free pages, and so that it can be made shorter while it is served.
    /// Nobody may have it open: the caller proves it by the lock.
    ///
    /// # Errors
    /// [`StoreError::Database`]; [`StoreError::StorageFull`] when there is no room for the rewritten file beside the old
    /// one. The database is unchanged then.
    pub async fn compact(path: &Path, lock: &DatabaseLock) -> Result<(), StoreError> {
        sqlite::copies::compact(path, lock).await
    }

    async fn time(&self, connection: &mut Connection) -> Result<Time, StoreError> {
        Engine::time(connection, &self.settings).await
    }

    async fn now(&self, connection: &mut Connection) -> Result<Milliseconds, StoreError> {
        Ok(self.time(connection).await?.now)
    }

    /// A connection that reads records.
    async fn reader(&self) -> Result<Connection, StoreError> {
        self.engine.reader().await
    }

    /// Begins a transaction in which several statements read arrays from one snapshot.
    async fn read(&self) -> Result<Connection, StoreError> {
        self.engine.snapshot().await
    }

    /// A job may have changed.
    fn announce(&self) {
        self.news.tell(Subject::Change);
        self.engine.tell(Subject::Change);
    }

    /// A job may have been queued.
    fn announce_arrival(&self) {
        self.news.tell(Subject::Arrival);
        self.engine.tell(Subject::Arrival);
    }
}

/// Kinds of change notifications.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Subject {
    /// A job may have changed.
    Change,
    /// A job may have been queued, which is a change too.
    Arrival,
}

/// Counters that go up when something may have happened.
#[derive(Debug, Clone, Default)]
struct News {
    changes: watch::Sender<u64>,
    arrivals: watch::Sender<u64>,
}

impl News {
    fn tell(&self, subject: Subject) {
        self.changes.send_modify(|count| *count += 1);
        if subject == Subject::Arrival {
            self.arrivals.send_modify(|count| *count += 1);
        }
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

//! SQLite: one file, one process, nothing to install.
//!
//! One connection writes, so writers queue in this process instead of failing at the file's lock; many read, each from the
//! snapshot at which its reading began, records and arrays by connections of their own.

pub(super) mod copies;
pub(super) mod database;
mod disk;
mod lock;
mod writer;

use std::fs::File;
use std::io;
use std::path::Path;
use std::time::{Duration, Instant};

use sqlx::{Row, SqlitePool};

pub use lock::DatabaseLock;
pub(super) use writer::Writer;

use super::{Space, StoreError, StoreSettings};
use disk::Disk;

/// Connections to the file, and its disk.
#[derive(Debug, Clone)]
pub(super) struct Database {
    writer: SqlitePool,
    /// For records.
    pub(super) readers: SqlitePool,
    /// For clouds and results.
    pub(super) arrays: SqlitePool,
    /// How long another process that holds the file's lock is waited for.
    busy: Duration,
    disk: Disk,
}

impl Database {
    pub(super) async fn open(path: &Path, settings: &StoreSettings) -> Result<Self, StoreError> {
        let (writer, readers, arrays) = database::open(path, settings).await?;
        Ok(Self { writer, readers, arrays, busy: settings.busy, disk: Disk::of(path, settings.disk_floor) })
    }

    /// A file without a name beside the database's.
    pub(super) fn scratch_file(&self, bytes: u64) -> io::Result<File> {
        self.disk.scratch_file(bytes)
    }

    /// Ends all connections and merges the write-ahead log into the file.
    pub(super) async fn close(&self) {
        self.readers.close().await;
        self.arrays.close().await;
        self.writer.close().await;
    }

    /// Begins a transaction that writes. The time that went by in the queue counts as waited: otherwise each of those who
    /// wait behind one that meets a locked file would wait as long again, one after the other.
    pub(super) async fn begin(&self) -> Result<Writer, StoreError> {
        let asked = Instant::now();
        let connection = self.writer.acquire().await?;
        Writer::begin(connection, self.busy.saturating_sub(asked.elapsed())).await
    }

    pub(super) async fn space(&self) -> Result<Space, StoreError> {
        let pages = sqlx::query(
            "SELECT page_count * page_size AS file, freelist_count * page_size AS free \
             FROM pragma_page_count, pragma_freelist_count, pragma_page_size",
        )
        .fetch_one(&self.readers)
        .await?;
        let (file, free): (i64, i64) = (pages.try_get("file")?, pages.try_get("free")?);
        Ok(Space { file: file as u64, free_pages: free as u64, disk_free: Some(self.disk.free()?) })
    }

    pub(super) async fn refuse_when_disk_full(&self) -> Result<(), StoreError> {
        if self.disk.has_room()? || self.space().await?.room() >= self.disk.floor() {
            return Ok(());
        }
        Err(StoreError::StorageFull)
    }

    /// Whether the file can be made shorter while it is served.
    pub(super) async fn can_shrink(&self) -> Result<bool, StoreError> {
        let row = sqlx::query("PRAGMA auto_vacuum").fetch_one(&self.readers).await?;
        Ok(row.try_get::<i64, _>(0)? != 0)
    }
}

/// The statement that moves up to `pages` pages from the file's end into its free pages: a pragma takes no parameters.
pub(super) fn shrinking(pages: u32) -> String {
    format!("PRAGMA incremental_vacuum({pages})")
}

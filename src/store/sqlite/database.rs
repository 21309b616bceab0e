//! The database file: how it is opened, and which engine may open it.

use std::fs::{File, OpenOptions};
use std::os::unix::fs::OpenOptionsExt;
use std::path::Path;
use std::time::Duration;

use sqlx::sqlite::{
    SqliteAutoVacuum, SqliteConnectOptions, SqliteJournalMode, SqlitePoolOptions, SqliteSynchronous,
};
use sqlx::{ConnectOptions, Connection, Row, SqliteConnection, SqlitePool};

use crate::store::{StoreError, StoreSettings};

/// Before 3.51.3 a reset of the write-ahead log could corrupt the database when two connections checkpointed at once
/// (<https://www.sqlite.org/releaselog/3_51_3.html>).
const ENGINE_MIN: [u32; 3] = [3, 51, 3];

/// `PRAGMA application_id` of our files; the first migration writes it.
const APPLICATION_ID: i64 = 1_667_787_876;

/// A chunk of 64 KiB lies in a chain of pages, each found by reading the one before: large pages make it short. With
/// 4 KiB pages, deleting a result of 54 MB took three times as long (0.13 s); reading and writing differed less.
const PAGE_BYTES: u32 = 16_384;

/// Pages of an empty database, and some.
const PAGES_MIN: u64 = 64;

/// Most pages of a file, by SQLite's own limit (<https://www.sqlite.org/limits.html>, section 14).
const PAGES_MAX: u64 = 4_294_967_294;

/// The log is cut back to this size once its content is in the file, so that one large result does not hold twice its
/// space for good.
const LOG_BYTES_KEPT: &str = "67108864";

/// How long a caller waits for a connection. Long: the one writer may be storing a large cloud.
const ACQUIRE: Duration = Duration::from_mins(2);

/// Opens the file with one connection that writes, and with readers of records and of arrays, as many as the settings ask
/// for: a record is read in a moment and does not wait for those who read megabytes.
pub(super) async fn open(
    path: &Path,
    settings: &StoreSettings,
) -> Result<(SqlitePool, SqlitePool, SqlitePool), StoreError> {
    let file = private_file(path).map_err(|error| unusable(path, &error))?;
    if file.metadata().is_ok_and(|file| file.len() == 0) {
        set_up(path).await?;
    }
    let options = SqliteConnectOptions::new()
        .filename(path)
        .page_size(PAGE_BYTES)
        .journal_mode(SqliteJournalMode::Wal)
        .synchronous(SqliteSynchronous::Full)
        .foreign_keys(true)
        .busy_timeout(settings.busy)
        .pragma("journal_size_limit", LOG_BYTES_KEPT);
    let pages = settings.file_bytes_max / u64::from(PAGE_BYTES);
    let bounded = options.clone().pragma("max_page_count", pages.clamp(PAGES_MIN, PAGES_MAX).to_string());
    let writer = pool(1).connect_with(bounded).await.map_err(not_opened)?;
    check_engine(&writer).await?;
    check_owner(&mut *writer.acquire().await?).await?;
    sqlx::migrate!("./migrations/sqlite").run(&writer).await.map_err(StoreError::not_migrated)?;
    let options = options.pragma("query_only", "ON");
    let arrays = pool(settings.array_readers).connect_with(options.clone()).await?;
    let readers = pool(settings.readers).connect_with(options).await?;
    Ok((writer, readers, arrays))
}

/// Writes the head of an empty file. Free pages can be given back only if the first page says so; to say it to a file that
/// has its pages takes the write lock in vain.
async fn set_up(path: &Path) -> Result<(), StoreError> {
    let options = SqliteConnectOptions::new()
        .filename(path)
        .page_size(PAGE_BYTES)
        .auto_vacuum(SqliteAutoVacuum::Incremental)
        .journal_mode(SqliteJournalMode::Wal);
    Ok(options.connect().await.map_err(not_opened)?.close().await?)
}

/// Opens a file for reading and writing; a new one can be read by its owner alone. SQLite gives the mode of the database
/// to the files that it makes beside it.
pub(super) fn private_file(path: &Path) -> std::io::Result<File> {
    OpenOptions::new().read(true).write(true).create(true).truncate(false).mode(0o600).open(path)
}

/// Says what the matter is where SQLite would say "code 14".
pub(super) fn unusable(path: &Path, error: &std::io::Error) -> StoreError {
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty());
    match folder {
        Some(folder) if !folder.exists() => {
            StoreError::Database(format!("the folder {} does not exist", folder.display()))
        }
        _ => StoreError::Database(format!("the file cannot be opened for reading and writing: {error}")),
    }
}

fn not_opened(error: sqlx::Error) -> StoreError {
    match StoreError::from(error) {
        StoreError::Damaged(cause) if cause.contains("not a database") => {
            StoreError::Database("the file is not an SQLite database".to_owned())
        }
        StoreError::Damaged(cause) => {
            StoreError::Database(format!("the file is damaged, restore a backup: {cause}"))
        }
        other => other,
    }
}

/// Connections to a file do not go stale by themselves. One whose transaction could not be ended, as after an I/O error,
/// is closed instead of being used again; the ping lets a rollback that is under way end first.
fn pool(connections: u32) -> SqlitePoolOptions {
    SqlitePoolOptions::new()
        .after_release(|connection, _| {
            Box::pin(async move {
                connection.ping().await?;
                Ok(!connection.is_in_transaction())
            })
        })
        .max_connections(connections)
        .idle_timeout(None)
        .max_lifetime(None)
        .test_before_acquire(false)
        .acquire_timeout(ACQUIRE)
}

async fn check_engine(writer: &SqlitePool) -> Result<(), StoreError> {
    let version: String = sqlx::query_scalar("SELECT sqlite_version()").fetch_one(writer).await?;
    if is_recent(&version) {
        return Ok(());
    }
    Err(StoreError::Database(format!(
        "SQLite {version} is too old: {}.{}.{} is needed",
        ENGINE_MIN[0], ENGINE_MIN[1], ENGINE_MIN[2]
    )))
}

fn is_recent(version: &str) -> bool {
    let numbers: Option<Vec<u32>> = version.split('.').map(|number| number.parse().ok()).collect();
    numbers.is_some_and(|numbers| numbers.as_slice() >= ENGINE_MIN.as_slice())
}

/// Refuses files of other applications. A file without a mark may have been left by a first start that was killed before
/// the first migration: it has at most the empty table in which migrations are recorded.
pub(super) async fn check_owner(database: &mut SqliteConnection) -> Result<(), StoreError> {
    let row = sqlx::query(
        "SELECT application_id AS owner, \
         (SELECT count(*) FROM sqlite_schema WHERE tbl_name <> '_sqlx_migrations') AS others, \
         (SELECT count(*) FROM sqlite_schema WHERE tbl_name = '_sqlx_migrations') AS migrations \
         FROM pragma_application_id",
    )
    .fetch_one(&mut *database)
    .await
    .map_err(not_opened)?;
    let (owner, others): (i64, i64) = (row.try_get("owner")?, row.try_get("others")?);
    let is_new = owner == 0 && others == 0 && {
        let recorded = row.try_get::<i64, _>("migrations")? > 0;
        !recorded
            || sqlx::query_scalar::<_, i64>("SELECT count(*) FROM _sqlx_migrations")
                .fetch_one(database)
                .await?
                == 0
    };
    if owner == APPLICATION_ID || is_new {
        return Ok(());
    }
    Err(StoreError::Database("the file is a database of another application".to_owned()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_engine_is_recent_from_3_51_3_on() {
        for version in ["3.51.3", "3.52.0", "3.100.0", "4.0.0"] {
            assert!(is_recent(version), "{version}");
        }
        for version in ["3.51.2", "3.9.9", "2.99.99", "", "3.51", "three"] {
            assert!(!is_recent(version), "{version}");
        }
    }
}

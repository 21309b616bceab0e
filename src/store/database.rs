//! The database file: how it is opened, and which engine may open it.

use std::path::Path;
use std::time::Duration;

use sqlx::sqlite::{SqliteConnectOptions, SqliteJournalMode, SqlitePoolOptions, SqliteSynchronous};
use sqlx::{ConnectOptions, Connection, Row, SqliteExecutor, SqlitePool};

use super::StoreError;

/// Before 3.51.3 a reset of the write-ahead log could corrupt the database when two connections checkpointed at once
/// (<https://www.sqlite.org/releaselog/3_51_3.html>).
const ENGINE_MIN: [u32; 3] = [3, 51, 3];

/// `PRAGMA application_id` of our files; the first migration writes it.
const APPLICATION_ID: i64 = 1_667_787_876;

/// A chunk of 64 KiB lies in a chain of pages, each found by reading the one before: large pages make it short. With
/// 4 KiB pages, deleting a result of 54 MB took three times as long (0.13 s); reading and writing differed less.
const PAGE_BYTES: u32 = 16_384;

/// The log is cut back to this size once its content is in the file, so that one large result does not hold twice its
/// space for good.
const LOG_BYTES_KEPT: &str = "67108864";

/// Another process at the same file (a backup, an administrator's shell) is waited for this long.
const BUSY: Duration = Duration::from_secs(10);

/// How long a caller waits for a connection. Long: the one writer may be storing a large cloud.
const ACQUIRE: Duration = Duration::from_mins(2);

/// Opens the file with one connection that writes, `readers` that read records, and `array_readers` that read arrays: a
/// record is read in a moment and does not wait for those who read megabytes.
pub(super) async fn open(
    path: &Path,
    readers: u32,
    array_readers: u32,
) -> Result<(SqlitePool, SqlitePool, SqlitePool), StoreError> {
    let options = SqliteConnectOptions::new()
        .filename(path)
        .create_if_missing(true)
        .page_size(PAGE_BYTES)
        .journal_mode(SqliteJournalMode::Wal)
        .synchronous(SqliteSynchronous::Full)
        .foreign_keys(true)
        .busy_timeout(BUSY)
        .pragma("journal_size_limit", LOG_BYTES_KEPT);
    let writer = pool(1).connect_with(options.clone()).await?;
    check_engine(&writer).await?;
    check_owner(&writer).await?;
    sqlx::migrate!("./migrations").run(&writer).await.map_err(|e| StoreError::Database(e.to_string()))?;
    let options = options.pragma("query_only", "ON");
    let arrays = pool(array_readers).connect_with(options.clone()).await?;
    let readers = pool(readers).connect_with(options).await?;
    Ok((writer, readers, arrays))
}

/// Connections to a file do not go stale: they are neither tested nor replaced.
fn pool(connections: u32) -> SqlitePoolOptions {
    SqlitePoolOptions::new()
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

async fn check_owner(database: impl SqliteExecutor<'_>) -> Result<(), StoreError> {
    let row = sqlx::query(
        "SELECT application_id AS owner, (SELECT count(*) FROM sqlite_schema) AS objects FROM pragma_application_id",
    )
    .fetch_one(database)
    .await?;
    let (owner, objects): (i64, i64) = (row.try_get("owner")?, row.try_get("objects")?);
    if owner == APPLICATION_ID || (owner == 0 && objects == 0) {
        return Ok(());
    }
    Err(StoreError::Database("the file is a database of another application".to_owned()))
}

/// Copies the database as it is at one moment, compacted, and waits until the copy is on the disk. The copy gets its
/// name only then: what bears it is whole.
pub(super) async fn copy(path: &Path, copy: &Path) -> Result<(), StoreError> {
    let file = |error: std::io::Error| StoreError::Database(error.to_string());
    if copy.try_exists().map_err(file)? {
        return Err(StoreError::Database("the file of the copy is there already".to_owned()));
    }
    let mut partial = copy.as_os_str().to_owned();
    partial.push(".partial");
    let partial = Path::new(&partial);
    let name = partial.to_str().ok_or_else(|| StoreError::Database("the path is not UTF-8".to_owned()))?;
    if partial.try_exists().map_err(file)? {
        std::fs::remove_file(partial).map_err(file)?;
    }
    let mut connection = SqliteConnectOptions::new().filename(path).busy_timeout(BUSY).connect().await?;
    check_owner(&mut connection).await?;
    sqlx::query("VACUUM INTO ?1").bind(name).execute(&mut connection).await?;
    connection.close().await?;
    tokio::fs::File::open(partial).await.map_err(file)?.sync_all().await.map_err(file)?;
    tokio::fs::rename(partial, copy).await.map_err(file)
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

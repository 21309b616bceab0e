//! Compacted copies of the database file: as a backup, and in place of the file itself.

use std::io::Error as IoError;
use std::path::{Path, PathBuf};
use std::time::Duration;

use sqlx::sqlite::{SqliteAutoVacuum, SqliteConnectOptions};
use sqlx::{ConnectOptions, Connection};

use super::DatabaseLock;
use super::database::{check_owner, private_file};
use crate::store::StoreError;

/// Whoever writes to the database is waited for this long.
const BUSY: Duration = Duration::from_secs(10);

/// Copies the database as it is at one moment, compacted, and waits until the copy is on the disk. The copy gets its
/// name only then: what bears it is whole.
pub(in crate::store) async fn copy(path: &Path, copy: &Path) -> Result<(), StoreError> {
    if copy.try_exists().map_err(failed)? {
        return Err(StoreError::Database("the file of the copy is there already".to_owned()));
    }
    let partial = beside(copy, ".partial");
    write_copy(path, &partial, false).await?;
    tokio::fs::rename(&partial, copy).await.map_err(failed)
}

/// Puts a compacted copy in the place of the file. Until the last step, which is one renaming, the file is as it was.
pub(in crate::store) async fn compact(path: &Path, _lock: &DatabaseLock) -> Result<(), StoreError> {
    let path = &path.canonicalize().map_err(failed)?;
    let partial = beside(path, ".compact");
    write_copy(path, &partial, true).await?;
    // The last connection of the copying merged the write-ahead log into the file and deleted it. One that is still there
    // belongs to a process without the lock, and must never be applied to the new file.
    let log = beside(path, "-wal");
    if std::fs::metadata(&log).is_ok_and(|log| log.len() > 0) {
        std::fs::remove_file(&partial).map_err(failed)?;
        return Err(StoreError::Database("another program has the file open; close it first".to_owned()));
    }
    tokio::fs::rename(&partial, path).await.map_err(failed)?;
    let folder = path.parent().unwrap_or(Path::new("/"));
    tokio::fs::File::open(folder).await.map_err(failed)?.sync_all().await.map_err(failed)
}

/// Writes a compacted copy to `partial`, in place of what an earlier one left there, and waits until it is on the disk.
async fn write_copy(path: &Path, partial: &Path, shrinks: bool) -> Result<(), StoreError> {
    let name = partial.to_str().ok_or_else(|| StoreError::Database("the path is not UTF-8".to_owned()))?;
    for leftover in [partial.to_path_buf(), beside(partial, "-journal")] {
        if leftover.try_exists().map_err(failed)? {
            std::fs::remove_file(&leftover).map_err(failed)?;
        }
    }
    // SQLite writes into an empty file as into none, and leaves its mode as it is.
    private_file(partial).map_err(failed)?;
    let copied = vacuum_into(path, name, shrinks).await;
    if copied.is_err() {
        // Half a copy would keep its space; that it cannot be deleted matters less than why it was not made.
        let _ = std::fs::remove_file(partial);
    }
    copied?;
    tokio::fs::File::open(partial).await.map_err(failed)?.sync_all().await.map_err(failed)
}

/// With `shrinks`, the copy can give free pages back, whether the file can or not; that takes the file's write lock.
async fn vacuum_into(path: &Path, name: &str, shrinks: bool) -> Result<(), StoreError> {
    let options = SqliteConnectOptions::new().filename(path).busy_timeout(BUSY);
    let options = if shrinks { options.auto_vacuum(SqliteAutoVacuum::Incremental) } else { options };
    let mut connection = options.connect().await?;
    check_owner(&mut connection).await?;
    sqlx::query("VACUUM INTO ?1").bind(name).execute(&mut connection).await?;
    Ok(connection.close().await?)
}

/// The file whose name is that of `path` with `ending` behind it.
fn beside(path: &Path, ending: &str) -> PathBuf {
    let mut name = path.as_os_str().to_owned();
    name.push(ending);
    PathBuf::from(name)
}

#[allow(clippy::needless_pass_by_value)] // as `map_err` hands it over
fn failed(error: IoError) -> StoreError {
    match error.kind() {
        std::io::ErrorKind::StorageFull => StoreError::StorageFull,
        _ => StoreError::Database(error.to_string()),
    }
}

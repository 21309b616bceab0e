//! The room that the database has: free on its disk, and free within its file.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use sqlx::Row;

use super::rows::{count, integer};
use super::{Store, StoreError, detached};

/// The folder of the database, and the bytes that stay free on its disk.
#[derive(Debug, Clone)]
pub(super) struct Disk {
    folder: Arc<Path>,
    floor: u64,
}

impl Disk {
    pub(super) fn of(database: &Path, floor: u64) -> Self {
        let folder = database.parent().filter(|folder| !folder.as_os_str().is_empty());
        let folder = folder.map_or_else(|| PathBuf::from("."), Path::to_path_buf);
        Self { folder: folder.into(), floor }
    }

    fn free(&self) -> Result<u64, StoreError> {
        let disk =
            rustix::fs::statvfs(&*self.folder).map_err(|error| StoreError::Database(error.to_string()))?;
        Ok(disk.f_bavail.saturating_mul(disk.f_frsize))
    }
}

/// Bytes that the database takes and has.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Space {
    /// Size of the database file, without its write-ahead log.
    pub file: u64,
    /// Of these, in pages whose content was deleted; they are written to before the file grows.
    pub free_pages: u64,
    /// Free on the disk.
    pub disk_free: u64,
}

impl Space {
    /// What can be stored before the disk is full.
    #[must_use]
    pub fn room(&self) -> u64 {
        self.disk_free.saturating_add(self.free_pages)
    }
}

impl Store {
    /// What the database takes of its disk, and what is free.
    ///
    /// # Errors
    /// [`StoreError::Database`].
    pub async fn space(&self) -> Result<Space, StoreError> {
        let pages = sqlx::query(
            "SELECT page_count * page_size AS file, freelist_count * page_size AS free \
             FROM pragma_page_count, pragma_freelist_count, pragma_page_size",
        )
        .fetch_one(&self.readers)
        .await?;
        Ok(Space {
            file: count(&pages, "file")?,
            free_pages: count(&pages, "free")?,
            disk_free: self.disk.free()?,
        })
    }

    /// Refuses to go on when there is less room, on the disk and in free pages of the file, than must stay free.
    ///
    /// # Errors
    /// [`StoreError::StorageFull`], [`StoreError::Database`].
    pub async fn refuse_when_disk_full(&self) -> Result<(), StoreError> {
        if self.disk.free()? >= self.disk.floor || self.space().await?.room() >= self.disk.floor {
            return Ok(());
        }
        self.last_commit.forget();
        Err(StoreError::StorageFull)
    }

    /// Moves up to `pages` pages from the end of the file into its free pages, so that the file becomes shorter with the
    /// next checkpoint. Does nothing to databases made before version 0.2, which [`Store::compact`] prepares for it.
    ///
    /// # Errors
    /// [`StoreError::Database`].
    pub async fn shrink(&self, pages: u32) -> Result<(), StoreError> {
        let store = self.clone();
        detached(async move {
            let mut write = store.write().await?;
            // A pragma takes no bound parameters.
            let statement = sqlx::AssertSqlSafe(format!("PRAGMA incremental_vacuum({})", integer(pages)));
            sqlx::query(statement).execute(&mut *write).await?;
            write.commit().await
        })
        .await
    }

    /// Whether the file can be made shorter while it is served.
    ///
    /// # Errors
    /// [`StoreError::Database`].
    pub async fn can_shrink(&self) -> Result<bool, StoreError> {
        let row = sqlx::query("PRAGMA auto_vacuum").fetch_one(&self.readers).await?;
        Ok(row.try_get::<i64, _>(0)? != 0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_folder_that_is_not_there_has_no_disk() {
        assert!(Disk::of(Path::new("chladni.db"), 0).free().unwrap() > 0);
        assert!(matches!(Disk::of(Path::new("no/such/folder/x.db"), 0).free(), Err(StoreError::Database(_))));
    }

    #[test]
    fn free_pages_are_room() {
        let space = Space { file: 100, free_pages: 60, disk_free: 5 };
        assert_eq!(space.room(), 65);
    }
}

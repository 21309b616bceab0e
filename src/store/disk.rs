//! The disk under the database: how much is free, and how much must stay so.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::{Store, StoreError};

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

    pub(super) fn refuse_when_full(&self) -> Result<(), StoreError> {
        if self.free()? < self.floor { Err(StoreError::StorageFull) } else { Ok(()) }
    }
}

impl Store {
    /// Bytes that are free on the database's disk.
    ///
    /// # Errors
    /// [`StoreError::Database`].
    pub fn disk_free(&self) -> Result<u64, StoreError> {
        self.disk.free()
    }

    /// Refuses to go on when less is free than must stay so.
    ///
    /// # Errors
    /// [`StoreError::StorageFull`], [`StoreError::Database`].
    pub fn refuse_when_disk_full(&self) -> Result<(), StoreError> {
        self.disk.refuse_when_full()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_disk_is_full_when_less_is_free_than_must_stay_so() {
        let disk = |floor| Disk::of(Path::new("chladni.db"), floor);
        assert!(disk(0).free().unwrap() > 0);
        assert!(disk(0).refuse_when_full().is_ok());
        assert!(matches!(disk(u64::MAX).refuse_when_full(), Err(StoreError::StorageFull)));
    }

    #[test]
    fn a_folder_that_is_not_there_has_no_disk() {
        assert!(matches!(Disk::of(Path::new("no/such/folder/x.db"), 0).free(), Err(StoreError::Database(_))));
    }
}

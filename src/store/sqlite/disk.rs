//! The disk that the database's file is on.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use crate::store::StoreError;

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

    pub(super) fn folder(&self) -> &Path {
        &self.folder
    }

    pub(super) fn floor(&self) -> u64 {
        self.floor
    }

    pub(super) fn has_room(&self) -> Result<bool, StoreError> {
        Ok(self.free()? >= self.floor)
    }

    pub(super) fn free(&self) -> Result<u64, StoreError> {
        let disk =
            rustix::fs::statvfs(&*self.folder).map_err(|error| StoreError::Database(error.to_string()))?;
        Ok(disk.f_bavail.saturating_mul(disk.f_frsize))
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
}

//! The disk that the database's file is on.

use std::fs::File;
use std::io;
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

    /// A file without a name for so many bytes, which leaves free what is to stay free.
    pub(super) fn scratch_file(&self, bytes: u64) -> io::Result<File> {
        let free = self.free().map_err(io::Error::other)?;
        if free.saturating_sub(self.floor) < bytes {
            let (floor, kind) = (self.floor, io::ErrorKind::StorageFull);
            return Err(io::Error::new(
                kind,
                format!(
                    "{bytes} bytes are needed, and {free} are free, of which {floor} stay free (`--disk-floor`)"
                ),
            ));
        }
        tempfile::tempfile_in(&*self.folder)
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

    #[test]
    fn a_file_for_what_memory_has_no_room_for_leaves_the_floor_free() {
        let folder = tempfile::tempdir().unwrap();
        let database = folder.path().join("x.db");
        let half = Disk::of(&database, 0).free().unwrap() / 2;
        Disk::of(&database, half).scratch_file(1_000_000).unwrap();
        let refused = Disk::of(&database, half).scratch_file(2 * half).unwrap_err();
        assert_eq!(refused.kind(), io::ErrorKind::StorageFull);
        assert!(Disk::of(&database, u64::MAX).scratch_file(1).is_err());
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
    }
}

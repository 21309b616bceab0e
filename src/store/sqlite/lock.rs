//! One process serves a database: it holds a lock on a file beside it, which the system takes back when the process ends,
//! however it ends.

use std::fs::File;
use std::io::{Read, Seek, Write};
use std::path::{Path, PathBuf};

use rustix::fs::{FlockOperation, flock};

use super::database::private_file;
use crate::store::StoreError;

/// The right to serve or rewrite a database, for as long as it lives.
#[derive(Debug)]
pub struct DatabaseLock {
    /// Closing it gives the lock back. The file stays: deleting it would let two processes lock two files of one name.
    _file: File,
}

impl DatabaseLock {
    /// Takes the lock of the database at `path`, which need not exist yet.
    ///
    /// # Errors
    /// [`StoreError::InUse`] when another process holds it; [`StoreError::Database`] when its file cannot be made.
    pub fn take(path: &Path) -> Result<Self, StoreError> {
        let name = lock_path(path);
        let unusable = |error: std::io::Error| {
            StoreError::Database(format!("its lock, {}, cannot be used: {error}", name.display()))
        };
        let mut file = private_file(&name).map_err(unusable)?;
        match flock(&file, FlockOperation::NonBlockingLockExclusive) {
            Ok(()) => {}
            Err(rustix::io::Errno::WOULDBLOCK) => {
                return Err(StoreError::InUse { holder: holder(&mut file) });
            }
            Err(error) => return Err(unusable(error.into())),
        }
        file.set_len(0).map_err(unusable)?;
        write!(file, "{}", std::process::id()).map_err(unusable)?;
        Ok(Self { _file: file })
    }
}

/// The process that wrote its number into the lock, if it has got that far.
fn holder(file: &mut File) -> Option<u32> {
    let mut text = String::new();
    file.rewind().ok()?;
    file.read_to_string(&mut text).ok()?;
    text.trim().parse().ok()
}

/// `chladni.db.lock` beside `chladni.db`; where that is a link, beside what it leads to, as SQLite's own files are.
fn lock_path(database: &Path) -> PathBuf {
    let mut name = database.canonicalize().unwrap_or_else(|_| database.to_path_buf()).into_os_string();
    name.push(".lock");
    PathBuf::from(name)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_lock_is_held_once_whatever_the_name_of_the_database() {
        let folder = tempfile::tempdir().unwrap();
        let (path, link) = (folder.path().join("x.db"), folder.path().join("link.db"));
        File::create(&path).unwrap();
        std::os::unix::fs::symlink(&path, &link).unwrap();
        let lock = DatabaseLock::take(&path).unwrap();
        for path in [&path, &link] {
            let refused = DatabaseLock::take(path);
            let own = std::process::id();
            assert!(
                matches!(refused, Err(StoreError::InUse { holder: Some(pid) }) if pid == own),
                "{refused:?}"
            );
        }
        drop(lock);
        DatabaseLock::take(&link).unwrap();
    }

    #[test]
    fn a_folder_that_does_not_exist_has_no_lock() {
        let refused = DatabaseLock::take(Path::new("no/such/folder/x.db"));
        assert!(matches!(refused, Err(StoreError::Database(_))), "{refused:?}");
    }
}

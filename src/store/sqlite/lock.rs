//! One process serves a database: it holds a lock on the file, and one on a file beside it that names the process. The system
//! takes both back when the process ends, however it ends.

use std::fs::File;
use std::io::{Read, Seek, Write};
use std::os::fd::IntoRawFd;
use std::path::{Path, PathBuf};

use rustix::fs::{FlockOperation, flock};

use super::database::{private_file, unusable};
use crate::store::StoreError;

/// The right to serve or rewrite a database, for as long as it lives.
#[derive(Debug)]
pub struct DatabaseLock {
    /// Closing it gives the lock back. The file stays: deleting it would let two processes lock two files of one name.
    _beside: File,
    _database: Held,
}

/// A lock on the database itself, whatever name it was reached by. SQLite's own locks are of another kind, which know nothing
/// of this one.
#[derive(Debug)]
struct Held(Option<File>);

impl Held {
    /// `None` when another process holds it.
    fn take(file: File) -> std::io::Result<Option<Self>> {
        let held = Self(Some(file));
        let Some(file) = &held.0 else { return Ok(None) };
        match flock(file, FlockOperation::NonBlockingLockExclusive) {
            Ok(()) => Ok(Some(held)),
            Err(rustix::io::Errno::WOULDBLOCK) => Ok(None),
            Err(error) => Err(error.into()),
        }
    }
}

impl Drop for Held {
    /// The file stays open: closing it would take back SQLite's locks on it in this process
    /// (<https://www.sqlite.org/howtocorrupt.html>, section 2.2).
    fn drop(&mut self) {
        if let Some(file) = self.0.take() {
            let _ = flock(&file, FlockOperation::Unlock);
            let _ = file.into_raw_fd();
        }
    }
}

impl DatabaseLock {
    /// Takes the lock of the database at `path`, which need not exist yet.
    ///
    /// # Errors
    /// [`StoreError::InUse`] when another process holds it; [`StoreError::Database`] when its files cannot be made.
    pub fn take(path: &Path) -> Result<Self, StoreError> {
        let database = private_file(path).map_err(|error| unusable(path, &error))?;
        let name = lock_path(path);
        let unlockable = |error: std::io::Error| {
            StoreError::Database(format!("its lock, {}, cannot be used: {error}", name.display()))
        };
        let mut file = private_file(&name).map_err(unlockable)?;
        match flock(&file, FlockOperation::NonBlockingLockExclusive) {
            Ok(()) => {}
            Err(rustix::io::Errno::WOULDBLOCK) => {
                return Err(StoreError::InUse { holder: holder(&mut file) });
            }
            Err(error) => return Err(unlockable(error.into())),
        }
        file.set_len(0).map_err(unlockable)?;
        // Under another name, or with the file beside it deleted, somebody may serve it all the same.
        let held = Held::take(database).map_err(unlockable)?.ok_or(StoreError::InUse { holder: None })?;
        write!(file, "{}", std::process::id()).map_err(unlockable)?;
        Ok(Self { _beside: file, _database: held })
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
    fn a_lock_is_of_the_file_whatever_it_is_reached_by() {
        let folder = tempfile::tempdir().unwrap();
        let name = |name: &str| folder.path().join(name);
        std::os::unix::fs::symlink(name("x.db"), name("dangling.db")).unwrap();
        let lock = DatabaseLock::take(&name("dangling.db")).unwrap();
        std::fs::hard_link(name("x.db"), name("hard.db")).unwrap();
        for path in ["x.db", "hard.db", "dangling.db"] {
            let refused = DatabaseLock::take(&name(path));
            assert!(matches!(refused, Err(StoreError::InUse { .. })), "{path}: {refused:?}");
        }
        std::fs::remove_file(name("x.db.lock")).unwrap();
        let refused = DatabaseLock::take(&name("x.db"));
        assert!(matches!(refused, Err(StoreError::InUse { .. })), "{refused:?}");
        drop(lock);
        DatabaseLock::take(&name("hard.db")).unwrap();
    }

    #[test]
    fn a_folder_that_does_not_exist_has_no_lock() {
        let refused = DatabaseLock::take(Path::new("no/such/folder/x.db"));
        assert!(
            matches!(&refused, Err(StoreError::Database(why)) if why == "the folder no/such/folder does not exist"),
            "{refused:?}"
        );
    }
}

//! Copies of the database: one beside it while a service has it open, one in its place while none has.

use std::path::Path;

use crate::store::{DatabaseLock, Store, StoreError};

/// Writes a compacted copy of the database at `path`, as of one moment, to the new file `copy`, and waits until it is on
/// the disk. It takes about the time of reading and writing the database once; services that have it open go on.
///
/// # Errors
/// [`StoreError`], also when `copy` exists.
pub async fn backup(path: &Path, copy: &Path) -> Result<(), StoreError> {
    Store::backup(path, copy).await
}

/// Rewrites the database at `path` without the space of deleted data, and so that it gives such space back by itself from
/// then on. Until the last moment the file stays as it is; the new one needs room beside it.
///
/// # Errors
/// [`StoreError::InUse`] when a service has it open; [`StoreError`].
pub async fn compact(path: &Path) -> Result<(), StoreError> {
    let lock = DatabaseLock::take(path)?;
    Store::compact(path, &lock).await
}

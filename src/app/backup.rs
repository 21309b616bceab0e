//! A copy of the database, made while services have it open.

use std::path::Path;

use crate::store::{Store, StoreError};

/// Writes a compacted copy of the database at `path`, as of one moment, to the new file `copy`, and waits until it is on
/// the disk. It takes about the time of reading and writing the database once; services that have it open go on.
///
/// # Errors
/// [`StoreError`], also when `copy` exists.
pub async fn backup(path: &Path, copy: &Path) -> Result<(), StoreError> {
    Store::backup(path, copy).await
}

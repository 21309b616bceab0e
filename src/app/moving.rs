//! The move from an SQLite file to a PostgreSQL database.

use std::path::Path;

use crate::store::{DatabaseAddress, DatabaseLock, Moved, Store, StoreError, StoreSettings};

/// Copies clouds, jobs and results of the database at `from` into the one at `to`, which must be empty or hold what an
/// earlier attempt from the same file brought over; checks every digest. `tell` hears of every record. No service may run on
/// either.
///
/// # Errors
/// [`StoreError::InUse`] when a service has the file open; [`StoreError`].
pub async fn migrate(
    from: &Path,
    to: &DatabaseAddress,
    tell: impl FnMut(Moved),
) -> Result<Moved, StoreError> {
    let lock = DatabaseLock::take(from)?;
    let name = from.canonicalize().unwrap_or_else(|_| from.to_path_buf()).display().to_string();
    let from = Store::open_with(from, StoreSettings::default()).await?;
    let to = Store::open_at(to, StoreSettings::default()).await?;
    let moved = from.move_to(&to, &name, &lock, tell).await;
    to.close().await;
    from.close().await;
    moved
}

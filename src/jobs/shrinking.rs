//! Gives the space of deleted data back to the disk, a little at a time.

use std::time::Duration;

use tokio_util::sync::CancellationToken;

use crate::store::{Store, StoreError};

/// Pages that are moved in one transaction: others wait for it, about as long as for a small upload.
const STEP_PAGES: u32 = 256;

/// Bytes of free pages that stay: the next upload or result fills them without making the file grow.
const KEPT_BYTES: u64 = 16 << 20;

/// Between two steps, so that the disk and the writing connection have time for others.
const PAUSE: Duration = Duration::from_millis(50);

/// Shortens the file whenever it has many free pages, until `stop`; looks every `every`.
pub(super) async fn keep_small(store: Store, every: Duration, stop: CancellationToken) {
    match store.can_shrink().await {
        Ok(Some(true)) => {}
        // A server looks after its own space.
        Ok(None) => return,
        Ok(Some(false)) => {
            tracing::info!(
                "the database file was made by an older version and keeps its size when data is deleted, which makes \
                 room within it; `chladni compact` shortens it and lets it shrink by itself from then on"
            );
            return;
        }
        Err(error) => {
            return tracing::error!(%error, "cannot determine whether the database file can shrink");
        }
    }
    loop {
        tokio::select! {
            () = tokio::time::sleep(every) => {}
            () = stop.cancelled() => return,
        }
        if let Err(error) = shrink(&store, &stop).await {
            tracing::warn!(%error, "the database file could not be made shorter; will retry");
        }
    }
}

async fn shrink(store: &Store, stop: &CancellationToken) -> Result<(), StoreError> {
    while !stop.is_cancelled() && store.space().await?.free_pages > KEPT_BYTES {
        store.shrink(STEP_PAGES).await?;
        tokio::time::sleep(PAUSE).await;
    }
    Ok(())
}

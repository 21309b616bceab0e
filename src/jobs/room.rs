//! The memory that running analyses share: a job is claimed only when what it is estimated to take is free.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use tokio::sync::{Mutex, Notify};
use uuid::Uuid;

use crate::store::{Claim, Store, StoreError};

/// Bytes that are free for further analyses.
#[derive(Debug)]
pub(super) struct Room {
    free: AtomicU64,
    /// One claim at a time: what one worker sees free, no other takes before it.
    claiming: Mutex<()>,
    wake: Arc<Notify>,
}

/// A claimed job's share of the memory; given back when it is dropped.
#[derive(Debug)]
pub(super) struct Share {
    room: Arc<Room>,
    bytes: u64,
}

impl Room {
    /// Room for `bytes` bytes; `wake` is told when some become free.
    pub(super) fn new(bytes: u64, wake: Arc<Notify>) -> Self {
        Self { free: AtomicU64::new(bytes), claiming: Mutex::new(()), wake }
    }

    /// Claims the next job if there is room for it.
    pub(super) async fn claim(
        self: &Arc<Self>,
        store: &Store,
        process: Uuid,
    ) -> Result<Option<(Claim, Share)>, StoreError> {
        let _claiming = self.claiming.lock().await;
        let free = self.free.load(Ordering::SeqCst);
        let Some(claim) = store.claim_within(process, free).await? else { return Ok(None) };
        let bytes = claim.job.memory;
        self.free.fetch_sub(bytes, Ordering::SeqCst);
        Ok(Some((claim, Share { room: Arc::clone(self), bytes })))
    }

    /// Bytes that are free.
    pub(super) fn free(&self) -> u64 {
        self.free.load(Ordering::SeqCst)
    }
}

impl Drop for Share {
    fn drop(&mut self) {
        self.room.free.fetch_add(self.bytes, Ordering::SeqCst);
        self.room.wake.notify_one();
    }
}

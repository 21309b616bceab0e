//! The memory that running analyses share: a job is claimed only when what it is estimated to take is free.
//!
//! A job at a second or later attempt runs alone. Its first may have killed the process, and were others to run beside it
//! again, they would lose attempts for what they did not do.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering};

use tokio::sync::{Mutex, Notify};
use uuid::Uuid;

use crate::store::{Claim, Store, StoreError};

/// Bytes that are free for further analyses.
#[derive(Debug, Default)]
pub(super) struct MemoryGate {
    free: AtomicU64,
    running: AtomicUsize,
    /// A job runs that nothing may run beside.
    alone: AtomicBool,
    /// One claim at a time: what one worker sees free, no other takes before it.
    claiming: Mutex<()>,
    wake: Arc<Notify>,
}

/// A claimed job's part of the memory; given back when it is dropped.
#[derive(Debug, Default)]
pub(super) struct Reservation {
    gate: Arc<MemoryGate>,
    bytes: AtomicU64,
    alone: bool,
}

impl Reservation {
    /// Grows the reservation to `bytes`; false if not enough is free.
    pub(super) fn grow_to(&self, bytes: u64) -> bool {
        let more = bytes.saturating_sub(self.bytes.load(Ordering::SeqCst));
        let take = |free: u64| free.checked_sub(more);
        let is_free = self.gate.free.fetch_update(Ordering::SeqCst, Ordering::SeqCst, take).is_ok();
        if is_free {
            self.bytes.fetch_add(more, Ordering::SeqCst);
        }
        is_free
    }

    /// Its bytes.
    pub(super) fn bytes(&self) -> u64 {
        self.bytes.load(Ordering::SeqCst)
    }
}

impl MemoryGate {
    /// A gate for `bytes` bytes; `wake` is told when some become free.
    pub(super) fn new(bytes: u64, wake: Arc<Notify>) -> Self {
        Self {
            free: AtomicU64::new(bytes),
            running: AtomicUsize::new(0),
            alone: AtomicBool::new(false),
            claiming: Mutex::new(()),
            wake,
        }
    }

    /// Claims the next job if there is room for it.
    pub(super) async fn claim(
        self: &Arc<Self>,
        store: &Store,
        process: Uuid,
    ) -> Result<Option<(Claim, Arc<Reservation>)>, StoreError> {
        let _claiming = self.claiming.lock().await;
        if self.alone.load(Ordering::SeqCst) {
            return Ok(None);
        }
        let (free, idle) = (self.free.load(Ordering::SeqCst), self.running.load(Ordering::SeqCst) == 0);
        let Some(claim) = store.claim_within(process, free, idle).await? else { return Ok(None) };
        let (bytes, alone) = (claim.job.memory, claim.job.attempt > 1);
        // Running jobs may have taken some since `free` was read; at most what they were short of is missing then.
        let take = |free: u64| Some(free.saturating_sub(bytes));
        let before = self.free.fetch_update(Ordering::SeqCst, Ordering::SeqCst, take).unwrap_or_default();
        let bytes = bytes.min(before);
        self.running.fetch_add(1, Ordering::SeqCst);
        self.alone.store(alone, Ordering::SeqCst);
        let reservation = Reservation { gate: Arc::clone(self), bytes: AtomicU64::new(bytes), alone };
        Ok(Some((claim, Arc::new(reservation))))
    }

    /// Bytes that are free.
    pub(super) fn free(&self) -> u64 {
        self.free.load(Ordering::SeqCst)
    }
}

impl Drop for Reservation {
    fn drop(&mut self) {
        self.gate.free.fetch_add(self.bytes(), Ordering::SeqCst);
        self.gate.running.fetch_sub(1, Ordering::SeqCst);
        if self.alone {
            self.gate.alone.store(false, Ordering::SeqCst);
        }
        self.gate.wake.notify_one();
    }
}

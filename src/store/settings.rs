//! Limits of the store, and the clock that it reads.

use std::fmt;
use std::sync::Arc;
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use super::Milliseconds;

/// Limits of the store.
#[derive(Debug, Clone)]
pub struct StoreSettings {
    /// Most jobs that may wait.
    pub queue_max: u64,
    /// Most jobs of one owner that may wait.
    pub queue_max_per_owner: u64,
    /// Most bytes that the clouds and results of one owner may take together.
    pub stored_bytes_max_per_owner: u64,
    /// Bytes beyond which the database file does not grow; a server keeps limits of its own.
    pub file_bytes_max: u64,
    /// Most claims of one job, those not counted that an orderly stop gave back.
    pub attempts_max: u32,
    /// Bytes that the analyses running at one time may be estimated to take; what needs more by itself is refused.
    pub memory_budget: u64,
    /// Bytes that stay free on the database's disk: below, nothing is taken on that would need room.
    pub disk_floor: u64,
    /// How long a claim holds without a heartbeat, in milliseconds.
    pub lease: Milliseconds,
    /// How long a write waits in all for another process that holds the file's lock, such as an administrator's shell.
    pub busy: Duration,
    /// How this process appears among the nodes of a PostgreSQL database.
    pub node: NodeSettings,
    /// Connections for reading records.
    pub readers: u32,
    /// Connections for reading clouds and results.
    pub array_readers: u32,
    /// Source of every time that is stored or compared.
    pub clock: Clock,
}

/// What this node announces to the others.
#[derive(Debug, Clone, Copy, Default)]
pub struct NodeSettings {
    /// Threads that compute.
    pub threads: u64,
    /// Jobs that run at one time; 0 when it only answers.
    pub workers: u64,
}

impl Default for StoreSettings {
    fn default() -> Self {
        Self {
            queue_max: 1000,
            queue_max_per_owner: u64::MAX,
            stored_bytes_max_per_owner: u64::MAX,
            file_bytes_max: u64::MAX,
            attempts_max: 3,
            memory_budget: u64::MAX,
            disk_floor: 0,
            lease: 60_000,
            busy: Duration::from_secs(10),
            node: NodeSettings::default(),
            readers: 4,
            array_readers: 4,
            clock: Clock::default(),
        }
    }
}

/// Tells the time; tests bring their own and step it.
///
/// By default the engine's own: of SQLite this machine's, of PostgreSQL the server's, which all nodes share.
#[derive(Clone, Default)]
pub struct Clock(Option<Arc<dyn Fn() -> Milliseconds + Send + Sync>>);

impl Clock {
    /// A clock that asks `tell`.
    pub fn new(tell: impl Fn() -> Milliseconds + Send + Sync + 'static) -> Self {
        Self(Some(Arc::new(tell)))
    }

    /// Milliseconds since the Unix epoch, unless the engine tells the time.
    pub(super) fn told(&self) -> Option<Milliseconds> {
        self.0.as_ref().map(|tell| tell())
    }
}

/// This machine's clock.
pub(super) fn system_time() -> Milliseconds {
    SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |since| since.as_millis() as Milliseconds)
}

impl fmt::Debug for Clock {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Clock({:?})", self.told())
    }
}

/// What a clock says.
#[derive(Debug, Clone, Copy)]
pub(super) struct Time {
    pub(super) now: Milliseconds,
    /// Leases that ended before this have run out.
    pub(super) leases_end: Milliseconds,
}

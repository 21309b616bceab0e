//! What the store can be told, and where it takes the time from.

use std::fmt;
use std::sync::Arc;
use std::time::{SystemTime, UNIX_EPOCH};

use super::Milliseconds;

/// Limits of the store.
#[derive(Debug, Clone)]
pub struct StoreSettings {
    /// Most jobs that may wait.
    pub queue_max: u64,
    /// Most claims of one job, those not counted that an orderly stop gave back.
    pub attempts_max: u32,
    /// Bytes that the analyses running at one time may be estimated to take; what needs more by itself is refused.
    pub memory_budget: u64,
    /// Bytes that stay free on the database's disk: below, nothing is taken on that would need room.
    pub disk_floor: u64,
    /// How long a claim holds without a heartbeat, in milliseconds.
    pub lease: Milliseconds,
    /// Connections for reading records.
    pub readers: u32,
    /// Connections for reading clouds and results.
    pub array_readers: u32,
    /// Source of every time that is stored or compared.
    pub clock: Clock,
}

impl Default for StoreSettings {
    fn default() -> Self {
        Self {
            queue_max: 1000,
            attempts_max: 3,
            memory_budget: u64::MAX,
            disk_floor: 0,
            lease: 60_000,
            readers: 4,
            array_readers: 4,
            clock: Clock::default(),
        }
    }
}

/// Tells the time; tests bring their own and step it.
#[derive(Clone)]
pub struct Clock(Arc<dyn Fn() -> Milliseconds + Send + Sync>);

impl Clock {
    /// A clock that asks `tell`.
    pub fn new(tell: impl Fn() -> Milliseconds + Send + Sync + 'static) -> Self {
        Self(Arc::new(tell))
    }

    /// Milliseconds since the Unix epoch.
    #[must_use]
    pub fn now(&self) -> Milliseconds {
        (self.0)()
    }
}

impl Default for Clock {
    fn default() -> Self {
        Self::new(|| {
            SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |since| since.as_millis() as Milliseconds)
        })
    }
}

impl fmt::Debug for Clock {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Clock({})", self.now())
    }
}

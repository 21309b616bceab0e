//! After how many seconds a client may try again: `Retry-After` (RFC 9110 §10.2.3), `retry` of server-sent events.

/// A job that is not finished: soon, since asking is cheap.
pub(crate) const JOB_SECONDS: u64 = 1;
/// A request that met as many connections as there may be.
pub(crate) const PLACE_SECONDS: u64 = 1;
/// A follower of events whose connection ended.
pub(crate) const EVENTS_SECONDS: u64 = 1;
/// A request that found no memory beside the others.
pub(crate) const MEMORY_SECONDS: u64 = 5;
/// A request that met a busy database.
pub(crate) const BUSY_SECONDS: u64 = 5;
/// A submission that met a full queue.
pub(crate) const QUEUE_SECONDS: u64 = 10;

//! How ids, times and digests are written.

use sha2::{Digest, Sha256};
use uuid::Uuid;

use super::problem::{Kind, Problem};
use crate::store::Milliseconds;

/// An id of a path; what is not a UUID names nothing.
pub(crate) fn parse_id(text: &str) -> Result<Uuid, Problem> {
    text.parse().map_err(|_| {
        let shown: String = text.chars().take(80).collect();
        Problem::new(Kind::NotFound, format!("`{shown}` is not an id; ids are UUIDs"))
    })
}

/// A time as the interface shows it: RFC 3339, UTC.
pub(crate) fn timestamp(milliseconds: Milliseconds) -> String {
    jiff::Timestamp::from_millisecond(milliseconds).unwrap_or_default().to_string()
}

/// Names bytes: half of their SHA-256, in hex.
pub(crate) fn short_digest(bytes: &[u8]) -> String {
    Uuid::from_slice(&Sha256::digest(bytes)[..16]).unwrap_or_default().simple().to_string()
}

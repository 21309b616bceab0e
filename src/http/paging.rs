//! Listings in pages.

use uuid::Uuid;

use crate::arguments::arguments;

/// Longest page of a listing.
pub const PAGE_MAX: usize = 200;

arguments! {
    /// The arguments that every listing has.
    #[derive(Debug, Clone, Copy)]
    pub(crate) struct Paging {
        /// The `next` of the page before.
        cursor: Option<Uuid> = id(Uuid), absent "the newest";
        /// Entries of the page, at most.
        limit: usize = integer(1, PAGE_MAX), default 50;
    }
}

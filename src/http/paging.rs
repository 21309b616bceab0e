//! Listings in pages.

use super::wire::query::{Accepts, Argument};

/// Longest page of a listing.
pub(crate) const PAGE_MAX: u64 = 200;
/// Page of a listing when nothing is said.
pub(crate) const PAGE_DEFAULT: u64 = 50;

/// The arguments that every listing has.
pub(crate) const PAGING: &[Argument] = &[
    Argument {
        name: "cursor",
        alias: None,
        accepts: Accepts::Id,
        default: "the newest",
        meaning: "The `next` of the page before.",
    },
    Argument {
        name: "limit",
        alias: None,
        accepts: Accepts::Integer(1, PAGE_MAX),
        default: "50",
        meaning: "Entries of the page, at most.",
    },
];

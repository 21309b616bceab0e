//! What is offered: one file per resource.

pub(super) mod bases;
pub(super) mod bases_files;
pub(super) mod capabilities;
pub(super) mod clouds;
pub(super) mod coefficients;
pub(super) mod distances;
pub(super) mod docs;
pub(super) mod events;
pub(super) mod features;
pub(super) mod files;
pub(super) mod filtered;
pub(super) mod health;
pub(super) mod idempotency;
pub(super) mod image;
pub(super) mod index;
pub(super) mod jobs;
pub(super) mod laplacian;
pub(super) mod metrics;
pub(super) mod operator;
pub(super) mod parameters;
pub(super) mod points;
pub(super) mod problems;
pub(super) mod signatures;
pub(super) mod similarity;
pub(super) mod spectrum;
pub(super) mod submission;

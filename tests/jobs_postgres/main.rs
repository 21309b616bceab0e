//! The tests of store, queue and workers once more, on PostgreSQL; and what only nodes that share a database can show.
//!
//! One cluster for all, one database for each test, made from a template that is migrated once.

#![allow(clippy::unwrap_used)] // clippy.toml exempts test functions, but not what they share

#[path = "../jobs/admission.rs"]
mod admission;
#[path = "../jobs/clouds.rs"]
mod clouds;
#[path = "../cluster/mod.rs"]
mod cluster;
#[path = "../jobs/exceptions.rs"]
mod exceptions;
#[path = "../jobs/fairness.rs"]
mod fairness;
#[path = "../jobs/followers.rs"]
mod followers;
#[path = "../jobs/model.rs"]
mod model;
mod moving;
mod nodes;
mod opening;
#[path = "../jobs/owners.rs"]
mod owners;
#[path = "../jobs/queue.rs"]
mod queue;
#[path = "../jobs/results.rs"]
mod results;
#[path = "../jobs/retention.rs"]
mod retention;
mod shared;
#[path = "../jobs/stage.rs"]
mod stage;
#[path = "../jobs/workers.rs"]
mod workers;

/// Where [`stage::Stage`] has its database.
use shared::{Place, SHARES};

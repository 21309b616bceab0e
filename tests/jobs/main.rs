//! Store, queue and workers, through their public interface and, where bytes have to be damaged, through the file.

#![allow(clippy::unwrap_used)] // clippy.toml exempts test functions, but not what they share

mod admission;
mod clouds;
mod durability;
mod exceptions;
mod fairness;
mod file;
mod followers;
mod full_disk;
mod migrations;
mod model;
mod owners;
mod queue;
mod results;
mod retention;
mod stage;
mod workers;

/// Where [`stage::Stage`] has its database.
use file::{Place, SHARES};

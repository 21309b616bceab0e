//! The real binary as its operator sees it: killed, copied, logged, loaded.

#![allow(clippy::unwrap_used)] // clippy.toml exempts test functions, but not what they share

mod backup;
mod cancel;
#[path = "../cluster/mod.rs"]
mod cluster;
mod crashes;
mod estimate;
#[allow(dead_code)]
#[path = "../jobs/file.rs"]
mod file;
mod files;
mod load;
mod logs;
mod memory;
mod network;
mod nodes;
mod process;
#[allow(dead_code, unused_imports)] // the other half is used by the tests of the store
#[path = "../jobs/stage.rs"]
mod stage;

use file::{Place, SHARES};

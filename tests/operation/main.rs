//! The real binary as its operator sees it: killed, copied, logged, loaded.

#![allow(clippy::unwrap_used)] // clippy.toml exempts test functions, but not what they share

mod backup;
mod cancel;
mod crashes;
mod estimate;
mod files;
mod load;
mod logs;
mod memory;
mod process;
#[allow(dead_code, unused_imports)] // the other half is used by the tests of the store
#[path = "../jobs/stage.rs"]
mod stage;

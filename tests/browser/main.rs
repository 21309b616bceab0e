//! The viewer as people meet it: in a real browser, with real files, keys and fingers.
//!
//! Without a chromedriver (on Debian: `apt-get install chromium chromium-driver`) each test says that it was skipped.

#![allow(clippy::unwrap_used, clippy::panic, clippy::print_stderr)] // a test that cannot go on has failed

mod browser;
mod figures;
mod hands;
mod jobs;
mod kept;
mod look;
mod service;
mod work;

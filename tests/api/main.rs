//! The service as its users see it: over HTTP, on an app of its own per test.

#![allow(clippy::unwrap_used)] // a test that cannot go on has failed

mod chunks;
mod compatibility;
mod conventions;
mod formats;
mod harmonics;
mod jobs;
mod limits;
mod listing;
mod openapi;
mod operation;
mod operators;
mod owners;
mod requests;
mod results;
mod service;
mod shutdown;
mod strangers;
mod upload_errors;
mod uploads;

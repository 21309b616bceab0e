//! What speaks HTTP: negotiation, conditions and ranges, bodies and their memory, arguments, problems; and the state of all
//! handlers, which all that needs.

pub(super) mod accept;
pub(super) mod body;
pub(super) mod compress;
pub(super) mod compressed;
pub(super) mod cors;
pub(super) mod decompress;
pub(super) mod download;
pub(super) mod drain;
pub(super) mod guard;
pub(super) mod keys;
pub(super) mod memory;
pub(super) mod notation;
pub(super) mod owners;
pub(super) mod pace;
pub(super) mod paths;
pub(super) mod problem;
pub(super) mod problem_sets;
pub(super) mod query;
pub(super) mod request;
pub(super) mod retry;
pub(super) mod service;
pub(super) mod upload;
pub(super) mod waiting_places;

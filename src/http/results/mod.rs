//! What the results of jobs have in common: their requests, and the formats they are written in.

pub(super) mod cloud_file;
pub(super) mod functions;
pub(super) mod matrix;
pub(super) mod number_lists;
pub(super) mod offered;
pub(super) mod per_row;
pub(super) mod request;
pub(super) mod rows;
pub(super) mod view;

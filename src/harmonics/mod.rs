//! What the eigenbasis of a surface is good for; needs eigenpairs only.

pub mod heat_trace;

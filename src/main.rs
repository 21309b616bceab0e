//! Command line of chladni.

fn main() {}

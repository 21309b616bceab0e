//! Writers, one per format.

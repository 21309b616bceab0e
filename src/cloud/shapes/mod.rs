//! Placeholder while the readers are compiled.

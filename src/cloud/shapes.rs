//! Sample shapes with known geometry.

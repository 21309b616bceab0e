//! Readers, one per format. Row i of the cloud is point i of the file, whatever else the file says.
//!
//! No reader allocates on a header's word: announced counts are held against the bytes that are there.

mod columns;
mod csv;
mod error;
mod format;
mod npy;
mod obj;
mod off;
mod ply;
mod polygons;
mod table;
mod text;
mod xyz;

pub use error::{Location, ReadError};
pub use format::Format;
pub use npy::read_columns;

use super::{NonFinite, PointCloud};

/// How much of everything is accepted.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Limits {
    /// Points.
    pub points_max: usize,
    /// Scalars per point besides the coordinates.
    pub fields_max: usize,
    /// Coordinates per point.
    pub dimension_max: usize,
    /// Triangles.
    pub faces_max: usize,
}

impl Default for Limits {
    fn default() -> Self {
        Self {
            points_max: 5_000_000,
            fields_max: 64,
            dimension_max: super::DIMENSION_MAX,
            faces_max: 20_000_000,
        }
    }
}

impl Limits {
    /// Refuses more points than the limit.
    fn points(&self, points: usize) -> Result<(), ReadError> {
        if points > self.points_max {
            return Err(ReadError::TooManyPoints { points, points_max: self.points_max });
        }
        Ok(())
    }
}

/// What the caller wants of a reader.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct ReadOptions {
    /// What to do with non-finite coordinates.
    pub policy: NonFinite,
    /// For tables (XYZ, CSV, NPY): the first so many columns are the coordinates, the others fields.
    pub dimension: Option<usize>,
    /// Limits.
    pub limits: Limits,
}

/// Reads a whole file.
///
/// # Errors
/// [`ReadError`], which names the line or byte at fault and what would be accepted.
pub fn read(bytes: &[u8], format: Format, options: &ReadOptions) -> Result<PointCloud, ReadError> {
    if bytes.trim_ascii().is_empty() {
        return Err(ReadError::Empty);
    }
    let bytes = bytes.strip_prefix(b"\xEF\xBB\xBF").unwrap_or(bytes);
    match format {
        Format::Ply => ply::read(bytes, options),
        Format::Obj => obj::read(bytes, options),
        Format::Off => off::read(bytes, options),
        Format::Xyz => xyz::read(bytes, options),
        Format::Csv => csv::read(bytes, options),
        Format::Npy => npy::read(bytes, options),
    }
}

#[cfg(test)]
mod fuzz;

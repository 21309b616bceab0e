//! Readers, one per format. Row i of the cloud is point i of the file, whatever else the file says.
//!
//! No reader allocates on a header's word: announced counts are held against the bytes that are there.

mod columns;
mod csv;
mod e57;
mod error;
mod format;
mod las;
mod laz;
mod lzf;
mod npy;
mod number;
mod obj;
mod off;
mod pcd;
mod ply;
mod polygons;
mod stl;
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
    /// For files of several scans (E57): which one, counting from 0; the first when nothing is said.
    pub scan: Option<usize>,
    /// Limits.
    pub limits: Limits,
}

/// Bytes that any compressed file may unpack to, and how many times its own size if that is more. Scans are
/// compressed to a fifth or a tenth; what shrinks further is made to fill memory.
const UNPACKED_BYTES: usize = 64 << 20;
const UNPACKED_TIMES: usize = 40;

/// Bytes that a compressed file of `packed` bytes may unpack to.
fn unpacked_max(packed: usize) -> usize {
    packed.saturating_mul(UNPACKED_TIMES).max(UNPACKED_BYTES)
}

/// Refuses a compressed file that unpacks to too much, before it does.
fn check_unpacked(format: Format, packed: usize, unpacked: usize) -> Result<(), ReadError> {
    if unpacked > unpacked_max(packed) {
        return Err(ReadError::TooCompressed { format, packed, unpacked });
    }
    Ok(())
}

/// Runs a reader of a crate that may panic on broken files: what it stumbles over is the file's fault.
fn guarded<T>(format: Format, read: impl FnOnce() -> Result<T, ReadError>) -> Result<T, ReadError> {
    std::panic::catch_unwind(std::panic::AssertUnwindSafe(read))
        .unwrap_or_else(|_| Err(ReadError::byte(format, 0, "the file contradicts itself and cannot be read")))
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
        Format::Stl => stl::read(bytes, options),
        Format::Pcd => pcd::read(bytes, options),
        Format::Las | Format::Laz => las::read(bytes, options),
        Format::E57 => e57::read(bytes, options),
    }
}

#[cfg(test)]
mod fuzz;

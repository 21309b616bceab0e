//! Readers, one per format. Row i of the cloud is point i of the file, whatever else the file says.
//!
//! No reader allocates on a header's word: announced counts are held against the bytes that are there.

mod colmap;
mod columns;
mod container;
mod csv;
mod decode;
mod dialect;
mod e57;
mod error;
mod foreign;
mod format;
mod guard;
mod heading;
mod las;
mod lzf;
mod names;
mod npy;
mod number;
mod obj;
mod off;
mod pcd;
mod ply;
mod polygons;
mod ptx;
mod sniff;
mod stl;
mod table;
mod text;
mod xyz;

pub use error::{Location, ReadError};
pub use format::Format;
pub use npy::read_columns;

use self::guard::guarded;
use super::{DIMENSION_MAX, NonFinite, PointCloud};
use crate::arguments::arguments;

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
    /// Bytes of memory for numbers and triangles; never more than four times the file, unpacked, and 64 MiB.
    pub memory_max: usize,
}

impl Default for Limits {
    fn default() -> Self {
        Self {
            points_max: 50_000_000,
            fields_max: 64,
            dimension_max: super::DIMENSION_MAX,
            faces_max: 20_000_000,
            memory_max: usize::MAX,
        }
    }
}

impl Limits {
    /// For files of the caller's own: the default protects a service from strangers, here the machine is the limit.
    pub const OF_THE_MACHINE: Self = Self {
        points_max: u32::MAX as usize,
        fields_max: usize::MAX,
        dimension_max: super::DIMENSION_MAX,
        faces_max: u32::MAX as usize,
        memory_max: usize::MAX,
    };

    /// Refuses more points than the limit.
    fn points(&self, points: usize) -> Result<(), ReadError> {
        if points > self.points_max {
            return Err(ReadError::TooManyPoints { points, points_max: self.points_max });
        }
        Ok(())
    }

    /// Refuses what takes more bytes of memory than the limit.
    fn memory(&self, bytes: Option<usize>) -> Result<(), ReadError> {
        match bytes {
            Some(bytes) if bytes <= self.memory_max => Ok(()),
            _ => Err(ReadError::TooMuchMemory { allowed: self.memory_max }),
        }
    }
}

arguments! {
    /// How a file is read, as a caller asks for it.
    #[derive(Debug, Clone, Copy, PartialEq, Eq)]
    pub struct ReadRequest {
        /// Format of the file.
        format: Option<Format> = word(Format), absent "from Content-Type, then the file's name, then the bytes";
        /// What to do with rows that have a NaN or infinite coordinate: refuse the cloud, or keep the rows without a
        /// result.
        nonfinite: NonFinite = word(NonFinite), default NonFinite::Reject;
        /// For tables (XYZ, CSV, NPY): this number of columns are coordinates, those behind them fields.
        coordinates: Option<usize> = integer(1, DIMENSION_MAX), absent "3 or all columns, by format";
        /// For files of several scans (E57, PTX): which one, counting from 0.
        scan: Option<usize> = integer(0, usize::MAX), absent "all of them";
    }
}

impl ReadRequest {
    /// The options of a reader, within limits.
    #[must_use]
    pub fn options(&self, limits: Limits) -> ReadOptions {
        ReadOptions { policy: self.nonfinite, dimension: self.coordinates, scan: self.scan, limits }
    }
}

/// What the caller wants of a reader.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct ReadOptions {
    /// What to do with non-finite coordinates.
    pub policy: NonFinite,
    /// For tables (XYZ, CSV, NPY): this number of columns are coordinates, those behind them fields.
    pub dimension: Option<usize>,
    /// For files of several scans (E57, PTX): which one, counting from 0; all of them when nothing is said.
    pub scan: Option<usize>,
    /// Limits.
    pub limits: Limits,
}

/// Bytes of memory that any file may take, beside this multiple of its size.
const MEMORY_BYTES: usize = 64 << 20;
const MEMORY_TIMES: usize = 4;

impl ReadOptions {
    /// The same for a file of `bytes` bytes, unpacked: numbers as doubles are wider than most in files, and a
    /// file of the narrowest is not to fill the memory.
    fn for_bytes(&self, bytes: usize) -> Self {
        let memory_max = bytes.saturating_mul(MEMORY_TIMES).saturating_add(MEMORY_BYTES);
        Self { limits: Limits { memory_max: memory_max.min(self.limits.memory_max), ..self.limits }, ..*self }
    }
}

/// Bytes that any compressed file may unpack to, and how many times its own size if that is more. Scans are
/// compressed to a fifth or a tenth; what shrinks further is made to fill memory.
const UNPACKED_BYTES: usize = 64 << 20;
const UNPACKED_TIMES: usize = 40;

/// Bytes that a compressed file of `packed` bytes may unpack to.
fn unpacked_max(packed: usize) -> usize {
    packed.saturating_mul(UNPACKED_TIMES).max(UNPACKED_BYTES)
}

/// Bytes that a file comes to when it is unpacked, by what its header says and up to what is accepted: what is read from it
/// takes four times as many. Of files that are not packed it is their length.
#[must_use]
pub fn unpacked_bytes(bytes: &[u8]) -> usize {
    if let Some(length) = container::unpacked_len(bytes) {
        return length.max(bytes.len());
    }
    let unpacked = match Format::sniff(bytes) {
        Some(Format::Laz) => las::unpacked_bytes(bytes),
        Some(Format::Pcd) => pcd::unpacked_bytes(bytes),
        Some(Format::E57) => e57::unpacked_bytes(bytes),
        _ => None,
    };
    unpacked.unwrap_or(0).min(unpacked_max(bytes.len())).max(bytes.len())
}

/// How far a packed file is unpacked to see that it is no cloud.
const FOREIGN_BYTES: usize = 4096;

/// Refuses a compressed file that unpacks to too much, before it does.
fn check_unpacked(format: Format, packed: usize, unpacked: usize) -> Result<(), ReadError> {
    if unpacked > unpacked_max(packed) {
        return Err(ReadError::TooCompressed { format, packed, unpacked });
    }
    Ok(())
}

/// What a file is called that is not a cloud: an HTML page, a picture.
#[must_use]
pub fn foreign(bytes: &[u8]) -> Option<ReadError> {
    let packed = || foreign::told(&container::head(bytes, FOREIGN_BYTES)?.0);
    foreign::told(bytes)
        .or_else(packed)
        .map(|foreign::Foreign { what, advice }| ReadError::Foreign { what, advice })
}

/// Reads a whole file; one in gzip, or alone in a zip archive, is unpacked first.
///
/// # Errors
/// [`ReadError`], which names the line or byte at fault and what would be accepted.
pub fn read(bytes: &[u8], format: Format, options: &ReadOptions) -> Result<PointCloud, ReadError> {
    if bytes.trim_ascii().is_empty() {
        return Err(ReadError::Empty);
    }
    if let Some(error) = foreign(bytes) {
        return Err(error);
    }
    let inner = container::unpacked(bytes, format)?;
    let (packed, bytes) = (bytes, inner.as_ref());
    if bytes.trim_ascii().is_empty() {
        return Err(ReadError::Empty);
    }
    let bytes = bytes.strip_prefix(b"\xEF\xBB\xBF").unwrap_or(bytes);
    let decoded = if format.is_text() { text::from_utf16(bytes) } else { None };
    let bytes = decoded.as_deref().unwrap_or(bytes);
    // DOS ended texts by this byte, and some programs of instruments still do.
    let is_table = matches!(format, Format::Xyz | Format::Csv);
    let bytes = if is_table { bytes.strip_suffix(b"\x1A").unwrap_or(bytes) } else { bytes };
    // Of those that are packed, the size is known once their headers are read.
    let is_packed = matches!(format, Format::Las | Format::Laz | Format::Pcd | Format::E57);
    let size = bytes.len().max(packed.len());
    let options = if is_packed { options } else { &options.for_bytes(size) };
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
#[cfg(test)]
mod programs;

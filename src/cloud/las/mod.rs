//! LAS of the ASPRS: what its header, records and points look like, for reader and writer alike [LAS 1.4 R15].
//!
//! The header is parsed here and not by the crate `las`, which reads the number of points of version 1.4 only from
//! files of that version, keeps no record byte for byte, and has no place for flags that it does not know.

mod extra;
mod layout;
mod record;

pub(in crate::cloud) use super::scalar::Stored;
pub(in crate::cloud) use extra::{Extra, describe, described, is_reserved, undocumented};
pub(in crate::cloud) use layout::{Place, attributes, record_bytes};
pub(in crate::cloud) use record::{EXTENDED_HEAD, RECORD_HEAD, Record, is_kept};

use super::Grid;

/// Offsets in the public header block [table 3].
pub(in crate::cloud) mod at {
    pub(in crate::cloud) const ENCODING: usize = 6;
    pub(in crate::cloud) const VERSION_MINOR: usize = 25;
    pub(in crate::cloud) const SOFTWARE: usize = 58;
    pub(in crate::cloud) const HEADER_SIZE: usize = 94;
    pub(in crate::cloud) const BODY: usize = 96;
    pub(in crate::cloud) const RECORDS: usize = 100;
    /// The two highest bits are set by `LASzip`.
    pub(in crate::cloud) const POINT_FORMAT: usize = 104;
    pub(in crate::cloud) const RECORD_LENGTH: usize = 105;
    pub(in crate::cloud) const POINTS_LEGACY: usize = 107;
    pub(in crate::cloud) const RETURNS_LEGACY: usize = 111;
    pub(in crate::cloud) const SCALE: usize = 131;
    pub(in crate::cloud) const OFFSET: usize = 155;
    /// Largest x, smallest x, largest y, …
    pub(in crate::cloud) const BOUNDS: usize = 179;
    pub(in crate::cloud) const WAVEFORMS: usize = 227;
    pub(in crate::cloud) const EXTENDED: usize = 235;
    pub(in crate::cloud) const EXTENDED_COUNT: usize = 243;
    pub(in crate::cloud) const POINTS: usize = 247;
    pub(in crate::cloud) const RETURNS: usize = 255;
}

/// Bytes of the header in versions 1.0 to 1.2, the least, and in version 1.4.
pub(in crate::cloud) const HEADER_MIN: usize = 227;
pub(in crate::cloud) const HEADER_1_4: usize = 375;
/// Bits of the global encoding: waveforms within the file, coordinate reference system as WKT.
pub(in crate::cloud) const WAVEFORMS_INSIDE: u16 = 1 << 1;
pub(in crate::cloud) const WKT: u16 = 1 << 4;

/// A little-endian number at an offset, if it is there.
pub(in crate::cloud) fn u16_at(bytes: &[u8], at: usize) -> Option<u16> {
    bytes.get(at..)?.first_chunk().map(|bytes| u16::from_le_bytes(*bytes))
}

/// See [`u16_at`].
pub(in crate::cloud) fn u32_at(bytes: &[u8], at: usize) -> Option<u32> {
    bytes.get(at..)?.first_chunk().map(|bytes| u32::from_le_bytes(*bytes))
}

/// See [`u16_at`].
pub(in crate::cloud) fn u64_at(bytes: &[u8], at: usize) -> Option<u64> {
    bytes.get(at..)?.first_chunk().map(|bytes| u64::from_le_bytes(*bytes))
}

/// See [`u16_at`].
pub(in crate::cloud) fn f64_at(bytes: &[u8], at: usize) -> Option<f64> {
    u64_at(bytes, at).map(f64::from_bits)
}

/// What the header says, not yet held against the file.
#[derive(Debug, Clone, Copy)]
pub(in crate::cloud) struct Header {
    /// 0 to 10, or what else the file says.
    pub(in crate::cloud) point_format: u8,
    /// Bytes of a point.
    pub(in crate::cloud) record: usize,
    pub(in crate::cloud) points: u64,
    pub(in crate::cloud) size: usize,
    /// Offset of the first point.
    pub(in crate::cloud) body: usize,
    pub(in crate::cloud) records: u32,
    pub(in crate::cloud) extended_at: u64,
    pub(in crate::cloud) extended: u32,
    pub(in crate::cloud) grids: [Grid; 3],
}

impl Header {
    /// `None` when the file is shorter than its header.
    pub(in crate::cloud) fn parse(bytes: &[u8]) -> Option<Self> {
        let size = usize::from(u16_at(bytes, at::HEADER_SIZE)?);
        let header = bytes.get(..size.max(HEADER_MIN))?;
        let legacy = u32_at(header, at::POINTS_LEGACY)?;
        // Since version 1.4 the number of points has 64 bits; the old one may be there too.
        let large = (header[at::VERSION_MINOR] >= 4).then(|| u64_at(header, at::POINTS)).flatten();
        let extended = (header[at::VERSION_MINOR] >= 4).then(|| u32_at(header, at::EXTENDED_COUNT)).flatten();
        let grid = |axis: usize| {
            let scale = f64_at(header, at::SCALE + 8 * axis)?;
            Some(Grid { scale, offset: f64_at(header, at::OFFSET + 8 * axis)? })
        };
        Some(Self {
            point_format: header[at::POINT_FORMAT] & 0x3F,
            record: usize::from(u16_at(header, at::RECORD_LENGTH)?),
            points: large.filter(|&points| points > 0).unwrap_or(legacy.into()),
            size,
            body: u32_at(header, at::BODY)? as usize,
            records: u32_at(header, at::RECORDS)?,
            extended_at: u64_at(header, at::EXTENDED).unwrap_or(0),
            extended: extended.unwrap_or(0),
            grids: [grid(0)?, grid(1)?, grid(2)?],
        })
    }
}

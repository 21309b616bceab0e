//! A LAS file as its header and its records describe it, packed or not.

use crate::cloud::Grid;
use crate::cloud::las::{self, EXTENDED_HEAD, HEADER_MIN, Record, at};
use crate::cloud::reader::{Format, Location, ReadError};

/// A file as its header and its records tell.
#[derive(Debug)]
pub(super) struct File<'a> {
    pub(super) format: Format,
    pub(super) point_format: u8,
    pub(super) points: usize,
    /// Bytes of a point.
    pub(super) record: usize,
    /// Offset of the first point.
    pub(super) body: usize,
    /// Of x, y and z.
    pub(super) grids: [Grid; 3],
    pub(super) header: &'a [u8],
    pub(super) records: Vec<Record<'a>>,
    pub(super) extended: Vec<Record<'a>>,
}

impl<'a> File<'a> {
    pub(super) fn parse(bytes: &'a [u8], format: Format) -> Result<Self, ReadError> {
        let refuse = |byte: usize, message: String| Err(ReadError::byte(format, byte, message));
        if !bytes.starts_with(b"LASF") {
            return refuse(0, "the file does not begin with LASF".to_owned());
        }
        let Some(header) = las::Header::parse(bytes) else {
            let message = format!("the header has {HEADER_MIN} bytes at least");
            return Err(ReadError::Truncated { format, location: Location::Byte(bytes.len()), message });
        };
        let Some(least) = las::record_bytes(header.point_format) else {
            let message = format!("point format {} does not exist; 0 to 10 do", header.point_format);
            return refuse(at::POINT_FORMAT, message);
        };
        if header.record < least {
            let message = format!(
                "points of format {} have {least} bytes, {} are announced",
                header.point_format, header.record
            );
            return refuse(at::RECORD_LENGTH, message);
        }
        if header.grids.iter().any(|grid| !grid.scale.is_normal() || !grid.offset.is_finite()) {
            return refuse(
                at::SCALE,
                "a scale or an offset of the coordinates is zero or not finite".to_owned(),
            );
        }
        let mut records = Vec::new();
        let mut place = header.size;
        for index in 0..header.records {
            // Each is cut from bytes that are there, so that the loop ends with them.
            let Some(record) = bytes.get(place..).and_then(Record::first) else {
                let message =
                    format!("record {index} of the {} of variable length is incomplete", header.records);
                return refuse(place, message);
            };
            place += record.bytes.len();
            records.push(record);
        }
        Ok(Self {
            format,
            point_format: header.point_format,
            points: usize::try_from(header.points).unwrap_or(usize::MAX),
            record: header.record,
            body: header.body,
            grids: header.grids,
            header: bytes.get(..header.size).unwrap_or_default(),
            records,
            extended: extended(bytes, &header),
        })
    }

    /// [`ReadError::Malformed`] at a byte of this file.
    pub(super) fn refuse(&self, byte: usize, message: impl Into<String>) -> ReadError {
        ReadError::byte(self.format, byte, message)
    }
}

/// The extended records that are whole: they stand behind the points, and no point depends on them.
fn extended<'a>(bytes: &'a [u8], header: &las::Header) -> Vec<Record<'a>> {
    let mut records = Vec::new();
    let mut place = usize::try_from(header.extended_at).unwrap_or(usize::MAX);
    let possible = bytes.len() / EXTENDED_HEAD;
    for _ in 0..(header.extended as usize).min(possible) {
        let Some(record) = bytes.get(place..).and_then(Record::first_extended) else { break };
        place += record.bytes.len();
        records.push(record);
    }
    records
}

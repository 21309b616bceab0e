//! LAS, versions 1.0 to 1.5, and LAZ.
//!
//! Points are decoded column by column, which keeps the record's doubles and integers as they are. Fields that are 0 in
//! every point, as most are in most files, are left out; the frame of the file, header and records, is kept beside the
//! points, so that the writer puts them back.
//!
//! Not by the crate `las`, which allocates what a header says and keeps no record byte for byte; `laz` only decompresses.

mod file;
mod laz;

use rayon::prelude::*;

use self::file::File;
use super::columns::{Column, Columns, Target};
use super::decode::{ByteOrder, Place as Slot};
use super::number::{Number, Source};
use super::{Format, Location, ReadError, ReadOptions, guarded};
use crate::cloud::las::{self, Extra, Place, Record, at};
use crate::cloud::{Bytes, Origin, PointCloud, ScalarType, Survey};

/// Points that one thread looks at a time for places that are used.
const USED_POINTS: usize = 1 << 13;

/// Bytes of records that are kept beside a cloud.
const KEPT_MAX: usize = 1 << 20;

/// Whether a file that begins with `LASF` is compressed.
pub(super) fn is_compressed(head: &[u8]) -> bool {
    head.get(at::POINT_FORMAT).is_some_and(|format| format & 0x80 != 0)
}

/// Bytes of all points, as the header says.
pub(super) fn unpacked_bytes(bytes: &[u8]) -> Option<usize> {
    let file = File::parse(bytes, Format::Laz).ok()?;
    file.points.checked_mul(file.record)
}

pub(super) fn read(bytes: &[u8], options: &ReadOptions) -> Result<PointCloud, ReadError> {
    let format = if is_compressed(bytes) { Format::Laz } else { Format::Las };
    let file = File::parse(bytes, format)?;
    options.limits.points(file.points)?;
    let options = &options.for_bytes(file.points.saturating_mul(file.record));
    let unpacked;
    let records = if format == Format::Laz {
        unpacked = guarded(format, || laz::unpack(bytes, &file))?;
        unpacked.as_slice()
    } else {
        let length = file.points.checked_mul(file.record);
        length.and_then(|length| bytes.get(file.body..)?.get(..length)).ok_or_else(|| {
            let follow = bytes.len().saturating_sub(file.body);
            let message = format!(
                "{} points of {} bytes are announced, {follow} bytes follow",
                file.points, file.record
            );
            ReadError::Truncated { format, location: Location::Byte(bytes.len()), message }
        })?
    };
    file.cloud(records, options)
}

impl File<'_> {
    fn cloud(&self, records: &[u8], options: &ReadOptions) -> Result<PointCloud, ReadError> {
        let (mut layout, extra) = self.layout();
        let mut is_used = self.used(&layout, records).into_iter();
        layout.retain(|_| is_used.next() == Some(true));
        let axes = ["x", "y", "z"].map(|name| Column { name: name.to_owned(), kind: ScalarType::Float64 });
        let fields = layout.iter().map(|place| Column { name: place.name.clone(), kind: place.kind() });
        let named: Vec<Column> = axes.into_iter().chain(fields).collect();
        let mut columns = Columns::leading(&named, 3, &options.limits)?;
        columns.zeroed(self.points)?;
        let (targets, stride) = (columns.targets.clone(), self.record);
        columns.fill_blocks(|block| {
            let records = &records[block.rows.start * stride..block.rows.end * stride];
            for axis in 0..3 {
                let number = Number::little(ScalarType::Int32);
                let source = Source { rows: records, stride, offset: 4 * axis, number };
                source.decode(Slot { out: block.coordinates, stride: 3, offset: axis });
            }
            for point in block.coordinates.as_chunks_mut::<3>().0 {
                point.iter_mut().zip(&self.grids).for_each(|(x, grid)| *x = grid.coordinate(*x));
            }
            for (place, target) in layout.iter().zip(&targets[3..]) {
                if let Target::Field(field) = *target {
                    self.decode(place, records, block.field(field));
                }
            }
        });
        let origin = self.origin(&extra);
        Ok(columns.into_cloud(Vec::new(), options)?.with_grids(Some(self.grids)).with_origin(origin))
    }

    fn decode(&self, place: &Place, records: &[u8], values: &mut [f64]) {
        let number = Number::stored(place.stored, ByteOrder::Little);
        let source = Source { rows: records, stride: self.record, offset: place.offset, number };
        source.decode(Slot::packed(values));
        if place.mask != 0 {
            for x in &mut *values {
                *x = f64::from((*x as u8 >> place.shift) & place.mask);
            }
        }
        if let Some((scale, offset)) = place.scaled {
            for x in values {
                *x = *x * scale + offset;
            }
        }
    }

    /// Which places have anything but 0 in some point.
    fn used(&self, layout: &[Place], records: &[u8]) -> Vec<bool> {
        let parts = records.par_chunks(USED_POINTS * self.record).map(|part| bits(part, self.record));
        let none = || vec![0; self.record];
        let set = parts.reduce(none, |a, b| a.iter().zip(b).map(|(a, b)| a | b).collect());
        let is_used = |place: &Place| {
            // An offset makes a number other than 0 of bytes that are 0.
            let is_shifted = place.scaled.is_some_and(|(_, offset)| offset != 0.0);
            let mask = if place.mask == 0 { u8::MAX } else { place.mask << place.shift };
            let bytes = &set[place.offset..place.offset + place.stored.size()];
            is_shifted || bytes.iter().any(|&byte| byte & mask != 0)
        };
        layout.iter().map(is_used).collect()
    }

    /// The attributes of a point, then its extra bytes.
    fn layout(&self) -> (Vec<Place>, Extra) {
        let mut places = las::attributes(self.point_format);
        let descriptions: Vec<u8> = self
            .records
            .iter()
            .filter(|record| record.describes_extra_bytes())
            .flat_map(|record| record.data.iter().copied())
            .collect();
        let start = las::record_bytes(self.point_format).unwrap_or(self.record);
        let mut extra = las::described(&descriptions, start, self.record, &places);
        places.append(&mut extra.places);
        (places, extra)
    }

    /// Header and records, and what of them is not kept.
    fn origin(&self, extra: &Extra) -> Origin {
        let mut notes = Vec::new();
        if extra.left_out > 0 {
            let bytes = extra.left_out;
            notes.push(format!("{bytes} bytes of every point that no record describes were left out"));
        }
        let mut room = KEPT_MAX;
        let mut keep = |records: &[Record<'_>]| {
            let mut kept = Vec::new();
            for record in records.iter().filter(|record| las::is_kept(record)) {
                if record.bytes.len() > room {
                    let user = String::from_utf8_lossy(record.user()).into_owned();
                    let (number, length) = (record.number(), record.bytes.len());
                    notes.push(format!("the record {user} {number} of {length} bytes was left out"));
                    continue;
                }
                room -= record.bytes.len();
                kept.push(Bytes(record.bytes.to_vec()));
            }
            kept
        };
        let (records, extended) = (keep(&self.records), keep(&self.extended));
        let all = || self.records.iter().chain(&self.extended);
        if all().any(|record| record.user() == b"LASF_Spec" && record.number() == 65_535) {
            notes.push("the waveforms were left out; the points keep where they were".to_owned());
        }
        Origin { notes, survey: Some(Survey { header: Bytes(self.header.to_vec()), records, extended }) }
    }
}

/// The bits of a record that are set in some of the records.
fn bits(records: &[u8], stride: usize) -> Vec<u8> {
    // Eight records are as many words as one has bytes: the compiler joins several words at once.
    let mut words = vec![0_u64; stride];
    let blocks = records.chunks_exact(8 * stride);
    let rest = blocks.remainder();
    for block in blocks {
        for (word, bytes) in words.iter_mut().zip(block.as_chunks::<8>().0) {
            *word |= u64::from_le_bytes(*bytes);
        }
    }
    let mut bits = vec![0; stride];
    let bytes = words.iter().flat_map(|word| word.to_le_bytes()).chain(rest.iter().copied());
    bytes.enumerate().for_each(|(at, byte)| bits[at % stride] |= byte);
    bits
}

#[cfg(test)]
mod tests;

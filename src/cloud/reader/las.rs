//! LAS of the ASPRS, versions 1.0 to 1.4, and LAZ.
//!
//! The crate `las` reads header and records of variable length, `laz` unpacks; both allocate by counts of the file,
//! so counts are checked first. Points are decoded column by column, which keeps the record's doubles and integers
//! as they are. Fields that are 0 in every point, as most are in most files, are left out.

use std::io::Cursor;

use las::point::Format as PointFormat;
use las::raw::{Header as RawHeader, Vlr};

use super::columns::{Column, Columns, Target};
use super::number::{Number, Source};
use super::ply::Place;
use super::{Format, Location, ReadError, ReadOptions, guarded, laz};
use crate::cloud::{Grid, PointCloud, ScalarType};

/// Who defines the records that describe extra bytes, and their number [LAS 1.4 R15, table 24].
const EXTRA_BYTES: (&[u8], u16) = (b"LASF_Spec", 4);
/// Bytes of one description.
const DESCRIPTION: usize = 192;
/// Bits of its options: the scale is set, the offset is set.
const SCALED: u8 = 0b0000_1000;
const SHIFTED: u8 = 0b0001_0000;
/// Byte of the header that tells the point format; its highest bit is set by `LASzip`.
const POINT_FORMAT_AT: usize = 104;

/// Whether a file that begins with `LASF` is compressed.
pub(super) fn is_compressed(head: &[u8]) -> bool {
    head.get(POINT_FORMAT_AT).is_some_and(|format| format & 0x80 != 0)
}

/// Bytes of all points, as the header says.
pub(super) fn unpacked_bytes(bytes: &[u8]) -> Option<usize> {
    let file = guarded(Format::Laz, || File::parse(bytes, Format::Laz)).ok()?;
    file.points.checked_mul(file.record)
}

pub(super) fn read(bytes: &[u8], options: &ReadOptions) -> Result<PointCloud, ReadError> {
    let format = if is_compressed(bytes) { Format::Laz } else { Format::Las };
    let file = guarded(format, || File::parse(bytes, format))?;
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

/// What the header says.
#[derive(Debug)]
pub(super) struct File {
    format: Format,
    point: PointFormat,
    pub(super) points: usize,
    /// Bytes of a point.
    pub(super) record: usize,
    /// Offset of the first point.
    pub(super) body: usize,
    /// Of x, y and z.
    grids: [Grid; 3],
    pub(super) records: Vec<Vlr>,
}

impl File {
    fn parse(bytes: &[u8], format: Format) -> Result<Self, ReadError> {
        let mut cursor = Cursor::new(bytes);
        let malformed = |error: las::Error| ReadError::byte(format, 0, format!("the header: {error}"));
        let header = RawHeader::read_from(&mut cursor).map_err(malformed)?;
        let mut point = PointFormat::new(header.point_data_record_format).map_err(malformed)?;
        let record = header.point_data_record_length;
        point.extra_bytes = record.checked_sub(point.len()).ok_or_else(|| {
            let message =
                format!("points of format {point} have {} bytes, {record} are announced", point.len());
            ReadError::byte(format, POINT_FORMAT_AT, message)
        })?;
        let grids = [
            Grid { scale: header.x_scale_factor, offset: header.x_offset },
            Grid { scale: header.y_scale_factor, offset: header.y_offset },
            Grid { scale: header.z_scale_factor, offset: header.z_offset },
        ];
        if grids.iter().any(|grid| !grid.scale.is_normal() || !grid.offset.is_finite()) {
            let message = "a scale or an offset of the coordinates is zero or not finite";
            return Err(ReadError::byte(format, 131, message));
        }
        let large = header.large_file.map_or(0, |large| large.number_of_point_records);
        let points =
            if header.number_of_point_records > 0 { header.number_of_point_records.into() } else { large };
        cursor.set_position(header.header_size.into());
        let mut records = Vec::new();
        for _ in 0..header.number_of_variable_length_records {
            // Each is read from bytes that are there, so that the loop ends with them.
            match Vlr::read_from(&mut cursor, false) {
                Ok(record) => records.push(record),
                Err(error) => {
                    let at = cursor.position() as usize;
                    let message = format!("a record of variable length: {error}");
                    return Err(ReadError::byte(format, at, message));
                }
            }
        }
        let points = usize::try_from(points).unwrap_or(usize::MAX);
        let body = header.offset_to_point_data as usize;
        Ok(Self { format, point, points, record: record.into(), body, grids, records })
    }

    fn cloud(&self, records: &[u8], options: &ReadOptions) -> Result<PointCloud, ReadError> {
        let mut layout = self.layout();
        let source = |place: &Placed| Source {
            rows: records,
            stride: self.record,
            offset: place.offset,
            number: place.number,
        };
        layout.retain(|place| place.axis || !self.is_unused(place, records));
        let kind = |place: &Placed| match place.scaled {
            Some(_) => ScalarType::Float64,
            None if place.axis => ScalarType::Float64,
            None => place.number.scalar_type(),
        };
        let named: Vec<Column> =
            layout.iter().map(|place| Column { name: place.name.clone(), kind: kind(place) }).collect();
        let mut columns = Columns::leading(&named, 3, &options.limits)?;
        columns.zeroed(self.points)?;
        for (place, target) in layout.iter().zip(&columns.targets) {
            let source = source(place);
            match *target {
                Target::Coordinate(axis) => {
                    let out = columns.coordinates.as_mut_slice();
                    source.decode(Place { out, stride: 3, offset: axis });
                    let grid = self.grids[axis];
                    let steps = columns.coordinates.iter_mut().skip(axis).step_by(3);
                    steps.for_each(|x| *x = grid.coordinate(*x));
                }
                Target::Field(field) => {
                    let values = &mut columns.fields[field].values;
                    source.decode(Place::packed(values));
                    let masked = |x: &mut f64| *x = f64::from((*x as u32 >> place.shift) & place.mask);
                    if place.mask != 0 {
                        values.iter_mut().for_each(masked);
                    }
                    if let Some((scale, offset)) = place.scaled {
                        for x in values {
                            *x = *x * scale + offset;
                        }
                    }
                }
                Target::Skipped => {}
            }
        }
        Ok(columns.into_cloud(Vec::new(), options)?.with_grids(Some(self.grids)))
    }

    /// Whether every point has 0 there.
    fn is_unused(&self, place: &Placed, records: &[u8]) -> bool {
        let range = place.offset..place.offset + place.number.size();
        let mask = (place.mask << place.shift) as u8;
        records.chunks_exact(self.record).all(|record| {
            let bytes = &record[range.clone()];
            if place.mask == 0 { bytes.iter().all(|&byte| byte == 0) } else { bytes[0] & mask == 0 }
        })
    }

    /// The columns of a record [LAS 1.4 R15, §2.6], coordinates first.
    fn layout(&self) -> Vec<Placed> {
        use ScalarType::{Float64, Int8, Int16, Int32, Uint8, Uint16};
        let point = &self.point;
        let axis = |name, offset| Placed { axis: true, ..Placed::whole(name, offset, Int32) };
        let mut places = vec![axis("x", 0), axis("y", 4), axis("z", 8)];
        let mut whole = |name, offset, kind| places.push(Placed::whole(name, offset, kind));
        whole("intensity", 12, Uint16);
        if point.is_extended {
            whole("user_data", 17, Uint8);
            whole("point_source_id", 20, Uint16);
            whole("classification", 16, Uint8);
            places.push(Placed { scaled: Some((0.006, 0.0)), ..Placed::whole("scan_angle", 18, Int16) });
            places.push(Placed::bits("return_number", 14, 0, 15));
            places.push(Placed::bits("number_of_returns", 14, 4, 15));
        } else {
            whole("user_data", 17, Uint8);
            whole("point_source_id", 18, Uint16);
            whole("scan_angle", 16, Int8);
            places.push(Placed::bits("classification", 15, 0, 31));
            places.push(Placed::bits("return_number", 14, 0, 7));
            places.push(Placed::bits("number_of_returns", 14, 3, 7));
        }
        let mut offset = if point.is_extended { 22 } else { 20 };
        if point.has_gps_time {
            places.push(Placed::whole("gps_time", offset, Float64));
            offset += 8;
        }
        if point.has_color {
            for (index, name) in ["red", "green", "blue"].into_iter().enumerate() {
                places.push(Placed::whole(name, offset + 2 * index, Uint16));
            }
            offset += 6;
        }
        if point.has_nir {
            places.push(Placed::whole("nir", offset, Uint16));
        }
        places.extend(self.extra());
        places
    }

    /// The extra bytes that records describe.
    fn extra(&self) -> Vec<Placed> {
        let mut places = Vec::new();
        let mut offset = self.record - usize::from(self.point.extra_bytes);
        let (user, number) = EXTRA_BYTES;
        let is_description = |record: &&Vlr| record.user_id.starts_with(user) && record.record_id == number;
        let described = self.records.iter().filter(is_description);
        for description in described.flat_map(|record| record.data.chunks_exact(DESCRIPTION)) {
            let Some(place) = extra(description, offset) else { break };
            offset += place.number.size();
            if offset > self.record {
                break;
            }
            places.push(place);
        }
        places
    }

    /// [`ReadError::Malformed`] at a byte of this file.
    pub(super) fn refuse(&self, byte: usize, message: impl Into<String>) -> ReadError {
        ReadError::byte(self.format, byte, message)
    }
}

/// A column and its place in a record.
#[derive(Debug)]
struct Placed {
    name: String,
    offset: usize,
    number: Number,
    axis: bool,
    /// Bits of the number; 0 for the whole.
    shift: u32,
    mask: u32,
    scaled: Option<(f64, f64)>,
}

impl Placed {
    fn whole(name: &str, offset: usize, kind: ScalarType) -> Self {
        let (name, number) = (name.to_owned(), Number::little(kind));
        Self { name, offset, number, axis: false, shift: 0, mask: 0, scaled: None }
    }

    fn bits(name: &str, offset: usize, shift: u32, mask: u32) -> Self {
        Self { shift, mask, ..Self::whole(name, offset, ScalarType::Uint8) }
    }
}

/// A described scalar [LAS 1.4 R15, table 25]; `None` for arrays and undocumented bytes, behind which no place is
/// known.
fn extra(description: &[u8], offset: usize) -> Option<Placed> {
    let (letter, size) = match description[2] {
        1 => ('U', 1),
        2 => ('I', 1),
        3 => ('U', 2),
        4 => ('I', 2),
        5 => ('U', 4),
        6 => ('I', 4),
        7 => ('U', 8),
        8 => ('I', 8),
        9 => ('F', 4),
        10 => ('F', 8),
        _ => return None,
    };
    let number = Number::of(letter, size, super::ply::ByteOrder::Little)?;
    let name = description[4..36].split(|&byte| byte == 0).next().unwrap_or_default();
    let name = String::from_utf8_lossy(name).trim().to_owned();
    let double = |at: usize| description[at..].first_chunk().map_or(0.0, |bytes| f64::from_le_bytes(*bytes));
    let scale = if description[3] & SCALED != 0 { double(112) } else { 1.0 };
    let shift = if description[3] & SHIFTED != 0 { double(136) } else { 0.0 };
    let scaled = (description[3] & (SCALED | SHIFTED) != 0).then_some((scale, shift));
    Some(Placed { number, scaled, ..Placed::whole(&name, offset, ScalarType::Uint8) })
}

#[cfg(test)]
mod tests;

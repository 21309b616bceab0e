//! ASTM E57: the scans of a file, in the file's coordinate system.
//!
//! Points that the scanner marks as invalid have no position: they are rows without one.
//!
//! The crate `e57` reads the description, but makes a vector for every point, at less than half of libE57's speed: packets
//! are unpacked here.

mod layout;
mod packets;
mod unpack;

use std::io::Cursor;

use e57::{E57Reader, PointCloud as Scan};

use self::layout::{Layout, Place};
use self::packets::Packets;
use self::unpack::Stream;
use super::columns::Columns;
use super::{Format, ReadError, ReadOptions, check_unpacked, guarded};
use crate::cloud::{CloudError, PointCloud, ScalarType};

const FORMAT: Format = Format::E57;

fn refuse(error: impl std::fmt::Display) -> ReadError {
    ReadError::byte(FORMAT, 0, error.to_string())
}

/// The scans that the file describes.
fn scans(bytes: &[u8]) -> Result<Vec<Scan>, ReadError> {
    packets::check_description(bytes)?;
    guarded(FORMAT, || Ok(E57Reader::new(Cursor::new(bytes)).map_err(refuse)?.pointclouds()))
}

/// Bytes of all points, as the description says.
pub(super) fn unpacked_bytes(bytes: &[u8]) -> Option<usize> {
    Some(unpacked(&scans(bytes).ok()?))
}

fn unpacked(scans: &[Scan]) -> usize {
    let of_scan = |scan: &Scan| {
        let width = layout::packings(scan).map(unpack::Packing::unpacked_bytes).sum::<usize>();
        points_of(scan).saturating_mul(width)
    };
    scans.iter().map(of_scan).fold(0, usize::saturating_add)
}

fn points_of(scan: &Scan) -> usize {
    usize::try_from(scan.records).unwrap_or(usize::MAX)
}

pub(super) fn read(bytes: &[u8], options: &ReadOptions) -> Result<PointCloud, ReadError> {
    let mut scans = scans(bytes)?;
    let all = scans.len();
    if let Some(scan) = options.scan {
        if scan >= all {
            return Err(ReadError::NoSuchScan { scan, scans: all });
        }
        scans = vec![scans.swap_remove(scan)];
    }
    let points = scans.iter().map(points_of).fold(0, usize::saturating_add);
    options.limits.points(points)?;
    if points == 0 {
        return Err(CloudError::Empty.into());
    }
    let unpacked = unpacked(&scans);
    check_unpacked(FORMAT, bytes.len(), unpacked)?;
    let options = &options.for_bytes(unpacked.max(bytes.len()));
    let layout = Layout::of(&scans);
    let mut columns = Columns::leading(&layout.columns, 3, &options.limits)?;
    columns.zeroed(points)?;
    let mut first = 0;
    for scan in &scans {
        let rows = first..first + points_of(scan);
        read_scan(bytes, scan, &layout, &mut columns, rows.clone())?;
        first = rows.end;
    }
    if scans.len() > 1 {
        let values =
            scans.iter().enumerate().flat_map(|(i, scan)| std::iter::repeat_n(i as f64, points_of(scan)));
        columns.append("scan", ScalarType::Uint32, values.collect())?;
    }
    columns.into_cloud(Vec::new(), options)
}

/// Reads a scan into its rows.
fn read_scan(
    bytes: &[u8],
    scan: &Scan,
    layout: &Layout,
    columns: &mut Columns,
    rows: std::ops::Range<usize>,
) -> Result<(), ReadError> {
    if rows.is_empty() {
        return Ok(());
    }
    let places = layout.places(scan);
    let mut streams: Vec<Stream> =
        layout::packings(scan).map(|packing| Stream::new(packing, rows.len())).collect();
    if layout::packings(scan).all(|packing| packing.bits() == 0) {
        return Err(refuse("all attributes of its points are constants"));
    }
    let mut invalid = vec![false; if places.contains(&Place::Invalid) { rows.len() } else { 0 }];
    let coordinates = &mut columns.coordinates[3 * rows.start..3 * rows.end];
    let mut fields: Vec<&mut [f64]> =
        columns.fields.iter_mut().map(|field| &mut field.values[rows.clone()]).collect();
    let mut put = |stream: usize, place: usize, value: f64| match places[stream] {
        Place::Axis(axis) => coordinates[3 * place + axis] = value,
        Place::Field(field) => fields[field][place] = value,
        Place::Invalid => invalid[place] |= value != 0.0,
        Place::Skipped => {}
    };
    for (index, stream) in streams.iter_mut().enumerate() {
        if layout::packings(scan).nth(index).is_some_and(|packing| packing.bits() == 0) {
            stream.repeat(|place, value| put(index, place, value));
        }
    }
    let mut packets = Packets::of(bytes, scan.file_offset, streams.len())?;
    while !streams.iter().all(Stream::is_complete) {
        packets.next(|index, bytes| streams[index].take(bytes, |place, value| put(index, place, value)))?;
    }
    layout.settle(scan, columns, rows, &invalid);
    Ok(())
}

#[cfg(test)]
mod tests;

//! What stands around the points: header and records before them, extended records behind.

use std::io::{self, Write};

use laz::LazVlr;

use super::axis::Axis;
use super::points::Points;
use crate::cloud::las::{
    EXTENDED_HEAD, HEADER_1_4, HEADER_MIN, RECORD_HEAD, Record, WAVEFORMS_INSIDE, WKT, at, f64_at, is_kept,
    u16_at, u32_at,
};
use crate::cloud::{PointCloud, Survey};

/// The bytes before the points, and those behind.
pub(super) struct Frame {
    pub(super) head: Vec<u8>,
    extended: Vec<Vec<u8>>,
}

impl Frame {
    pub(super) fn of(
        cloud: &PointCloud,
        axes: &[Axis; 3],
        points: &Points<'_>,
        packing: Option<&LazVlr>,
    ) -> io::Result<Self> {
        let survey = cloud.origin().survey.as_ref().filter(|survey| survey.header.0.len() >= HEADER_MIN);
        let mut records = records(survey, points)?;
        let extended: Vec<Vec<u8>> = survey.map_or_else(Vec::new, kept_extended);
        if let Some(packing) = packing {
            let mut data = Vec::new();
            packing.write_to(&mut data)?;
            records.push(record(LazVlr::USER_ID.as_bytes(), LazVlr::RECORD_ID, LazVlr::DESCRIPTION, &data)?);
        }
        let mut header = survey.map_or_else(fresh_header, |survey| survey.header.0.clone());
        let is_1_4 = header[at::VERSION_MINOR] >= 4 && header.len() >= HEADER_1_4;
        let has_wkt = records.iter().chain(&extended).any(|bytes| Record { bytes, data: &[] }.is_wkt());
        let encoding = u16_at(&header, at::ENCODING).unwrap_or(0) & !WAVEFORMS_INSIDE;
        put(&mut header, at::ENCODING, &(if has_wkt { encoding } else { encoding & !WKT }).to_le_bytes());
        let body = header.len() + records.iter().map(Vec::len).sum::<usize>();
        let body = u32::try_from(body)
            .map_err(|_| super::unsupported("LAS: the records are too long".to_owned()))?;
        put(&mut header, at::BODY, &body.to_le_bytes());
        put(&mut header, at::RECORDS, &(records.len() as u32).to_le_bytes());
        header[at::POINT_FORMAT] = points.format | if packing.is_some() { 0x80 } else { 0 };
        let length = u16::try_from(points.record).map_err(|_| {
            super::unsupported(format!("LAS: a point of {} bytes is too long", points.record))
        })?;
        put(&mut header, at::RECORD_LENGTH, &length.to_le_bytes());
        for (axis, Axis { grid, .. }) in axes.iter().enumerate() {
            put(&mut header, at::SCALE + 8 * axis, &grid.scale.to_le_bytes());
            put(&mut header, at::OFFSET + 8 * axis, &grid.offset.to_le_bytes());
        }
        put_bounds(&mut header, cloud, axes);
        put_counts(&mut header, cloud.len(), points, is_1_4)?;
        if header.len() >= at::EXTENDED && header[at::VERSION_MINOR] >= 3 {
            put(&mut header, at::WAVEFORMS, &0_u64.to_le_bytes());
        }
        let mut head = header;
        head.extend(records.concat());
        Ok(Self { head, extended: if is_1_4 { extended } else { Vec::new() } })
    }

    /// Writes what follows the points, whose bytes are counted: the header, written before, says where they end.
    pub(super) fn write_tail(&self, out: &mut impl Write) -> io::Result<()> {
        self.extended.iter().try_for_each(|record| out.write_all(record))
    }

    /// Says in the header where the extended records stand, behind the bytes of the points.
    pub(super) fn place_extended(&mut self, points_bytes: usize) {
        if self.head[at::VERSION_MINOR] >= 4 && self.head.len() >= HEADER_1_4 {
            let place = if self.extended.is_empty() { 0 } else { (self.head.len() + points_bytes) as u64 };
            put(&mut self.head, at::EXTENDED, &place.to_le_bytes());
            put(&mut self.head, at::EXTENDED_COUNT, &(self.extended.len() as u32).to_le_bytes());
        }
    }
}

fn put(bytes: &mut [u8], at: usize, value: &[u8]) {
    bytes[at..at + value.len()].copy_from_slice(value);
}

/// A record with its head.
fn record(user: &[u8], number: u16, text: &str, data: &[u8]) -> io::Result<Vec<u8>> {
    let length = u16::try_from(data.len())
        .map_err(|_| super::unsupported("LAS: the points have too many fields".to_owned()))?;
    let mut bytes = vec![0; RECORD_HEAD];
    bytes[2..2 + user.len()].copy_from_slice(user);
    put(&mut bytes, 18, &number.to_le_bytes());
    put(&mut bytes, 20, &length.to_le_bytes());
    let text = &text.as_bytes()[..text.len().min(32)];
    put(&mut bytes, 22, text);
    bytes.extend(data);
    Ok(bytes)
}

/// The records of the file that the cloud came in, with the descriptions of extra bytes as they are now.
fn records(survey: Option<&Survey>, points: &Points<'_>) -> io::Result<Vec<Vec<u8>>> {
    let kept = survey.iter().flat_map(|survey| &survey.records).map(|bytes| &bytes.0);
    let kept: Vec<&Vec<u8>> =
        kept.filter(|bytes| Record::first(bytes).is_some_and(|record| is_kept(&record))).collect();
    let describes = |bytes: &&Vec<u8>| Record { bytes, data: &[] }.describes_extra_bytes();
    let known: Vec<u8> = kept
        .iter()
        .filter(|bytes| describes(bytes))
        .flat_map(|bytes| &bytes[RECORD_HEAD..])
        .copied()
        .collect();
    if known == points.descriptions {
        return Ok(kept.into_iter().cloned().collect());
    }
    let mut records: Vec<Vec<u8>> = kept.into_iter().filter(|bytes| !describes(bytes)).cloned().collect();
    records.push(record(b"LASF_Spec", 4, "extra bytes", &points.descriptions)?);
    Ok(records)
}

fn kept_extended(survey: &Survey) -> Vec<Vec<u8>> {
    let is_whole = |bytes: &&Vec<u8>| {
        bytes.len() >= EXTENDED_HEAD && Record::first_extended(bytes).is_some_and(|record| is_kept(&record))
    };
    survey.extended.iter().map(|bytes| &bytes.0).filter(is_whole).cloned().collect()
}

/// The header of a file of version 1.4.
fn fresh_header() -> Vec<u8> {
    let mut header = vec![0; HEADER_1_4];
    header[..4].copy_from_slice(b"LASF");
    header[at::VERSION_MINOR - 1..=at::VERSION_MINOR].copy_from_slice(&[1, 4]);
    // The same cloud gives the same file, today and tomorrow: no date.
    let software = concat!("chladni ", env!("CARGO_PKG_VERSION"));
    put(&mut header, at::SOFTWARE, software.as_bytes());
    put(&mut header, at::HEADER_SIZE, &(HEADER_1_4 as u16).to_le_bytes());
    header
}

/// Smallest and largest coordinates. Those of the file are kept where they are right to a step.
fn put_bounds(header: &mut [u8], cloud: &PointCloud, axes: &[Axis; 3]) {
    for (index, axis) in axes.iter().enumerate() {
        let steps = (0..cloud.len()).map(|row| axis.encode(cloud, row));
        let (low, high) = steps.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), x| (a.min(x), b.max(x)));
        let (a, b) = (axis.grid.coordinate(low), axis.grid.coordinate(high));
        for (value, at) in [(a.max(b), at::BOUNDS + 16 * index), (a.min(b), at::BOUNDS + 16 * index + 8)] {
            let is_right =
                f64_at(header, at).is_some_and(|before| (before - value).abs() <= axis.grid.scale.abs());
            if !is_right {
                put(header, at, &value.to_le_bytes());
            }
        }
    }
}

/// Numbers of points, all and by return, in the fields that the version has.
fn put_counts(header: &mut [u8], count: usize, points: &Points<'_>, is_1_4: bool) -> io::Result<()> {
    let mut returns = [0_u64; 15];
    for &number in points.attribute("return_number").unwrap_or_default() {
        if let Some(slot) = (number as usize).checked_sub(1).and_then(|index| returns.get_mut(index)) {
            *slot += 1;
        }
    }
    let count = count as u64;
    let had_legacy = u32_at(header, at::POINTS_LEGACY).is_some_and(|points| points > 0);
    let fits = u32::try_from(count).is_ok();
    if !fits && !is_1_4 {
        return Err(super::unsupported("LAS before 1.4 holds 4294967295 points at most".to_owned()));
    }
    // Formats from 6 on leave the numbers of 32 bits at 0 [table 3].
    let is_legacy = points.format < 6 && fits && (!is_1_4 || had_legacy);
    let legacy = |count: u64| (if is_legacy { count as u32 } else { 0 }).to_le_bytes();
    put(header, at::POINTS_LEGACY, &legacy(count));
    for (index, &count) in returns[..5].iter().enumerate() {
        put(header, at::RETURNS_LEGACY + 4 * index, &legacy(count));
    }
    if is_1_4 {
        put(header, at::POINTS, &count.to_le_bytes());
        for (index, count) in returns.iter().enumerate() {
            put(header, at::RETURNS + 8 * index, &count.to_le_bytes());
        }
    }
    Ok(())
}

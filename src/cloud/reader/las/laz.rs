//! Unpacking LAZ, chunks side by side: what the crate `laz` allocates is held against the file first.

use std::io::{Cursor, Seek, SeekFrom};
use std::ops::Range;

use laz::laszip::ChunkTable;
use laz::record::{LayeredPointRecordDecompressor, RecordDecompressor, SequentialPointRecordDecompressor};
use laz::{LasZipDecompressor, LazItemType, LazVlr};
use rayon::prelude::*;

use super::file::File;
use crate::cloud::las::Record;
use crate::cloud::reader::{Format, ReadError, check_unpacked, guarded};

/// Points unpacked together where chunks are not known: memory grows with what has been unpacked.
const BATCH: usize = 50_000;

/// Points that are packed together, and by themselves.
struct Chunk {
    /// Where in the file.
    place: Range<usize>,
    points: usize,
}

/// The points of a file as records of `file.record` bytes.
pub(super) fn unpack(bytes: &[u8], file: &File<'_>) -> Result<Vec<u8>, ReadError> {
    let length = file.points.saturating_mul(file.record);
    check_unpacked(Format::Laz, bytes.len(), length)?;
    let is_ours = |record: &&Record<'_>| {
        record.user() == LazVlr::USER_ID.as_bytes() && record.number() == LazVlr::RECORD_ID
    };
    let record = file.records.iter().find(is_ours);
    let record = record
        .ok_or_else(|| file.refuse(file.body, "the record that describes the compression is missing"))?;
    // Compressor 1 has no chunks, and is what LASzip wrote before 2011.
    if let Some(compressor @ (0 | 1)) = record.data.first_chunk().map(|bytes| u16::from_le_bytes(*bytes)) {
        let message = format!(
            "the points are packed by compressor {compressor} of LASzip, which is not supported; compressors 2 and 3 are: \
             write the file again with a LASzip of 2.0 or later"
        );
        return Err(file.refuse(file.body, message));
    }
    let described =
        LazVlr::from_buffer(record.data).map_err(|error| file.refuse(file.body, error.to_string()))?;
    if described.items_size() != file.record as u64 {
        let message =
            format!("compressed points have {} bytes, {} are announced", described.items_size(), file.record);
        return Err(file.refuse(file.body, message));
    }
    check_chunk_table(bytes, file)?;
    // The version of the first item decides how `laz` unpacks; 3 and 4 are layers.
    let is_layered = described.items().first().is_some_and(|item| item.version() > 2);
    let chunks =
        if is_layered { Some(layered(bytes, file, &described)?) } else { listed(bytes, file, &described) };
    match chunks {
        Some(chunks) => side_by_side(bytes, file, &described, &chunks, is_layered),
        None => one_by_one(bytes, file, described),
    }
}

/// Unpacks chunks of which it is known where they are.
fn side_by_side(
    bytes: &[u8],
    file: &File<'_>,
    described: &LazVlr,
    chunks: &[Chunk],
    is_layered: bool,
) -> Result<Vec<u8>, ReadError> {
    let mut records = vec![0; file.points * file.record];
    let (mut rest, mut parts, mut done) = (records.as_mut_slice(), Vec::new(), 0);
    for chunk in chunks {
        let (part, behind) = rest.split_at_mut(chunk.points * file.record);
        parts.push((done, &bytes[chunk.place.clone()], part));
        (rest, done) = (behind, done + chunk.points);
    }
    parts.into_par_iter().try_for_each(|(done, chunk, part)| {
        let source = Cursor::new(chunk);
        let unpack = || {
            let unpacked = if is_layered {
                let mut decompressor = LayeredPointRecordDecompressor::new(source);
                decompressor.set_fields_from(described.items()).map(|()| decompressor.decompress_many(part))
            } else {
                let mut decompressor = SequentialPointRecordDecompressor::new(source);
                decompressor.set_fields_from(described.items()).map(|()| decompressor.decompress_many(part))
            };
            let damaged = |error: &dyn std::fmt::Display| damaged(file, done, error);
            unpacked.map_err(|error| damaged(&error))?.map_err(|error| damaged(&error))
        };
        // A panic on another thread is caught there.
        guarded(Format::Laz, unpack)
    })?;
    Ok(records)
}

fn damaged(file: &File<'_>, done: usize, error: &dyn std::fmt::Display) -> ReadError {
    file.refuse(file.body, format!("the compressed points from {done} on are damaged: {error}"))
}

/// Unpacks a file without a table of its chunks.
fn one_by_one(bytes: &[u8], file: &File<'_>, described: LazVlr) -> Result<Vec<u8>, ReadError> {
    let length = file.points * file.record;
    let damaged = |done: usize, error: &dyn std::fmt::Display| damaged(file, done, error);
    let mut source = Cursor::new(bytes);
    source.seek(SeekFrom::Start(file.body as u64)).map_err(|error| damaged(0, &error))?;
    let mut decompressor = LasZipDecompressor::new(source, described).map_err(|error| damaged(0, &error))?;
    let mut records = Vec::new();
    while records.len() < length {
        let done = records.len();
        records.resize((done + BATCH * file.record).min(length), 0);
        decompressor
            .decompress_many(&mut records[done..])
            .map_err(|error| damaged(done / file.record, &error))?;
    }
    Ok(records)
}

/// The table of chunks has an entry per chunk, and a chunk a point at least.
fn check_chunk_table(bytes: &[u8], file: &File<'_>) -> Result<(), ReadError> {
    let number =
        |at: usize| bytes.get(at..).and_then(|rest| rest.first_chunk()).map(|b| i64::from_le_bytes(*b));
    let behind_body = |at: &i64| usize::try_from(*at).is_ok_and(|at| at > file.body);
    // Writers that cannot go back leave a placeholder, and the offset in the last bytes of the file.
    let table = number(file.body).filter(behind_body).or_else(|| number(bytes.len().checked_sub(8)?));
    let Some(table) = table.filter(behind_body).map(|at| at as usize) else { return Ok(()) };
    let chunks = bytes.get(table + 4..).and_then(|rest| rest.first_chunk()).map(|b| u32::from_le_bytes(*b));
    match chunks {
        Some(chunks) if chunks as usize > file.points.max(1) => {
            let message = format!("{chunks} chunks are announced for {} points", file.points);
            Err(file.refuse(table, message))
        }
        _ => Ok(()),
    }
}

/// The chunks of the table; `None` where there is none, or none that fits the file.
fn listed(bytes: &[u8], file: &File<'_>, described: &LazVlr) -> Option<Vec<Chunk>> {
    let mut source = Cursor::new(bytes);
    source.set_position(file.body as u64);
    let table = ChunkTable::read_from(&mut source, described).ok()?;
    let (mut at, mut left) = (file.body + ChunkTable::OFFSET_SIZE, file.points);
    let mut chunks = Vec::new();
    for entry in table.as_ref() {
        let end =
            at.checked_add(usize::try_from(entry.byte_count).ok()?).filter(|&end| end <= bytes.len())?;
        // The last of equal chunks has what is left.
        let points = left.min(usize::try_from(entry.point_count).ok()?);
        chunks.push(Chunk { place: at..end, points });
        (at, left) = (end, left - points);
    }
    chunks.retain(|chunk| chunk.points > 0);
    (left == 0).then_some(chunks)
}

/// Chunks of layers (point formats 6 to 10) announce the length of every layer: walks along all of them.
fn layered(bytes: &[u8], file: &File<'_>, described: &LazVlr) -> Result<Vec<Chunk>, ReadError> {
    let layers: usize = described
        .items()
        .iter()
        .map(|item| match item.item_type() {
            // Coordinates, flags, classification and the others are packed apart from each other.
            LazItemType::Point14 => 9,
            LazItemType::RGBNIR14 => 2,
            LazItemType::Byte14(count) => count.into(),
            _ => 1,
        })
        .sum();
    let number = |at: usize| {
        bytes.get(at..).and_then(|rest| rest.first_chunk()).map(|b| u32::from_le_bytes(*b) as usize)
    };
    let (mut at, mut points) = (file.body + ChunkTable::OFFSET_SIZE, 0);
    let mut chunks = Vec::new();
    while points < file.points {
        let start = at;
        let counts = at + file.record;
        let lengths =
            |counts: usize| (1..=layers).map(|layer| number(counts + 4 * layer)).sum::<Option<usize>>();
        let (Some(count @ 1..), Some(length)) = (number(counts), lengths(counts)) else {
            return Err(file.refuse(at, format!("a chunk is incomplete behind {points} points")));
        };
        at = counts + 4 + 4 * layers + length;
        if at > bytes.len() {
            let message =
                format!("a chunk of {count} points reaches {} bytes beyond the file", at - bytes.len());
            return Err(file.refuse(counts, message));
        }
        chunks.push(Chunk { place: start..at, points: count.min(file.points - points) });
        points += count;
    }
    Ok(chunks)
}

//! Columns of numbers become rows of bytes.

use crate::cloud::ScalarType;

/// A number per row: every `stride`-th of `values`, from the first.
#[derive(Debug, Clone, Copy)]
pub struct Column<'a> {
    /// The numbers.
    pub values: &'a [f64],
    /// Distance from one row's number to the next one's, at least 1.
    pub stride: usize,
    /// Type in which they are written. Integer types take values rounded and within their range; NaN becomes 0.
    pub kind: ScalarType,
}

/// Rows written together, so that a block of output stays in the cache while every column passes through it.
const BLOCK_ROWS: usize = 64;

/// `rows` rows, in each the numbers of all columns one after another, little-endian. Numbers that a column does
/// not have are 0.
#[must_use]
pub fn encode_rows(columns: &[Column<'_>], rows: usize) -> Vec<u8> {
    let width: usize = columns.iter().map(|column| column.kind.size()).sum();
    let mut bytes = Vec::with_capacity(rows * width);
    for first in (0..rows).step_by(BLOCK_ROWS) {
        // A whole answer of zeros would come as fresh pages from the system, which takes longer than all that follows.
        bytes.resize(rows.min(first + BLOCK_ROWS) * width, 0);
        let block = &mut bytes[first * width..];
        let mut offset = 0;
        for column in columns {
            let from = column.values.get(first * column.stride..).unwrap_or_default();
            encode(from.iter().step_by(column.stride.max(1)), column.kind, block, width, offset);
            offset += column.kind.size();
        }
    }
    bytes
}

/// Writes one column into rows of `width` bytes, at `offset` of each.
///
/// # Panics
/// When the number does not fit behind `offset`.
pub fn encode_column(column: Column<'_>, rows: &mut [u8], width: usize, offset: usize) {
    encode(column.values.iter().step_by(column.stride.max(1)), column.kind, rows, width, offset);
}

fn encode<'a>(
    values: impl Iterator<Item = &'a f64>,
    kind: ScalarType,
    rows: &mut [u8],
    width: usize,
    offset: usize,
) {
    match kind {
        ScalarType::Int8 => place(values, rows, width, offset, |x| (x.round() as i8).to_le_bytes()),
        ScalarType::Uint8 => place(values, rows, width, offset, |x| (x.round() as u8).to_le_bytes()),
        ScalarType::Int16 => place(values, rows, width, offset, |x| (x.round() as i16).to_le_bytes()),
        ScalarType::Uint16 => place(values, rows, width, offset, |x| (x.round() as u16).to_le_bytes()),
        ScalarType::Int32 => place(values, rows, width, offset, |x| (x.round() as i32).to_le_bytes()),
        ScalarType::Uint32 => place(values, rows, width, offset, |x| (x.round() as u32).to_le_bytes()),
        ScalarType::Float32 => place(values, rows, width, offset, |x| (x as f32).to_le_bytes()),
        ScalarType::Float64 => place(values, rows, width, offset, f64::to_le_bytes),
    }
}

fn place<'a, const N: usize>(
    values: impl Iterator<Item = &'a f64>,
    rows: &mut [u8],
    width: usize,
    offset: usize,
    convert: impl Fn(f64) -> [u8; N],
) {
    for (row, &value) in rows.chunks_exact_mut(width).zip(values) {
        row[offset..offset + N].copy_from_slice(&convert(value));
    }
}

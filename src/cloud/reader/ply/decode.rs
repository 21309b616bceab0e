//! Binary numbers at fixed places become `f64`.

use crate::cloud::ScalarType;

/// Which byte comes first.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::cloud::reader) enum ByteOrder {
    /// The least significant.
    Little,
    /// The most significant.
    Big,
}

/// Decodes the value at `offset` of every row of `stride` bytes into the next `out`.
///
/// The type is looked at once per column and not once per value.
pub(in crate::cloud::reader) fn decode<'a>(
    rows: &[u8],
    stride: usize,
    offset: usize,
    kind: ScalarType,
    order: ByteOrder,
    out: impl Iterator<Item = &'a mut f64>,
) {
    use ByteOrder::{Big, Little};
    match (kind, order) {
        (ScalarType::Int8, _) => column(rows, stride, offset, out, |b| i8::from_le_bytes(b).into()),
        (ScalarType::Uint8, _) => column(rows, stride, offset, out, |b| u8::from_le_bytes(b).into()),
        (ScalarType::Int16, Little) => column(rows, stride, offset, out, |b| i16::from_le_bytes(b).into()),
        (ScalarType::Int16, Big) => column(rows, stride, offset, out, |b| i16::from_be_bytes(b).into()),
        (ScalarType::Uint16, Little) => column(rows, stride, offset, out, |b| u16::from_le_bytes(b).into()),
        (ScalarType::Uint16, Big) => column(rows, stride, offset, out, |b| u16::from_be_bytes(b).into()),
        (ScalarType::Int32, Little) => column(rows, stride, offset, out, |b| i32::from_le_bytes(b).into()),
        (ScalarType::Int32, Big) => column(rows, stride, offset, out, |b| i32::from_be_bytes(b).into()),
        (ScalarType::Uint32, Little) => column(rows, stride, offset, out, |b| u32::from_le_bytes(b).into()),
        (ScalarType::Uint32, Big) => column(rows, stride, offset, out, |b| u32::from_be_bytes(b).into()),
        (ScalarType::Float32, Little) => column(rows, stride, offset, out, |b| f32::from_le_bytes(b).into()),
        (ScalarType::Float32, Big) => column(rows, stride, offset, out, |b| f32::from_be_bytes(b).into()),
        (ScalarType::Float64, Little) => column(rows, stride, offset, out, f64::from_le_bytes),
        (ScalarType::Float64, Big) => column(rows, stride, offset, out, f64::from_be_bytes),
    }
}

/// [`decode`] for integers of 64 bits, which PLY does not have; exact up to 2⁵³.
pub(in crate::cloud::reader) fn decode_integers<'a>(
    rows: &[u8],
    stride: usize,
    offset: usize,
    is_signed: bool,
    order: ByteOrder,
    out: impl Iterator<Item = &'a mut f64>,
) {
    match (is_signed, order) {
        (true, ByteOrder::Little) => column(rows, stride, offset, out, |b| i64::from_le_bytes(b) as f64),
        (true, ByteOrder::Big) => column(rows, stride, offset, out, |b| i64::from_be_bytes(b) as f64),
        (false, ByteOrder::Little) => column(rows, stride, offset, out, |b| u64::from_le_bytes(b) as f64),
        (false, ByteOrder::Big) => column(rows, stride, offset, out, |b| u64::from_be_bytes(b) as f64),
    }
}

/// Converts N bytes at `offset` of every row.
fn column<'a, const N: usize>(
    rows: &[u8],
    stride: usize,
    offset: usize,
    out: impl Iterator<Item = &'a mut f64>,
    convert: impl Fn([u8; N]) -> f64,
) {
    for (row, value) in rows.chunks_exact(stride).zip(out) {
        if let Some(bytes) = row[offset..].first_chunk::<N>() {
            *value = convert(*bytes);
        }
    }
}

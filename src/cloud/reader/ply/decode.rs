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

/// Where values go: the one at `offset` of every `stride` numbers.
pub(in crate::cloud::reader) struct Place<'a> {
    pub(in crate::cloud::reader) out: &'a mut [f64],
    pub(in crate::cloud::reader) stride: usize,
    pub(in crate::cloud::reader) offset: usize,
}

impl<'a> Place<'a> {
    /// One value after another.
    pub(in crate::cloud::reader) fn packed(out: &'a mut [f64]) -> Self {
        Self { out, stride: 1, offset: 0 }
    }
}

/// Decodes the value at `offset` of every row of `stride` bytes into its place.
///
/// The type is looked at once per column and not once per value.
pub(in crate::cloud::reader) fn decode(
    rows: &[u8],
    stride: usize,
    offset: usize,
    kind: ScalarType,
    order: ByteOrder,
    place: Place<'_>,
) {
    use ByteOrder::{Big, Little};
    match (kind, order) {
        (ScalarType::Int8, _) => column(rows, stride, offset, place, |b| i8::from_le_bytes(b).into()),
        (ScalarType::Uint8, _) => column(rows, stride, offset, place, |b| u8::from_le_bytes(b).into()),
        (ScalarType::Int16, Little) => column(rows, stride, offset, place, |b| i16::from_le_bytes(b).into()),
        (ScalarType::Int16, Big) => column(rows, stride, offset, place, |b| i16::from_be_bytes(b).into()),
        (ScalarType::Uint16, Little) => column(rows, stride, offset, place, |b| u16::from_le_bytes(b).into()),
        (ScalarType::Uint16, Big) => column(rows, stride, offset, place, |b| u16::from_be_bytes(b).into()),
        (ScalarType::Int32, Little) => column(rows, stride, offset, place, |b| i32::from_le_bytes(b).into()),
        (ScalarType::Int32, Big) => column(rows, stride, offset, place, |b| i32::from_be_bytes(b).into()),
        (ScalarType::Uint32, Little) => column(rows, stride, offset, place, |b| u32::from_le_bytes(b).into()),
        (ScalarType::Uint32, Big) => column(rows, stride, offset, place, |b| u32::from_be_bytes(b).into()),
        (ScalarType::Float32, Little) => {
            column(rows, stride, offset, place, |b| f32::from_le_bytes(b).into());
        }
        (ScalarType::Float32, Big) => column(rows, stride, offset, place, |b| f32::from_be_bytes(b).into()),
        (ScalarType::Float64, Little) => column(rows, stride, offset, place, f64::from_le_bytes),
        (ScalarType::Float64, Big) => column(rows, stride, offset, place, f64::from_be_bytes),
    }
}

/// [`decode`] for integers of 64 bits, which PLY does not have; exact up to 2⁵³.
pub(in crate::cloud::reader) fn decode_integers(
    rows: &[u8],
    stride: usize,
    offset: usize,
    is_signed: bool,
    order: ByteOrder,
    place: Place<'_>,
) {
    match (is_signed, order) {
        (true, ByteOrder::Little) => column(rows, stride, offset, place, |b| i64::from_le_bytes(b) as f64),
        (true, ByteOrder::Big) => column(rows, stride, offset, place, |b| i64::from_be_bytes(b) as f64),
        (false, ByteOrder::Little) => column(rows, stride, offset, place, |b| u64::from_le_bytes(b) as f64),
        (false, ByteOrder::Big) => column(rows, stride, offset, place, |b| u64::from_be_bytes(b) as f64),
    }
}

/// Converts N bytes at `offset` of every row.
fn column<const N: usize>(
    rows: &[u8],
    stride: usize,
    offset: usize,
    place: Place<'_>,
    convert: impl Fn([u8; N]) -> f64,
) {
    let Place { out, stride: stride_out, offset: offset_out } = place;
    for (row, out) in rows.chunks_exact(stride).zip(out.chunks_mut(stride_out)) {
        if let Some(bytes) = row[offset..].first_chunk::<N>() {
            out[offset_out] = convert(*bytes);
        }
    }
}

//! Binary numbers at fixed places become `f64`.

use crate::cloud::ScalarType;

/// Which byte comes first.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum ByteOrder {
    /// The least significant.
    Little,
    /// The most significant.
    Big,
}

/// Where values go: the one at `offset` of every `stride` numbers.
pub(super) struct Place<'a> {
    pub(super) out: &'a mut [f64],
    pub(super) stride: usize,
    pub(super) offset: usize,
}

impl<'a> Place<'a> {
    /// One value after another.
    pub(super) fn packed(out: &'a mut [f64]) -> Self {
        Self { out, stride: 1, offset: 0 }
    }
}

/// Decodes the value at `offset` of every row of `stride` bytes into its place.
///
/// The type is looked at once per column and not once per value.
pub(super) fn decode(
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
pub(super) fn decode_integers(
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

/// Decodes three numbers behind each other, at `offset` of every row, into points in space; `false`, and nothing is done,
/// for types that coordinates rarely have.
pub(super) fn decode_points(
    rows: &[u8],
    stride: usize,
    offset: usize,
    kind: ScalarType,
    order: ByteOrder,
    points: &mut [[f64; 3]],
) -> bool {
    use ByteOrder::{Big, Little};
    match (kind, order) {
        (ScalarType::Float32, Little) => {
            triples(rows, stride, offset, points, |b| f32::from_le_bytes(b).into());
        }
        (ScalarType::Float32, Big) => triples(rows, stride, offset, points, |b| f32::from_be_bytes(b).into()),
        (ScalarType::Float64, Little) => triples(rows, stride, offset, points, f64::from_le_bytes),
        (ScalarType::Float64, Big) => triples(rows, stride, offset, points, f64::from_be_bytes),
        _ => return false,
    }
    true
}

/// Converts three times N bytes at `offset` of every row.
fn triples<const N: usize>(
    rows: &[u8],
    stride: usize,
    offset: usize,
    points: &mut [[f64; 3]],
    convert: impl Fn([u8; N]) -> f64,
) {
    if stride == 3 * N {
        // Nothing in between: the compiler converts several at once.
        let numbers = rows.as_chunks::<N>().0;
        numbers.iter().zip(points.as_flattened_mut()).for_each(|(bytes, out)| *out = convert(*bytes));
        return;
    }
    for (row, point) in rows.get(offset..).unwrap_or_default().chunks(stride).zip(points) {
        if let Some([x, y, z]) = row.as_chunks::<N>().0.first_chunk::<3>() {
            *point = [convert(*x), convert(*y), convert(*z)];
        }
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
    let numbers =
        rows.get(offset..).unwrap_or_default().chunks(stride).map_while(|row| row.first_chunk::<N>());
    // Without a stride the places are known to follow each other, and need no check.
    if stride_out == 1 {
        numbers.zip(out).for_each(|(bytes, out)| *out = convert(*bytes));
    } else {
        let places = out.get_mut(offset_out..).unwrap_or_default().iter_mut().step_by(stride_out);
        numbers.zip(places).for_each(|(bytes, out)| *out = convert(*bytes));
    }
}

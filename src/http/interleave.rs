//! Columns of numbers to rows of bytes.

use crate::cloud::ScalarType;

/// A number per row, every `stride`-th of `values` from the first.
#[derive(Debug, Clone, Copy)]
pub struct Column<'a> {
    /// The numbers.
    pub values: &'a [f64],
    /// Distance from one row's number to the next one's, at least 1.
    pub stride: usize,
    /// Type in which they are written.
    pub kind: ScalarType,
}

/// Rows written together, so that a block of output stays in the cache while every column passes through it.
const BLOCK_ROWS: usize = 64;

/// `rows` rows, in each the numbers of all columns one after another, little-endian.
#[must_use]
pub fn rows(columns: &[Column<'_>], rows: usize) -> Vec<u8> {
    let width: usize = columns.iter().map(|column| column.kind.size()).sum();
    let mut bytes = vec![0; rows * width];
    for (block, bytes) in bytes.chunks_mut(BLOCK_ROWS * width.max(1)).enumerate() {
        let mut offset = 0;
        for column in columns {
            let values = column.values[block * BLOCK_ROWS * column.stride..].iter().step_by(column.stride);
            write(&mut bytes[offset..], width, values.copied(), column.kind);
            offset += column.kind.size();
        }
    }
    bytes
}

/// Writes a number at the beginning of every `width` bytes.
fn write(bytes: &mut [u8], width: usize, values: impl Iterator<Item = f64>, kind: ScalarType) {
    macro_rules! as_type {
        ($number:ty) => {
            for (row, value) in bytes.chunks_mut(width).zip(values) {
                row[..size_of::<$number>()].copy_from_slice(&(value as $number).to_le_bytes());
            }
        };
    }
    match kind {
        ScalarType::Int8 => as_type!(i8),
        ScalarType::Uint8 => as_type!(u8),
        ScalarType::Int16 => as_type!(i16),
        ScalarType::Uint16 => as_type!(u16),
        ScalarType::Int32 => as_type!(i32),
        ScalarType::Uint32 => as_type!(u32),
        ScalarType::Float32 => as_type!(f32),
        ScalarType::Float64 => as_type!(f64),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_row_holds_its_number_of_every_column() {
        let n = 2 * BLOCK_ROWS + 3;
        let pairs: Vec<f64> = (0..2 * n).map(|i| i as f64).collect();
        let bytes = rows(
            &[
                Column { values: &pairs, stride: 2, kind: ScalarType::Float32 },
                Column { values: &pairs[1..], stride: 2, kind: ScalarType::Float64 },
                Column { values: &pairs[..n], stride: 1, kind: ScalarType::Uint8 },
            ],
            n,
        );
        assert_eq!(bytes.len(), n * 13);
        for (row, bytes) in bytes.chunks(13).enumerate() {
            assert_eq!(bytes[..4], (2.0 * row as f32).to_le_bytes());
            assert_eq!(bytes[4..12], (2.0 * row as f64 + 1.0).to_le_bytes());
            assert_eq!(bytes[12], row as u8);
        }
    }
}

//! Numbers as bytes: how chunks are written, read and checked. No SQL here.

use sha2::{Digest, Sha256};

use super::{CHUNK_POINTS, StoreError};
use crate::cloud::ScalarType;

/// SHA-256.
pub(super) type Checksum = [u8; 32];

/// A number of a fixed width, stored little-endian.
pub(super) trait Number: Copy {
    fn write(values: &[Self]) -> Vec<u8>;
    /// Appends the numbers in `bytes`; false when `bytes` does not divide into numbers.
    fn read(bytes: &[u8], values: &mut Vec<Self>) -> bool;
}

macro_rules! number {
    ($($kind:ty),*) => {$(
        impl Number for $kind {
            fn write(values: &[Self]) -> Vec<u8> {
                let mut bytes = vec![0; size_of_val(values)];
                let (places, _) = bytes.as_chunks_mut::<{ size_of::<$kind>() }>();
                for (place, value) in places.iter_mut().zip(values) {
                    *place = value.to_le_bytes();
                }
                bytes
            }

            fn read(bytes: &[u8], values: &mut Vec<Self>) -> bool {
                let (numbers, rest) = bytes.as_chunks::<{ size_of::<$kind>() }>();
                values.extend(numbers.iter().map(|number| Self::from_le_bytes(*number)));
                rest.is_empty()
            }
        }
    )*};
}
number!(i8, u8, i16, u16, i32, u32, u64, f32, f64);

/// Checksum of a chunk. Its place is part of it, so that chunks that changed places are found too.
pub(super) fn checksum(index: usize, chunk: usize, bytes: &[u8]) -> Checksum {
    let mut hash = Sha256::new();
    hash.update((index as u64).to_le_bytes());
    hash.update((chunk as u64).to_le_bytes());
    hash.update(bytes);
    hash.finalize().into()
}

/// Checksum of texts, each with its length before it.
pub(super) fn text_checksum(texts: &[&str]) -> Checksum {
    let mut hash = Sha256::new();
    for text in texts {
        hash.update((text.len() as u64).to_le_bytes());
        hash.update(text);
    }
    hash.finalize().into()
}

/// Digest of a whole array: over its chunks' checksums, so that reading it whole hashes the numbers once, not twice.
#[derive(Default)]
pub(super) struct ArrayDigest(Sha256);

impl ArrayDigest {
    pub(super) fn add(&mut self, chunk: &Checksum) {
        self.0.update(chunk);
    }

    pub(super) fn finish(self) -> Checksum {
        self.0.finalize().into()
    }
}

/// An array cut into chunks, as rows of the database.
pub(super) struct Chunked {
    pub(super) chunks: Vec<(Checksum, Vec<u8>)>,
    pub(super) digest: Checksum,
}

/// Bytes of a chunk of all bases of a job, at most, as long as that leaves [`BASIS_CHUNK_POINTS_MIN`] rows. Whoever serves
/// bases row by row has a few such chunks in memory: read, encoded, and being sent.
const BASES_CHUNK_BYTES: usize = 4 << 20;
/// Rows of a chunk, at least: below, the database's rows would be more keys and checksums than numbers.
const BASIS_CHUNK_POINTS_MIN: usize = 64;

/// Bytes of a page of the database, of its head, and of its reference to the page that goes on with a long row
/// (<https://www.sqlite.org/fileformat2.html>, sections 1.6 and 2.1).
const PAGE_BYTES: usize = 16_384;
const PAGE_HEAD: usize = 8;
const PAGE_LINK: usize = 4;
/// Bytes of a chunk's row beside its numbers, at most: checksum, keys, their lengths, and the row's place in the page.
const CHUNK_ROW_BYTES: usize = 90;

/// Rows per chunk of a job of so many bases: those that a power of two of them has, less the few that leave room for the
/// row's other columns. So a chunk fills whole pages, or several fill one; of the power of two itself, every page or every
/// chunk's last page would be half empty.
pub(super) fn basis_chunk_points(bases: usize) -> usize {
    let power = fitting_power(bases);
    if power == CHUNK_POINTS {
        return power;
    }
    let bytes = size_of::<f64>() * power;
    let content = match bytes / PAGE_BYTES {
        0 => (PAGE_BYTES - PAGE_HEAD) / (PAGE_BYTES / bytes),
        pages => bytes - PAGE_HEAD - PAGE_LINK * pages,
    };
    ((content - CHUNK_ROW_BYTES) / size_of::<f64>()).max(BASIS_CHUNK_POINTS_MIN)
}

/// Bytes of the rows into which PostgreSQL cuts a long value
/// (<https://www.postgresql.org/docs/current/storage-toast.html>; `TOAST_MAX_CHUNK_SIZE` of pages of 8 KiB).
const PIECE_BYTES: usize = 1996;

/// As [`basis_chunk_points`], for PostgreSQL: as many as fill whole pieces. Of the power of two itself, each chunk would have
/// one more piece of a few bytes.
pub(super) fn toasted_basis_chunk_points(bases: usize) -> usize {
    let power = fitting_power(bases);
    let pieces = size_of::<f64>() * power / PIECE_BYTES;
    if power == CHUNK_POINTS || pieces == 0 { power } else { pieces * PIECE_BYTES / size_of::<f64>() }
}

/// The largest power of two of rows with which a chunk of all bases keeps within its bytes.
fn fitting_power(bases: usize) -> usize {
    let fitting = BASES_CHUNK_BYTES / (size_of::<f64>() * bases.max(1));
    fitting.checked_ilog2().map_or(0, |power| 1 << power).clamp(BASIS_CHUNK_POINTS_MIN, CHUNK_POINTS)
}

/// Cuts `values` into chunks of `length` numbers.
pub(super) fn cut<T: Number>(index: usize, values: &[T], length: usize) -> Chunked {
    let mut digest = ArrayDigest::default();
    let chunks = values.chunks(length).enumerate().map(|(chunk, values)| {
        let bytes = T::write(values);
        let sum = checksum(index, chunk, &bytes);
        digest.add(&sum);
        (sum, bytes)
    });
    Chunked { chunks: chunks.collect(), digest: digest.finish() }
}

/// Appends the numbers of a chunk whose checksum holds.
pub(super) fn read_checked<T: Number>(
    (index, chunk): (usize, usize),
    stored: &[u8],
    bytes: &[u8],
    values: &mut Vec<T>,
) -> Result<Checksum, StoreError> {
    let sum = checksum(index, chunk, bytes);
    if sum.as_slice() != stored || !T::read(bytes, values) {
        return Err(StoreError::Damaged(format!("chunk {chunk} of array {index}")));
    }
    Ok(sum)
}

/// Bytes of `values` in the narrowest of `wished` and `f64` that gives every value back bit for bit, and which it was.
///
/// A field's declared type is a claim about its values that nothing enforces; the bits are the truth.
pub(super) fn write_exactly(values: &[f64], wished: ScalarType) -> (ScalarType, Vec<u8>) {
    let narrow = match wished {
        ScalarType::Int8 => narrowed(values, |x| x as i8, f64::from),
        ScalarType::Uint8 => narrowed(values, |x| x as u8, f64::from),
        ScalarType::Int16 => narrowed(values, |x| x as i16, f64::from),
        ScalarType::Uint16 => narrowed(values, |x| x as u16, f64::from),
        ScalarType::Int32 => narrowed(values, |x| x as i32, f64::from),
        ScalarType::Uint32 => narrowed(values, |x| x as u32, f64::from),
        ScalarType::Float32 => narrowed(values, |x| x as f32, f64::from),
        ScalarType::Float64 => None,
    };
    narrow.map_or_else(|| (ScalarType::Float64, f64::write(values)), |bytes| (wished, bytes))
}

fn narrowed<T: Number>(
    values: &[f64],
    narrow: impl Fn(f64) -> T,
    widen: impl Fn(T) -> f64,
) -> Option<Vec<u8>> {
    let mut numbers = Vec::with_capacity(values.len());
    for &value in values {
        let number = narrow(value);
        if widen(number).to_bits() != value.to_bits() {
            return None;
        }
        numbers.push(number);
    }
    Some(T::write(&numbers))
}

/// The inverse of [`write_exactly`]; false when `bytes` does not divide into numbers.
pub(super) fn read_exactly(kind: ScalarType, bytes: &[u8], values: &mut Vec<f64>) -> bool {
    fn widened<T: Number + Into<f64>>(bytes: &[u8], values: &mut Vec<f64>) -> bool {
        let mut numbers: Vec<T> = Vec::new();
        let whole = T::read(bytes, &mut numbers);
        values.extend(numbers.into_iter().map(Into::into));
        whole
    }
    match kind {
        ScalarType::Int8 => widened::<i8>(bytes, values),
        ScalarType::Uint8 => widened::<u8>(bytes, values),
        ScalarType::Int16 => widened::<i16>(bytes, values),
        ScalarType::Uint16 => widened::<u16>(bytes, values),
        ScalarType::Int32 => widened::<i32>(bytes, values),
        ScalarType::Uint32 => widened::<u32>(bytes, values),
        ScalarType::Float32 => widened::<f32>(bytes, values),
        ScalarType::Float64 => f64::read(bytes, values),
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const KINDS: [ScalarType; 8] = [
        ScalarType::Int8,
        ScalarType::Uint8,
        ScalarType::Int16,
        ScalarType::Uint16,
        ScalarType::Int32,
        ScalarType::Uint32,
        ScalarType::Float32,
        ScalarType::Float64,
    ];

    proptest! {
        #[test]
        fn whatever_the_declared_type_every_bit_pattern_comes_back(
            patterns in prop::collection::vec(
                prop_oneof![
                    any::<u64>(),
                    (-300i32..70_000).prop_map(|x| f64::from(x).to_bits()),
                    any::<f32>().prop_map(|x| f64::from(x).to_bits()),
                ],
                0..40,
            ),
            kind in prop::sample::select(KINDS.to_vec()),
        ) {
            let values: Vec<f64> = patterns.iter().map(|&bits| f64::from_bits(bits)).collect();
            let (encoding, bytes) = write_exactly(&values, kind);
            let mut back = Vec::new();
            prop_assert!(read_exactly(encoding, &bytes, &mut back));
            let back: Vec<u64> = back.iter().map(|x| x.to_bits()).collect();
            prop_assert_eq!(back, patterns);
        }
    }

    #[test]
    fn values_that_fit_their_declared_type_take_its_width() {
        let (encoding, bytes) = write_exactly(&[0.0, 255.0], ScalarType::Uint8);
        assert_eq!((encoding, bytes.as_slice()), (ScalarType::Uint8, [0, 255].as_slice()));
        let (encoding, bytes) = write_exactly(&[0.5, f64::NAN], ScalarType::Float32);
        assert_eq!((encoding, bytes.len()), (ScalarType::Float32, 8));
    }

    #[test]
    fn values_that_do_not_fit_their_declared_type_are_kept_as_doubles() {
        for value in [256.0, -1.0, 0.5, -0.0, f64::NAN, f64::INFINITY] {
            assert_eq!(write_exactly(&[value], ScalarType::Uint8).0, ScalarType::Float64, "{value}");
        }
        assert_eq!(write_exactly(&[0.1], ScalarType::Float32).0, ScalarType::Float64);
    }

    #[test]
    fn a_chunk_of_all_bases_is_bounded_in_bytes_and_few_bases_have_long_ones() {
        for (bases, points) in [(0, 8192), (64, 8192), (65, 4082), (256, 2035), (257, 1012), (1000, 500)] {
            assert_eq!(basis_chunk_points(bases), points, "{bases}");
        }
        for bases in 1..=8192 {
            assert!(8 * bases * basis_chunk_points(bases) <= BASES_CHUNK_BYTES, "{bases}");
            assert!(8 * bases * toasted_basis_chunk_points(bases) <= BASES_CHUNK_BYTES, "{bases}");
        }
        for (bases, points) in [(64, 8192), (65, 3992), (256, 1996), (257, 998), (1000, 499), (8192, 64)] {
            assert_eq!(toasted_basis_chunk_points(bases), points, "{bases}");
        }
        assert_eq!(basis_chunk_points(1_000_000), BASIS_CHUNK_POINTS_MIN);
    }

    #[test]
    fn a_chunk_with_a_changed_bit_is_refused() {
        let cut = cut(3, &[1.0, 2.0, 3.0], 2);
        let (sum, mut bytes) = cut.chunks[1].clone();
        let mut values: Vec<f64> = Vec::new();
        assert!(read_checked((3, 1), &sum, &bytes, &mut values).is_ok());
        bytes[4] ^= 1;
        assert!(matches!(read_checked((3, 1), &sum, &bytes, &mut values), Err(StoreError::Damaged(_))));
    }

    #[test]
    fn a_chunk_at_another_chunks_place_is_refused() {
        let cut = cut(3, &[1.0, 1.0], 1);
        let (sum, bytes) = &cut.chunks[1];
        let mut values: Vec<f64> = Vec::new();
        assert!(matches!(read_checked((3, 0), sum, bytes, &mut values), Err(StoreError::Damaged(_))));
        assert!(matches!(read_checked((2, 1), sum, bytes, &mut values), Err(StoreError::Damaged(_))));
    }

    #[test]
    fn bytes_that_do_not_divide_into_numbers_are_refused() {
        let bytes = [0u8; 9];
        let sum = checksum(0, 0, &bytes);
        let mut values: Vec<f64> = Vec::new();
        assert!(matches!(read_checked((0, 0), &sum, &bytes, &mut values), Err(StoreError::Damaged(_))));
        assert!(!read_exactly(ScalarType::Int16, &bytes, &mut values));
    }
}

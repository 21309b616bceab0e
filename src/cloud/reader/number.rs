//! Columns of binary numbers at fixed places, and the number types that NumPy, PCD and LAS have.

use std::ops::Range;

use super::columns::{Columns, Target};
use super::decode::{ByteOrder, Place, decode, decode_integers, decode_points};
use crate::cloud::scalar::Stored;
use crate::cloud::{ScalarField, ScalarType};

/// A number type.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Number {
    Scalar(ScalarType, ByteOrder),
    /// 64 bits; exact in `f64` up to 2⁵³.
    Integer {
        is_signed: bool,
        order: ByteOrder,
    },
}

impl Number {
    /// The type with this letter (`F` floating, `I` signed, `U` unsigned) and as many bytes.
    pub(super) fn of(letter: char, bytes: usize, order: ByteOrder) -> Option<Self> {
        let scalar = match (letter, bytes) {
            ('F', 4) => ScalarType::Float32,
            ('F', 8) => ScalarType::Float64,
            ('I', 1) => ScalarType::Int8,
            ('I', 2) => ScalarType::Int16,
            ('I', 4) => ScalarType::Int32,
            ('U', 1) => ScalarType::Uint8,
            ('U', 2) => ScalarType::Uint16,
            ('U', 4) => ScalarType::Uint32,
            ('I' | 'U', 8) => return Some(Self::Integer { is_signed: letter == 'I', order }),
            _ => return None,
        };
        Some(Self::Scalar(scalar, order))
    }

    /// A number as it is stored, in a byte order.
    pub(super) const fn stored(stored: Stored, order: ByteOrder) -> Self {
        match stored {
            Stored::Scalar(kind) => Self::Scalar(kind, order),
            Stored::Integer { is_signed } => Self::Integer { is_signed, order },
        }
    }

    /// A little-endian scalar.
    pub(super) const fn little(kind: ScalarType) -> Self {
        Self::Scalar(kind, ByteOrder::Little)
    }

    /// Bytes of a value.
    pub(super) fn size(self) -> usize {
        match self {
            Self::Scalar(kind, _) => kind.size(),
            Self::Integer { .. } => 8,
        }
    }

    /// The type in which such values are kept.
    pub(super) fn scalar_type(self) -> ScalarType {
        match self {
            Self::Scalar(kind, _) => kind,
            Self::Integer { .. } => ScalarType::Float64,
        }
    }
}

/// A column of a file: the number at `offset` of every `stride` bytes.
#[derive(Debug, Clone, Copy)]
pub(super) struct Source<'a> {
    pub(super) rows: &'a [u8],
    pub(super) stride: usize,
    pub(super) offset: usize,
    pub(super) number: Number,
}

impl Source<'_> {
    /// The same column of some of the rows.
    fn of(&self, rows: &Range<usize>) -> Self {
        let end = self.rows.len().min(rows.end * self.stride);
        Self { rows: self.rows.get(rows.start * self.stride..end).unwrap_or_default(), ..*self }
    }

    /// Whether `next` stands right behind it, in the same rows and of the same type.
    fn is_followed_by(&self, next: &Self) -> bool {
        std::ptr::eq(self.rows, next.rows)
            && (self.stride, self.number) == (next.stride, next.number)
            && self.offset + self.number.size() == next.offset
    }

    /// Decodes this column and the two behind it into points in space; `false`, and nothing is done, for types that
    /// coordinates rarely have.
    fn decode_points(&self, points: &mut [[f64; 3]]) -> bool {
        match self.number {
            Number::Scalar(kind, order) => {
                decode_points(self.rows, self.stride, self.offset, kind, order, points)
            }
            Number::Integer { .. } => false,
        }
    }

    /// Decodes all values into their places.
    pub(super) fn decode(&self, place: Place<'_>) {
        let &Self { rows, stride, offset, number } = self;
        match number {
            Number::Scalar(kind, order) => decode(rows, stride, offset, kind, order, place),
            Number::Integer { is_signed, order } => {
                decode_integers(rows, stride, offset, is_signed, order, place);
            }
        }
    }
}

/// Integers up to which doubles are exact.
const EXACT_MAX: f64 = 9_007_199_254_740_992.0;

/// Tells of a field of integers that doubles do not hold.
pub(super) fn rounded(field: &ScalarField) -> Option<String> {
    field
        .values
        .iter()
        .any(|x| x.abs() > EXACT_MAX)
        .then(|| format!("`{}` has integers of more than 53 bits, which were rounded to doubles", field.name))
}

/// Decodes every column into coordinates and fields, which have room for all values, and tells of integers that doubles do
/// not hold; there is a source per target.
pub(super) fn fill(columns: &mut Columns, sources: &[Source<'_>]) {
    decode_all(columns, sources);
    for (source, target) in sources.iter().zip(&columns.targets) {
        if let (Number::Integer { .. }, Target::Field(field)) = (source.number, *target) {
            columns.notes.extend(rounded(&columns.fields[field]));
        }
    }
}

/// The same without a word.
pub(super) fn decode_all(columns: &mut Columns, sources: &[Source<'_>]) {
    let (targets, dimension) = (columns.targets.clone(), columns.dimension);
    let together = together(sources, &targets, dimension);
    columns.fill_blocks(|block| {
        let points = block.coordinates.as_chunks_mut::<3>().0;
        let is_decoded = together.is_some_and(|source| source.of(&block.rows).decode_points(points));
        for (source, target) in sources.iter().zip(&targets) {
            match *target {
                Target::Coordinate(_) if is_decoded => {}
                Target::Coordinate(axis) => {
                    let place = Place { out: block.coordinates, stride: dimension, offset: axis };
                    source.of(&block.rows).decode(place);
                }
                Target::Field(field) => {
                    source.of(&block.rows).decode(Place::packed(block.field(field)));
                }
                Target::Skipped => {}
            }
        }
    });
}

/// The first of x, y and z where these stand behind each other, have one type, and are all coordinates.
fn together<'a, 'b>(
    sources: &'b [Source<'a>],
    targets: &[Target],
    dimension: usize,
) -> Option<&'b Source<'a>> {
    let axes = [0, 1, 2].map(Target::Coordinate);
    let first = targets.windows(3).position(|three| three == axes).filter(|_| dimension == 3)?;
    let are_together = sources[first..first + 3].windows(2).all(|two| two[0].is_followed_by(&two[1]));
    are_together.then(|| &sources[first])
}

#[cfg(test)]
mod tests {
    use super::super::Limits;
    use super::super::columns::Column;
    use super::*;

    /// Rows of three parts of which threads take one each.
    const ROWS: usize = 140_001;

    fn value(row: usize, column: usize) -> f32 {
        (10 * row + column) as f32
    }

    #[test]
    fn rows_and_columns_of_every_dimension_come_to_their_places() {
        for dimension in [1, 2, 3, 8] {
            let count = dimension + 2;
            // a byte between rows, so that nothing is aligned
            let stride = 4 * count + 1;
            let row = |row: usize| {
                let numbers = (0..count).flat_map(move |column| value(row, column).to_be_bytes());
                numbers.chain(std::iter::once(7))
            };
            let rows: Vec<u8> = (0..ROWS).flat_map(row).collect();
            let column = |column: usize| (0..ROWS).flat_map(move |row| value(row, column).to_be_bytes());
            let each: Vec<Vec<u8>> = (0..count).map(|index| column(index).collect()).collect();
            let number = Number::Scalar(ScalarType::Float32, ByteOrder::Big);
            let of_rows = |index| Source { rows: &rows, stride, offset: 4 * index, number };
            let of_columns = |index: usize| Source { rows: &each[index], stride: 4, offset: 0, number };
            let kind = ScalarType::Float32;
            let named: Vec<Column> =
                (0..count).map(|index| Column { kind, ..Column::unnamed(index) }).collect();
            let arrangements: [Vec<Source<'_>>; 2] =
                [(0..count).map(of_rows).collect(), (0..count).map(of_columns).collect()];
            for sources in arrangements {
                let mut columns = Columns::leading(&named, dimension, &Limits::default()).unwrap();
                columns.zeroed(ROWS).unwrap();
                fill(&mut columns, &sources);
                for row in 0..ROWS {
                    let point = &columns.coordinates[dimension * row..][..dimension];
                    let fields = [0, 1].map(|field| columns.fields[field].values[row]);
                    let found = point.iter().chain(&fields).map(|x| x.to_bits());
                    assert!(found.eq((0..count).map(|column| f64::from(value(row, column)).to_bits())));
                }
            }
        }
    }
}

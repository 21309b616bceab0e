//! Columns of binary numbers at fixed places, and the number types that NumPy, PCD and LAS have.

use super::columns::{Columns, Target};
use super::ply::{ByteOrder, Place, decode, decode_integers};
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

/// Decodes every column into coordinates and fields, which have room for all values; there is a source per target.
pub(super) fn fill(columns: &mut Columns, sources: &[Source<'_>]) {
    for (source, target) in sources.iter().zip(&columns.targets) {
        let is_wide = matches!(source.number, Number::Integer { .. });
        match *target {
            Target::Coordinate(axis) => {
                let (stride, out) = (columns.dimension, columns.coordinates.as_mut_slice());
                source.decode(Place { out, stride, offset: axis });
            }
            Target::Field(field) => {
                let field = &mut columns.fields[field];
                source.decode(Place::packed(&mut field.values));
                if is_wide {
                    columns.notes.extend(rounded(field));
                }
            }
            Target::Skipped => {}
        }
    }
}

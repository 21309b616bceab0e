//! Names, sizes and ranges of the scalar types of PLY.

use super::ScalarType;

impl ScalarType {
    /// Bytes of one value.
    #[must_use]
    pub const fn size(self) -> usize {
        match self {
            Self::Int8 | Self::Uint8 => 1,
            Self::Int16 | Self::Uint16 => 2,
            Self::Int32 | Self::Uint32 | Self::Float32 => 4,
            Self::Float64 => 8,
        }
    }

    /// Name in a PLY header: the older of its two names, which every viewer reads.
    #[must_use]
    pub const fn ply_name(self) -> &'static str {
        match self {
            Self::Int8 => "char",
            Self::Uint8 => "uchar",
            Self::Int16 => "short",
            Self::Uint16 => "ushort",
            Self::Int32 => "int",
            Self::Uint32 => "uint",
            Self::Float32 => "float",
            Self::Float64 => "double",
        }
    }

    /// The type with this PLY name, old (`uchar`) or new (`uint8`).
    #[must_use]
    pub fn from_ply_name(name: &[u8]) -> Option<Self> {
        Some(match name {
            b"char" | b"int8" => Self::Int8,
            b"uchar" | b"uint8" => Self::Uint8,
            b"short" | b"int16" => Self::Int16,
            b"ushort" | b"uint16" => Self::Uint16,
            b"int" | b"int32" => Self::Int32,
            b"uint" | b"uint32" => Self::Uint32,
            b"float" | b"float32" => Self::Float32,
            b"double" | b"float64" => Self::Float64,
            _ => return None,
        })
    }

    /// Smallest and largest value of an integer type; `None` for the floating types.
    #[must_use]
    pub fn integer_range(self) -> Option<(f64, f64)> {
        Some(match self {
            Self::Int8 => (i8::MIN.into(), i8::MAX.into()),
            Self::Uint8 => (u8::MIN.into(), u8::MAX.into()),
            Self::Int16 => (i16::MIN.into(), i16::MAX.into()),
            Self::Uint16 => (u16::MIN.into(), u16::MAX.into()),
            Self::Int32 => (i32::MIN.into(), i32::MAX.into()),
            Self::Uint32 => (u32::MIN.into(), u32::MAX.into()),
            Self::Float32 | Self::Float64 => return None,
        })
    }

    /// Whether `value` can leave in this type: integers exactly, floats up to rounding. NaN and infinities fit
    /// the floating types.
    #[must_use]
    pub fn holds(self, value: f64) -> bool {
        match self.integer_range() {
            Some((low, high)) => value.fract() == 0.0 && (low..=high).contains(&value),
            None => self == Self::Float64 || !value.is_finite() || value.abs() <= f64::from(f32::MAX),
        }
    }

    /// The type in which computed values of such a quantity are written: `float` stays `float`, everything else
    /// becomes `double`, since a filtered integer is not an integer.
    #[must_use]
    pub const fn floating(self) -> Self {
        match self {
            Self::Float32 => Self::Float32,
            _ => Self::Float64,
        }
    }
}

/// How a number is stored.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::cloud) enum Stored {
    Scalar(ScalarType),
    /// 64 bits; exact in `f64` up to 2⁵³.
    Integer {
        is_signed: bool,
    },
}

impl Stored {
    /// The type with this PLY name; beside those of PLY the ones that programs made up for 64 bits and truth values.
    pub(in crate::cloud) fn from_ply_name(name: &[u8]) -> Option<Self> {
        Some(match name {
            b"bool" | b"boolean" => Self::Scalar(ScalarType::Uint8),
            b"int64" | b"longlong" | b"long" => Self::Integer { is_signed: true },
            b"uint64" | b"ulonglong" | b"ulong" => Self::Integer { is_signed: false },
            name => Self::Scalar(ScalarType::from_ply_name(name)?),
        })
    }

    /// The type in which values are kept.
    pub(in crate::cloud) const fn scalar_type(self) -> ScalarType {
        match self {
            Self::Scalar(kind) => kind,
            Self::Integer { .. } => ScalarType::Float64,
        }
    }

    /// Whether it is an integer.
    pub(in crate::cloud) fn is_integer(self) -> bool {
        match self {
            Self::Scalar(kind) => kind.integer_range().is_some(),
            Self::Integer { .. } => true,
        }
    }

    /// Bytes.
    pub(in crate::cloud) const fn size(self) -> usize {
        match self {
            Self::Scalar(kind) => kind.size(),
            Self::Integer { .. } => 8,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_type_is_found_under_its_own_name() {
        for kind in ScalarType::ALL {
            assert_eq!(ScalarType::from_ply_name(kind.ply_name().as_bytes()), Some(kind));
        }
        assert_eq!(ScalarType::from_ply_name(b"half"), None);
    }

    #[test]
    fn a_value_outside_the_range_of_its_type_does_not_fit() {
        assert!(ScalarType::Uint8.holds(255.0) && !ScalarType::Uint8.holds(256.0));
        assert!(
            !ScalarType::Int8.holds(-129.0)
                && !ScalarType::Int8.holds(0.5)
                && !ScalarType::Int8.holds(f64::NAN)
        );
        assert!(ScalarType::Float32.holds(f64::NAN) && !ScalarType::Float32.holds(1e39));
        assert!(ScalarType::Float64.holds(1e300));
    }
}

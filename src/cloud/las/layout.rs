//! Where the attributes of a point stand in its record [§2.6].

use crate::cloud::ScalarType::{self, Float32, Float64, Int8, Int16, Uint8, Uint16, Uint32};
use crate::cloud::scalar::Stored;

/// Degrees of a step of the scan angle in formats 6 to 10 [§2.6.7].
const SCAN_ANGLE_STEP: f64 = 0.006;

/// A column of the records: a number at a place, or some bits of a byte.
#[derive(Debug, Clone, PartialEq)]
pub(in crate::cloud) struct Place {
    pub(in crate::cloud) name: String,
    /// Bytes of the record before it.
    pub(in crate::cloud) offset: usize,
    pub(in crate::cloud) stored: Stored,
    /// Bits of the byte; a mask of 0 stands for the whole number.
    pub(in crate::cloud) shift: u32,
    pub(in crate::cloud) mask: u8,
    /// The value is the number times the first, plus the second.
    pub(in crate::cloud) scaled: Option<(f64, f64)>,
}

impl Place {
    pub(in crate::cloud) fn whole(name: impl Into<String>, offset: usize, kind: ScalarType) -> Self {
        Self { name: name.into(), offset, stored: Stored::Scalar(kind), shift: 0, mask: 0, scaled: None }
    }

    fn bits(name: &str, offset: usize, shift: u32, width: u32) -> Self {
        Self { shift, mask: ((1_u16 << width) - 1) as u8, ..Self::whole(name, offset, Uint8) }
    }

    /// The type in which its values are kept.
    pub(in crate::cloud) fn kind(&self) -> ScalarType {
        match self.stored {
            Stored::Scalar(kind) if self.scaled.is_none() => kind,
            _ => Float64,
        }
    }

    /// The number that stands for a value, before it is rounded.
    pub(in crate::cloud) fn number_of(&self, value: f64) -> f64 {
        self.scaled.map_or(value, |(scale, offset)| (value - offset) / scale)
    }

    /// Whether a value can stand here without loss, steps up to rounding.
    pub(in crate::cloud) fn holds(&self, value: f64) -> bool {
        let number = self.number_of(value);
        let is_near = self.scaled.is_some() && (number - number.round()).abs() < 1e-6;
        let number = if is_near { number.round() } else { number };
        if self.mask != 0 {
            return number.fract() == 0.0 && (0.0..=f64::from(self.mask)).contains(&number);
        }
        match self.stored {
            Stored::Scalar(Float32) => {
                number.is_nan() || f64::from(number as f32).to_bits() == number.to_bits()
            }
            Stored::Scalar(kind) => kind.holds(number),
            Stored::Integer { is_signed } => {
                number.fract() == 0.0
                    && number.abs() <= 9_007_199_254_740_992.0
                    && (is_signed || number >= 0.0)
            }
        }
    }
}

/// Bytes of a point of a format; `None` for formats that do not exist.
pub(in crate::cloud) fn record_bytes(format: u8) -> Option<usize> {
    [20, 28, 26, 34, 57, 63, 30, 36, 38, 59, 67].get(usize::from(format)).copied()
}

/// The attributes of a point besides its coordinates, which are three 32-bit integers at its beginning.
pub(in crate::cloud) fn attributes(format: u8) -> Vec<Place> {
    let mut places = if format >= 6 { extended() } else { legacy() };
    let mut offset = if format >= 6 { 22 } else { 20 };
    if !matches!(format, 0 | 2) {
        places.push(Place::whole("gps_time", offset, Float64));
        offset += 8;
    }
    if matches!(format, 2 | 3 | 5 | 7 | 8 | 10) {
        let colors = ["red", "green", "blue"].into_iter().enumerate();
        places.extend(colors.map(|(index, name)| Place::whole(name, offset + 2 * index, Uint16)));
        offset += 6;
    }
    if matches!(format, 8 | 10) {
        places.push(Place::whole("nir", offset, Uint16));
        offset += 2;
    }
    if matches!(format, 4 | 5 | 9 | 10) {
        places.push(Place::whole("wavepacket_index", offset, Uint8));
        let stored = Stored::Integer { is_signed: false };
        places.push(Place { stored, ..Place::whole("wavepacket_offset", offset + 1, Uint8) });
        places.push(Place::whole("wavepacket_size", offset + 9, Uint32));
        let floats = ["return_point_wave_location", "x_t", "y_t", "z_t"].into_iter().enumerate();
        places.extend(floats.map(|(index, name)| Place::whole(name, offset + 13 + 4 * index, Float32)));
    }
    places
}

/// Formats 0 to 5 [§2.6.1].
fn legacy() -> Vec<Place> {
    vec![
        Place::whole("intensity", 12, Uint16),
        Place::whole("user_data", 17, Uint8),
        Place::whole("point_source_id", 18, Uint16),
        Place::whole("scan_angle", 16, Int8),
        Place::bits("classification", 15, 0, 5),
        Place::bits("return_number", 14, 0, 3),
        Place::bits("number_of_returns", 14, 3, 3),
        Place::bits("scan_direction_flag", 14, 6, 1),
        Place::bits("edge_of_flight_line", 14, 7, 1),
        Place::bits("synthetic", 15, 5, 1),
        Place::bits("key_point", 15, 6, 1),
        Place::bits("withheld", 15, 7, 1),
    ]
}

/// Formats 6 to 10 [§2.6.7].
fn extended() -> Vec<Place> {
    let angle = Place::whole("scan_angle", 18, Int16);
    vec![
        Place::whole("intensity", 12, Uint16),
        Place::whole("user_data", 17, Uint8),
        Place::whole("point_source_id", 20, Uint16),
        Place::whole("classification", 16, Uint8),
        Place { scaled: Some((SCAN_ANGLE_STEP, 0.0)), ..angle },
        Place::bits("return_number", 14, 0, 4),
        Place::bits("number_of_returns", 14, 4, 4),
        Place::bits("synthetic", 15, 0, 1),
        Place::bits("key_point", 15, 1, 1),
        Place::bits("withheld", 15, 2, 1),
        Place::bits("overlap", 15, 3, 1),
        Place::bits("scanner_channel", 15, 4, 2),
        Place::bits("scan_direction_flag", 15, 6, 1),
        Place::bits("edge_of_flight_line", 15, 7, 1),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_attributes_of_every_format_fill_its_record() {
        for format in 0..=10 {
            let mut bits = vec![0_u32; 8 * record_bytes(format).unwrap()];
            for place in attributes(format) {
                let (start, width) = match place.mask {
                    0 => (8 * place.offset, 8 * place.stored.size()),
                    mask => (8 * place.offset + place.shift as usize, mask.count_ones() as usize),
                };
                bits[start..start + width].iter_mut().for_each(|bit| *bit += 1);
            }
            assert!(bits[96..].iter().all(|&times| times == 1), "format {format}: every bit once");
        }
        assert_eq!(record_bytes(11), None);
    }

    #[test]
    fn a_value_that_does_not_fit_its_place_is_told() {
        let angle = extended().swap_remove(4);
        assert!(angle.holds(100.0 * 0.006) && !angle.holds(-5.0) && !angle.holds(200.0));
        let returns = legacy().swap_remove(5);
        assert!(returns.holds(7.0) && !returns.holds(8.0) && !returns.holds(0.5) && !returns.holds(f64::NAN));
    }
}

//! Records of points: where every field of a cloud goes.

use std::ops::Range;

use super::axis::Axis;
use crate::cloud::las::{self, Place, Stored};
use crate::cloud::writer::{Column, encode_column};
use crate::cloud::{PointCloud, ScalarField, ScalarType};

/// The attributes that are colors.
const COLORS: [&str; 3] = ["red", "green", "blue"];

/// The layout of the records of a cloud.
pub(super) struct Points<'a> {
    /// Point format.
    pub(super) format: u8,
    /// Bytes of a point.
    pub(super) record: usize,
    /// Places with the field that fills them.
    filled: Vec<(Place, &'a ScalarField)>,
    /// Descriptions of extra bytes: those of the file that the cloud came in, then its further fields.
    pub(super) descriptions: Vec<u8>,
}

impl<'a> Points<'a> {
    pub(super) fn of(cloud: &'a PointCloud) -> Self {
        let fields = cloud.fields();
        let frame = cloud.origin().survey.as_ref().and_then(|survey| {
            let header = las::Header::parse(&survey.header.0)?;
            las::record_bytes(header.point_format)
                .map(|least| (header.point_format, header.record.max(least)))
        });
        let (format, mut record) = frame.unwrap_or_else(|| fresh_format(fields));
        let attributes = las::attributes(format);
        let mut descriptions = Vec::new();
        let start = las::record_bytes(format).unwrap_or(record);
        for bytes in cloud.origin().survey.iter().flat_map(|survey| &survey.records) {
            let record = las::Record::first(&bytes.0).filter(las::Record::describes_extra_bytes);
            descriptions.extend(record.iter().flat_map(|record| record.data));
        }
        let extra = las::described(&descriptions, start, record, &attributes);
        let places = attributes.into_iter().chain(extra.places.iter().cloned());
        let narrow_colors = has_8_bit_colors(fields);
        let mut rest: Vec<&ScalarField> = fields.iter().collect();
        let mut filled = Vec::new();
        let mut taken: Vec<String> = Vec::new();
        for mut place in places {
            if narrow_colors && COLORS.contains(&place.name.as_str()) {
                place.scaled = Some((1.0 / 256.0, 0.0));
            }
            let fits = |field: &&&ScalarField| {
                field.name == place.name && field.values.iter().all(|&value| place.holds(value))
            };
            taken.push(place.name.to_ascii_lowercase());
            if let Some(index) = rest.iter().position(|field| fits(&field)) {
                filled.push((place, rest.remove(index)));
            }
        }
        if !rest.is_empty() && extra.undescribed > 0 {
            // Further bytes are found only behind described ones.
            descriptions.truncate(192 * extra.descriptions);
            descriptions.extend(las::undocumented(extra.undescribed));
        }
        for field in rest {
            let name = free_name(&field.name, &taken);
            taken.push(name.to_ascii_lowercase());
            filled.push((Place::whole(field.name.clone(), record, field.kind), field));
            descriptions.extend(las::describe(&field.name, &name, field.kind));
            record += field.kind.size();
        }
        Self { format, record, filled, descriptions }
    }

    /// Bytes of a point beyond those of its format.
    pub(super) fn extra_bytes(&self) -> usize {
        self.record - las::record_bytes(self.format).unwrap_or(self.record)
    }

    /// The values of a return number or the like, if the cloud has it.
    pub(super) fn attribute(&self, name: &str) -> Option<&'a [f64]> {
        self.filled.iter().find(|(place, _)| place.name == name).map(|(_, field)| &*field.values)
    }

    /// Records of some rows.
    pub(super) fn encode(&self, cloud: &PointCloud, axes: &[Axis; 3], rows: Range<usize>) -> Vec<u8> {
        let mut records = vec![0; rows.len() * self.record];
        let mut write = |values: &[f64], kind, offset| {
            encode_column(Column { values, stride: 1, kind }, &mut records, self.record, offset);
        };
        for (index, axis) in axes.iter().enumerate() {
            let steps: Vec<f64> = rows.clone().map(|row| axis.encode(cloud, row)).collect();
            write(&steps, ScalarType::Int32, 4 * index);
        }
        for (place, field) in self.filled.iter().filter(|(place, _)| place.mask == 0) {
            if let Stored::Scalar(kind) = place.stored {
                let values = &field.values[rows.clone()];
                if place.scaled.is_none() {
                    write(values, kind, place.offset);
                } else {
                    let numbers: Vec<f64> = values.iter().map(|&value| place.number_of(value)).collect();
                    write(&numbers, kind, place.offset);
                }
            }
        }
        for (place, field) in &self.filled {
            let values = &field.values[rows.clone()];
            for (record, &value) in records.chunks_exact_mut(self.record).zip(values) {
                match (place.stored, place.mask) {
                    (_, 1..) => record[place.offset] |= (value as u8 & place.mask) << place.shift,
                    (Stored::Integer { is_signed }, _) => {
                        let number = place.number_of(value).round();
                        let bytes = if is_signed {
                            (number as i64).to_le_bytes()
                        } else {
                            (number as u64).to_le_bytes()
                        };
                        record[place.offset..place.offset + 8].copy_from_slice(&bytes);
                    }
                    _ => break,
                }
            }
        }
        records
    }
}

/// Whether the cloud's colors go from 0 to 255: in LAS they are those times 256 [§2.6.3].
fn has_8_bit_colors(fields: &[ScalarField]) -> bool {
    COLORS.into_iter().all(|name| {
        let field = fields.iter().find(|field| field.name == name);
        field.is_some_and(|field| {
            field.kind != ScalarType::Uint16 && field.values.iter().all(|&x| ScalarType::Uint8.holds(x))
        })
    })
}

/// The point format and bytes of a cloud that did not come as LAS.
fn fresh_format(fields: &[ScalarField]) -> (u8, usize) {
    let is_word = |name: &str| {
        let field = fields.iter().find(|field| field.name == name);
        field.is_some_and(|field| field.values.iter().all(|&x| ScalarType::Uint16.holds(x)))
    };
    let format = match (COLORS.into_iter().all(is_word), is_word("nir")) {
        (false, _) => 6,
        (true, false) => 7,
        (true, true) => 8,
    };
    (format, las::record_bytes(format).unwrap_or(0))
}

/// A name for extra bytes that no attribute has and no extra bytes before them, within 32 bytes.
fn free_name(name: &str, taken: &[String]) -> String {
    let cut = |name: &str, room: usize| name[..name.floor_char_boundary(room)].to_owned();
    let is_free = |name: &String| !las::is_reserved(name) && !taken.contains(&name.to_ascii_lowercase());
    let short = cut(name, 32);
    let tries = std::iter::once(short)
        .chain(std::iter::once(format!("{}_value", cut(name, 26))))
        .chain((2..).map(|number| format!("{}_{number}", cut(name, 24))));
    tries.into_iter().find(is_free).unwrap_or_else(|| name.to_owned())
}

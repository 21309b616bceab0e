//! Extra bytes of points, and the record that describes them [table 24, table 25].

use super::{Place, Stored, f64_at};
use crate::cloud::ScalarType::{self, Float32, Float64, Int8, Int16, Int32, Uint8, Uint16, Uint32};

/// Bytes of a description.
const DESCRIPTION: usize = 192;
/// Bits of its options: the scale is set, the offset is set.
const SCALED: u8 = 0b0000_1000;
const SHIFTED: u8 = 0b0001_0000;
/// Undocumented bytes that become fields, at most.
const UNDOCUMENTED_MAX: usize = 16;
/// Begins the text of a description whose name is not the field's.
const OWN: &str = "chladni:";

/// Names of attributes in any point format, and those under which laspy and PDAL know their bits: extra bytes called so
/// make files that they refuse.
const RESERVED: [&str; 40] = [
    "x",
    "y",
    "z",
    "intensity",
    "bit_fields",
    "return_number",
    "number_of_returns",
    "scan_direction_flag",
    "edge_of_flight_line",
    "raw_classification",
    "classification",
    "classification_flags",
    "synthetic",
    "key_point",
    "keypoint",
    "withheld",
    "overlap",
    "scanner_channel",
    "scan_channel",
    "scan_angle",
    "scan_angle_rank",
    "user_data",
    "point_source_id",
    "pointsourceid",
    "gps_time",
    "gpstime",
    "red",
    "green",
    "blue",
    "nir",
    "infrared",
    "wavepacket_index",
    "wavepacket_offset",
    "wavepacket_size",
    "return_point_wave_location",
    "x_t",
    "y_t",
    "z_t",
    "flag_byte",
    "number_of_returns_of_given_pulse",
];

/// Whether extra bytes may not be called so.
pub(in crate::cloud) fn is_reserved(name: &str) -> bool {
    RESERVED.contains(&name.to_ascii_lowercase().as_str())
}

/// What the extra bytes of a record are.
#[derive(Debug, Default)]
pub(in crate::cloud) struct Extra {
    pub(in crate::cloud) places: Vec<Place>,
    /// Descriptions that describe bytes of the record.
    pub(in crate::cloud) descriptions: usize,
    /// Bytes at the end of which nothing is known.
    pub(in crate::cloud) undescribed: usize,
    /// Those of them that are not places.
    pub(in crate::cloud) left_out: usize,
}

/// Takes the bytes of a record from `start` to `end` apart, as descriptions tell. Names are those of `taken` no second
/// time.
pub(in crate::cloud) fn described(data: &[u8], start: usize, end: usize, taken: &[Place]) -> Extra {
    let mut extra = Extra::default();
    let mut offset = start;
    for description in data.chunks_exact(DESCRIPTION) {
        let Some((stored, count)) = element(description) else { break };
        if offset + stored.size() * count > end {
            break;
        }
        let (name, is_own) = name(description);
        // A field of ours has the name of an attribute because that attribute is not used.
        let taken = if is_own { &[] } else { taken };
        for index in 0..count {
            let each = if count == 1 { name.clone() } else { format!("{name}_{index}") };
            let name = unique(each, taken, &extra.places);
            let scaled = if description[2] == 0 { None } else { scaled(description, index) };
            extra.places.push(Place { stored, scaled, ..Place::whole(name, offset, Uint8) });
            offset += stored.size();
        }
        extra.descriptions += 1;
    }
    extra.undescribed = end - offset;
    if extra.undescribed <= UNDOCUMENTED_MAX {
        for (index, offset) in (offset..end).enumerate() {
            let name = unique(format!("extra_byte_{index}"), taken, &extra.places);
            extra.places.push(Place::whole(name, offset, Uint8));
        }
    } else {
        extra.left_out = extra.undescribed;
    }
    extra
}

/// A name that no attribute and no extra bytes before it have.
fn unique(name: String, taken: &[Place], more: &[Place]) -> String {
    let is_axis = |name: &str| matches!(name, "x" | "X" | "y" | "Y" | "z" | "Z");
    let is_free = |name: &str| !is_axis(name) && taken.iter().chain(more).all(|place| place.name != name);
    if is_free(&name) {
        return name;
    }
    let mut number = 2;
    while !is_free(&format!("{name}_{number}")) {
        number += 1;
    }
    format!("{name}_{number}")
}

/// Type and number of the values of a description; bytes for those without documentation.
fn element(description: &[u8]) -> Option<(Stored, usize)> {
    let scalar = |code: u8| {
        Some(match code {
            1 => Stored::Scalar(Uint8),
            2 => Stored::Scalar(Int8),
            3 => Stored::Scalar(Uint16),
            4 => Stored::Scalar(Int16),
            5 => Stored::Scalar(Uint32),
            6 => Stored::Scalar(Int32),
            7 => Stored::Integer { is_signed: false },
            8 => Stored::Integer { is_signed: true },
            9 => Stored::Scalar(Float32),
            10 => Stored::Scalar(Float64),
            _ => return None,
        })
    };
    match description[2] {
        0 => Some((Stored::Scalar(Uint8), usize::from(description[3]))),
        code @ 1..=10 => Some((scalar(code)?, 1)),
        // Arrays of two and three, deprecated and in use.
        code @ 11..=20 => Some((scalar(code - 10)?, 2)),
        code @ 21..=30 => Some((scalar(code - 20)?, 3)),
        _ => None,
    }
}

fn scaled(description: &[u8], index: usize) -> Option<(f64, f64)> {
    let options = description[3];
    let double = |at: usize| f64_at(description, at + 8 * index);
    let scale = if options & SCALED != 0 { double(112)? } else { 1.0 };
    let offset = if options & SHIFTED != 0 { double(136)? } else { 0.0 };
    (options & (SCALED | SHIFTED) != 0 && scale.is_normal()).then_some((scale, offset))
}

fn text(bytes: &[u8]) -> String {
    let text = bytes.split(|&byte| byte == 0).next().unwrap_or_default();
    String::from_utf8_lossy(text).trim().to_owned()
}

/// The name, and whether it is that of a field of ours.
fn name(description: &[u8]) -> (String, bool) {
    let told = text(&description[160..192]);
    match told.strip_prefix(OWN) {
        Some(own) if !own.is_empty() => (own.to_owned(), true),
        _ => (text(&description[4..36]), false),
    }
}

/// Describes a field under a name: its own, if the format has it free.
pub(in crate::cloud) fn describe(field: &str, name: &str, kind: ScalarType) -> [u8; DESCRIPTION] {
    let mut bytes = [0; DESCRIPTION];
    bytes[2] = match kind {
        Uint8 => 1,
        Int8 => 2,
        Uint16 => 3,
        Int16 => 4,
        Uint32 => 5,
        Int32 => 6,
        Float32 => 9,
        Float64 => 10,
    };
    let name = &name.as_bytes()[..name.floor_char_boundary(32)];
    bytes[4..4 + name.len()].copy_from_slice(name);
    if name != field.as_bytes() && field.len() + OWN.len() <= 32 {
        let told = format!("{OWN}{field}");
        bytes[160..160 + told.len()].copy_from_slice(told.as_bytes());
    }
    bytes
}

/// Descriptions of undocumented bytes.
pub(in crate::cloud) fn undocumented(bytes: usize) -> Vec<u8> {
    let pieces = (0..bytes).step_by(usize::from(u8::MAX)).enumerate();
    let described = pieces.flat_map(|(index, start)| {
        let mut description = describe("", &format!("undocumented_{index}"), Uint8);
        description[2] = 0;
        description[3] = (bytes - start).min(usize::from(u8::MAX)) as u8;
        description[160..].fill(0);
        description
    });
    described.collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn description(code: u8, options: u8, name: &str) -> Vec<u8> {
        let mut bytes = vec![0; DESCRIPTION];
        (bytes[2], bytes[3]) = (code, options);
        bytes[4..4 + name.len()].copy_from_slice(name.as_bytes());
        bytes
    }

    #[test]
    fn what_stands_behind_arrays_and_undocumented_bytes_is_found() {
        let data = [
            description(1, 0, "a"),
            description(21, 0, "vec"),
            description(0, 2, "raw"),
            description(10, 0, "b"),
            description(6, 0, "a"),
        ];
        let extra = described(&data.concat(), 20, 20 + 1 + 3 + 2 + 8 + 4 + 1, &[]);
        let found: Vec<_> = extra.places.iter().map(|place| (place.name.as_str(), place.offset)).collect();
        let expected = [
            ("a", 20),
            ("vec_0", 21),
            ("vec_1", 22),
            ("vec_2", 23),
            ("raw_0", 24),
            ("raw_1", 25),
            ("b", 26),
            ("a_2", 34),
            ("extra_byte_0", 38),
        ];
        assert_eq!(found, expected);
        assert_eq!((extra.undescribed, extra.left_out), (1, 0));
    }

    #[test]
    fn descriptions_beyond_the_record_describe_nothing() {
        let extra = described(&description(10, 0, "b"), 20, 24, &[]);
        assert_eq!((extra.places.len(), extra.undescribed), (4, 4));
        assert_eq!(described(&[], 20, 120, &[]).left_out, 100);
    }

    #[test]
    fn a_field_whose_name_is_taken_is_found_under_its_own() {
        let bytes = describe("intensity", "intensity_value", Float32);
        assert_eq!(name(&bytes), ("intensity".to_owned(), true));
        assert_eq!(name(&describe("höhe", "höhe", Float32)), ("höhe".to_owned(), false));
        assert!(is_reserved("Intensity") && !is_reserved("quality"));
    }
}

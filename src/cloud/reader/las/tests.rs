//! Files as the crate `las` writes them, and broken ones.

#![allow(clippy::float_cmp)] // to the last digit

use std::io::Cursor;

use ::las::point::Format as PointFormat;
use ::las::{Builder, Point, Transform, Vector, Writer};

use super::*;

const OFFSET: [f64; 3] = [500_000.0, 5_200_000.0, 100.0];

/// A point like those of airborne scans, at multiples of a millimeter.
fn point(i: i32, format: PointFormat) -> Point {
    let millimeter = |axis: usize, steps: i32| f64::from(steps) * 0.001 + OFFSET[axis];
    Point {
        x: millimeter(0, i * 1_237),
        y: millimeter(1, -i * 991),
        z: millimeter(2, i % 17),
        intensity: (i * 3) as u16,
        return_number: 1 + (i % 2) as u8,
        number_of_returns: 2,
        scan_angle: 0.0,
        gps_time: format.has_gps_time.then_some(1e5 + f64::from(i)),
        color: format.has_color.then(|| ::las::Color::new(i as u16, 2 * i as u16, 40_000)),
        nir: format.has_nir.then_some(i as u16),
        ..Point::default()
    }
}

fn file(format: u8, is_compressed: bool, points: i32) -> Vec<u8> {
    let mut builder = Builder::from((1, 4));
    builder.point_format = PointFormat::new(format).unwrap();
    builder.point_format.is_compressed = is_compressed;
    let [x, y, z] = OFFSET.map(|offset| Transform { scale: 0.001, offset });
    builder.transforms = Vector { x, y, z };
    let format = builder.point_format;
    let mut writer = Writer::new(Cursor::new(Vec::new()), builder.into_header().unwrap()).unwrap();
    for i in 0..points {
        writer.write_point(point(i, format)).unwrap();
    }
    writer.into_inner().unwrap().into_inner()
}

fn message(bytes: &[u8]) -> String {
    read(bytes, &ReadOptions::default()).unwrap_err().to_string()
}

#[test]
fn every_point_format_is_read_packed_and_unpacked_in_full_precision() {
    for format in [0, 1, 2, 3, 6, 7, 8] {
        for is_compressed in [false, true] {
            let bytes = file(format, is_compressed, 60_000 / 100);
            assert_eq!(Format::sniff(&bytes), Some(if is_compressed { Format::Laz } else { Format::Las }));
            let cloud = read(&bytes, &ReadOptions::default()).unwrap();
            assert_eq!(cloud.len(), 600);
            let layout = PointFormat::new(format).unwrap();
            let field = |name: &str| {
                let field = cloud.fields().iter().find(|field| field.name == name);
                field.unwrap_or_else(|| panic!("format {format}: {name}")).values.clone()
            };
            for (row, i) in (0..600).enumerate() {
                let written = point(i, layout);
                assert_eq!(cloud.point(row), [written.x, written.y, written.z], "format {format}");
                assert_eq!(field("intensity")[row], f64::from(written.intensity));
                assert_eq!(field("return_number")[row], f64::from(written.return_number));
                assert_eq!(field("number_of_returns")[row], 2.0);
                if let Some(color) = written.color {
                    let found = ["red", "green", "blue"].map(|name| field(name)[row]);
                    assert_eq!(found, [color.red, color.green, color.blue].map(f64::from));
                }
                if let Some(time) = written.gps_time {
                    assert_eq!(field("gps_time")[row], time);
                }
            }
            assert!(cloud.fields().iter().all(|field| field.name != "classification"), "0 everywhere");
        }
    }
}

#[test]
fn counts_are_held_against_the_bytes_that_are_there() {
    let bytes = file(2, false, 10);
    let message_of = |count: u32| {
        let mut bytes = bytes.clone();
        bytes[247..255].copy_from_slice(&u64::from(count).to_le_bytes());
        message(&bytes)
    };
    assert!(
        message_of(11).contains("11 points of 26 bytes are announced, 260 bytes follow"),
        "{}",
        message_of(11)
    );
    assert!(message_of(u32::MAX).contains("up to 50000000"), "{}", message_of(u32::MAX));
    assert!(message(&bytes[..bytes.len() - 1]).contains("259 bytes follow"));
    assert!(message(&bytes[..200]).contains("the header has 227 bytes"));
}

#[test]
fn a_header_that_makes_no_sense_is_refused() {
    let damaged = |at: usize, replacement: &[u8]| {
        let mut bytes = file(2, false, 10);
        bytes[at..at + replacement.len()].copy_from_slice(replacement);
        message(&bytes)
    };
    assert!(damaged(131, &0_f64.to_le_bytes()).contains("a scale or an offset"));
    assert!(damaged(155, &f64::NAN.to_le_bytes()).contains("a scale or an offset"));
    assert!(damaged(104, &[31]).contains("point format 31 does not exist"));
    assert!(damaged(105, &[3, 0]).contains("have 26 bytes, 3 are announced"));
    assert!(damaged(100, &[255; 4]).contains("of variable length is incomplete"));
}

#[test]
fn packed_points_that_contradict_the_header_are_refused_before_anything_is_allocated() {
    for format in [2, 7] {
        let bytes = file(format, true, 600);
        let parsed = File::parse(&bytes, Format::Laz).unwrap();
        for damage in (parsed.body..bytes.len()).step_by(3) {
            let mut damaged = bytes.clone();
            damaged[damage] = 0xFF;
            // Some bytes are numbers that mean other numbers then; none may panic or fill memory.
            if let Ok(cloud) = read(&damaged, &ReadOptions::default()) {
                assert_eq!(cloud.len(), 600);
            }
        }
        let table = i64::from_le_bytes(*bytes[parsed.body..].first_chunk().unwrap()) as usize;
        let mut many = bytes.clone();
        many[table + 4..table + 8].copy_from_slice(&[255; 4]);
        assert!(message(&many).contains("4294967295 chunks are announced for 600 points"));
        let mut none = bytes.clone();
        let description = none.windows(14).position(|name| name == b"laszip encoded").unwrap();
        none[description] = b'L';
        assert!(message(&none).contains("describes the compression is missing"));
    }
    let mut layered = file(7, true, 600);
    let parsed = File::parse(&layered, Format::Laz).unwrap();
    let layer = parsed.body + 8 + parsed.record + 4;
    layered[layer..layer + 4].copy_from_slice(&[255; 4]);
    assert!(message(&layered).contains("beyond the file"), "{}", message(&layered));
}

#[test]
fn a_small_file_that_would_unpack_to_hundreds_of_megabytes_is_refused_before_it_does() {
    let mut bytes = file(2, true, 10);
    bytes[247..255].copy_from_slice(&4_000_000_u64.to_le_bytes());
    let error = read(&bytes, &ReadOptions::default()).unwrap_err();
    assert!(matches!(error, ReadError::TooCompressed { unpacked: 104_000_000, .. }), "{error}");
}

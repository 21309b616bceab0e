//! Files of every point format, made by hand, come back byte for byte.

#![allow(clippy::float_cmp)] // to the last digit

use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::cloud::las::{HEADER_1_4, attributes, record_bytes};
use crate::cloud::reader::{Format, ReadOptions, read};
use crate::cloud::scalar::Stored;
use crate::cloud::writer::write;
use crate::cloud::{NonFinite, PointCloud, ScalarField, ScalarType};

const POINTS: usize = 300;

fn put(bytes: &mut [u8], at: usize, value: &[u8]) {
    bytes[at..at + value.len()].copy_from_slice(value);
}

fn record(user: &str, number: u16, data: &[u8]) -> Vec<u8> {
    let mut bytes = vec![0; 54];
    put(&mut bytes, 2, user.as_bytes());
    put(&mut bytes, 18, &number.to_le_bytes());
    put(&mut bytes, 20, &(data.len() as u16).to_le_bytes());
    put(&mut bytes, 22, b"as another program describes it");
    bytes.extend(data);
    bytes
}

/// A scaled 16-bit integer, a vector of three bytes, two undocumented bytes, a double.
fn descriptions() -> Vec<u8> {
    let mut scaled = vec![0; 192];
    (scaled[2], scaled[3]) = (4, 0b0001_1000);
    put(&mut scaled, 4, b"temperature");
    put(&mut scaled, 112, &0.01_f64.to_le_bytes());
    put(&mut scaled, 136, &20_f64.to_le_bytes());
    let plain = |code: u8, options: u8, name: &str| {
        let mut bytes = vec![0; 192];
        (bytes[2], bytes[3]) = (code, options);
        put(&mut bytes, 4, name.as_bytes());
        bytes
    };
    [scaled, plain(21, 0, "vec"), plain(0, 2, "raw"), plain(10, 0, "b")].concat()
}

const EXTRA: usize = 2 + 3 + 2 + 8;

/// A point with all its bits in use.
fn point(format: u8, index: usize, random: &mut ChaCha8Rng) -> Vec<u8> {
    let start = record_bytes(format).unwrap();
    let mut bytes: Vec<u8> = (0..start + EXTRA).map(|_| random.random()).collect();
    for place in attributes(format) {
        match place.stored {
            Stored::Scalar(ScalarType::Float32) => {
                put(&mut bytes, place.offset, &random.random_range(-1e3_f32..1e3).to_le_bytes());
            }
            Stored::Scalar(ScalarType::Float64) => {
                put(&mut bytes, place.offset, &(3e5 + index as f64 / 7.0).to_le_bytes());
            }
            Stored::Integer { .. } => {
                put(&mut bytes, place.offset, &random.random_range(0..1_u64 << 50).to_le_bytes());
            }
            Stored::Scalar(_) => {}
        }
    }
    put(&mut bytes, start + EXTRA - 8, &random.random_range(-1e3_f64..1e3).to_le_bytes());
    bytes
}

/// A file of version 1.4 with records before and behind its points, and all that its header may say.
fn file(format: u8) -> Vec<u8> {
    let mut random = ChaCha8Rng::seed_from_u64(format.into());
    let points: Vec<Vec<u8>> = (0..POINTS).map(|i| point(format, i, &mut random)).collect();
    let records =
        [record("LASF_Projection", 2112, b"PROJCS[\"made up\"]\0"), record("LASF_Spec", 4, &descriptions())];
    let mut extended = vec![0; 60];
    put(&mut extended, 2, b"somebody");
    put(&mut extended, 18, &7_u16.to_le_bytes());
    put(&mut extended, 20, &5_u64.to_le_bytes());
    extended.extend(b"notes");
    let mut header = vec![0; HEADER_1_4];
    put(&mut header, 0, b"LASF");
    // GPS time of week is not set, a synthetic return number is; the system is told as WKT.
    put(&mut header, 4, &99_u16.to_le_bytes());
    put(&mut header, 6, &0b1_1001_u16.to_le_bytes());
    put(&mut header, 8, b"0123456789abcdef");
    put(&mut header, 24, &[1, 4]);
    put(&mut header, 26, b"a scanner");
    put(&mut header, 58, b"another program");
    put(&mut header, 90, &[33, 0, 0xE9, 7]);
    put(&mut header, 94, &(HEADER_1_4 as u16).to_le_bytes());
    let body = HEADER_1_4 + records.iter().map(Vec::len).sum::<usize>();
    put(&mut header, 96, &(body as u32).to_le_bytes());
    put(&mut header, 100, &2_u32.to_le_bytes());
    header[104] = format;
    let length = record_bytes(format).unwrap() + EXTRA;
    put(&mut header, 105, &(length as u16).to_le_bytes());
    let (scales, offsets) = ([0.001, 0.000_25, 0.01], [5e5, 5.2e6, -77.7]);
    for axis in 0..3 {
        let step = |point: &Vec<u8>| i32::from_le_bytes(*point[4 * axis..].first_chunk().unwrap());
        let coordinate = |step: i32| f64::from(step) * scales[axis] + offsets[axis];
        let (low, high) = (points.iter().map(step).min().unwrap(), points.iter().map(step).max().unwrap());
        put(&mut header, 131 + 8 * axis, &scales[axis].to_le_bytes());
        put(&mut header, 155 + 8 * axis, &offsets[axis].to_le_bytes());
        put(&mut header, 179 + 16 * axis, &coordinate(high).to_le_bytes());
        put(&mut header, 187 + 16 * axis, &coordinate(low).to_le_bytes());
    }
    let mask = if format < 6 { 7 } else { 15 };
    let count = |number: u8| points.iter().filter(|point| point[14] & mask == number).count();
    if format < 6 {
        put(&mut header, 107, &(POINTS as u32).to_le_bytes());
        for number in 1..=5 {
            put(&mut header, 107 + 4 * usize::from(number), &(count(number) as u32).to_le_bytes());
        }
    }
    put(&mut header, 235, &((body + POINTS * length) as u64).to_le_bytes());
    put(&mut header, 243, &1_u32.to_le_bytes());
    put(&mut header, 247, &(POINTS as u64).to_le_bytes());
    for number in 1..=15 {
        put(&mut header, 247 + 8 * usize::from(number), &(count(number) as u64).to_le_bytes());
    }
    [header, records.concat(), points.concat(), extended].concat()
}

fn written(cloud: &PointCloud, format: Format) -> Vec<u8> {
    let mut bytes = Vec::new();
    write(cloud, format, &mut bytes).unwrap();
    bytes
}

#[test]
fn every_point_format_comes_back_byte_for_byte() {
    for format in 0..=10 {
        let bytes = file(format);
        let cloud = read(&bytes, Format::Las, &ReadOptions::default()).unwrap();
        assert!(cloud.notes().is_empty(), "format {format}: {:?}", cloud.notes());
        let back = written(&cloud, Format::Las);
        let first = back.iter().zip(&bytes).position(|(a, b)| a != b);
        assert!(
            back == bytes,
            "format {format}: {} and {} bytes, differ at {first:?}",
            back.len(),
            bytes.len()
        );
        let packed = written(&cloud, Format::Laz);
        assert_eq!(Format::sniff(&packed), Some(Format::Laz));
        let again = read(&packed, Format::Laz, &ReadOptions::default()).unwrap();
        assert!(written(&again, Format::Las) == bytes, "format {format}, packed and unpacked");
    }
}

#[test]
fn every_flag_is_a_field() {
    for (format, flags) in [
        (1, &["synthetic", "key_point", "withheld", "scan_direction_flag", "edge_of_flight_line"][..]),
        (6, &["synthetic", "key_point", "withheld", "overlap", "scanner_channel", "scan_direction_flag"]),
        (
            4,
            &[
                "wavepacket_index",
                "wavepacket_offset",
                "wavepacket_size",
                "return_point_wave_location",
                "x_t",
            ],
        ),
        (3, &["temperature", "vec_0", "vec_1", "vec_2", "raw_0", "raw_1", "b"]),
    ] {
        let cloud = read(&file(format), Format::Las, &ReadOptions::default()).unwrap();
        for flag in flags {
            let field = cloud.fields().iter().find(|field| field.name == *flag);
            assert!(field.is_some_and(|field| field.values.iter().any(|&x| x != 0.0)), "{format}: {flag}");
        }
    }
}

#[test]
fn a_changed_field_and_a_new_one_stand_beside_what_was_there() {
    let cloud = read(&file(3), Format::Las, &ReadOptions::default()).unwrap();
    let mut fields = cloud.fields().to_vec();
    let intensity = fields.iter_mut().find(|field| field.name == "intensity").unwrap();
    intensity.values.iter_mut().for_each(|x| *x += 0.25);
    intensity.kind = ScalarType::Float64;
    let values = (0..POINTS).map(|i| i as f64).collect();
    fields.push(ScalarField { name: "curvature".to_owned(), kind: ScalarType::Float32, values });
    let changed = cloud.clone().with_fields(fields.clone()).unwrap();
    for format in [Format::Las, Format::Laz] {
        let back = read(&written(&changed, format), format, &ReadOptions::default()).unwrap();
        assert_eq!(back.coordinates(), cloud.coordinates());
        for field in &fields {
            let found = back.fields().iter().find(|found| found.name == field.name);
            assert_eq!(found.map(|found| &found.values), Some(&field.values), "{format} {}", field.name);
        }
    }
}

#[test]
fn colors_of_8_bits_fill_16() {
    let cloud = PointCloud::new(3, vec![0.0, 0.0, 0.0, 1.0, 1.0, 1.0], NonFinite::Reject).unwrap();
    let colored = |kind: ScalarType, largest: f64| {
        let field =
            |name: &str| ScalarField { name: name.to_owned(), kind, values: vec![1.0, largest].into() };
        let cloud = cloud.clone().with_fields(["red", "green", "blue"].map(field).to_vec()).unwrap();
        let back = read(&written(&cloud, Format::Las), Format::Las, &ReadOptions::default()).unwrap();
        back.fields()[0].values.clone()
    };
    for kind in [ScalarType::Uint8, ScalarType::Float64] {
        assert_eq!(colored(kind, 255.0), [256.0, 65_280.0], "as LAS 1.4 wants it");
    }
    assert_eq!(colored(ScalarType::Uint16, 255.0), [1.0, 255.0], "they have 16 bits already");
    assert_eq!(colored(ScalarType::Float64, 256.0), [1.0, 256.0]);
}

#[test]
fn coordinates_from_end_to_end_of_their_32_bits_are_packed_and_unpacked() {
    for format in 0..=10 {
        let mut bytes = file(format);
        let header = crate::cloud::las::Header::parse(&bytes).unwrap();
        for (index, point) in
            bytes[header.body..][..POINTS * header.record].chunks_exact_mut(header.record).enumerate()
        {
            for axis in 0..3 {
                let step = if (index + axis).is_multiple_of(2) {
                    i32::MIN
                } else {
                    i32::MAX - 7 * i32::from(index as u16)
                };
                point[4 * axis..4 * axis + 4].copy_from_slice(&step.to_le_bytes());
            }
        }
        let cloud = read(&bytes, Format::Las, &ReadOptions::default()).unwrap();
        let back = read(&written(&cloud, Format::Laz), Format::Laz, &ReadOptions::default()).unwrap();
        assert_eq!(back.coordinates(), cloud.coordinates(), "format {format}");
    }
}

#[test]
fn extra_bytes_never_have_the_name_of_an_attribute() {
    let field = |name: &str, values: &[f64]| ScalarField {
        name: name.to_owned(),
        kind: ScalarType::Float32,
        values: values.to_vec().into(),
    };
    let cloud = PointCloud::new(3, vec![0.0, 0.0, 0.0, 1.0, 1.0, 1.0], NonFinite::Reject).unwrap();
    let fields =
        vec![field("intensity", &[0.5, 0.25]), field("scan_angle", &[-5.0, 3.0]), field("Red", &[1.0, 2.5])];
    let bytes = written(&cloud.with_fields(fields.clone()).unwrap(), Format::Las);
    let names = ["intensity_value", "scan_angle_value", "Red_value"];
    let is_there =
        |name: &str| bytes.windows(name.len() + 1).any(|part| part == [name.as_bytes(), &[0]].concat());
    assert!(names.into_iter().all(is_there));
    let back = read(&bytes, Format::Las, &ReadOptions::default()).unwrap();
    assert_eq!(back.fields(), fields, "and come back under their own");
}

#[test]
fn what_las_cannot_hold_is_refused() {
    let refusal = |dimension, values: &[f64]| {
        let cloud = PointCloud::new(dimension, values.to_vec(), NonFinite::Drop).unwrap();
        super::write_las(&cloud, false, &mut Vec::new()).unwrap_err().to_string()
    };
    assert!(refusal(4, &[0.0; 4]).contains("these points have 4"));
    assert!(refusal(3, &[0.0, 0.0, 0.0, 1.0, f64::NAN, 0.0]).contains("point 1"));
}

//! Files as the crate `e57` writes them, and broken ones.

#![allow(clippy::float_cmp)] // to the last digit

use e57::{E57Writer, Quaternion, Record, RecordDataType, RecordName, RecordValue, Transform, Translation};

use super::*;
use crate::cloud::{CloudError, NonFinite};

const DOUBLE: RecordDataType = RecordDataType::Double { min: None, max: None };
const BYTE: RecordDataType = RecordDataType::Integer { min: 0, max: 255 };

fn record(name: RecordName, data_type: RecordDataType) -> Record {
    Record { name, data_type }
}

/// A file of scans, each with its pose and its points.
fn file(prototype: &[Record], scans: &[(Option<Transform>, Vec<Vec<RecordValue>>)]) -> Vec<u8> {
    let mut bytes = Cursor::new(Vec::new());
    let mut writer = E57Writer::new(&mut bytes, "file").unwrap();
    for (pose, points) in scans {
        let mut scan = writer.add_pointcloud("scan", prototype.to_vec()).unwrap();
        scan.set_transform(pose.clone());
        for point in points {
            scan.add_point(point.clone()).unwrap();
        }
        scan.finalize().unwrap();
    }
    writer.finalize().unwrap();
    drop(writer);
    bytes.into_inner()
}

/// A file of one point, with its description changed.
fn described(prototype: &[Record], point: Vec<RecordValue>, change: impl Fn(String) -> String) -> Vec<u8> {
    let mut bytes = Cursor::new(Vec::new());
    let mut writer = E57Writer::new(&mut bytes, "file").unwrap();
    let mut scan = writer.add_pointcloud("scan", prototype.to_vec()).unwrap();
    scan.add_point(point).unwrap();
    scan.finalize().unwrap();
    writer.finalize_customized_xml(|xml| Ok(change(xml))).unwrap();
    drop(writer);
    bytes.into_inner()
}

fn cartesian(more: &[Record]) -> Vec<Record> {
    use RecordName::{CartesianX, CartesianY, CartesianZ};
    let axes = [CartesianX, CartesianY, CartesianZ].map(|name| record(name, DOUBLE));
    axes.into_iter().chain(more.iter().cloned()).collect()
}

fn doubles(values: &[f64]) -> Vec<RecordValue> {
    values.iter().map(|&value| RecordValue::Double(value)).collect()
}

fn small() -> Vec<u8> {
    file(&cartesian(&[]), &[(None, vec![doubles(&[1.0, 2.0, 3.0]), doubles(&[4.0, 5.0, 6.0])])])
}

#[test]
fn coordinates_and_fields_of_a_scan_come_in_full_precision() {
    let color = [RecordName::ColorRed, RecordName::ColorGreen, RecordName::ColorBlue];
    let color = color.map(|name| record(name, BYTE));
    let point = |x: f64, red: i64| {
        [doubles(&[x, 0.1, -0.2]), [red, 7, 8].map(RecordValue::Integer).to_vec()].concat()
    };
    let scans = [(None, vec![point(5e6 + 1e-7, 255), point(1.0, 0)]), (None, vec![point(9.0, 9)])];
    let bytes = file(&cartesian(&color), &scans);
    let first = ReadOptions { scan: Some(0), ..ReadOptions::default() };
    let cloud = read(&bytes, &first).unwrap();
    assert_eq!(cloud.coordinates(), [5e6 + 1e-7, 0.1, -0.2, 1.0, 0.1, -0.2]);
    let fields: Vec<_> = cloud.fields().iter().map(|f| (f.name.as_str(), f.kind, f.values[0])).collect();
    let expected = [("red", 255.0), ("green", 7.0), ("blue", 8.0)];
    assert_eq!(fields, expected.map(|(name, value)| (name, ScalarType::Uint8, value)));
    let second = read(&bytes, &ReadOptions { scan: Some(1), ..ReadOptions::default() }).unwrap();
    assert_eq!(second.point(0)[0], 9.0);
    let error = read(&bytes, &ReadOptions { scan: Some(2), ..ReadOptions::default() }).unwrap_err();
    assert_eq!(error.to_string(), "the file has 2 scans, 0 to 1; scan=2 is none of them");
}

#[test]
fn a_scan_is_turned_and_moved_into_the_coordinate_system_of_the_file() {
    // A quarter turn about z.
    let half = std::f64::consts::FRAC_1_SQRT_2;
    let rotation = Quaternion { w: half, x: 0.0, y: 0.0, z: half };
    let pose = Transform { rotation, translation: Translation { x: 100.0, y: 200.0, z: 300.0 } };
    let bytes = file(&cartesian(&[]), &[(Some(pose), vec![doubles(&[1.0, 0.0, 5.0])])]);
    let cloud = read(&bytes, &ReadOptions::default()).unwrap();
    for (found, expected) in cloud.point(0).iter().zip([100.0, 201.0, 305.0]) {
        assert!((found - expected).abs() < 1e-12, "{:?}", cloud.point(0));
    }
}

#[test]
fn spherical_coordinates_become_cartesian() {
    use RecordName::{SphericalAzimuth, SphericalElevation, SphericalRange};
    let prototype = [SphericalRange, SphericalAzimuth, SphericalElevation].map(|name| record(name, DOUBLE));
    let bytes = file(&prototype, &[(None, vec![doubles(&[2.0, std::f64::consts::FRAC_PI_2, 0.0])])]);
    let cloud = read(&bytes, &ReadOptions::default()).unwrap();
    for (found, expected) in cloud.point(0).iter().zip([0.0, 2.0, 0.0]) {
        assert!((found - expected).abs() < 1e-12);
    }
}

#[test]
fn a_point_that_the_scanner_marks_as_invalid_is_a_row_without_a_position() {
    let state = RecordDataType::Integer { min: 0, max: 2 };
    let prototype = cartesian(&[record(RecordName::CartesianInvalidState, state)]);
    let point = |state| [doubles(&[1.0, 2.0, 3.0]), vec![RecordValue::Integer(state)]].concat();
    let bytes = file(&prototype, &[(None, vec![point(0), point(2)])]);
    assert_eq!(read(&bytes, &ReadOptions::default()).unwrap_err(), CloudError::NonFinite { row: 1 }.into());
    let options = ReadOptions { policy: NonFinite::Drop, ..ReadOptions::default() };
    assert_eq!(read(&bytes, &options).unwrap().nonfinite(), 1);
}

#[test]
fn damaged_files_are_refused() {
    let bytes = small();
    for place in (0..bytes.len()).step_by(3) {
        let mut damaged = bytes.clone();
        damaged[place] ^= 0x55;
        assert!(read(&damaged, &ReadOptions::default()).is_err(), "byte {place}: every page has a checksum");
    }
    for end in (0..bytes.len()).step_by(97) {
        assert!(read(&bytes[..end], &ReadOptions::default()).is_err());
    }
    let mut long = bytes.clone();
    long[32..40].copy_from_slice(&5_000_000_u64.to_le_bytes());
    let error = read(&long, &ReadOptions::default()).unwrap_err().to_string();
    assert!(error.contains("its description has 5000000 bytes; up to 786432 are accepted"), "{error}");
}

#[test]
fn all_scans_of_a_file_are_one_cloud_with_a_field_of_them() {
    let prototype = cartesian(&[record(RecordName::Intensity, BYTE)]);
    let point = |x: f64| [doubles(&[x, 2.0, 3.0]), vec![RecordValue::Integer(9)]].concat();
    let bytes = file(&prototype, &[(None, vec![point(1.0), point(2.0)]), (None, vec![point(3.0)])]);
    let cloud = read(&bytes, &ReadOptions::default()).unwrap();
    assert_eq!(cloud.coordinates(), [1.0, 2.0, 3.0, 2.0, 2.0, 3.0, 3.0, 2.0, 3.0]);
    let fields: Vec<_> = cloud.fields().iter().map(|f| (f.name.as_str(), &*f.values)).collect();
    assert_eq!(fields, [("intensity", &[9.0; 3][..]), ("scan", &[0.0, 0.0, 1.0])]);
}

#[test]
fn a_quaternion_that_is_not_quite_of_length_one_does_not_scale() {
    let rotation = Quaternion { w: 0.7072, x: 0.0, y: 0.0, z: 0.7072 };
    let pose = Transform { rotation, translation: Translation { x: 0.0, y: 0.0, z: 0.0 } };
    let bytes = file(&cartesian(&[]), &[(Some(pose), vec![doubles(&[100.0, 0.0, 0.0])])]);
    let cloud = read(&bytes, &ReadOptions::default()).unwrap();
    for (found, expected) in cloud.point(0).iter().zip([0.0, 100.0, 0.0]) {
        assert!((found - expected).abs() < 1e-12, "{:?}", cloud.point(0));
    }
}

#[test]
fn bits_are_unpacked_as_the_crate_unpacks_them() {
    use RecordName::{CartesianX, CartesianY, CartesianZ, Intensity, RowIndex};

    let scaled = RecordDataType::ScaledInteger { min: -65_536, max: 65_535, scale: 1e-3, offset: 0.5 };
    let odd = RecordDataType::Integer { min: -5, max: 4994 };
    let mut prototype: Vec<Record> =
        [CartesianX, CartesianY, CartesianZ].map(|name| record(name, scaled.clone())).to_vec();
    prototype.extend([record(Intensity, odd), record(RowIndex, BYTE)]);
    let points: Vec<Vec<RecordValue>> = (0..20_000_i64)
        .map(|i| {
            let scaled =
                [i * 7919, i * 104_729, i * 31].map(|x| RecordValue::ScaledInteger(x % 131_072 - 65_536));
            [scaled.to_vec(), vec![RecordValue::Integer(i % 5000 - 5), RecordValue::Integer(i % 256)]]
                .concat()
        })
        .collect();
    let bytes = file(&prototype, &[(None, points.clone())]);
    let cloud = read(&bytes, &ReadOptions::default()).unwrap();
    for (row, point) in points.iter().enumerate() {
        let expected: Vec<f64> = point
            .iter()
            .zip(&prototype)
            .map(|(value, record)| value.to_f64(&record.data_type).unwrap())
            .collect();
        assert_eq!(cloud.point(row), &expected[..3]);
        assert_eq!(cloud.fields()[0].values[row], expected[3]);
        assert_eq!(cloud.fields()[1].values[row], expected[4]);
    }
}

#[test]
fn points_of_constants_alone_are_refused() {
    use RecordName::{CartesianX, CartesianY, CartesianZ};
    // The crate does not write them: they become constants in the description.
    let bit = RecordDataType::Integer { min: 6, max: 7 };
    let prototype = [CartesianX, CartesianY, CartesianZ].map(|name| record(name, bit.clone()));
    let values = vec![RecordValue::Integer(7); 3];
    let bytes = described(&prototype, values, |xml| xml.replace("minimum=\"6\"", "minimum=\"7\""));
    let constant = RecordDataType::Integer { min: 7, max: 7 };
    let error = read(&bytes, &ReadOptions::default()).unwrap_err().to_string();
    assert!(error.contains("constants"), "{error}");
    let mixed = cartesian(&[record(RecordName::Intensity, constant)]);
    let point = |x| [doubles(&[x, 2.0, 3.0]), vec![RecordValue::Integer(7)]].concat();
    let cloud =
        read(&file(&mixed, &[(None, vec![point(1.0), point(2.0)])]), &ReadOptions::default()).unwrap();
    assert_eq!(cloud.fields()[0].values, [7.0, 7.0], "a constant beside others is a field");
}

#[test]
fn a_description_of_more_attributes_than_any_has_is_refused() {
    let with = |count: usize| {
        let attributes = (0..count).map(|i| format!(" a{i}=\">\"")).collect::<Vec<_>>().concat();
        let more = |xml: String| xml.replace("</e57Root>", &format!("<e{attributes}/></e57Root>"));
        let bytes = described(&cartesian(&[]), doubles(&[1.0, 2.0, 3.0]), more);
        read(&bytes, &ReadOptions::default())
    };
    assert_eq!(with(900).unwrap().len(), 1);
    let error = with(1001).unwrap_err().to_string();
    assert!(error.contains("more than 1000 attributes"), "{error}");
}

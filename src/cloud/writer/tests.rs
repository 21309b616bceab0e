//! What is written is read back as it was, by our readers and by others'.

use super::*;
use crate::cloud::reader::{ReadOptions, read};
use crate::cloud::{NonFinite, ScalarField, ScalarType};

/// 5,000 rows: more than a chunk. Numbers that need all their digits.
fn cloud(dimension: usize) -> PointCloud {
    let n = 5000;
    let value = |i: usize| (i as f64 * 0.7).sin() * [1e-3, 1e-2, 0.1, 1.0, 10.0, 100.0, 1e3][i % 7];
    let coordinates = (0..n * dimension).map(value).collect();
    let fields = ScalarType::ALL.map(|kind| ScalarField {
        name: format!("field of {}", kind.ply_name()),
        kind,
        values: (0..n)
            .map(|i| match (kind.integer_range(), kind) {
                (Some((low, high)), _) => [low, high, (i % 100) as f64][i % 3],
                (None, ScalarType::Float32) => f64::from(value(i) as f32),
                (None, _) => value(i),
            })
            .collect(),
    });
    let faces = (2..n as u32).map(|i| [i, i - 1, i - 2]).collect();
    let cloud = PointCloud::new(dimension, coordinates, NonFinite::Reject).unwrap();
    cloud.with_fields(fields.to_vec()).unwrap().with_faces(faces).unwrap()
}

fn renamed(cloud: &PointCloud) -> Vec<ScalarField> {
    let fields = cloud.fields().iter().cloned();
    fields.map(|field| ScalarField { name: field.name.replace(' ', "_"), ..field }).collect()
}

#[test]
fn ply_is_read_back_exactly_in_both_encodings() {
    for dimension in [3, 5] {
        for encoding in [PlyEncoding::BinaryLittleEndian, PlyEncoding::Ascii] {
            let cloud = cloud(dimension);
            let mut bytes = Vec::new();
            write_ply(&cloud, encoding, &mut bytes).unwrap();
            let back = read(&bytes, Format::Ply, &ReadOptions::default()).unwrap();
            assert!(back.coordinates() == cloud.coordinates(), "{encoding:?}");
            assert!(back.fields() == renamed(&cloud), "{encoding:?}");
            assert_eq!(back.faces(), cloud.faces());
            assert_eq!(back.coordinate_type(), ScalarType::Float64);
        }
    }
}

#[test]
fn a_plane_is_written_into_space() {
    let cloud = PointCloud::new(2, vec![1.0, 2.0, 3.0, 4.0], NonFinite::Reject).unwrap();
    for encoding in [PlyEncoding::BinaryLittleEndian, PlyEncoding::Ascii] {
        let mut bytes = Vec::new();
        write_ply(&cloud, encoding, &mut bytes).unwrap();
        let back = read(&bytes, Format::Ply, &ReadOptions::default()).unwrap();
        assert_eq!(back.coordinates(), [1.0, 2.0, 0.0, 3.0, 4.0, 0.0]);
    }
}

#[test]
fn the_length_of_a_binary_ply_is_known_before_it_is_written() {
    let cloud = cloud(3);
    let mut bytes = Vec::new();
    write_ply(&cloud, PlyEncoding::BinaryLittleEndian, &mut bytes).unwrap();
    let header = PlyHeader::of(&cloud, PlyEncoding::BinaryLittleEndian);
    assert_eq!(header.file_len(), Some(bytes.len() as u64));
    let start = header.to_bytes().len() + 17 * header.stride();
    let rows = header.encode_rows(&ply_columns(&cloud, 17), 2);
    assert_eq!(rows, bytes[start..start + 2 * header.stride()], "a chunk is a slice of the file");
    assert_eq!(PlyHeader::of(&cloud, PlyEncoding::Ascii).file_len(), None);
}

fn with<'a>(cloud: &'a PointCloud, values: &'a [f64], kind: ScalarType) -> Vec<Column<'a>> {
    let mut columns = ply_columns(cloud, 0);
    columns.push(Column { values, stride: 1, kind });
    columns
}

#[test]
fn added_columns_stand_behind_the_fields() {
    let cloud = PointCloud::new(3, vec![1.0, 2.0, 3.0], NonFinite::Reject).unwrap();
    let header = PlyHeader::of(&cloud, PlyEncoding::Ascii).with_property("basis_0", ScalarType::Float32);
    let bytes =
        [header.to_bytes(), header.encode_rows(&with(&cloud, &[0.1], ScalarType::Float32), 1)].concat();
    assert!(String::from_utf8_lossy(&bytes).ends_with("property float basis_0\nend_header\n1 2 3 0.1\n"));
    let back = read(&bytes, Format::Ply, &ReadOptions::default()).unwrap();
    assert_eq!(back.fields()[0].name, "basis_0");
}

#[test]
fn another_ply_reader_finds_the_same_points_and_faces() {
    use ply_rs_bw::ply::{DefaultElement, Property};
    let cloud = cloud(3);
    let mut bytes = Vec::new();
    write_ply(&cloud, PlyEncoding::BinaryLittleEndian, &mut bytes).unwrap();
    let ply = ply_rs_bw::parser::Parser::<DefaultElement>::new().read_ply(&mut &bytes[..]).unwrap();
    let (vertices, faces) = (&ply.payload["vertex"], &ply.payload["face"]);
    assert_eq!((vertices.len(), faces.len()), (cloud.len(), cloud.faces().len()));
    assert_eq!(vertices[4321]["y"], Property::Double(cloud.point(4321)[1]));
    assert_eq!(vertices[4321]["field_of_short"], Property::Short(cloud.fields()[2].values[4321] as i16));
    assert_eq!(faces[9]["vertex_indices"], Property::ListInt(vec![11, 10, 9]));
}

#[test]
fn values_outside_an_integer_type_are_brought_into_its_range() {
    let cloud = PointCloud::new(3, vec![0.0; 12], NonFinite::Reject).unwrap();
    let values = [300.0, -1.0, 1.6, f64::NAN];
    for encoding in [PlyEncoding::BinaryLittleEndian, PlyEncoding::Ascii] {
        let header = PlyHeader::of(&cloud, encoding).with_property("red", ScalarType::Uint8);
        let bytes =
            [header.to_bytes(), header.encode_rows(&with(&cloud, &values, ScalarType::Uint8), 4)].concat();
        let back = read(&bytes, Format::Ply, &ReadOptions::default()).unwrap();
        assert_eq!(back.fields()[0].values, [255.0, 0.0, 2.0, 0.0]);
    }
}

#[test]
fn nan_passes_through_every_format_with_fields() {
    let cloud =
        PointCloud::new(3, vec![1.0, f64::NAN, 3.0, 4.0, 5.0, f64::INFINITY], NonFinite::Drop).unwrap();
    let options = ReadOptions { policy: NonFinite::Drop, ..ReadOptions::default() };
    for format in Format::ALL {
        let mut bytes = Vec::new();
        write(&cloud, format, &mut bytes).unwrap();
        let back = read(&bytes, format, &options).unwrap();
        assert!(back.point(0)[1].is_nan(), "{format}");
        assert_eq!(back.point(1)[2..], [f64::INFINITY], "{format}");
    }
}

#[test]
fn tables_and_meshes_are_read_back_exactly() {
    let cloud = cloud(3);
    for format in [Format::Obj, Format::Off, Format::Xyz, Format::Csv, Format::Npy] {
        let mut bytes = Vec::new();
        write(&cloud, format, &mut bytes).unwrap();
        let back = read(&bytes, format, &ReadOptions::default()).unwrap();
        assert_eq!(back.coordinates(), cloud.coordinates(), "{format}");
        if matches!(format, Format::Obj | Format::Off) {
            assert_eq!(back.faces(), cloud.faces(), "{format}");
        }
        if matches!(format, Format::Xyz | Format::Csv) {
            let values =
                |cloud: &PointCloud| cloud.fields().iter().map(|f| f.values.clone()).collect::<Vec<_>>();
            assert_eq!(values(&back), values(&cloud), "{format}");
        }
    }
}

#[test]
fn npy_is_what_npyz_reads_and_can_be_mapped() {
    for kind in ScalarType::ALL {
        for (rows, columns) in [(1, 1), (123_456, 100), (3, 7)] {
            let header = npy_header(rows, columns, kind);
            assert_eq!(header.len() % 64, 0);
            let parsed = npyz::NpyHeader::from_reader(&header[..]).unwrap();
            assert_eq!(parsed.shape(), [rows as u64, columns as u64]);
            assert_eq!(parsed.order(), npyz::Order::C);
            assert_eq!(parsed.dtype().num_bytes(), Some(kind.size()));
        }
    }
    let column = |values, kind| Column { values, stride: 1, kind };
    let columns =
        [column(&[1.0, 3.0, 5.0], ScalarType::Float64), column(&[2.0, 4.0, 6.0], ScalarType::Float64)];
    let bytes = [npy_header(3, 2, ScalarType::Float64), encode_rows(&columns, 3)].concat();
    let values: Vec<f64> = npyz::NpyFile::new(&bytes[..]).unwrap().into_vec().unwrap();
    assert_eq!(values, [1.0, 2.0, 3.0, 4.0, 5.0, 6.0]);
    let bytes = [
        npy_header_by_columns(3, 2, ScalarType::Float64),
        encode_rows(&columns[..1], 3),
        encode_rows(&columns[1..], 3),
    ];
    let back = read(&bytes.concat(), Format::Npy, &ReadOptions::default()).unwrap();
    assert_eq!(back.coordinates(), [1.0, 2.0, 3.0, 4.0, 5.0, 6.0]);
    let vector = encode_rows(&[column(&[1.5, -2.5], ScalarType::Float32)], 2);
    let bytes = [npy_vector_header(2, ScalarType::Float32), vector].concat();
    let values: Vec<f32> = npyz::NpyFile::new(&bytes[..]).unwrap().into_vec().unwrap();
    assert_eq!(values, [1.5, -2.5]);
}

#[test]
fn every_row_holds_its_number_of_every_column() {
    let n = 200;
    let pairs: Vec<f64> = (0..2 * n).map(f64::from).collect();
    let kinds = [ScalarType::Float32, ScalarType::Float64, ScalarType::Uint8];
    let columns = [(0, 2), (1, 2), (0, 1)].map(|(from, stride)| (&pairs[from..], stride));
    let columns: Vec<_> =
        kinds.iter().zip(columns).map(|(&kind, (values, stride))| Column { values, stride, kind }).collect();
    let bytes = encode_rows(&columns, n as usize);
    assert_eq!(bytes.len(), 200 * 13);
    for (row, bytes) in bytes.chunks(13).enumerate() {
        assert_eq!(bytes[..4], (2.0 * row as f32).to_le_bytes());
        assert_eq!(bytes[4..12], (2.0 * row as f64 + 1.0).to_le_bytes());
        assert_eq!(bytes[12], row as u8);
    }
    let mut columnwise = vec![0; 200 * 13];
    for (column, offset) in columns.iter().zip([0, 4, 12]) {
        encode_column(*column, &mut columnwise, 13, offset);
    }
    assert_eq!(columnwise, bytes);
}

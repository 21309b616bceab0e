//! What is written is read back as it was, by our readers and by others'.

#![allow(clippy::float_cmp)] // to the last digit

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
        for encoding in [PlyEncoding::Binary, PlyEncoding::Ascii] {
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
    for encoding in [PlyEncoding::Binary, PlyEncoding::Ascii] {
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
    write_ply(&cloud, PlyEncoding::Binary, &mut bytes).unwrap();
    let header = PlyHeader::of(&cloud, PlyEncoding::Binary);
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
    assert!(
        String::from_utf8_lossy(&bytes).ends_with("property float scalar_basis_0\nend_header\n1 2 3 0.1\n")
    );
    let back = read(&bytes, Format::Ply, &ReadOptions::default()).unwrap();
    assert_eq!(back.fields()[0].name, "basis_0");
}

#[test]
fn another_ply_reader_finds_the_same_points_and_faces() {
    use ply_rs_bw::ply::{DefaultElement, Property};
    let cloud = cloud(3);
    let mut bytes = Vec::new();
    write_ply(&cloud, PlyEncoding::Binary, &mut bytes).unwrap();
    let ply = ply_rs_bw::parser::Parser::<DefaultElement>::new().read_ply(&mut &bytes[..]).unwrap();
    let (vertices, faces) = (&ply.payload["vertex"], &ply.payload["face"]);
    assert_eq!((vertices.len(), faces.len()), (cloud.len(), cloud.faces().len()));
    assert_eq!(vertices[4321]["y"], Property::Double(cloud.point(4321)[1]));
    assert_eq!(
        vertices[4321]["scalar_field_of_short"],
        Property::Short(cloud.fields()[2].values[4321] as i16)
    );
    assert_eq!(faces[9]["vertex_indices"], Property::ListInt(vec![11, 10, 9]));
}

#[test]
fn values_outside_an_integer_type_are_brought_into_its_range() {
    let cloud = PointCloud::new(3, vec![0.0; 12], NonFinite::Reject).unwrap();
    let values = [300.0, -1.0, 1.6, f64::NAN];
    for encoding in [PlyEncoding::Binary, PlyEncoding::Ascii] {
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
    for format in Format::WRITTEN
        .into_iter()
        .filter(|format| !matches!(format, Format::Las | Format::Laz | Format::Stl))
    {
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
fn names_that_a_spreadsheet_would_run_are_written_behind_an_apostrophe() {
    let names = ["=1+1", "@sum", "+a", "-b", "plain"];
    let field = |name: &str| ScalarField {
        name: name.to_owned(),
        kind: ScalarType::Float64,
        values: vec![1.0].into(),
    };
    let cloud = PointCloud::new(3, vec![1.0, 2.0, 3.0], NonFinite::Reject).unwrap();
    let cloud = cloud.with_fields(names.map(field).to_vec()).unwrap();
    let mut bytes = Vec::new();
    write(&cloud, Format::Csv, &mut bytes).unwrap();
    assert!(bytes.starts_with(b"x,y,z,'=1+1,'@sum,'+a,'-b,plain\n"), "{}", String::from_utf8_lossy(&bytes));
    assert_eq!(read(&bytes, Format::Csv, &ReadOptions::default()).unwrap().fields(), cloud.fields());
    let header = csv_header(&["=cmd".to_owned()]);
    assert_eq!(header, b"'=cmd\n");
}

#[test]
fn a_pcd_comes_back_with_types_colors_and_normals() {
    let field = |name: &str, kind, values: [f64; 2]| ScalarField {
        name: name.to_owned(),
        kind,
        values: values.to_vec().into(),
    };
    for (points, kind) in [
        ([0.5, 1.0, 2.0, f64::NAN, 4.0, 5.0], ScalarType::Float32),
        ([5e6 + 0.001, 1.0, 2.0, 3.0, 4.0, 5.0], ScalarType::Float64),
    ] {
        let cloud = PointCloud::new(3, points.to_vec(), NonFinite::Drop).unwrap().with_coordinate_type(kind);
        let fields = vec![
            field("red", ScalarType::Uint8, [255.0, 0.0]),
            field("green", ScalarType::Uint8, [1.0, 2.0]),
            field("blue", ScalarType::Uint8, [3.0, 4.0]),
            field("nx", ScalarType::Float32, [0.5, f64::NAN]),
            field("ring", ScalarType::Uint16, [65_535.0, 7.0]),
            field("stamp", ScalarType::Float64, [1e9 + 0.125, 0.1]),
        ];
        let cloud = cloud.with_fields(fields).unwrap();
        let mut bytes = Vec::new();
        write(&cloud, Format::Pcd, &mut bytes).unwrap();
        assert_eq!(Format::sniff(&bytes), Some(Format::Pcd));
        let options = ReadOptions { policy: NonFinite::Drop, ..ReadOptions::default() };
        let back = read(&bytes, Format::Pcd, &options).unwrap();
        assert_eq!(format!("{back:?}"), format!("{cloud:?}"));
    }
}

#[test]
fn an_stl_has_the_triangles_in_binary_or_where_floats_are_too_coarse_in_text() {
    for offset in [0.0, 5e6] {
        let points: Vec<f64> =
            [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 1.0, 0.25].map(|x| x + offset).to_vec();
        let cloud = PointCloud::new(3, points, NonFinite::Reject).unwrap();
        let error = write(&cloud, Format::Stl, &mut Vec::new()).unwrap_err();
        assert_eq!(error.to_string(), "STL holds triangles; this cloud has none");
        let cloud = cloud.with_faces(vec![[0, 1, 2], [0, 2, 3]]).unwrap();
        let mut bytes = Vec::new();
        write(&cloud, Format::Stl, &mut bytes).unwrap();
        assert_eq!(bytes.starts_with(b"solid"), offset > 0.0);
        let back = read(&bytes, Format::Stl, &ReadOptions::default()).unwrap();
        assert_eq!((back.coordinates(), back.faces()), (cloud.coordinates(), cloud.faces()));
    }
}

#[test]
fn polygons_are_written_as_they_came() {
    let text = b"v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 3 4\nf 1 2 3\n";
    let cloud = read(text, Format::Obj, &ReadOptions::default()).unwrap();
    for format in [Format::Obj, Format::Off] {
        let mut bytes = Vec::new();
        write(&cloud, format, &mut bytes).unwrap();
        let back = read(&bytes, format, &ReadOptions::default()).unwrap();
        assert_eq!((back.faces(), back.continued()), (cloud.faces(), &[1][..]), "{format}");
        let in_four = PointCloud::new(4, vec![0.0; 4], NonFinite::Reject).unwrap();
        assert!(
            write(&in_four, format, &mut Vec::new()).unwrap_err().to_string().contains("these points have 4")
        );
    }
}

#[test]
fn formats_that_are_only_read_are_refused_by_name() {
    for format in Format::ALL.into_iter().filter(|format| !Format::WRITTEN.contains(format)) {
        let error = write(&cloud(3), format, &mut Vec::new()).unwrap_err();
        assert_eq!(error.to_string(), format!("{format} is read, not written"));
    }
}

#[test]
fn a_georeferenced_scan_goes_through_las_and_laz_with_all_its_fields() {
    let n = 70_000;
    let millimeters = |i: usize| (i * 7919 % 300_000) as f64 * 0.001;
    let coordinates: Vec<f64> = (0..n)
        .flat_map(|i| [1e6 + millimeters(i), 5.2e6 + millimeters(3 * i), millimeters(7 * i) - 40.0])
        .collect();
    let field = |name: &str, kind, value: fn(usize) -> f64| ScalarField {
        name: name.to_owned(),
        kind,
        values: (0..n).map(value).collect(),
    };
    let fields = vec![
        field("red", ScalarType::Uint8, |i| (i % 256) as f64),
        field("green", ScalarType::Uint8, |_| 9.0),
        field("blue", ScalarType::Uint8, |_| 255.0),
        field("classification", ScalarType::Uint8, |i| (i % 200 + 1) as f64),
        field("return_number", ScalarType::Uint8, |i| (i % 15 + 1) as f64),
        field("scan_angle", ScalarType::Float64, |i| (i % 100 + 1) as f64 * 0.006),
        field("intensity", ScalarType::Float32, |_| 0.25),
        field("a name of more than thirty-two bytes", ScalarType::Int32, |i| -1.0 - i as f64),
        field("rückstreuung", ScalarType::Float64, |i| 1.0 / (1.0 + i as f64)),
    ];
    let cloud = PointCloud::new(3, coordinates, NonFinite::Reject).unwrap().with_fields(fields).unwrap();
    for format in [Format::Las, Format::Laz] {
        let mut bytes = Vec::new();
        write(&cloud, format, &mut bytes).unwrap();
        assert_eq!(Format::sniff(&bytes), Some(format));
        let back = read(&bytes, format, &ReadOptions::default()).unwrap();
        let pairs = back.coordinates().iter().zip(cloud.coordinates());
        let farthest = pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        // A unit in the last place of 5.2e6 is 9.3e-10.
        assert!(farthest < 2e-9, "{format}: {farthest:e}");
        for field in cloud.fields() {
            let name: String = field.name.chars().take(32).collect();
            let found = back.fields().iter().find(|found| found.name == name).unwrap();
            // Colors of 8 bits fill 16.
            let times = if ["red", "green", "blue"].contains(&name.as_str()) { 256.0 } else { 1.0 };
            let pairs = found.values.iter().zip(&*field.values);
            let farthest = pairs.map(|(a, b)| (a - times * b).abs()).fold(0.0, f64::max);
            assert!(farthest < 1e-12, "{format} {name}: {farthest:e}");
        }
    }
}

#[test]
fn an_archive_has_points_fields_in_their_types_and_faces() {
    let cloud = cloud(3);
    let mut bytes = Vec::new();
    write_npz(&cloud, &mut bytes).unwrap();
    let mut archive = npyz::npz::NpzArchive::new(io::Cursor::new(bytes)).unwrap();
    let points = archive.by_name("points").unwrap().unwrap();
    assert_eq!(points.shape(), [5000, 3]);
    assert_eq!(points.into_vec::<f64>().unwrap(), cloud.coordinates());
    let floats = archive.by_name("field of float").unwrap().unwrap().into_vec::<f32>().unwrap();
    assert!(floats.iter().zip(&*cloud.fields()[6].values).all(|(&a, &b)| f64::from(a) == b));
    assert_eq!(archive.by_name("field of uchar").unwrap().unwrap().into_vec::<u8>().unwrap().len(), 5000);
    let faces = archive.by_name("faces").unwrap().unwrap().into_vec::<u32>().unwrap();
    assert_eq!(faces, cloud.faces().as_flattened());
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

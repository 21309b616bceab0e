//! Both encodings, every type, and every way to be wrong.

use ply_rs_bw::parser::Parser;
use ply_rs_bw::ply::{DefaultElement, Property};

use super::*;
use crate::cloud::reader::Location;
use crate::cloud::{CloudError, ScalarType};

const HEADER: &str = "ply\nformat ENCODING 1.0\ncomment caf\u{e9}\nobj_info none\nelement camera 1\nproperty float view\n\
    element vertex 3\nproperty uchar red\nproperty float z\nproperty double x\nproperty int y\n\
    property list uchar short ring\nproperty short scalar_Scalar_field_#2\nelement face 1\n\
    property list uchar uint vertex_indices\nproperty uchar flags\nend_header\n";

fn ply(bytes: &[u8]) -> Result<PointCloud, ReadError> {
    read(bytes, &ReadOptions::default())
}

fn message(bytes: &[u8]) -> String {
    ply(bytes).unwrap_err().to_string()
}

fn ascii(header: &str, body: &str) -> Vec<u8> {
    format!("ply\nformat ascii 1.0\n{header}end_header\n{body}").into_bytes()
}

/// The sample in binary; `flip` turns the bytes of every number into the wanted order.
fn binary(encoding: &str, flip: impl Fn(&[u8]) -> Vec<u8>) -> Vec<u8> {
    let mut bytes = HEADER.replace("ENCODING", encoding).into_bytes();
    bytes.extend(flip(&9.0_f32.to_le_bytes()));
    for i in 0..3_u8 {
        bytes.push(200 + i);
        bytes.extend(flip(&(f32::from(i) + 0.5).to_le_bytes()));
        bytes.extend(flip(&(f64::from(i) * 0.1).to_le_bytes()));
        bytes.extend(flip(&(-i32::from(i)).to_le_bytes()));
        bytes.push(i);
        for _ in 0..i {
            bytes.extend(flip(&7_i16.to_le_bytes()));
        }
        bytes.extend(flip(&(-300 - i16::from(i)).to_le_bytes()));
    }
    bytes.push(3);
    for corner in [2_u32, 1, 0] {
        bytes.extend(flip(&corner.to_le_bytes()));
    }
    bytes.push(1);
    bytes
}

fn sample_in_every_encoding() -> [Vec<u8>; 3] {
    let text = "9\n200 0.5 0 0 0 -300\n201 1.5 0.1 -1 1 7 -301\n202 2.5 0.2 -2 2 7 7 -302\n3 2 1 0 1\n";
    [
        format!("{}{text}", HEADER.replace("ENCODING", "ascii")).into_bytes(),
        binary("binary_little_endian", <[u8]>::to_vec),
        binary("binary_big_endian", |bytes| bytes.iter().rev().copied().collect()),
    ]
}

#[test]
fn every_encoding_gives_the_same_cloud() {
    for bytes in sample_in_every_encoding() {
        let cloud = ply(&bytes).unwrap();
        assert_eq!(cloud.coordinates(), [0.0, 0.0, 0.5, 0.1, -1.0, 1.5, 0.2, -2.0, 2.5]);
        assert_eq!(cloud.coordinate_type(), ScalarType::Float64);
        let [red, scalar] = cloud.fields() else { panic!("two fields") };
        assert_eq!(
            (red.name.as_str(), red.kind, &red.values[..]),
            ("red", ScalarType::Uint8, &[200.0, 201.0, 202.0][..])
        );
        assert_eq!((scalar.name.as_str(), scalar.kind), ("Scalar_field_#2", ScalarType::Int16));
        assert_eq!(scalar.values, [-300.0, -301.0, -302.0]);
        assert_eq!(cloud.faces(), [[2, 1, 0]]);
    }
}

#[test]
fn a_file_cut_at_any_byte_is_refused_with_its_place() {
    for bytes in sample_in_every_encoding() {
        let is_ascii = bytes.windows(5).any(|window| window == b"ascii");
        // In ASCII, the last byte is the end of the last line, which may be missing.
        let whole = bytes.len() - usize::from(is_ascii);
        for end in 0..whole {
            match ply(&bytes[..end]).unwrap_err() {
                ReadError::Truncated { location: Location::Byte(byte), .. } => assert_eq!(byte, end),
                ReadError::Truncated { location: Location::Line(line), .. }
                | ReadError::Malformed { location: Location::Line(line), .. } => {
                    assert!((1..30).contains(&line));
                }
                error => panic!("{end}: {error}"),
            }
        }
    }
}

#[test]
fn vertices_at_fixed_distances_are_decoded_across_blocks() {
    let mut bytes =
        b"ply\nformat binary_little_endian 1.0\nelement vertex 2000\nproperty float x\nproperty float y\n\
        property float z\nproperty uchar red\nend_header\n"
            .to_vec();
    for i in 0..2000_u16 {
        for axis in 0..3_u16 {
            bytes.extend((f32::from(i) + 0.25 * f32::from(axis)).to_le_bytes());
        }
        bytes.push((i % 251) as u8);
    }
    let cloud = ply(&bytes).unwrap();
    assert_eq!((cloud.len(), cloud.coordinate_type()), (2000, ScalarType::Float32));
    for i in 0..2000 {
        let x = i as f64;
        assert_eq!(cloud.point(i), [x, x + 0.25, x + 0.5]);
        assert_eq!(cloud.fields()[0].values[i..=i], [(i % 251) as f64]);
    }
    let theirs = Parser::<DefaultElement>::new().read_ply(&mut &bytes[..]).unwrap();
    for (i, vertex) in theirs.payload["vertex"].iter().enumerate() {
        assert_eq!(vertex["y"], Property::Float(cloud.point(i)[1] as f32));
    }
}

#[test]
fn strips_become_triangles_of_one_orientation() {
    // Two strips; the second repeats a corner, which makes a triangle without area.
    let body = "0 0 0\n1 0 0\n0 1 0\n1 1 0\n9 0 1 2 3 -1 1 1 2 3\n";
    let header = "element vertex 4\nproperty float x\nproperty float y\nproperty float z\n\
        element tristrips 1\nproperty list int int vertex_indices\n";
    let cloud = ply(&ascii(header, body)).unwrap();
    assert_eq!(cloud.faces(), [[0, 1, 2], [2, 1, 3], [2, 1, 3]]);
    assert!(cloud.continued().is_empty(), "each is a face");
}

#[test]
fn a_higher_dimension_is_found_by_name() {
    let header = "element vertex 1\nproperty float coordinate_3\nproperty float x\nproperty float y\nproperty float z\n";
    let cloud = ply(&ascii(header, "4 1 2 3\n")).unwrap();
    assert_eq!(cloud.coordinates(), [1.0, 2.0, 3.0, 4.0]);
}

#[test]
fn line_ends_of_windows_are_read() {
    let text = "ply\r\nformat ascii 1.0\r\nelement vertex 1\r\nproperty float x\r\nproperty float y\r\nproperty float z\r\nend_header\r\n1 2 3\r\n";
    assert_eq!(ply(text.as_bytes()).unwrap().coordinates(), [1.0, 2.0, 3.0]);
}

const VERTEX: &str = "element vertex 2\nproperty float x\nproperty float y\nproperty float z\n";

#[test]
fn announced_counts_are_held_against_the_bytes_before_anything_is_reserved() {
    let huge = VERTEX.replace('2', "4000000");
    assert_eq!(
        message(&ascii(&huge, "1 2 3\n")),
        "PLY, line 7: the file ends too early: 4000000 rows of element `vertex` are announced, 1 at most can follow"
    );
    let binary = format!("ply\nformat binary_little_endian 1.0\n{huge}end_header\n012345678901");
    assert!(
        message(binary.as_bytes())
            .contains("4000000 rows of element `vertex` are announced, 1 at most are there")
    );
    let beyond = VERTEX.replace('2', "18446744073709551615");
    assert!(matches!(ply(&ascii(&beyond, "")).unwrap_err(), ReadError::TooManyPoints { .. }));
    let list = format!(
        "ply\nformat binary_little_endian 1.0\nelement junk 1\nproperty list uint int a\n{VERTEX}end_header\n\u{7f}\u{7f}\u{7f}\u{7f}"
    );
    assert!(message(list.as_bytes()).contains("row 0 of the 1 of `junk` is incomplete"));
}

#[test]
fn an_element_without_properties_costs_nothing() {
    let header = format!("element nothing 18446744073709551615\n{VERTEX}");
    assert_eq!(ply(&ascii(&header, "1 2 3\n4 5 6\n")).unwrap().len(), 2);
}

#[test]
fn a_malformed_face_is_refused_by_name() {
    let header = format!("{VERTEX}element face 1\nproperty list uchar int vertex_index\n");
    let face = |row: &str| message(&ascii(&header, &format!("0 0 0\n1 1 1\n{row}\n")));
    assert_eq!(face("3 0 1 2"), "PLY, line 12: face 0 names point 2; the file has points 0 to 1");
    assert_eq!(face("3 0 1 -1"), "PLY, line 12: face 0 names point -1; the file has points 0 to 1");
    let left_out = ply(&ascii(&header, "0 0 0\n1 1 1\n2 0 1\n")).unwrap();
    assert_eq!(left_out.notes(), ["1 faces of fewer than three corners were left out"]);
    assert_eq!(face("4 0 1 1"), "PLY, line 12: the line ends before property `vertex_index`");
    assert_eq!(face("3 0 1 1 5"), "PLY, line 12: `5` is more than the header's properties account for");
    let mut binary = sample_in_every_encoding()[1].clone();
    let corner = binary.len() - 2;
    binary[corner] = 1;
    assert!(
        message(&binary).contains("face 0 names point 16777216; the file has points 0 to 2"),
        "{}",
        message(&binary)
    );
}

#[test]
fn a_list_of_negative_length_is_refused() {
    let header = format!(
        "ply\nformat binary_little_endian 1.0\nelement junk 1\nproperty list char int a\n{VERTEX}end_header\n"
    );
    let mut bytes = header.into_bytes();
    bytes.push(0xff);
    assert!(message(&bytes).contains("a list of -1 items"));
}

#[test]
fn a_malformed_header_is_refused_by_line() {
    let cases = [
        ("ply\nformat ascii 2.0\n", "PLY, line 2: version `2.0` is not supported; 1.0 is"),
        ("ply\nformat utf8 1.0\n", "PLY, line 2: format `utf8` is unknown"),
        ("ply\nproperty float x\n", "PLY, line 2: a property before any element"),
        ("ply\nelement vertex many\n", "PLY, line 2: `many` is not a number of elements"),
        ("ply\nelement vertex 1\nproperty half x\n", "PLY, line 3: `half` is not a type"),
        (
            "ply\nelement vertex 1\nproperty list float int x\n",
            "PLY, line 3: the length of a list has a floating type",
        ),
        ("ply\nelement vertex 1\nproperty float\n", "PLY, line 3: a property without a name"),
        ("ply\nelement vertex 1\nproperty\n", "PLY, line 3: a property without a type"),
        ("ply\nnonsense\n", "PLY, line 2: `nonsense` is not a header line"),
        ("ply\nend_header\n", "PLY, line 2: the header has no format line"),
        ("ply\nformat ascii 1.0\n", "PLY, line 2: the file ends too early: the line `end_header` is missing"),
        ("ply\nformat ascii 1.0\nend_header\n", "PLY, line 3: no `element vertex`"),
        ("plx\n", "PLY, line 1: the first line is not `ply`"),
    ];
    for (text, start) in cases {
        let message = message(text.as_bytes());
        assert!(message.starts_with(start), "{message}");
    }
    for properties in
        ["property float x\nproperty float z\n", "property float x\nproperty float x\n", "property float a\n"]
    {
        let message = message(&ascii(&format!("element vertex 1\n{properties}"), "1 2\n"));
        assert!(message.contains("needs the scalar properties x, y and z, once each"), "{message}");
    }
}

#[test]
fn a_value_that_does_not_fit_its_type_is_refused() {
    let header =
        "element vertex 1\nproperty float x\nproperty float y\nproperty float z\nproperty uchar red\n";
    assert_eq!(
        message(&ascii(header, "1 2 3 256\n")),
        "PLY, line 9: `256` does not fit property `red` of type uchar"
    );
}

#[test]
fn non_finite_coordinates_and_empty_clouds_are_the_clouds_errors() {
    assert_eq!(ply(&ascii(VERTEX, "1 2 3\n4 nan 6\n")).unwrap_err(), CloudError::NonFinite { row: 1 }.into());
    assert_eq!(ply(&ascii(&VERTEX.replace('2', "0"), "")).unwrap_err(), CloudError::Empty.into());
}

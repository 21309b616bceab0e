//! Files as PCL and `Open3D` write them, and broken ones.

use super::*;

const HEADER: &str = "# .PCD v0.7 - Point Cloud Data file format\nVERSION 0.7\nFIELDS x y z rgb normal_x _\n\
    SIZE 4 4 8 4 4 1\nTYPE F F F F F U\nCOUNT 1 1 1 1 1 3\nWIDTH 2\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS 2\n";

const COLOR: u32 = 0x00FF_8001;

/// The two points of every file here, with their padding.
fn rows() -> [Vec<u8>; 2] {
    [(1.0_f32, 2.0_f32, 1e6 + 1e-7, 0.5_f32), (4.0, 5.0, 6.0, -0.5)].map(|(x, y, z, nx): (_, _, f64, _)| {
        let (color, padding) = (COLOR.to_le_bytes(), [9_u8; 3]);
        [&x.to_le_bytes()[..], &y.to_le_bytes(), &z.to_le_bytes(), &color, &nx.to_le_bytes(), &padding]
            .concat()
    })
}

fn file(data: &str, body: &[u8]) -> Vec<u8> {
    [HEADER.as_bytes(), format!("DATA {data}\n").as_bytes(), body].concat()
}

/// A body in which every field stands by itself, packed as literals only.
fn packed() -> Vec<u8> {
    let rows = rows();
    let fields = [0..4, 4..8, 8..16, 16..20, 20..24, 24..27];
    let plain: Vec<u8> = fields
        .into_iter()
        .flat_map(|field| rows.each_ref().map(|row| row[field.clone()].to_vec()).concat())
        .collect();
    let literals: Vec<u8> =
        plain.chunks(32).flat_map(|piece| [&[piece.len() as u8 - 1][..], piece].concat()).collect();
    [&(literals.len() as u32).to_le_bytes()[..], &(plain.len() as u32).to_le_bytes(), &literals].concat()
}

fn cloud(bytes: &[u8]) -> PointCloud {
    read(bytes, &ReadOptions::default()).unwrap()
}

fn message(bytes: &[u8]) -> String {
    read(bytes, &ReadOptions::default()).unwrap_err().to_string()
}

#[test]
fn ascii_binary_and_compressed_files_hold_the_same_cloud() {
    let float = f32::from_bits(COLOR);
    let text = format!("1 2 1000000.0000001 {float:e} 0.5 9 9 9\n4 5 6 {float:e} -0.5 9 9 9\n");
    let clouds = [
        cloud(&file("ascii", text.as_bytes())),
        cloud(&file("binary", &rows().concat())),
        cloud(&file("binary_compressed", &packed())),
    ];
    assert_eq!(clouds[0].coordinates(), [1.0, 2.0, 1e6 + 1e-7, 4.0, 5.0, 6.0]);
    assert_eq!(clouds[0].coordinate_type(), ScalarType::Float64, "no axis loses digits");
    let fields: Vec<_> = clouds[0].fields().iter().map(|f| (f.name.as_str(), f.values[0])).collect();
    assert_eq!(fields, [("red", 255.0), ("green", 128.0), ("blue", 1.0), ("nx", 0.5)]);
    assert_eq!(clouds[1], clouds[0]);
    assert_eq!(clouds[2], clouds[0]);
}

#[test]
fn an_integer_color_with_alpha_becomes_four_fields() {
    let bytes = b"VERSION .7\nFIELDS x y z rgba\nSIZE 4 4 4 4\nTYPE F F F U\nWIDTH 1\nHEIGHT 1\nPOINTS 1\nDATA ascii\n\
        0 0 0 2164326657\n";
    let fields: Vec<_> = cloud(bytes).fields().iter().map(|f| (f.name.clone(), f.values[0])).collect();
    // 2164326657 = 0x81010101, hence 0x81 of alpha
    assert_eq!(
        fields,
        [("red", 1.0), ("green", 1.0), ("blue", 1.0), ("alpha", 129.0)].map(|(n, v)| (n.to_owned(), v))
    );
}

#[test]
fn a_field_of_several_values_becomes_several_fields() {
    let bytes = b"FIELDS x y z d\nSIZE 4 4 4 2\nTYPE F F F I\nCOUNT 1 1 1 2\nWIDTH 1\nHEIGHT 1\nDATA ascii\n0 0 0 7 -8\n";
    let fields: Vec<_> = cloud(bytes).fields().iter().map(|f| (f.name.clone(), f.values[0])).collect();
    assert_eq!(fields, [("d_0".to_owned(), 7.0), ("d_1".to_owned(), -8.0)]);
}

#[test]
fn counts_are_held_against_the_bytes_that_are_there() {
    let body = rows().concat();
    assert!(
        message(&file("binary", &body[1..])).contains("2 points of 27 bytes are announced, 53 bytes follow")
    );
    let huge = String::from_utf8(file("binary", b"")).unwrap();
    for points in ["4999999", "5000001", "18446744073709551615"] {
        let huge = huge.replace("POINTS 2", &format!("POINTS {points}"));
        assert!(read(huge.as_bytes(), &ReadOptions::default()).is_err());
        let ascii = huge.replace("DATA binary", "DATA ascii");
        assert!(read(ascii.as_bytes(), &ReadOptions::default()).is_err());
    }
    assert!(message(&file("ascii", b"1 2 3 0 0 9 9 9\n")).contains("2 points are announced, 1 follow"));
    assert!(message(&file("ascii", b"1 2 3 0 0 9 9\n")).contains("has 7 values"));
}

#[test]
fn compressed_data_that_contradicts_itself_is_refused() {
    let good = packed();
    let mut longer = good.clone();
    longer[4] += 1;
    assert!(message(&file("binary_compressed", &longer)).contains("the data unpacks to 55 bytes"));
    let mut damaged = good.clone();
    damaged[8] = 0xFF;
    assert!(message(&file("binary_compressed", &damaged)).contains("does not unpack"));
    assert!(message(&file("binary_compressed", &good[..20])).contains("bytes follow"));
    assert!(message(&file("binary_compressed", &[0; 3])).contains("3 bytes follow"));
}

#[test]
fn a_small_file_that_would_unpack_to_hundreds_of_megabytes_is_refused_before_it_does() {
    let header = HEADER.replace("POINTS 2", "POINTS 4000000");
    let sizes = [[0, 1, 0, 0], 108_000_000_u32.to_le_bytes()].concat();
    let bytes = [header.as_bytes(), b"DATA binary_compressed\n", &sizes, &[0; 256]].concat();
    let error = read(&bytes, &ReadOptions::default()).unwrap_err();
    assert!(matches!(error, ReadError::TooCompressed { unpacked: 108_000_000, .. }), "{error}");
}

#[test]
fn a_header_with_holes_is_refused_by_its_line() {
    assert!(message(b"FIELDS x y z\nDATA ascii\n").contains("PCD, line 2: SIZE is missing"));
    let two = b"FIELDS x y\nSIZE 4 4\nTYPE F F\nCOUNT 1\nPOINTS 1\nDATA ascii\n";
    assert!(message(two).contains("different numbers of entries"));
    let half = b"FIELDS x\nSIZE 2\nTYPE F\nPOINTS 1\nDATA ascii\n";
    assert!(message(half).contains("type F of 2 bytes"));
    assert!(message(b"VERSION 0.7\nPOINTS 3\n").contains("the line DATA is missing"));
    assert!(message(b"VERSION 0.7\nPOINTS many\n").contains("`many` is not a number of points"));
    assert!(message(b"VERSION 0.7\nNONSENSE\n").contains("`NONSENSE` is not a line of a PCD header"));
    let without_x = b"FIELDS a\nSIZE 4\nTYPE F\nPOINTS 1\nDATA ascii\n1\n";
    assert!(message(without_x).contains("FIELDS needs x, y and z"));
}

//! Small files as many programs write them, and what is right.

#![allow(clippy::float_cmp)] // to the last digit

use super::{Format, ReadOptions, read};
use crate::cloud::{NonFinite, PointCloud, ScalarType};

/// Reads a file of the format that its first bytes tell, or else of `format`.
fn file(bytes: impl AsRef<[u8]>, format: Format) -> PointCloud {
    let bytes = bytes.as_ref();
    let found = Format::sniff(bytes).unwrap_or(format);
    read(bytes, found, &ReadOptions::default()).unwrap_or_else(|error| panic!("{error}"))
}

fn names(cloud: &PointCloud) -> Vec<&str> {
    cloud.fields().iter().map(|field| field.name.as_str()).collect()
}

const FOUR: [f64; 12] = [0.25, 0.0, 1.0, 1.5, 0.0, 2.0, 1.5, 1.25, 3.0, 0.0, 1.75, 4.0];

#[test]
fn nan_and_infinity_as_windows_printed_them_are_no_numbers() {
    let cloud = file("0 0 1 5\n1 0 2 1.#QNAN\n1 1 3 -1.#IND\n0 1 4 1.#INF00\n", Format::Xyz);
    let values = &cloud.fields()[0].values;
    assert_eq!((cloud.len(), values[0], values[3]), (4, 5.0, f64::INFINITY));
    assert!(values[1].is_nan() && values[2].is_nan());
    let text = "0 0 1\n1 0 -1.#IND\n1 1 3\n";
    let error = read(text.as_bytes(), Format::Xyz, &ReadOptions::default()).unwrap_err();
    assert!(error.to_string().contains("point 1 "), "{error}");
    let options = ReadOptions { policy: NonFinite::Drop, ..ReadOptions::default() };
    let cloud = read(text.as_bytes(), Format::Xyz, &options).unwrap();
    assert!(cloud.point(1)[2].is_nan());
    let pcd = "VERSION .7\nFIELDS x y z i\nSIZE 4 4 4 4\nTYPE F F F F\nCOUNT 1 1 1 1\nWIDTH 2\nHEIGHT 1\nPOINTS 2\n\
        DATA ascii\n0 0 1 5\n1 0 2 1.#QNAN\n";
    let cloud = file(pcd, Format::Pcd);
    assert!(cloud.fields()[0].values[0] == 5.0 && cloud.fields()[0].values[1].is_nan());
    let off = read(b"OFF\n2 0 0\n0 0 1\n1 0 1.#INF\n", Format::Off, &options).unwrap();
    assert_eq!(off.point(1)[2], f64::INFINITY);
}

#[test]
fn lines_may_end_in_cr_alone() {
    let cloud = file("0.25 0 1\r1.5 0 2\r1.5 1.25 3\r0 1.75 4\r", Format::Xyz);
    assert_eq!((cloud.coordinates(), cloud.fields().len()), (&FOUR[..], 0));
    assert_eq!(file("x,y,z\r0.25,0,1\r1.5,0,2\r1.5,1.25,3\r0,1.75,4", Format::Csv).coordinates(), FOUR);
    let header = |encoding: &str| {
        format!(
            "ply\rformat {encoding} 1.0\relement vertex 4\rproperty float x\rproperty float y\rproperty float z\r\
             end_header\r"
        )
    };
    let body: Vec<u8> = FOUR.iter().flat_map(|&x| (x as f32).to_le_bytes()).collect();
    let binary = [header("binary_little_endian").into_bytes(), body].concat();
    assert_eq!(file(binary, Format::Ply).coordinates(), FOUR);
    let ascii = header("ascii") + "0.25 0 1\r1.5 0 2\r1.5 1.25 3\r0 1.75 4\r";
    assert_eq!(file(ascii, Format::Ply).coordinates(), FOUR);
    assert_eq!(file("v 0 0 0\rv 2 0 0\rv 2 1 0\rf 1 2 3\r", Format::Obj).faces(), [[0, 1, 2]]);
    // The first byte of the data is a line feed.
    let bytes = "ply\rformat binary_little_endian 1.0\relement vertex 1\rproperty uchar x\rproperty uchar y\rproperty \
        uchar z\rend_header\r\n\r\n";
    assert_eq!(file(bytes, Format::Ply).coordinates(), [10.0, 13.0, 10.0]);
}

#[test]
fn coordinates_are_found_where_the_header_says() {
    let expected = [512_000.25, 5_301_000.5, 411.5, 512_001.25, 5_301_000.5, 411.75];
    for header in ["id,easting,northing,height", "OBJECTID,POINT_X,POINT_Y,POINT_Z", "n,X [m],Y [m],Z [m]"] {
        let cloud = file(
            format!("{header}\n1,512000.25,5301000.5,411.5\n2,512001.25,5301000.5,411.75\n"),
            Format::Csv,
        );
        assert_eq!(cloud.coordinates(), expected, "{header}");
        assert_eq!(names(&cloud), [header.split(',').next().unwrap()]);
    }
    for text in ["# id,x,y,z\n7,0.25,0,1\n8,1.5,0,2\n", "//id,x,y,z\n2\n7,0.25,0,1\n8,1.5,0,2\n"] {
        let cloud = file(text, Format::Xyz);
        assert_eq!((cloud.coordinates(), names(&cloud)), (&FOUR[..6], vec!["id"]), "{text}");
    }
    let cloud = file("Point ID\tX\tY\tZ\nA1\t1\t2\t3\nA2\t4\t5\t6\n", Format::Xyz);
    assert_eq!(cloud.coordinates(), [1.0, 2.0, 3.0, 4.0, 5.0, 6.0]);
    let cloud = file("X [m] Y [m] Z [m]\n1 2 3\n", Format::Xyz);
    assert_eq!(cloud.coordinates(), [1.0, 2.0, 3.0]);
}

#[test]
fn names_of_r_of_windows_and_of_counts_are_read() {
    // R writes a name before every row and none above them.
    let cloud = file("\"x\" \"y\" \"z\"\n\"1\" 0.25 0 1\n\"2\" 1.5 0 2\n", Format::Xyz);
    assert_eq!((cloud.coordinates(), cloud.fields().len()), (&FOUR[..6], 0));
    let latin = b"Rechtswert;Hochwert;H\xF6he;G\xFCte\n0,25;0;1;7\n1,5;0;2;8\n";
    let cloud = file(latin, Format::Csv);
    assert_eq!((cloud.coordinates(), names(&cloud)), (&FOUR[..6], vec!["G\u{fc}te"]));
    let cloud = file("X Y Z I\n2\n0.25 0 1 7\n1.5 0 2 8\n", Format::Xyz);
    assert_eq!((cloud.coordinates(), names(&cloud)), (&FOUR[..6], vec!["I"]));
    // Chemists' XYZ: a count, a title, an element before every position.
    let cloud = file("2\nwater\nO 0.25 0 1\nH 1.5 0 2\n", Format::Xyz);
    assert_eq!(cloud.coordinates(), &FOUR[..6]);
    assert!(cloud.notes().iter().any(|note| note.contains("column 1 holds text")), "{:?}", cloud.notes());
    assert_eq!(file("0.25 0 1\r\n1.5 0 2\r\n\x1A", Format::Xyz).coordinates(), &FOUR[..6]);
    assert_eq!(file("0.25D+00 0 1\n.15D+01 0 2\n", Format::Xyz).coordinates(), &FOUR[..6]);
}

#[test]
fn what_spreadsheets_and_fortran_write_for_no_number_is_none() {
    for word in
        ["#NV", "#DIV/0!", "#WERT!", "<NA>", "n.a.", "******", "1.#QNAN00e+000", "nan(0x8000000000000)"]
    {
        let cloud = file(format!("x,y,z,q\n0.25,0,1,{word}\n1.5,0,2,7\n"), Format::Csv);
        let values = &cloud.fields()[0].values;
        assert!(values[0].is_nan() && values[1] == 7.0, "{word}");
    }
}

#[test]
fn what_stands_behind_the_last_announced_row_is_told_of() {
    let pcd = "VERSION .7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH 1\nHEIGHT 1\nPOINTS 1\nDATA ASCII\n";
    let ply = "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\nend_header\n";
    for (header, format) in [(pcd, Format::Pcd), (ply, Format::Ply), ("OFF\n1 0 0\n", Format::Off)] {
        let cloud = file(format!("{header}1 2 3\n\n"), format);
        assert!(cloud.notes().is_empty(), "{format}: {:?}", cloud.notes());
        let cloud = file(format!("{header}1 2 3\n4 5 6\n7 8 9\n"), format);
        assert_eq!(cloud.len(), 1);
        assert!(cloud.notes()[0].starts_with("2 lines behind the"), "{format}: {:?}", cloud.notes());
    }
}

#[test]
fn text_of_more_digits_than_floats_have_is_kept_in_doubles() {
    let body = "512000.123 5301000.61 411.76\n512001.5 5301001.5 412\n";
    let pcd = "VERSION .7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH 2\nHEIGHT 1\nPOINTS 2\nDATA ascii\n";
    let ply = "ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty float y\nproperty float z\nend_header\n";
    for (header, format) in [(pcd, Format::Pcd), (ply, Format::Ply)] {
        let cloud = file(format!("{header}{body}"), format);
        assert_eq!(
            (cloud.point(0)[1], cloud.coordinate_type()),
            (5_301_000.61, ScalarType::Float64),
            "{format}"
        );
        let cloud = file(format!("{header}0.1 0.2 0.300000012\n1 2 3\n"), format);
        assert_eq!(cloud.coordinate_type(), ScalarType::Float32);
        assert_eq!(cloud.point(0), [f64::from(0.1_f32), f64::from(0.2_f32), f64::from(0.3_f32)]);
    }
}

#[test]
fn an_array_of_six_columns_is_points_and_three_fields_as_text_is() {
    let header = format!("{:117}\n", "{'descr': '<f8', 'fortran_order': False, 'shape': (1, 6), }");
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    bytes.extend((header.len() as u16).to_le_bytes());
    bytes.extend(header.as_bytes());
    bytes.extend([0.25_f64, 0.0, 1.0, 255.0, 0.0, 0.0].iter().flat_map(|x| x.to_le_bytes()));
    let cloud = file(bytes, Format::Npy);
    assert_eq!((cloud.coordinates(), cloud.fields().len()), (&FOUR[..3], 3));
}

#[test]
fn files_in_gzip_and_alone_in_zip_are_read() {
    use std::io::Write;
    let text = b"x,y,z\n0.25,0,1\n1.5,0,2\n";
    let mut gzip = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::default());
    gzip.write_all(text).unwrap();
    let gzip = gzip.finish().unwrap();
    let zip = |names: &[&str]| {
        let mut zip = npyz::zip::ZipWriter::new(std::io::Cursor::new(Vec::new()));
        for name in names {
            zip.start_file(*name, npyz::zip::write::FileOptions::default()).unwrap();
            zip.write_all(text).unwrap();
        }
        zip.finish().unwrap().into_inner()
    };
    for (name, bytes) in [("scan.csv.gz", &gzip), ("scan.zip", &zip(&["folder/scan.csv"]))] {
        for name in [Some(name), None] {
            let format = Format::of_file(name, bytes).unwrap();
            let cloud = read(bytes, format, &ReadOptions::default()).unwrap();
            assert_eq!(cloud.coordinates(), &FOUR[..6], "{name:?} {format}");
        }
    }
    let error = read(&zip(&["a.csv", "b.csv"]), Format::Csv, &ReadOptions::default()).unwrap_err();
    assert!(error.to_string().contains("holds 2 files"), "{error}");
    assert_eq!(Format::of_file(Some("scan.zip"), &zip(&["a.csv", "b.txt"])), Some(Format::Csv));
    let mut page = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::default());
    page.write_all(b"<!DOCTYPE html><html>404").unwrap();
    let told = super::foreign(&page.finish().unwrap()).unwrap().to_string();
    assert!(told.contains("an HTML page"), "{told}");
    let bomb = vec![b'0'; 70 << 20];
    let mut packed = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::fast());
    packed.write_all(&bomb).unwrap();
    let error = read(&packed.finish().unwrap(), Format::Xyz, &ReadOptions::default()).unwrap_err();
    assert!(matches!(error, super::ReadError::TooCompressed { .. }), "{error}");
    assert!(read(&gzip[..gzip.len() - 9], Format::Csv, &ReadOptions::default()).is_err());
}

#[test]
fn an_archive_of_arrays_is_a_cloud_as_we_write_it() {
    let cloud = file("x y z i\n0.25 0 1 7\n1.5 0 2 8\n1.5 1.25 3 9\n", Format::Xyz);
    let cloud = cloud.with_faces(vec![[0, 1, 2]]).unwrap();
    let mut bytes = Vec::new();
    crate::cloud::writer::write_npz(&cloud, &mut bytes).unwrap();
    for name in [Some("cloud.npz"), None] {
        let format = Format::of_file(name, &bytes).unwrap();
        let back = read(&bytes, format, &ReadOptions::default()).unwrap();
        assert_eq!(back, cloud);
    }
}

#[test]
fn an_archive_of_vectors_x_y_and_z_is_a_cloud() {
    use npyz::WriterBuilder;
    let archive = |vectors: &[(&str, &[u64], &[f32])]| {
        let mut bytes = Vec::new();
        let mut archive = npyz::npz::NpzWriter::new(std::io::Cursor::new(&mut bytes));
        for (name, shape, values) in vectors {
            let array = archive.array(name, npyz::zip::write::FileOptions::default()).unwrap();
            let mut array = array.default_dtype().shape(shape).begin_nd().unwrap();
            array.extend(values.iter().copied()).unwrap();
            array.finish().unwrap();
        }
        drop(archive);
        bytes
    };
    let (x, y, z) = (
        ("X", &[2][..], &[1.0, 4.0][..]),
        ("y", &[2][..], &[2.0, 5.0][..]),
        ("z", &[2][..], &[3.0, 6.0][..]),
    );
    let intensity = ("intensity", &[2][..], &[7.0, 8.0][..]);
    let bytes = archive(&[z, intensity, x, y]);
    let format = Format::of_file(None, &bytes).unwrap();
    let cloud = file(&bytes, format);
    assert_eq!(cloud.coordinates(), [1.0, 2.0, 3.0, 4.0, 5.0, 6.0]);
    assert_eq!(cloud.coordinate_type(), crate::cloud::ScalarType::Float32);
    assert_eq!((names(&cloud), &cloud.fields()[0].values[..]), (vec!["intensity"], &[7.0, 8.0][..]));
    let refused = |vectors: &[(&str, &[u64], &[f32])]| {
        read(&archive(vectors), format, &ReadOptions::default()).unwrap_err().to_string()
    };
    let short = refused(&[x, y, ("z", &[1], &[3.0])]);
    assert!(short.contains("vectors of one length") && short.contains("2×1, 2×1, 1×1"), "{short}");
    let grid = refused(&[x, y, ("z", &[2, 2], &[3.0; 4])]);
    assert!(grid.contains("ravel()") && grid.contains("2×2"), "{grid}");
    assert!(refused(&[x, y]).contains("no array `points` and no vectors `x`, `y` and `z`; it has X, y"));
}

#[test]
fn a_pcd_with_padding_of_no_values_is_read() {
    let header = "# .PCD v0.7 - Point Cloud Data file format\nVERSION 0.7\nFIELDS x y z _ i _ ring _\nSIZE 4 4 4 1 4 1 1 1\n\
        TYPE F F F U F U U U\nCOUNT 1 1 1 4 1 0 1 3\nWIDTH 2\nHEIGHT 1\nPOINTS 2\nDATA binary\n";
    let point = |x: f32| {
        let mut bytes: Vec<u8> = [x, 2.0, 3.0].iter().flat_map(|x| x.to_le_bytes()).collect();
        bytes.extend([0; 4]);
        bytes.extend(9_f32.to_le_bytes());
        bytes.extend([5, 0, 0, 0]);
        bytes
    };
    let cloud = file([header.as_bytes(), &point(1.0), &point(4.0)].concat(), Format::Pcd);
    assert_eq!((cloud.coordinates()[3], names(&cloud)), (4.0, vec!["i", "ring"]));
    assert_eq!(cloud.fields()[1].values, [5.0, 5.0]);
}

#[test]
fn a_ply_may_have_integers_of_64_bits_and_truth_values() {
    let header = |encoding: &str| {
        format!(
            "ply\nformat {encoding} 1.0\nelement vertex 2\nproperty float x\nproperty float y\nproperty float z\n\
             property int64 t\nproperty bool seen\nend_header\n"
        )
    };
    let point = |t: i64| {
        let mut bytes: Vec<u8> = [1.0_f32, 2.0, 3.0].iter().flat_map(|x| x.to_le_bytes()).collect();
        bytes.extend(t.to_le_bytes());
        bytes.push(1);
        bytes
    };
    let binary = [header("binary_little_endian").into_bytes(), point(1 << 40), point(-7)].concat();
    let ascii = header("ascii") + "1 2 3 1099511627776 1\n1 2 3 -7 true\n";
    for bytes in [binary.as_slice(), ascii.as_bytes()] {
        let cloud = file(bytes, Format::Ply);
        assert_eq!(cloud.fields()[0].values, [1_099_511_627_776.0, -7.0]);
        assert_eq!((cloud.fields()[1].values[0], cloud.notes().len()), (1.0, 0));
    }
    let stamps =
        [header("binary_little_endian").into_bytes(), point(1_700_000_000_000_000_001), point(2)].concat();
    assert!(file(stamps, Format::Ply).notes()[0].contains("more than 53 bits"));
}

#[test]
fn scalar_fields_have_one_name_whatever_the_file() {
    let text = "x y z intensity\n1 2 3 9\n";
    let cloud = file(text, Format::Xyz);
    let mut bytes = Vec::new();
    crate::cloud::writer::write(&cloud, Format::Ply, &mut bytes).unwrap();
    assert!(String::from_utf8_lossy(&bytes).contains("property double scalar_intensity\n"));
    assert_eq!(names(&file(&bytes, Format::Ply)), ["intensity"]);
    let both = "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\n\
        property float q\nproperty float scalar_q\nproperty float scalar_x\nend_header\n1 2 3 4 5 6\n";
    let cloud = file(both, Format::Ply);
    assert_eq!(names(&cloud), ["q", "scalar_q", "scalar_x"]);
    let mut bytes = Vec::new();
    crate::cloud::writer::write(&cloud, Format::Ply, &mut bytes).unwrap();
    let back = file(&bytes, Format::Ply);
    assert_eq!(back.fields().iter().map(|field| field.values[0]).collect::<Vec<_>>(), [4.0, 5.0, 6.0]);
}

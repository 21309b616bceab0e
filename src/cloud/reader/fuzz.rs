//! No reader panics, whatever the bytes.

use proptest::prelude::*;

use super::{Format, Limits, ReadOptions, read};

/// A small file per format that uses most of what the format has.
fn seeds() -> Vec<(Format, Vec<u8>)> {
    let mut ply = b"ply\nformat binary_little_endian 1.0\nelement vertex 3\nproperty float x\nproperty float y\n\
        property float z\nproperty uchar red\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n"
        .to_vec();
    ply.extend([0; 39]);
    ply.extend([3, 0, 0, 0, 0, 1, 0, 0, 0, 2, 0, 0, 0]);
    let mut npy =
        b"\x93NUMPY\x01\x00\x3c\x00{'descr': '<f8', 'fortran_order': False, 'shape': (2, 3), }\n".to_vec();
    npy.extend([0; 48]);
    let strips = b"ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n\
        element tristrips 1\nproperty list int int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n5 0 1 2 -1 0\n";
    vec![
        (Format::Ply, ply),
        (Format::Ply, strips.to_vec()),
        (Format::Obj, b"v 0 0 0 1 1 1\nv 1 0 0 1 1 1\nv 0 1 0 1 1 1\nf 1//1 2/2 -1\n".to_vec()),
        (Format::Off, b"COFF\n3 1 0\n0 0 0 9 9 9\n1 0 0 9 9 9\n0 1 0 9 9 9\n3 0 1 2\n".to_vec()),
        (Format::Xyz, b"2\n//X Y Z Intensity\n1 2 3 4\n5 6 7 8 # end\n".to_vec()),
        (Format::Csv, b"x;y;z;\"a b\"\n1;2;3;4\n5;6;7;8\n".to_vec()),
        (Format::Npy, npy),
        (Format::Stl, b"solid s\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\nendsolid s\n".to_vec()),
        (Format::Stl, binary_stl()),
        (Format::Pcd, b"VERSION 0.7\nFIELDS x y z rgb\nSIZE 4 4 4 4\nTYPE F F F U\nCOUNT 1 1 1 1\nWIDTH 2\nHEIGHT 1\nPOINTS 2\nDATA ascii\n1 2 3 4\n5 6 7 8\n".to_vec()),
        (Format::Pcd, compressed_pcd()),
        (Format::Las, written(Format::Las)),
        (Format::Laz, written(Format::Laz)),
        (Format::Xyz, b"1\n3\n0 0 9\n1 0 0\n0 1 0\n0 0 1\n1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 9 1\n1 2 3 0.5\n0 0 0 0\n4 5 6 0.25\n".to_vec()),
        (Format::Xyz, b"2\n1 2 3 4\n5 6 7 8\n1\n1 2 3 4\n".to_vec()),
        (Format::Xyz, b"# POINT3D_ID, X, Y, Z, R, G, B\n7 1 2 3 4 5 6 0.5 1 2\n8 1 2 3 4 5 6 0.5\n".to_vec()),
        (Format::Csv, b"sep=;\nname;easting;northing;height\na;0,5;1;2;\n\"b\";1;2;NA;\n".to_vec()),
        (Format::Off, binary_off()),
        (Format::Npy, records_npy()),
        (Format::Npy, archive()),
        (Format::Csv, gzip(b"x,y,z\n1,2,3\n4,5,6\n")),
        (Format::Stl, written(Format::Stl)),
        (Format::Pcd, written(Format::Pcd)),
        (Format::Obj, b"v 0 0 \\\n0 # c\nv 1 0 0 1 1 1 1\nv 0 1\nvt 0 0\nf 1/1 2 3\nf 1 2\n".to_vec()),
    ]
}

/// Places of seeds in their list.
const SEEDS: usize = 24;

fn binary_off() -> Vec<u8> {
    let mut bytes = b"OFF BINARY\n".to_vec();
    bytes.extend([3, 1, 0].iter().flat_map(|x: &u32| x.to_be_bytes()));
    bytes.extend([0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0].iter().flat_map(|x: &f32| x.to_be_bytes()));
    bytes.extend([3, 0, 1, 2, 0].iter().flat_map(|x: &u32| x.to_be_bytes()));
    bytes
}

fn records_npy() -> Vec<u8> {
    let header = format!(
        "{:117}\n",
        "{'descr': [('x', '<f8'), ('y', '<f8'), ('z', '<f8'), ('c', '|u1', (3,))], 'fortran_order': False, 'shape': (2,), }"
    );
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    bytes.extend((header.len() as u16).to_le_bytes());
    bytes.extend(header.as_bytes());
    bytes.extend([0; 2 * 27]);
    bytes
}

fn archive() -> Vec<u8> {
    let mut bytes = Vec::new();
    crate::cloud::writer::write_npz(&cloud(), &mut bytes).unwrap();
    bytes
}

fn gzip(bytes: &[u8]) -> Vec<u8> {
    use std::io::Write;
    let mut packed = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::default());
    packed.write_all(bytes).unwrap();
    packed.finish().unwrap()
}

fn binary_stl() -> Vec<u8> {
    let mut bytes = vec![0; 84 + 50];
    bytes[80] = 1;
    bytes[84 + 24..84 + 28].copy_from_slice(&1_f32.to_le_bytes());
    bytes[84 + 40..84 + 44].copy_from_slice(&1_f32.to_le_bytes());
    bytes
}

fn compressed_pcd() -> Vec<u8> {
    let mut bytes =
        b"VERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH 2\nHEIGHT 1\nPOINTS 2\n\
        DATA binary_compressed\n"
            .to_vec();
    // 8 zeros and a reference back for the other 16
    bytes.extend([12, 0, 0, 0, 24, 0, 0, 0, 7, 0, 0, 0, 0, 0, 0, 0, 0, 7 << 5, 7, 7]);
    bytes
}

/// A cloud with colors, as we write it.
fn written(format: Format) -> Vec<u8> {
    let mut bytes = Vec::new();
    crate::cloud::writer::write(&cloud(), format, &mut bytes).unwrap();
    bytes
}

/// Three points with colors and a face.
fn cloud() -> crate::cloud::PointCloud {
    let field = |name: &str| crate::cloud::ScalarField {
        name: name.to_owned(),
        kind: crate::cloud::ScalarType::Uint16,
        values: vec![1.0, 2.0, 3.0].into(),
    };
    let points = vec![1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 0.0];
    let cloud = crate::cloud::PointCloud::new(3, points, crate::cloud::NonFinite::Reject);
    let fields = ["red", "green", "blue", "more"].map(field).to_vec();
    cloud
        .and_then(|cloud| cloud.with_fields(fields))
        .and_then(|cloud| cloud.with_faces(vec![[0, 1, 2]]))
        .unwrap()
}

#[test]
fn every_seed_is_drawn() {
    assert_eq!(seeds().len(), SEEDS);
}

#[test]
fn every_seed_is_a_valid_file_of_the_format_it_looks_like() {
    for (format, bytes) in seeds() {
        let options = ReadOptions { policy: crate::cloud::NonFinite::Drop, ..ReadOptions::default() };
        assert!(read(&bytes, format, &options).is_ok(), "{format}");
        if format != Format::Xyz {
            assert_eq!(Format::of_file(None, &bytes), Some(format));
        }
    }
}

#[test]
fn a_file_cut_at_any_byte_is_read_in_part_or_refused() {
    for (format, bytes) in seeds() {
        for end in 0..bytes.len() {
            if let Ok(cloud) = read(&bytes[..end], format, &ReadOptions::default()) {
                assert!(cloud.len() <= 3);
            }
        }
    }
}

#[test]
fn limits_hold_in_every_format() {
    let limits = Limits { points_max: 1, ..Limits::default() };
    let options = ReadOptions { limits, ..ReadOptions::default() };
    for (format, bytes) in seeds() {
        let error = read(&bytes, format, &options).unwrap_err();
        assert!(matches!(error, super::ReadError::TooManyPoints { points_max: 1, .. }), "{format}: {error}");
    }
}

#[test]
fn an_empty_file_is_refused_in_every_format() {
    for format in Format::ALL {
        for bytes in [&b""[..], b" \r\n\t"] {
            assert_eq!(read(bytes, format, &ReadOptions::default()), Err(super::ReadError::Empty));
        }
    }
}

proptest! {
    #[test]
    fn random_bytes_never_panic(bytes in proptest::collection::vec(any::<u8>(), 0..300), format in 0..Format::ALL.len()) {
        let _ = Format::sniff(&bytes);
        let _ = read(&bytes, Format::ALL[format], &ReadOptions::default());
    }

    #[test]
    fn random_text_never_panics(text in "[-0-9a-z .,;/#\n\t\"]{0,200}", format in 0..Format::ALL.len()) {
        let _ = Format::sniff(text.as_bytes());
        let _ = read(text.as_bytes(), Format::ALL[format], &ReadOptions::default());
    }

    #[test]
    fn damaged_files_never_panic(
        seed in 0..SEEDS,
        damages in proptest::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..6),
        dimension in proptest::option::of(0..10_usize),
    ) {
        let (format, mut bytes) = seeds().swap_remove(seed);
        for (place, byte) in damages {
            let place = place.index(bytes.len());
            bytes[place] = byte;
        }
        let options = ReadOptions { dimension, ..ReadOptions::default() };
        let _ = read(&bytes, format, &options);
    }

    #[test]
    fn damaged_numbers_in_headers_never_panic_or_allocate_what_they_say(seed in 0..SEEDS, digits in "[0-9]{1,22}") {
        let (format, bytes) = seeds().swap_remove(seed);
        for place in (0..bytes.len()).filter(|&i| bytes[i].is_ascii_digit()) {
            let damaged = [&bytes[..place], digits.as_bytes(), &bytes[place + 1..]].concat();
            let _ = read(&damaged, format, &ReadOptions::default());
        }
    }
}

//! The files: valid ones, every way to damage them, and some that are made to hurt.

use std::io::Cursor;

use chladni::cloud::reader::Format;
use chladni::cloud::shapes::{SampleRequest, Shape, sample};
use chladni::cloud::writer::write;
use e57::{E57Writer, Record, RecordDataType, RecordName, RecordValue};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// A file, and the format it looks like; with none it is read as every format.
pub(crate) struct File {
    pub(crate) name: String,
    pub(crate) format: Option<Format>,
    pub(crate) bytes: Vec<u8>,
}

pub(crate) fn file(name: impl Into<String>, format: Option<Format>, bytes: impl Into<Vec<u8>>) -> File {
    File { name: name.into(), format, bytes: bytes.into() }
}

/// What stands in a damaged header in place of a number.
const NUMBERS: [&str; 8] =
    ["0", "-1", "255", "4294967295", "18446744073709551615", "99999999999999999999999", "1e300", "nan"];

/// A valid file of every format, and more where a format has several faces.
pub(crate) fn seeds() -> Vec<File> {
    let sphere = sample(&SampleRequest::new(Shape::Sphere, 12)).unwrap();
    let mut seeds = Vec::new();
    for format in Format::ALL {
        let bytes = match format {
            Format::Stl | Format::Pcd | Format::E57 => continue,
            _ => {
                let mut bytes = Vec::new();
                write(&sphere, format, &mut bytes).unwrap();
                bytes
            }
        };
        seeds.push(file(format!("{format} as written"), Some(format), bytes));
    }
    seeds.extend(read_only_formats());
    let mut binary = b"ply\nformat binary_little_endian 1.0\nelement vertex 3\nproperty float x\nproperty float y\n\
        property float z\nproperty uchar red\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n"
        .to_vec();
    binary.extend([0; 39]);
    binary.extend([3, 0, 0, 0, 0, 1, 0, 0, 0, 2, 0, 0, 0]);
    let strips = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n\
        element tristrips 1\nproperty list int int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n5 0 1 2 -1 0\n";
    seeds.push(file("binary ply with faces", Some(Format::Ply), binary));
    seeds.push(file("ascii ply with strips", Some(Format::Ply), strips));
    seeds.push(file(
        "obj with faces",
        Some(Format::Obj),
        "v 0 0 0 1 1 1\nv 1 0 0 1 1 1\nv 0 1 0 1 1 1\nf 1//1 2/2 -1\n",
    ));
    seeds.push(file(
        "off with colors",
        Some(Format::Off),
        "COFF\n3 1 0\n0 0 0 9 9 9\n1 0 0 9 9 9\n0 1 0 9 9 9\n3 0 1 2\n",
    ));
    seeds.push(file("csv with a header", Some(Format::Csv), "x;y;z;\"a b\"\n1;2;3;4\n5;6;7;8\n"));
    seeds.push(file(
        "xyz with comments",
        Some(Format::Xyz),
        "2\n//X Y Z Intensity\n1 2 3 4\n5 6 7 8 # end\n",
    ));
    seeds
}

/// Valid files of the formats that are read but not written.
fn read_only_formats() -> Vec<File> {
    let mut stl = vec![b' '; 80];
    stl.extend(2_u32.to_le_bytes());
    for facet in [[0.0_f32, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0]; 2] {
        stl.extend(facet.iter().flat_map(|x| x.to_le_bytes()));
        stl.extend([0, 0]);
    }
    let text = "solid a\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\n\
        endsolid a\n";
    let header = |data: &str| {
        format!(
            "# .PCD v0.7\nVERSION 0.7\nFIELDS x y z intensity\nSIZE 4 4 4 4\nTYPE F F F F\nCOUNT 1 1 1 1\nWIDTH 3\n\
             HEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS 3\nDATA {data}\n"
        )
    };
    let mut binary = header("binary").into_bytes();
    binary.extend((0_u8..12).flat_map(|i| f32::from(i).to_le_bytes()));
    let mut compressed = header("binary_compressed").into_bytes();
    // one literal run of 32 bytes and one of 16: LZF without any repetition
    let plain: Vec<u8> = (0_u8..12).flat_map(|i| f32::from(i).to_le_bytes()).collect();
    compressed.extend([50, 0, 0, 0, 48, 0, 0, 0, 31]);
    compressed.extend(&plain[..32]);
    compressed.push(15);
    compressed.extend(&plain[32..]);
    vec![
        file("binary stl", Some(Format::Stl), stl),
        file("ascii stl", Some(Format::Stl), text),
        file("ascii pcd", Some(Format::Pcd), header("ascii") + "0 0 0 1\n1 0 0 2\n0 1 0 3\n"),
        file("binary pcd", Some(Format::Pcd), binary),
        file("compressed pcd", Some(Format::Pcd), compressed),
        file("e57", Some(Format::E57), e57()),
    ]
}

fn e57() -> Vec<u8> {
    let axes = [RecordName::CartesianX, RecordName::CartesianY, RecordName::CartesianZ];
    let double = RecordDataType::Double { min: None, max: None };
    let prototype = axes.map(|name| Record { name, data_type: double.clone() }).to_vec();
    let mut bytes = Cursor::new(Vec::new());
    let mut writer = E57Writer::new(&mut bytes, "file").unwrap();
    let mut scan = writer.add_pointcloud("scan", prototype).unwrap();
    for i in 0..5 {
        scan.add_point([i, i * i, 1].map(|x| RecordValue::Double(f64::from(x))).to_vec()).unwrap();
    }
    scan.finalize().unwrap();
    writer.finalize().unwrap();
    drop(writer);
    bytes.into_inner()
}

/// All small files: every seed damaged in every way, and those made by hand.
pub(crate) fn hostile_files() -> Vec<File> {
    let mut files = by_hand();
    let mut random = ChaCha8Rng::seed_from_u64(6);
    for seed in seeds() {
        let damaged = |what: &str, bytes: Vec<u8>| file(format!("{}, {what}", seed.name), seed.format, bytes);
        let bytes = &seed.bytes;
        for end in (0..bytes.len()).step_by((bytes.len() / 60).max(1)) {
            files.push(damaged(&format!("cut at {end}"), bytes[..end].to_vec()));
        }
        for (start, end) in runs_of_digits(&bytes[..bytes.len().min(400)]).into_iter().take(12) {
            for number in NUMBERS {
                let changed = [&bytes[..start], number.as_bytes(), &bytes[end..]].concat();
                files.push(damaged(&format!("{number} at {start}"), changed));
            }
        }
        for _ in 0..40 {
            let mut changed = bytes.clone();
            for _ in 0..random.random_range(1..5) {
                let place = random.random_range(0..changed.len());
                changed[place] = random.random();
            }
            files.push(damaged("bytes changed", changed));
        }
        let middle = bytes.len() / 2;
        for (what, inserted) in [
            ("invalid UTF-8", b"\xff\xfe\xc3\x28".as_slice()),
            ("zeros", &[0; 64]),
            ("not a number", b" nan inf -inf 1e999 "),
            ("a line without end", &[b'7'; 4096]),
            ("a sign", b"-"),
        ] {
            files.push(damaged(what, [&bytes[..middle], inserted, &bytes[middle..]].concat()));
        }
        files.push(damaged("twice", [bytes.as_slice(), bytes].concat()));
        files.push(file(format!("{} under another name", seed.name), None, bytes.clone()));
    }
    files
}

/// Where in the text numbers stand.
fn runs_of_digits(text: &[u8]) -> Vec<(usize, usize)> {
    let mut runs: Vec<(usize, usize)> = Vec::new();
    for (at, _) in text.iter().enumerate().filter(|(_, byte)| byte.is_ascii_digit()) {
        match runs.last_mut() {
            Some((_, end)) if *end == at => *end = at + 1,
            _ => runs.push((at, at + 1)),
        }
    }
    runs
}

fn ply(elements: &str, body: &[u8]) -> Vec<u8> {
    [b"ply\nformat binary_little_endian 1.0\n", elements.as_bytes(), b"end_header\n", body].concat()
}

fn npy(header: &str) -> Vec<u8> {
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    bytes.extend((header.len() as u16).to_le_bytes());
    bytes.extend(header.as_bytes());
    bytes
}

/// Promises without bytes behind them, and structures without end.
fn by_hand() -> Vec<File> {
    let xyz = "property float x\nproperty float y\nproperty float z\n";
    let of_ply = |name: &str, bytes: Vec<u8>| file(name, Some(Format::Ply), bytes);
    let of_npy = |name: &str, header: &str| file(name, Some(Format::Npy), npy(header));
    let mut files = vec![
        of_ply("ply, 4 billion points", ply(&format!("element vertex 4294967295\n{xyz}"), &[0; 12])),
        of_ply("ply, points without properties", ply("element vertex 18446744073709551615\n", &[0; 12])),
        of_ply(
            "ply, elements without properties",
            ply(&format!("element camera 18446744073709551615\nelement vertex 1\n{xyz}"), &[0; 12]),
        ),
        of_ply(
            "ply, a list of 4 billion",
            ply(
                &format!("element vertex 1\n{xyz}element face 1\nproperty list uint int vertex_indices\n"),
                &[&[0; 12], [0xff; 4].as_slice(), &[0; 4]].concat(),
            ),
        ),
        of_ply(
            "ply, a list of less than nothing",
            ply(
                &format!("element vertex 1\n{xyz}element face 1\nproperty list int int vertex_indices\n"),
                &[&[0; 12], [0xff; 4].as_slice(), &[0; 4]].concat(),
            ),
        ),
        of_ply(
            "ply, a list with a length of a double",
            ply(
                &format!("element vertex 1\n{xyz}element face 1\nproperty list double int vertex_indices\n"),
                &[&[0; 12], f64::MAX.to_le_bytes().as_slice(), &[0; 4]].concat(),
            ),
        ),
        of_ply(
            "ply, a header without end",
            b"ply\nformat ascii 1.0\n".iter().copied().chain(b"comment x\n".repeat(20_000)).collect(),
        ),
        of_ply(
            "ply, many properties",
            ply(&format!("element vertex 1\n{}", "property double p\n".repeat(20_000)), &[0; 800]),
        ),
        of_ply(
            "ply, many elements",
            ply(&(0..20_000).map(|i| format!("element e{i} 1\n")).collect::<Vec<_>>().concat(), &[0; 8]),
        ),
        of_npy(
            "npy, more than there is",
            "{'descr': '<f8', 'fortran_order': False, 'shape': (999999999999, 3), }\n",
        ),
        of_npy(
            "npy, a product that overflows",
            "{'descr': '<f8', 'fortran_order': False, 'shape': (4294967296, 4294967296), }\n",
        ),
        of_npy(
            "npy, rows without columns",
            "{'descr': '<f8', 'fortran_order': False, 'shape': (18446744073709551615, 0), }\n",
        ),
        of_npy(
            "npy, columns without rows",
            "{'descr': '<f8', 'fortran_order': True, 'shape': (0, 18446744073709551615), }\n",
        ),
        of_npy("npy, numbers without width", "{'descr': '<f0', 'fortran_order': False, 'shape': (9, 3), }\n"),
        of_npy("npy, objects", "{'descr': '|O', 'fortran_order': False, 'shape': (9, 3), }\n"),
        of_npy(
            "npy, records",
            "{'descr': [('x', '<f8'), ('y', '<f8')], 'fortran_order': False, 'shape': (9,), }\n",
        ),
        of_npy("npy, nested", &format!("{{'descr': {}", "[(".repeat(3000))),
        file(
            "npy, a header longer than the file",
            Some(Format::Npy),
            b"\x93NUMPY\x02\x00\xff\xff\xff\xff{".to_vec(),
        ),
        file("off, 4 billion points", Some(Format::Off), "OFF\n4294967295 4294967295 0\n0 0 0\n"),
        file(
            "off, a face of 4 billion",
            Some(Format::Off),
            "OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n4294967295 0 1 2\n",
        ),
        file("off, in more dimensions than there are", Some(Format::Off), "nOFF\n4294967295\n1 0 0\n0 0 0\n"),
        file(
            "obj, faces of points that are not there",
            Some(Format::Obj),
            "v 0 0 0\nf 99999999999 -99999999999 1\nf 1 1\nf\n",
        ),
        file("obj, a continued line", Some(Format::Obj), "v 0 0 \\\n".repeat(5000)),
        file("csv, a quote without end", Some(Format::Csv), format!("x,y,z\n1,2,\"{}", "9,".repeat(50_000))),
        file("csv, nothing but separators", Some(Format::Csv), ";".repeat(100_000)),
        file("xyz, a count that is none", Some(Format::Xyz), "18446744073709551615\n1 2 3\n"),
    ];
    for (name, bytes) in [
        ("nothing", Vec::new()),
        ("one byte", vec![0]),
        ("only line ends", b"\r\n".repeat(5000)),
        ("only zeros", vec![0; 10_000]),
        ("only ones", vec![0xff; 10_000]),
        ("a byte order mark", b"\xEF\xBB\xBF".to_vec()),
        ("UTF-16", "ply\nformat".encode_utf16().flat_map(u16::to_le_bytes).collect()),
    ] {
        files.push(file(name, None, bytes));
    }
    files
}

/// A large file of a format, made when it is needed.
pub(crate) type Make = Box<dyn Fn() -> File>;

/// Files of many megabytes with as many numbers as fit, so that memory follows what is in them.
pub(crate) fn large_files() -> Vec<Make> {
    // Well beyond the 64 MiB that every file may take: what it takes beside them shows.
    const BYTES: usize = 24 << 20;
    // As many as are accepted.
    const POINTS: usize = 5_000_000;
    fn repeated(name: &'static str, format: Format, head: &'static str, line: &'static str) -> Make {
        Box::new(move || {
            file(name, Some(format), [head.as_bytes(), &line.as_bytes().repeat(BYTES / line.len())].concat())
        })
    }
    let mut files = vec![
        repeated("xyz of one digit per line", Format::Xyz, "", "0\n"),
        repeated("xyz of three digits per line", Format::Xyz, "", "0 1 2\n"),
        repeated(
            "xyz of many columns",
            Format::Xyz,
            "",
            "0 1 2 3 4 5 6 7 8 9 0 1 2 3 4 5 6 7 8 9 0 1 2 3 4 5 6 7 8 9\n",
        ),
        repeated("xyz of one line", Format::Xyz, "", "1 "),
        repeated("csv of three digits per line", Format::Csv, "x,y,z\n", "0,1,2\n"),
        repeated("csv of one line", Format::Csv, "", "1,"),
        repeated("obj of points", Format::Obj, "", "v 0 1 2\n"),
        repeated("obj of triangles", Format::Obj, "v 0 0 0\nv 1 0 0\nv 0 1 0\n", "f 1 2 3\n"),
        repeated("obj of one polygon", Format::Obj, "v 0 0 0\nv 1 0 0\nv 0 1 0\nf", " 1 2 3"),
        repeated("obj of nothing", Format::Obj, "", "#\n"),
        repeated("obj of colored points", Format::Obj, "", "v 0 0 0 0 0 0\n"),
        repeated(
            "obj of polygons",
            Format::Obj,
            "v 0 0 0\nv 1 0 0\nv 0 1 0\n",
            "f 1 2 3 1 2 3 1 2 3 1 2 3 1 2 3 1 2 3 1 2 3 1 2 3 1 2 3\n",
        ),
    ];
    let points = "element vertex 3\nproperty char x\nproperty char y\nproperty char z\n";
    files.push(Box::new(move || {
        let head = format!("{points}element face 1\nproperty list uint uchar vertex_indices\n");
        let body = [&[0; 9], (BYTES as u32).to_le_bytes().as_slice(), &vec![1; BYTES]].concat();
        file("ply of one polygon", Some(Format::Ply), ply(&head, &body))
    }));
    files.push(Box::new(move || {
        let faces = BYTES / 256;
        let head = format!("{points}element face {faces}\nproperty list uchar uchar vertex_indices\n");
        let polygon = [&[255; 1], [1; 255].as_slice()].concat();
        file(
            "ply of polygons",
            Some(Format::Ply),
            ply(&head, &[&[0; 9], polygon.repeat(faces).as_slice()].concat()),
        )
    }));
    files.push(Box::new(move || {
        let head = format!("{points}element tristrips 1\nproperty list uint uchar vertex_indices\n");
        let strip = [0, 1, 2].repeat(BYTES / 3);
        let body = [&[0; 9], (strip.len() as u32).to_le_bytes().as_slice(), &strip].concat();
        file("ply of one strip", Some(Format::Ply), ply(&head, &body))
    }));
    files.push(Box::new(|| {
        let points = BYTES / 43;
        let fields = (0..40).map(|i| format!("property uchar f{i}\n")).collect::<Vec<_>>().concat();
        let head =
            format!("element vertex {points}\nproperty char x\nproperty char y\nproperty char z\n{fields}");
        file("ply of fields of bytes", Some(Format::Ply), ply(&head, &vec![1; 43 * points]))
    }));
    files.push(Box::new(|| {
        let corners = BYTES / 2;
        let head = format!("OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n{corners}");
        file("off of one polygon", Some(Format::Off), [head.as_bytes(), &b" 1".repeat(corners)].concat())
    }));
    files.push(Box::new(|| {
        let triangles = BYTES / 50;
        let mut bytes = vec![0; 80];
        bytes.extend((triangles as u32).to_le_bytes());
        for triangle in 0..triangles {
            bytes.extend([0; 12]);
            let numbers = (0..9).map(|i| (9 * triangle + i) as f32);
            bytes.extend(numbers.flat_map(f32::to_le_bytes));
            bytes.extend([0; 2]);
        }
        file("stl without common corners", Some(Format::Stl), bytes)
    }));
    files.push(Box::new(|| {
        let triangles = BYTES / 8;
        let head = format!("OFF\n3 {triangles} 0\n0 0 0\n1 0 0\n0 1 0\n");
        file(
            "off of triangles",
            Some(Format::Off),
            [head.as_bytes(), &b"3 0 1 2\n".repeat(triangles)].concat(),
        )
    }));
    files.push(Box::new(|| {
        let points = (BYTES / 3).min(POINTS);
        let head = format!("element vertex {points}\nproperty char x\nproperty char y\nproperty char z\n");
        file("ply of bytes", Some(Format::Ply), ply(&head, &vec![1; 3 * points]))
    }));
    files.push(Box::new(|| {
        let points = (BYTES / 3).min(POINTS);
        let header = format!("{{'descr': '|i1', 'fortran_order': False, 'shape': ({points}, 3), }}\n");
        file("npy of bytes", Some(Format::Npy), [npy(&header), vec![1; 3 * points]].concat())
    }));
    files
}

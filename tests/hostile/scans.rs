//! Large scans in E57, whose readers keep more than the points: queues of values, and a description in XML.

use std::io::Cursor;

use chladni::cloud::reader::Format;
use e57::{E57Writer, Record, RecordDataType, RecordName, RecordValue};

use crate::files::{File, Make, file};

const POINTS: usize = 5_000_000;
const DOUBLE: RecordDataType = RecordDataType::Double { min: None, max: None };

/// A scan of so many points, all alike, and its description as `describe` changes it.
fn scan(
    name: &str,
    prototype: &[(RecordName, RecordDataType)],
    points: usize,
    describe: impl Fn(String) -> String,
) -> File {
    let prototype =
        prototype.iter().cloned().map(|(name, data_type)| Record { name, data_type }).collect::<Vec<_>>();
    let point: Vec<RecordValue> = prototype
        .iter()
        .map(|record| match record.data_type {
            RecordDataType::Integer { max, .. } => RecordValue::Integer(max),
            _ => RecordValue::Double(1.0),
        })
        .collect();
    let mut bytes = Cursor::new(Vec::new());
    let mut writer = E57Writer::new(&mut bytes, "file").unwrap();
    let mut scan = writer.add_pointcloud("scan", prototype).unwrap();
    for _ in 0..points {
        scan.add_point(point.clone()).unwrap();
    }
    scan.finalize().unwrap();
    writer.finalize_customized_xml(|xml| Ok(describe(xml))).unwrap();
    drop(writer);
    file(name, Some(Format::E57), bytes.into_inner())
}

fn integers(max: i64) -> RecordDataType {
    RecordDataType::Integer { min: 0, max }
}

fn axes(of: &RecordDataType) -> Vec<(RecordName, RecordDataType)> {
    use RecordName::{CartesianX, CartesianY, CartesianZ};
    [CartesianX, CartesianY, CartesianZ].map(|name| (name, of.clone())).to_vec()
}

/// `more` bytes at most of `element`, over and over, at the end of the description.
fn with(xml: &str, element: &str, more: usize) -> String {
    xml.replace("</e57Root>", &format!("<more>{}</more></e57Root>", element.repeat(more / element.len())))
}

pub(crate) fn large_scans() -> Vec<Make> {
    let as_it_is = |xml: String| xml;
    vec![
        // The crate writes no constants alone: bits, of which the description says that they are none.
        Box::new(|| {
            let constant = |xml: String| xml.replace("maximum=\"1\"", "maximum=\"0\"");
            scan("e57 of constants", &axes(&integers(1)), 9, constant)
        }),
        Box::new(move || {
            let mut prototype = axes(&integers(0));
            prototype.push((RecordName::Intensity, integers(1)));
            scan("e57 of constants and bits", &prototype, POINTS, as_it_is)
        }),
        Box::new(move || {
            let mut prototype = axes(&integers(0));
            prototype.push((RecordName::Intensity, integers(1)));
            scan("e57 of fewer constants and bits", &prototype, POINTS / 20, as_it_is)
        }),
        Box::new(move || scan("e57 of bits", &axes(&integers(1)), POINTS, as_it_is)),
        Box::new(move || {
            let mut prototype = axes(&integers(255));
            prototype.push((RecordName::Intensity, integers(255)));
            prototype.push((RecordName::RowIndex, integers(255)));
            scan("e57 of bytes", &prototype, POINTS, as_it_is)
        }),
        Box::new(move || scan("e57 of fewer bytes", &axes(&integers(255)), POINTS / 2, as_it_is)),
        Box::new(move || scan("e57 of doubles", &axes(&DOUBLE), POINTS / 5, as_it_is)),
        Box::new(|| scan("e57 of elements", &axes(&DOUBLE), 9, |xml| with(&xml, "<a/>", 760 << 10))),
        Box::new(|| scan("e57 of more elements", &axes(&DOUBLE), 9, |xml| with(&xml, "<a/>", 4 << 20))),
        Box::new(|| scan("e57 of brackets", &axes(&DOUBLE), 9, |xml| with(&xml, "<", 24 << 20))),
        Box::new(|| {
            let attributes = (0..200_000).map(|i| format!(" a{i}=\"\"")).collect::<Vec<_>>().concat();
            scan("e57 of attributes", &axes(&DOUBLE), 9, move |xml| {
                with(&xml, &format!("<a{attributes}/>"), 9 << 20)
            })
        }),
    ]
}

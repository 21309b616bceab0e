//! PLY, binary little-endian or ASCII.
//!
//! Coordinates come first, then the scalars, then the faces. Viewers want x, y and z: missing axes are written
//! as 0, so a cloud of the plane comes back from a file as one of space; axes beyond z are the properties
//! `coordinate_3`, `coordinate_4`…, which the reader knows as coordinates.

use std::fmt::Write as _;
use std::ops::Range;

use super::{CHUNK_ROWS, Column, axis_name, encode_rows, push_number};
use crate::arguments::words;
use crate::cloud::{PointCloud, ScalarType};

/// Bytes of a triangle in binary: its number of corners and three indices.
pub const FACE_BYTES: usize = 13;

words! {
    /// How the body of a PLY file is written.
    #[derive(Default)]
    pub enum PlyEncoding {
        /// Rows of a fixed number of bytes, the lowest first.
        #[default]
        Binary,
        /// A line per row.
        Ascii,
    }
}

/// What a file will hold.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct PlyHeader {
    /// How.
    pub encoding: PlyEncoding,
    /// Number of points.
    pub points: usize,
    /// Scalars per point, coordinates first. Blanks in names are written as `_`.
    pub properties: Vec<(String, ScalarType)>,
    /// Number of triangles.
    pub faces: usize,
}

/// Header of a binary file with these scalars per point.
#[must_use]
pub fn ply_header(properties: &[(String, ScalarType)], points: usize, faces: usize) -> Vec<u8> {
    let encoding = PlyEncoding::Binary;
    PlyHeader { encoding, points, properties: properties.to_vec(), faces }.to_bytes()
}

/// Three axes at least, in the type in which they came, then the fields.
#[must_use]
pub fn ply_properties(cloud: &PointCloud) -> Vec<(String, ScalarType)> {
    let axes = (0..cloud.dimension().max(3)).map(|axis| (axis_name(axis), cloud.coordinate_type()));
    axes.chain(cloud.fields().iter().map(|field| (field.name.clone(), field.kind))).collect()
}

/// Values of [`ply_properties`] from a row on.
#[must_use]
pub fn ply_columns(cloud: &PointCloud, first: usize) -> Vec<Column<'_>> {
    let stride = cloud.dimension();
    let kind = cloud.coordinate_type();
    let from = cloud.coordinates().get(first * stride..).unwrap_or_default();
    let axis = |axis| Column { values: from.get(axis..).unwrap_or_default(), stride, kind };
    let missing = (stride..3).map(|_| Column { values: &[], stride: 1, kind });
    let fields = cloud.fields().iter().map(|field| Column {
        values: field.values.get(first..).unwrap_or_default(),
        stride: 1,
        kind: field.kind,
    });
    (0..stride).map(axis).chain(missing).chain(fields).collect()
}

impl PlyHeader {
    /// Everything that a cloud has, in the types in which it came.
    #[must_use]
    pub fn of(cloud: &PointCloud, encoding: PlyEncoding) -> Self {
        Self { encoding, points: cloud.len(), properties: ply_properties(cloud), faces: cloud.faces().len() }
    }

    /// The same with one more scalar.
    #[must_use]
    pub fn with_property(mut self, name: impl Into<String>, kind: ScalarType) -> Self {
        self.properties.push((name.into(), kind));
        self
    }

    /// The header, up to and with `end_header` and its line end.
    #[must_use]
    pub fn to_bytes(&self) -> Vec<u8> {
        let encoding = match self.encoding {
            PlyEncoding::Binary => "binary_little_endian",
            PlyEncoding::Ascii => "ascii",
        };
        let mut text = format!("ply\nformat {encoding} 1.0\nelement vertex {}\n", self.points);
        let mut written: Vec<String> = Vec::with_capacity(self.properties.len());
        for (name, kind) in &self.properties {
            let name = property_name(name, &written);
            // Writing to a string cannot fail.
            let _ = writeln!(text, "property {} {name}", kind.ply_name());
            written.push(name);
        }
        if self.faces > 0 {
            let _ = writeln!(text, "element face {}\nproperty list uchar int vertex_indices", self.faces);
        }
        text.push_str("end_header\n");
        text.into_bytes()
    }

    /// Bytes of a point in binary.
    #[must_use]
    pub fn stride(&self) -> usize {
        self.properties.iter().map(|(_, kind)| kind.size()).sum()
    }

    /// Bytes of the whole file, header and faces included; `None` for ASCII, whose rows differ in length.
    #[must_use]
    pub fn file_len(&self) -> Option<u64> {
        let body = self.points as u64 * self.stride() as u64 + (self.faces * FACE_BYTES) as u64;
        (self.encoding == PlyEncoding::Binary).then(|| self.to_bytes().len() as u64 + body)
    }

    /// Encodes some rows; there is a column for every property, of its type.
    #[must_use]
    pub fn encode_rows(&self, columns: &[Column<'_>], rows: usize) -> Vec<u8> {
        match self.encoding {
            PlyEncoding::Binary => encode_rows(columns, rows),
            PlyEncoding::Ascii => encode_lines(columns, rows),
        }
    }

    /// The rows of a file in chunks.
    pub fn chunks(&self) -> impl Iterator<Item = Range<usize>> + use<> {
        let points = self.points;
        (0..points).step_by(CHUNK_ROWS).map(move |first| first..(first + CHUNK_ROWS).min(points))
    }
}

fn encode_lines(columns: &[Column<'_>], rows: usize) -> Vec<u8> {
    let mut text = Vec::with_capacity(rows * 16 * columns.len());
    for row in 0..rows {
        for column in columns {
            push_typed(
                column.values.get(row * column.stride).copied().unwrap_or(0.0),
                column.kind,
                &mut text,
            );
        }
        text.pop();
        text.push(b'\n');
    }
    text
}

/// Encodes triangles.
#[must_use]
pub fn encode_faces(faces: &[[u32; 3]], encoding: PlyEncoding) -> Vec<u8> {
    let mut bytes = Vec::with_capacity(faces.len() * FACE_BYTES);
    for face in faces {
        match encoding {
            PlyEncoding::Binary => {
                bytes.push(3);
                bytes.extend(face.iter().flat_map(|corner| corner.to_le_bytes()));
            }
            PlyEncoding::Ascii => {
                bytes.extend(format!("3 {} {} {}\n", face[0], face[1], face[2]).into_bytes());
            }
        }
    }
    bytes
}

/// Appends a value as its type would keep it, and a blank.
fn push_typed(value: f64, kind: ScalarType, text: &mut Vec<u8>) {
    match kind.integer_range() {
        Some(_) if value.is_nan() => text.push(b'0'),
        Some((low, high)) => push_number(value.round().clamp(low, high), text),
        None if kind == ScalarType::Float32 && value.is_finite() => {
            let mut buffer = [0; <f32 as lexical_core::FormattedSize>::FORMATTED_SIZE_DECIMAL];
            let shortest = lexical_core::write(value as f32, &mut buffer);
            text.extend_from_slice(shortest.strip_suffix(b".0").unwrap_or(shortest));
        }
        None => push_number(value, text),
    }
    text.push(b' ');
}

/// Begins the names of scalar fields, as `CloudCompare` writes and expects them. The reader takes it off again.
pub(in crate::cloud) const SCALAR_PREFIX: &str = "scalar_";

/// Whether viewers know a property by its bare name: coordinates, normals, colors.
pub(in crate::cloud) fn is_plain(name: &str) -> bool {
    const NAMES: [&str; 10] = ["x", "y", "z", "nx", "ny", "nz", "red", "green", "blue", "alpha"];
    NAMES.contains(&name) || name.starts_with("coordinate_")
}

/// The name of a property for a field: one word, as most readers want it, and none that is written already.
fn property_name(field: &str, written: &[String]) -> String {
    let word: String =
        field.chars().map(|c| if c.is_whitespace() || c.is_control() { '_' } else { c }).collect();
    let word = if word.is_empty() { "_".to_owned() } else { word };
    let marked = if is_plain(&word) || word.starts_with(SCALAR_PREFIX) {
        word
    } else {
        format!("{SCALAR_PREFIX}{word}")
    };
    let numbered = (2..).map(|number| format!("{marked}_{number}"));
    std::iter::once(marked.clone()).chain(numbered).find(|name| !written.contains(name)).unwrap_or(marked)
}

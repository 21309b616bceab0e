//! The header: which elements follow, with which properties, in which encoding.

use super::super::decode::ByteOrder;
use super::{FORMAT, ReadError};
use crate::cloud::reader::Location;
use crate::cloud::reader::text::{Line, Lines, count_at, shown};
use crate::cloud::scalar::Stored;

/// No scanner writes headers longer than this.
const HEADER_BYTES_MAX: usize = 1 << 20;

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Encoding {
    Ascii,
    Binary(ByteOrder),
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum PropertyKind {
    Scalar(Stored),
    List { length: Stored, item: Stored },
}

#[derive(Debug, Clone, PartialEq)]
pub(super) struct Property {
    pub(super) name: String,
    pub(super) kind: PropertyKind,
}

#[derive(Debug, Clone, PartialEq)]
pub(super) struct Element {
    pub(super) name: String,
    pub(super) count: usize,
    pub(super) properties: Vec<Property>,
}

impl Element {
    /// Names and types of the properties that are not lists.
    pub(super) fn scalars(&self) -> impl Iterator<Item = (&str, Stored)> {
        self.properties.iter().filter_map(|property| match property.kind {
            PropertyKind::Scalar(kind) => Some((property.name.as_str(), kind)),
            PropertyKind::List { .. } => None,
        })
    }

    /// Bytes of a row in binary, if no property is a list.
    pub(super) fn stride(&self) -> Option<usize> {
        self.properties
            .iter()
            .map(|property| match property.kind {
                PropertyKind::Scalar(kind) => Some(kind.size()),
                PropertyKind::List { .. } => None,
            })
            .sum()
    }

    /// Least number of bytes of a row in binary: lists may be empty.
    pub(super) fn stride_min(&self) -> usize {
        self.properties
            .iter()
            .map(|property| match property.kind {
                PropertyKind::Scalar(kind) | PropertyKind::List { length: kind, .. } => kind.size(),
            })
            .sum()
    }
}

#[derive(Debug, Clone, PartialEq)]
pub(super) struct Header {
    pub(super) encoding: Encoding,
    pub(super) elements: Vec<Element>,
    /// Offset of the first byte behind the header.
    pub(super) body: usize,
    /// Number of lines of the header.
    pub(super) lines: usize,
    /// Names of picture files, from comments `TextureFile NAME`.
    pub(super) textures: Vec<String>,
}

impl Header {
    pub(super) fn parse(bytes: &[u8]) -> Result<Self, ReadError> {
        let mut lines = Lines::of_header(&bytes[..bytes.len().min(HEADER_BYTES_MAX)]);
        if lines.next().is_none_or(|line| line.text != b"ply") {
            let message = if bytes.starts_with(b"plyformat") {
                "the file has lost its line ends, as `curl -d` loses them; send it by `curl -T` or `--data-binary`"
            } else {
                "the first line is not `ply`"
            };
            return Err(ReadError::line(FORMAT, 1, message));
        }
        let mut encoding = None;
        let (mut elements, mut textures) = (Vec::new(), Vec::new());
        while let Some(line) = lines.next() {
            let words: Vec<&[u8]> = line.words().collect();
            match words.as_slice() {
                [b"comment", b"TextureFile", name, ..] if textures.len() < 8 => textures.push(lossy(name)),
                [] | [b"comment" | b"obj_info", ..] => {}
                [b"format", name, version] => encoding = Some(format(name, version, &line)?),
                [b"element", name, count] => {
                    let count = count_at(count, "number of elements", FORMAT, line.number)?;
                    elements.push(Element { name: lossy(name), count, properties: Vec::new() });
                }
                [b"property", rest @ ..] => {
                    let Some(element) = elements.last_mut() else {
                        return Err(ReadError::line(FORMAT, line.number, "a property before any element"));
                    };
                    element.properties.push(property(rest, &line)?);
                }
                [b"end_header"] => {
                    let Some(encoding) = encoding else {
                        return Err(ReadError::line(FORMAT, line.number, "the header has no format line"));
                    };
                    let body = bytes.len().min(HEADER_BYTES_MAX) - lines.rest().len();
                    return Ok(Self { encoding, elements, body, lines: line.number, textures });
                }
                _ => {
                    let message = format!(
                        "{} is not a header line; format, comment, obj_info, element, property and end_header are",
                        shown(line.text)
                    );
                    return Err(ReadError::line(FORMAT, line.number, message));
                }
            }
        }
        Err(ReadError::Truncated {
            format: FORMAT,
            location: Location::Line(lines.number()),
            message: format!("the line `end_header` is missing in the first {HEADER_BYTES_MAX} bytes"),
        })
    }
}

impl Header {
    /// Names of the fields of vertices that have 64 bits.
    pub(super) fn wide_fields(&self) -> Vec<String> {
        let Some(vertex) = self.elements.iter().find(|element| element.name == "vertex") else {
            return Vec::new();
        };
        let wide = vertex.scalars().filter(|(_, stored)| matches!(stored, Stored::Integer { .. }));
        wide.map(|(name, _)| super::field_name(name, vertex)).collect()
    }

    /// What of the file is not a part of a cloud.
    pub(super) fn left_out(&self) -> Vec<String> {
        let mut notes = Vec::new();
        for element in self.elements.iter().filter(|element| element.count > 0) {
            let name = shown(element.name.as_bytes());
            let mut lists = element.properties.iter();
            match element.name.as_str() {
                "vertex" => {
                    for property in lists.filter(|p| matches!(p.kind, PropertyKind::List { .. })) {
                        let list = shown(property.name.as_bytes());
                        notes.push(format!("the lists {list} of the vertices were left out"));
                    }
                }
                "face" | "tristrips" => {
                    if lists.any(|property| matches!(property.name.as_str(), "texcoord" | "texnumber")) {
                        notes.push("texture coordinates of the faces were left out".to_owned());
                    }
                }
                _ => notes.push(format!("{} rows of element {name} were left out", element.count)),
            }
        }
        notes.truncate(20);
        notes.extend(
            self.textures.iter().map(|name| format!("the texture {} was left out", shown(name.as_bytes()))),
        );
        notes
    }
}

fn format(name: &[u8], version: &[u8], line: &Line<'_>) -> Result<Encoding, ReadError> {
    if version != b"1.0" {
        let message = format!("version {} is not supported; 1.0 is", shown(version));
        return Err(ReadError::line(FORMAT, line.number, message));
    }
    match name {
        b"ascii" => Ok(Encoding::Ascii),
        b"binary_little_endian" => Ok(Encoding::Binary(ByteOrder::Little)),
        b"binary_big_endian" => Ok(Encoding::Binary(ByteOrder::Big)),
        _ => {
            let message = format!(
                "format {} is unknown; ascii, binary_little_endian and binary_big_endian are accepted",
                shown(name)
            );
            Err(ReadError::line(FORMAT, line.number, message))
        }
    }
}

/// The words behind `property`. Names may hold blanks.
fn property(words: &[&[u8]], line: &Line<'_>) -> Result<Property, ReadError> {
    let kind = |word: &[u8]| {
        Stored::from_ply_name(word).ok_or_else(|| {
            let message = format!(
                "{} is not a type; char, uchar, short, ushort, int, uint, int64, uint64, float, double and bool are",
                shown(word)
            );
            ReadError::line(FORMAT, line.number, message)
        })
    };
    let (kind, name) = match words {
        [b"list", length, item, name @ ..] => {
            let (length, item) = (kind(length)?, kind(item)?);
            if !length.is_integer() {
                let message = "the length of a list has a floating type; integer types are accepted";
                return Err(ReadError::line(FORMAT, line.number, message));
            }
            (PropertyKind::List { length, item }, name)
        }
        [scalar, name @ ..] => (PropertyKind::Scalar(kind(scalar)?), name),
        [] => return Err(ReadError::line(FORMAT, line.number, "a property without a type")),
    };
    if name.is_empty() {
        return Err(ReadError::line(FORMAT, line.number, "a property without a name"));
    }
    Ok(Property { name: lossy(&name.join(&b' ')), kind })
}

fn lossy(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

//! The header of an array: type, order and shape.

use npyz::{Endianness, TypeChar, TypeStr};

use super::FORMAT;
use crate::cloud::reader::decode::ByteOrder;
use crate::cloud::reader::number::{Number, Source};
use crate::cloud::reader::text::shown;
use crate::cloud::reader::{Location, ReadError};

/// Members of a record that are looked at.
const MEMBERS_MAX: usize = 4096;

/// A column of an array: a number at a place of every record.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Member {
    pub(super) name: Option<String>,
    pub(super) number: Number,
    offset: usize,
}

#[derive(Debug, Clone, PartialEq)]
pub(super) struct Header {
    pub(super) columns: Vec<Member>,
    /// Members of records that hold no numbers.
    pub(super) left_out: Vec<String>,
    /// Whether the array is one of records.
    pub(super) has_names: bool,
    /// Whether the first member of the records is three numbers.
    pub(super) begins_with_triple: bool,
    is_fortran: bool,
    pub(super) rows: usize,
    /// Bytes of a row.
    stride: usize,
    /// Offset of the first byte behind the header.
    body: usize,
}

impl Header {
    pub(super) fn parse(bytes: &[u8]) -> Result<Self, ReadError> {
        let (text, body) = text(bytes)?;
        let refuse = |message: String| ReadError::byte(FORMAT, 0, format!("the header {message}"));
        let entry = |key: &str| value(text, key).ok_or_else(|| refuse(format!("has no entry '{key}'")));
        let descr = entry("descr")?;
        let kind = Kind::parse(descr).ok_or_else(|| {
            let end = if descr.starts_with('[') { ']' } else { ',' };
            let shown = shown(descr.split(end).next().unwrap_or_default().as_bytes());
            refuse(format!(
                "gives the type {shown}; real numbers <f4 <f8, integers of 1 to 8 bytes and records of them are accepted"
            ))
        })?;
        let order = entry("fortran_order")?;
        let is_fortran = order.starts_with("True");
        if !is_fortran && !order.starts_with("False") {
            return Err(refuse("gives a fortran_order that is neither True nor False".to_owned()));
        }
        let shape = shape(entry("shape")?)
            .ok_or_else(|| refuse("gives a shape that is not a tuple of whole numbers".to_owned()))?;
        let is_record = matches!(kind, Kind::Record { .. });
        let (rows, width) = match shape[..] {
            [rows] => (rows, 1),
            [rows, width] if !is_record => (rows, width),
            [height, width] => (height.saturating_mul(width), 1),
            [height, width, channels] if !is_record && !is_fortran => {
                (height.saturating_mul(width), channels)
            }
            _ => {
                let axes = shape.len();
                let message = format!(
                    "gives an array of {axes} axes; (n, d), (n,) and, in C order, (h, w, d) are accepted"
                );
                return Err(refuse(message));
            }
        };
        if rows == 0 || width == 0 {
            return Err(crate::cloud::CloudError::Empty.into());
        }
        let has_names = is_record;
        let mut header = Self {
            columns: Vec::new(),
            left_out: Vec::new(),
            has_names,
            begins_with_triple: false,
            is_fortran,
            rows,
            stride: 0,
            body,
        };
        match kind {
            Kind::Number(number) => {
                header.stride = width.saturating_mul(number.size());
                header.block(bytes)?;
                let member = |index| Member { name: None, number, offset: index * number.size() };
                header.columns = (0..width).map(member).collect();
            }
            Kind::Record { members, left_out, stride, begins_with_triple } => {
                header.stride = stride;
                header.left_out = left_out;
                header.begins_with_triple = begins_with_triple;
                header.block(bytes)?;
                header.columns = members;
            }
        }
        Ok(header)
    }

    /// The bytes of the numbers, as many as are announced.
    pub(super) fn block<'a>(&self, bytes: &'a [u8]) -> Result<&'a [u8], ReadError> {
        let (rows, stride) = (self.rows, self.stride);
        let body = &bytes[self.body..];
        rows.checked_mul(stride).and_then(|length| body.get(..length)).ok_or_else(|| {
            let message = format!(
                "an array of {rows} rows of {stride} bytes is announced, {} bytes follow",
                body.len()
            );
            ReadError::Truncated { format: FORMAT, location: Location::Byte(bytes.len()), message }
        })
    }

    /// Where one column of the block stands.
    pub(super) fn source<'a>(&self, block: &'a [u8], index: usize) -> Source<'a> {
        let Member { number, offset, .. } = self.columns[index];
        if self.is_fortran && !self.has_names {
            let bytes = self.rows * number.size();
            return Source {
                rows: &block[index * bytes..][..bytes],
                stride: number.size(),
                offset: 0,
                number,
            };
        }
        Source { rows: block, stride: self.stride, offset, number }
    }
}

/// What a `descr` says.
enum Kind {
    Number(Number),
    Record { members: Vec<Member>, left_out: Vec<String>, stride: usize, begins_with_triple: bool },
}

impl Kind {
    fn parse(descr: &str) -> Option<Self> {
        if let Some(descr) = quoted(descr) {
            return number(descr).map(Self::Number);
        }
        let mut rest = descr.strip_prefix('[')?.trim_start();
        let (mut members, mut left_out) = (Vec::new(), Vec::new());
        let (mut offset, mut begins_with_triple) = (0_usize, false);
        while let Some(member) = rest.strip_prefix('(') {
            let name = quoted(member)?;
            let behind = member[name.len() + 2..].trim_start().strip_prefix(',')?.trim_start();
            let descr = quoted(behind)?;
            let behind = behind[descr.len() + 2..].trim_start();
            let (count, behind) = count(behind)?;
            if let Some(bytes) = bytes_of_no_number(descr) {
                offset = offset.checked_add(bytes.checked_mul(count)?)?;
                if !name.is_empty() && left_out.len() < MEMBERS_MAX {
                    left_out.push(name.to_owned());
                }
            } else {
                let number = number(descr)?;
                begins_with_triple |= members.is_empty() && count == 3;
                if members.len() + count > MEMBERS_MAX {
                    return None;
                }
                for index in 0..count {
                    let name = if count == 1 { name.to_owned() } else { format!("{name}_{index}") };
                    members.push(Member { name: Some(name), number, offset });
                    offset += number.size();
                }
            }
            rest = behind.strip_prefix(')')?.trim_start();
            rest = rest.strip_prefix(',').unwrap_or(rest).trim_start();
        }
        (rest.starts_with(']') && !members.is_empty()).then_some(Self::Record {
            members,
            left_out,
            stride: offset,
            begins_with_triple,
        })
    }
}

/// Bytes of a member that holds no real numbers: padding, text, times, complex and short or long floating numbers.
fn bytes_of_no_number(descr: &str) -> Option<usize> {
    let descr = descr.trim_start_matches(['|', '<', '>', '=']);
    let (letter, size) = descr.split_at_checked(1)?;
    let bytes = |text: &str| text.parse::<usize>().ok();
    match letter {
        "V" | "S" | "a" | "c" => bytes(size),
        "U" => bytes(size)?.checked_mul(4),
        "M" | "m" => bytes(size.split('[').next()?),
        "f" => bytes(size).filter(|bytes| !matches!(bytes, 4 | 8)),
        _ => None,
    }
}

/// Numbers of a member: those of its shape, if it has one, up to the closing bracket.
fn count(text: &str) -> Option<(usize, &str)> {
    let Some(behind) = text.strip_prefix(',') else { return Some((1, text)) };
    let behind = behind.trim_start();
    if behind.starts_with(')') {
        return Some((1, behind));
    }
    if behind.starts_with('(') {
        let numbers = shape(behind)?;
        let count = numbers.iter().try_fold(1_usize, |all, &axis| all.checked_mul(axis))?;
        let end = behind.find(')')?;
        return (count <= MEMBERS_MAX).then_some((count, behind[end + 1..].trim_start()));
    }
    let end = behind.find(')')?;
    let count = behind[..end].trim().parse().ok()?;
    (count <= MEMBERS_MAX).then_some((count, &behind[end..]))
}

/// The number type that a `descr` names.
fn number(descr: &str) -> Option<Number> {
    let kind: TypeStr = descr.parse().ok()?;
    let order = if kind.endianness() == Endianness::Big { ByteOrder::Big } else { ByteOrder::Little };
    let letter = match kind.type_char() {
        TypeChar::Float => 'F',
        TypeChar::Int => 'I',
        TypeChar::Uint | TypeChar::Bool => 'U',
        _ => return None,
    };
    Number::of(letter, usize::try_from(kind.size_field()).ok()?, order)
}

/// The header's text and the offset behind it.
fn text(bytes: &[u8]) -> Result<(&str, usize), ReadError> {
    let truncated = |message: &str| ReadError::Truncated {
        format: FORMAT,
        location: Location::Byte(bytes.len()),
        message: message.to_owned(),
    };
    let Some(after) = bytes.strip_prefix(b"\x93NUMPY") else {
        return Err(ReadError::byte(FORMAT, 0, "the file does not begin with \\x93NUMPY"));
    };
    let [version @ 1..=3, 0, ..] = *after else {
        let message = "versions 1.0, 2.0 and 3.0 are accepted";
        return Err(ReadError::byte(FORMAT, 6, message));
    };
    let (length, start) = match (version, &after[2..]) {
        (1, [a, b, ..]) => (usize::from(u16::from_le_bytes([*a, *b])), 10),
        (2 | 3, [a, b, c, d, ..]) => (u32::from_le_bytes([*a, *b, *c, *d]) as usize, 12),
        _ => return Err(truncated("the length of the header is missing")),
    };
    let Some(text) = bytes[start..].get(..length) else {
        return Err(truncated("the header is incomplete"));
    };
    let text = std::str::from_utf8(text).map_err(|error| {
        ReadError::byte(FORMAT, start + error.valid_up_to(), "the header is not UTF-8 text")
    })?;
    Ok((text, start + length))
}

/// What follows `'key':`.
fn value<'a>(text: &'a str, key: &str) -> Option<&'a str> {
    let quoted = [format!("'{key}'"), format!("\"{key}\"")];
    let after = quoted.iter().find_map(|key| text.split_once(key.as_str()))?.1;
    Some(after.trim_start().strip_prefix(':')?.trim_start())
}

/// The content of a string literal at the beginning.
fn quoted(text: &str) -> Option<&str> {
    let quote = text.chars().next().filter(|c| matches!(c, '\'' | '"'))?;
    Some(text[1..].split_once(quote)?.0)
}

fn shape(text: &str) -> Option<Vec<usize>> {
    let inside = text.strip_prefix('(')?.split_once(')')?.0;
    let numbers: Vec<&str> = inside.split(',').map(str::trim).collect();
    let numbers = match numbers.split_last()? {
        (&"", rest) => rest,
        _ => &numbers,
    };
    // NumPy for Python 2 wrote long integers as `3L`.
    numbers.iter().map(|number| number.trim_end_matches('L').parse().ok()).collect()
}

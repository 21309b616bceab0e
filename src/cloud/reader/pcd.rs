//! PCD of the Point Cloud Library, version 0.7: ASCII, binary, and compressed by LZF.
//!
//! Written here and not taken from `pcd-rs`, which allocates what a header says. A packed `rgb` becomes the fields
//! red, green and blue, `normal_x` becomes nx as in PLY; columns called `_` are padding.

use super::columns::{Column, Columns, ragged};
use super::decode::ByteOrder;
use super::number::{self, Number, Source};
use super::text::{Line, Lines, count_at, number_at, shown};
use super::{Format, Location, ReadError, ReadOptions, check_unpacked, lzf, unpacked_max};
use crate::cloud::{PointCloud, ScalarType};

const FORMAT: Format = Format::Pcd;
/// Values per field that are taken for a slip beyond it: the longest descriptors of PCL have 1,980.
const COUNT_MAX: usize = 4096;

/// Whether a file begins as PCD files do.
pub(super) fn is_pcd(head: &[u8]) -> bool {
    head.starts_with(b"# .PCD") || head.starts_with(b"VERSION .") || head.starts_with(b"VERSION 0.")
}

/// Bytes of all points, as the header says; `None` when they are not packed.
pub(super) fn unpacked_bytes(bytes: &[u8]) -> Option<usize> {
    let header = Header::parse(bytes).ok().filter(|header| header.data == Data::Compressed)?;
    header.points.checked_mul(header.stride)
}

pub(super) fn read(bytes: &[u8], options: &ReadOptions) -> Result<PointCloud, ReadError> {
    let header = Header::parse(bytes)?;
    options.limits.points(header.points)?;
    let bytes_read = match header.data {
        Data::Compressed => header.points.saturating_mul(header.stride).min(unpacked_max(bytes.len())),
        _ => bytes.len(),
    };
    let options = &options.for_bytes(bytes_read);
    let named: Vec<Column> = header.columns.iter().map(|(column, _)| column.clone()).collect();
    let Some(mut columns) = Columns::named(&named, &options.limits)? else {
        return Err(ReadError::line(FORMAT, header.lines, "FIELDS needs x, y and z, once each"));
    };
    match header.data {
        Data::Ascii => header.read_text(bytes, &mut columns)?,
        Data::Binary => {
            let body = header.block(bytes, header.body, header.points.checked_mul(header.stride))?;
            header.fill(&mut columns, body, Arrangement::Rows)?;
        }
        Data::Compressed => {
            let size = |at: usize| {
                let bytes = header.block(bytes, header.body + at, Some(4))?;
                Ok::<usize, ReadError>(u32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]) as usize)
            };
            let (packed, unpacked) = (size(0)?, size(4)?);
            let wanted = header.points.checked_mul(header.stride);
            if wanted != Some(unpacked) {
                let message = format!(
                    "the data unpacks to {unpacked} bytes; {} points of {} bytes are announced",
                    header.points, header.stride
                );
                return Err(ReadError::byte(FORMAT, header.body, message));
            }
            check_unpacked(FORMAT, bytes.len(), unpacked)?;
            let packed = header.block(bytes, header.body + 8, Some(packed))?;
            let body = lzf::unpack(packed, unpacked).ok_or_else(|| {
                ReadError::byte(FORMAT, header.body + 8, "the LZF data is damaged: it does not unpack")
            })?;
            header.fill(&mut columns, &body, Arrangement::Fields)?;
        }
    }
    columns.into_cloud(Vec::new(), options)
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Data {
    Ascii,
    Binary,
    Compressed,
}

/// What stands next to each other in binary data.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Arrangement {
    /// The fields of a point.
    Rows,
    /// The values of a field.
    Fields,
}

/// A field as announced.
#[derive(Debug, Clone, Copy)]
struct Field {
    number: Number,
    count: usize,
    /// Bytes of a point before it.
    offset: usize,
    is_packed_color: bool,
}

/// Where a column's values come from: a field, and the bytes before the value in it.
#[derive(Debug, Clone, Copy)]
struct Origin {
    field: usize,
    within: usize,
    number: Number,
}

#[derive(Debug)]
struct Header {
    fields: Vec<Field>,
    columns: Vec<(Column, Origin)>,
    points: usize,
    stride: usize,
    data: Data,
    body: usize,
    lines: usize,
}

impl Header {
    fn parse(bytes: &[u8]) -> Result<Self, ReadError> {
        let mut lines = Lines::of_header(bytes);
        let (mut names, mut sizes, mut types, mut counts) = (None, None, None, None);
        let (mut width, mut height, mut points) = (None, None, None);
        while let Some(line) = lines.next_without_comment(b'#') {
            let words: Vec<&[u8]> = line.words().collect();
            let whole = |what| count_at(words.get(1).copied().unwrap_or_default(), what, FORMAT, line.number);
            match words[0] {
                b"VERSION" | b"VIEWPOINT" => {}
                b"FIELDS" | b"COLUMNS" => names = Some(words[1..].to_vec()),
                b"SIZE" => sizes = Some(wholes(&words[1..], "number of bytes", &line)?),
                b"TYPE" => types = Some(words[1..].to_vec()),
                b"COUNT" => counts = Some(wholes(&words[1..], "number of values", &line)?),
                b"WIDTH" => width = Some(whole("width")?),
                b"HEIGHT" => height = Some(whole("height")?),
                b"POINTS" => points = Some(whole("number of points")?),
                b"DATA" => {
                    let data = data(words.get(1).copied().unwrap_or_default(), &line)?;
                    let body = bytes.len() - lines.rest().len();
                    let missing =
                        |what: &str| ReadError::line(FORMAT, line.number, format!("{what} is missing"));
                    let names = names.ok_or_else(|| missing("FIELDS"))?;
                    let counts = counts.unwrap_or_else(|| vec![1; names.len()]);
                    let sizes = sizes.ok_or_else(|| missing("SIZE"))?;
                    let types = types.ok_or_else(|| missing("TYPE"))?;
                    let points = points.or_else(|| width?.checked_mul(height.unwrap_or(1)));
                    let points = points.ok_or_else(|| missing("POINTS"))?;
                    if [sizes.len(), types.len(), counts.len()] != [names.len(); 3] {
                        let message = "FIELDS, SIZE, TYPE and COUNT have different numbers of entries";
                        return Err(ReadError::line(FORMAT, line.number, message));
                    }
                    let described = names.iter().zip(&types).zip(sizes.iter().zip(&counts));
                    let mut header = Self {
                        fields: Vec::new(),
                        columns: Vec::new(),
                        points,
                        stride: 0,
                        data,
                        body,
                        lines: line.number,
                    };
                    for ((name, letter), (&size, &count)) in described {
                        header.add(name, letter, size, count)?;
                    }
                    return Ok(header);
                }
                word => {
                    let message = format!("{} is not a line of a PCD header; DATA ends it", shown(word));
                    return Err(ReadError::line(FORMAT, line.number, message));
                }
            }
        }
        let location = Location::Line(lines.number());
        Err(ReadError::Truncated { format: FORMAT, location, message: "the line DATA is missing".to_owned() })
    }

    fn add(&mut self, name: &[u8], letter: &[u8], size: usize, count: usize) -> Result<(), ReadError> {
        let refuse = |message: String| ReadError::line(FORMAT, self.lines, message);
        let letter = letter.first().map_or('?', |&letter| char::from(letter));
        let shown = shown(name);
        let number = Number::of(letter, size, ByteOrder::Little).ok_or_else(|| {
            refuse(format!(
                "field {shown} has type {letter} of {size} bytes; F 4, 8 and I, U 1, 2, 4, 8 are accepted"
            ))
        })?;
        if count > COUNT_MAX {
            return Err(refuse(format!(
                "field {shown} has {count} values per point; up to {COUNT_MAX} are accepted"
            )));
        }
        let is_packed_color = matches!(name, b"rgb" | b"rgba") && (size, count) == (4, 1);
        let field = self.fields.len();
        self.fields.push(Field { number, count, offset: self.stride, is_packed_color });
        self.stride += size * count;
        let mut column = |name: String, within, number: Number| {
            let column = Column { name, kind: number.scalar_type() };
            self.columns.push((column, Origin { field, within, number }));
        };
        if is_packed_color {
            let channels = [("red", 2), ("green", 1), ("blue", 0), ("alpha", 3)];
            for (channel, within) in &channels[..if name == b"rgba" { 4 } else { 3 }] {
                column((*channel).to_owned(), *within, Number::little(ScalarType::Uint8));
            }
        } else if name != b"_" {
            let name = normal_name(&String::from_utf8_lossy(name));
            for value in 0..count {
                let name = if count == 1 { name.clone() } else { format!("{name}_{value}") };
                column(name, value * size, number);
            }
        }
        Ok(())
    }

    /// The bytes from `start`, as many as are announced.
    fn block<'a>(&self, bytes: &'a [u8], start: usize, length: Option<usize>) -> Result<&'a [u8], ReadError> {
        let rest = bytes.get(start..).unwrap_or_default();
        length.and_then(|length| rest.get(..length)).ok_or_else(|| {
            let (points, stride) = (self.points, self.stride);
            let message =
                format!("{points} points of {stride} bytes are announced, {} bytes follow", rest.len());
            ReadError::Truncated { format: FORMAT, location: Location::Byte(bytes.len()), message }
        })
    }

    fn fill(&self, columns: &mut Columns, body: &[u8], arrangement: Arrangement) -> Result<(), ReadError> {
        columns.zeroed(self.points)?;
        let source = |origin: &Origin| {
            let field = &self.fields[origin.field];
            let width = field.number.size() * field.count;
            let number = origin.number;
            match arrangement {
                Arrangement::Rows => {
                    Source { rows: body, stride: self.stride, offset: field.offset + origin.within, number }
                }
                Arrangement::Fields => {
                    let rows = &body[field.offset * self.points..][..width * self.points];
                    Source { rows, stride: width, offset: origin.within, number }
                }
            }
        };
        let sources: Vec<Source> = self.columns.iter().map(|(_, origin)| source(origin)).collect();
        number::fill(columns, &sources);
        Ok(())
    }

    fn read_text(&self, bytes: &[u8], columns: &mut Columns) -> Result<(), ReadError> {
        let mut lines = Lines::starting_at(&bytes[self.body..], self.lines + 1);
        let values: usize = self.fields.iter().map(|field| field.count).sum();
        // Every value takes a digit and a blank at least.
        let possible = (bytes.len() - self.body).div_ceil(2 * values.max(1));
        columns.reserve(self.points.min(possible))?;
        let first: Vec<usize> = self
            .fields
            .iter()
            .scan(0, |before, field| Some(std::mem::replace(before, *before + field.count)))
            .collect();
        let mut row = Vec::with_capacity(self.columns.len());
        while columns.len() < self.points {
            let Some(line) = lines.next_without_comment(b'#') else {
                let message = format!("{} points are announced, {} follow", self.points, columns.len());
                let location = Location::Line(lines.number());
                return Err(ReadError::Truncated { format: FORMAT, location, message });
            };
            let words: Vec<&[u8]> = line.words().collect();
            if words.len() != values {
                let is_last = lines.rest().trim_ascii().is_empty();
                return Err(ragged(words.len(), values, is_last, FORMAT, line.number));
            }
            row.clear();
            for (_, origin) in &self.columns {
                let field = &self.fields[origin.field];
                row.push(if field.is_packed_color {
                    let color = packed_color(words[first[origin.field]], field.number, &line)?;
                    f64::from(color.to_le_bytes()[origin.within])
                } else {
                    let place = first[origin.field] + origin.within / origin.number.size();
                    number_at(words[place], FORMAT, line.number)?
                });
            }
            columns.push(&row)?;
        }
        columns.note_lines_behind(lines, "points");
        columns.settle_types();
        Ok(())
    }
}

/// The bits 0xAARRGGBB, written as the float or the integer that they make.
fn packed_color(word: &[u8], number: Number, line: &Line<'_>) -> Result<u32, ReadError> {
    let value = number_at(word, FORMAT, line.number)?;
    Ok(if number.scalar_type() == ScalarType::Float32 {
        (value as f32).to_bits()
    } else {
        value as i64 as u32
    })
}

fn normal_name(name: &str) -> String {
    match name {
        "normal_x" => "nx".to_owned(),
        "normal_y" => "ny".to_owned(),
        "normal_z" => "nz".to_owned(),
        name => name.to_owned(),
    }
}

fn wholes(words: &[&[u8]], what: &str, line: &Line<'_>) -> Result<Vec<usize>, ReadError> {
    words.iter().map(|word| count_at(word, what, FORMAT, line.number)).collect()
}

fn data(word: &[u8], line: &Line<'_>) -> Result<Data, ReadError> {
    match word.to_ascii_lowercase().as_slice() {
        b"ascii" => Ok(Data::Ascii),
        b"binary" => Ok(Data::Binary),
        b"binary_compressed" => Ok(Data::Compressed),
        _ => {
            let message =
                format!("DATA is {}; ascii, binary and binary_compressed are accepted", shown(word));
            Err(ReadError::line(FORMAT, line.number, message))
        }
    }
}

#[cfg(test)]
mod tests;

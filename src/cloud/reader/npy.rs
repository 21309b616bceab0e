//! NumPy arrays: n×d, or n numbers.
//!
//! npyz parses the type; the header's three entries are picked out here, because npyz 0.9.1 multiplies the shape
//! without a check (a panic in builds that check arithmetic), allocates what the header's length field says,
//! and its grammar recurses once per bracket. The tests hold both readers against each other.

use npyz::{Endianness, TypeChar, TypeStr};

use super::columns::{Column, Columns};
use super::number::{self, Number, Source};
use super::ply::{ByteOrder, Place};
use super::text::shown;
use super::{Format, Location, ReadError, ReadOptions};
use crate::cloud::PointCloud;

const FORMAT: Format = Format::Npy;

pub(super) fn read(bytes: &[u8], options: &ReadOptions) -> Result<PointCloud, ReadError> {
    let header = Header::parse(bytes)?;
    let (rows, width) = (header.rows, header.width);
    options.limits.points(rows)?;
    let block = header.block(bytes)?;
    let dimension = options.dimension.unwrap_or(width);
    if dimension > options.limits.dimension_max {
        return Err(ReadError::Dimension { dimension, dimension_max: options.limits.dimension_max });
    }
    let kind = header.number.scalar_type();
    let names: Vec<Column> = (0..width).map(|i| Column { kind, ..Column::unnamed(i) }).collect();
    let mut columns = Columns::leading(&names, dimension, &options.limits)?;
    columns.zeroed(rows)?;
    let sources: Vec<Source> = (0..width).map(|index| header.source(block, index)).collect();
    number::fill(&mut columns, &sources);
    columns.into_cloud(Vec::new(), options)
}

/// Reads an array of `n × m` or n numbers as its columns.
///
/// # Errors
/// [`ReadError`].
pub fn read_columns(bytes: &[u8]) -> Result<Vec<Vec<f64>>, ReadError> {
    let header = Header::parse(bytes)?;
    let block = header.block(bytes)?;
    let column = |index| {
        let mut values = vec![0.0; header.rows];
        header.source(block, index).decode(Place::packed(&mut values));
        values
    };
    Ok((0..header.width).map(column).collect())
}

/// The number type that a `descr` names.
fn number(descr: &str) -> Option<Number> {
    let kind: TypeStr = descr.parse().ok()?;
    let order = if kind.endianness() == Endianness::Big { ByteOrder::Big } else { ByteOrder::Little };
    let letter = match kind.type_char() {
        TypeChar::Float => 'F',
        TypeChar::Int => 'I',
        TypeChar::Uint => 'U',
        _ => return None,
    };
    Number::of(letter, usize::try_from(kind.size_field()).ok()?, order)
}

#[derive(Debug, Clone, PartialEq)]
struct Header {
    number: Number,
    is_fortran: bool,
    rows: usize,
    width: usize,
    /// Offset of the first byte behind the header.
    body: usize,
}

impl Header {
    fn parse(bytes: &[u8]) -> Result<Self, ReadError> {
        let (text, body) = text(bytes)?;
        let refuse = |message: String| ReadError::byte(FORMAT, 0, format!("the header {message}"));
        let entry = |key: &str| value(text, key).ok_or_else(|| refuse(format!("has no entry '{key}'")));
        let descr = entry("descr")?;
        let number = quoted(descr).and_then(number).ok_or_else(|| {
            let shown = shown(descr.split([',', '}']).next().unwrap_or_default().as_bytes());
            refuse(format!(
                "gives the type {shown}; real numbers <f4 <f8 and integers of 1 to 8 bytes are accepted"
            ))
        })?;
        let order = entry("fortran_order")?;
        let is_fortran = order.starts_with("True");
        if !is_fortran && !order.starts_with("False") {
            return Err(refuse("gives a fortran_order that is neither True nor False".to_owned()));
        }
        let shape = shape(entry("shape")?)
            .ok_or_else(|| refuse("gives a shape that is no tuple of whole numbers".to_owned()))?;
        let (rows, width) = match shape[..] {
            [rows] => (rows, 1),
            [rows, width] => (rows, width),
            _ => {
                let axes = shape.len();
                return Err(refuse(format!("gives an array of {axes} axes; (n, d) and (n,) are accepted")));
            }
        };
        if rows == 0 || width == 0 {
            return Err(crate::cloud::CloudError::Empty.into());
        }
        Ok(Self { number, is_fortran, rows, width, body })
    }

    /// The bytes of the numbers, as many as are announced.
    fn block<'a>(&self, bytes: &'a [u8]) -> Result<&'a [u8], ReadError> {
        let (rows, width) = (self.rows, self.width);
        let cells = rows.checked_mul(width).and_then(|cells| cells.checked_mul(self.number.size()));
        let body = &bytes[self.body..];
        cells.and_then(|cells| body.get(..cells)).ok_or_else(|| {
            let message = format!("an array of {rows}×{width} is announced, {} bytes follow", body.len());
            ReadError::Truncated { format: FORMAT, location: Location::Byte(bytes.len()), message }
        })
    }

    /// Where one column of the block stands.
    fn source<'a>(&self, block: &'a [u8], index: usize) -> Source<'a> {
        let size = self.number.size();
        let (rows, stride, offset) = if self.is_fortran {
            (&block[index * self.rows * size..][..self.rows * size], size, 0)
        } else {
            (block, self.width * size, index * size)
        };
        Source { rows, stride, offset, number: self.number }
    }
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

#[cfg(test)]
mod tests {
    use npyz::WriterBuilder;

    use super::*;
    use crate::cloud::ScalarType;

    fn npy<T: npyz::AutoSerialize>(values: &[T], shape: &[u64], order: npyz::Order) -> Vec<u8> {
        let mut bytes = Vec::new();
        let options = npyz::WriteOptions::new().default_dtype().shape(shape).order(order);
        let mut writer = options.writer(&mut bytes).begin_nd().unwrap();
        writer.extend(values).unwrap();
        writer.finish().unwrap();
        bytes
    }

    fn with_header(header: &str, body: &[u8]) -> Vec<u8> {
        let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
        bytes.extend(u16::try_from(header.len()).unwrap().to_le_bytes());
        bytes.extend(header.as_bytes());
        bytes.extend(body);
        bytes
    }

    fn message(bytes: &[u8]) -> String {
        read(bytes, &ReadOptions::default()).unwrap_err().to_string()
    }

    #[test]
    fn arrays_that_npyz_writes_are_read_in_both_orders() {
        let options = ReadOptions::default();
        let cloud = read(&npy(&[1.0, 2.0, 3.0, 4.0, 5.0, 6.0], &[2, 3], npyz::Order::C), &options).unwrap();
        assert_eq!(cloud.coordinates(), [1.0, 2.0, 3.0, 4.0, 5.0, 6.0]);
        let fortran = npy(&[1.0_f32, 4.0, 2.0, 5.0, 3.0, 6.0], &[2, 3], npyz::Order::Fortran);
        let cloud = read(&fortran, &options).unwrap();
        assert_eq!(cloud.coordinates(), [1.0, 2.0, 3.0, 4.0, 5.0, 6.0]);
        assert_eq!(cloud.coordinate_type(), ScalarType::Float32);
        let integers = npy(&[-1_i64, 2, 3, 4], &[2, 2], npyz::Order::C);
        assert_eq!(read(&integers, &options).unwrap().coordinates(), [-1.0, 2.0, 3.0, 4.0]);
        assert_eq!(read(&npy(&[7_u8, 8], &[2], npyz::Order::C), &options).unwrap().dimension(), 1);
    }

    #[test]
    fn an_array_is_read_by_columns_whatever_its_order_and_its_width() {
        let columns = [[1.0, 3.0, 5.0].to_vec(), [2.0, 4.0, 6.0].to_vec()];
        let rows = npy(&[1.0, 2.0, 3.0, 4.0, 5.0, 6.0], &[3, 2], npyz::Order::C);
        assert_eq!(read_columns(&rows).unwrap(), columns);
        let fortran = npy(&[1.0, 3.0, 5.0, 2.0, 4.0, 6.0], &[3, 2], npyz::Order::Fortran);
        assert_eq!(read_columns(&fortran).unwrap(), columns);
        assert_eq!(read_columns(&npy(&[0_u8; 40], &[2, 20], npyz::Order::C)).unwrap().len(), 20);
        assert!(read_columns(&rows[..rows.len() - 1]).is_err());
    }

    #[test]
    fn big_endian_arrays_are_read() {
        let header = "{'descr': '>f4', 'fortran_order': False, 'shape': (1, 2), }\n";
        let body: Vec<u8> = [1.5_f32, -2.0].iter().flat_map(|x| x.to_be_bytes()).collect();
        let cloud = read(&with_header(header, &body), &ReadOptions::default()).unwrap();
        assert_eq!(cloud.coordinates(), [1.5, -2.0]);
    }

    #[test]
    fn the_caller_chooses_the_dimension_and_keeps_the_other_columns() {
        let bytes = npy(&[1.0; 18], &[2, 9], npyz::Order::C);
        assert!(message(&bytes).contains("dimension=3"), "{}", message(&bytes));
        let options = ReadOptions { dimension: Some(3), ..ReadOptions::default() };
        let cloud = read(&bytes, &options).unwrap();
        assert_eq!((cloud.dimension(), cloud.fields().len()), (3, 6));
        assert_eq!(cloud.fields()[0].name, "column4");
    }

    #[test]
    fn a_shape_beyond_the_file_is_refused() {
        for shape in ["(4000000, 3)", "(3, 18446744073709551615)"] {
            let header = format!("{{'descr': '<f8', 'fortran_order': False, 'shape': {shape}}}");
            let message = message(&with_header(&header, &[0; 24]));
            assert!(message.contains("is announced, 24 bytes follow"), "{message}");
        }
        let header = "{'descr': '<f8', 'fortran_order': False, 'shape': (99999999999999999999999, 3)}";
        assert!(message(&with_header(header, &[])).contains("no tuple of whole numbers"));
    }

    #[test]
    fn what_is_no_table_of_real_numbers_is_refused() {
        let refusal = |descr: &str, shape: &str| {
            let header = format!("{{'descr': {descr}, 'fortran_order': False, 'shape': {shape}}}");
            message(&with_header(&header, &[0; 64]))
        };
        assert!(refusal("'<c16'", "(2, 2)").contains("gives the type `'<c16'`"));
        assert!(refusal("[('x', '<f8')]", "(2,)").contains("gives the type"));
        assert!(refusal("'<f8'", "(2, 2, 2)").contains("an array of 3 axes; (n, d) and (n,) are accepted"));
        assert!(refusal("'<f8'", "()").contains("0 axes"));
        assert!(refusal("'<f8'", "(0, 3)").contains("no points"));
        assert!(message(b"\x93NUMPX").contains("does not begin"));
        assert!(message(b"\x93NUMPY\x09\x00").contains("versions 1.0"));
        assert!(message(b"\x93NUMPY\x01\x00\xff").contains("length of the header"));
        assert!(message(b"\x93NUMPY\x02\x00\xff\xff\xff\xff{}").contains("header is incomplete"));
        assert!(message(&with_header("{'descr': '<f8'}", &[])).contains("no entry 'fortran_order'"));
    }
}

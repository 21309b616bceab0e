//! XYZ, CSV, OBJ and OFF.

use std::io::{self, Write};

use super::{CHUNK_ROWS, Column, axis_name, push_number};
use crate::cloud::PointCloud;

/// How the columns of a table are separated and named.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Table {
    /// Blanks, names in a comment.
    Xyz,
    /// Commas, names in the first line.
    Csv,
}

/// Coordinates, then fields.
pub(super) fn write_table(cloud: &PointCloud, table: Table, out: &mut impl Write) -> io::Result<()> {
    let axes = (0..cloud.dimension()).map(axis_name);
    let names: Vec<String> = axes.chain(cloud.fields().iter().map(|field| table.name(&field.name))).collect();
    let separator = match table {
        Table::Xyz => {
            writeln!(out, "# {}", names.join(" "))?;
            b' '
        }
        Table::Csv => {
            writeln!(out, "{}", names.join(","))?;
            b','
        }
    };
    rows(cloud, out, |row, text| {
        let values = cloud.point(row).iter().copied();
        for value in values.chain(cloud.fields().iter().map(|field| field.values[row])) {
            push_number(value, text);
            text.push(separator);
        }
        text.pop();
    })
}

impl Table {
    /// A field's name without anything that separates or quotes.
    fn name(self, name: &str) -> String {
        let separates = |c: char| match self {
            Self::Xyz => c.is_whitespace() || c == '#',
            Self::Csv => c.is_control() || matches!(c, ',' | ';' | '"'),
        };
        let name = name.replace(separates, "_");
        // A spreadsheet runs what begins so. The reader takes the apostrophe off again.
        if self == Self::Csv && name.starts_with(['=', '+', '-', '@']) { format!("'{name}") } else { name }
    }
}

/// First line of a CSV: the names of its columns.
#[must_use]
pub fn csv_header(names: &[String]) -> Vec<u8> {
    let names: Vec<String> = names.iter().map(|name| Table::Csv.name(name)).collect();
    format!("{}\n", names.join(",")).into_bytes()
}

/// Lines of a CSV, one for each of `rows`: the shortest decimals that read back as the same doubles, `nan` for NaN. The
/// types of the columns are not looked at.
///
/// # Panics
/// When a column has no number for a row.
#[must_use]
pub fn csv_lines(columns: &[Column<'_>], rows: std::ops::Range<usize>) -> Vec<u8> {
    let mut text = Vec::new();
    for row in rows {
        for column in columns {
            push_number(column.values[row * column.stride], &mut text);
            text.push(b',');
        }
        text.pop();
        text.push(b'\n');
    }
    text
}

pub(super) fn write_obj(cloud: &PointCloud, out: &mut impl Write) -> io::Result<()> {
    in_space(cloud, "OBJ")?;
    rows(cloud, out, |row, text| {
        text.extend_from_slice(b"v ");
        push_point(cloud.point(row), text);
    })?;
    cloud.polygons().try_for_each(|fan| {
        let corners: Vec<String> = corners(fan).map(|corner| (corner + 1).to_string()).collect();
        writeln!(out, "f {}", corners.join(" "))
    })
}

pub(super) fn write_off(cloud: &PointCloud, out: &mut impl Write) -> io::Result<()> {
    in_space(cloud, "OFF")?;
    writeln!(out, "OFF\n{} {} 0", cloud.len(), cloud.polygons().count())?;
    rows(cloud, out, |row, text| push_point(cloud.point(row), text))?;
    cloud.polygons().try_for_each(|fan| {
        let corners: Vec<String> = corners(fan).map(|corner| corner.to_string()).collect();
        writeln!(out, "{} {}", corners.len(), corners.join(" "))
    })
}

/// Corners of the polygon that a fan of triangles is.
fn corners(fan: &[[u32; 3]]) -> impl Iterator<Item = u32> {
    let first = fan.first().copied().unwrap_or_default();
    first.into_iter().chain(fan.iter().skip(1).map(|triangle| triangle[2]))
}

fn in_space(cloud: &PointCloud, format: &str) -> io::Result<()> {
    if cloud.dimension() <= 3 {
        return Ok(());
    }
    let message = format!("{format} has three coordinates; these points have {}", cloud.dimension());
    Err(io::Error::new(io::ErrorKind::Unsupported, message))
}

/// Three coordinates.
fn push_point(point: &[f64], text: &mut Vec<u8>) {
    for axis in 0..3 {
        if axis > 0 {
            text.push(b' ');
        }
        push_number(point.get(axis).copied().unwrap_or(0.0), text);
    }
}

/// Writes a line per row, in chunks.
fn rows(cloud: &PointCloud, out: &mut impl Write, push: impl Fn(usize, &mut Vec<u8>)) -> io::Result<()> {
    let mut text = Vec::new();
    for row in 0..cloud.len() {
        push(row, &mut text);
        text.push(b'\n');
        if (row + 1) % CHUNK_ROWS == 0 {
            out.write_all(&text)?;
            text.clear();
        }
    }
    out.write_all(&text)
}

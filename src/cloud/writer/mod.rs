//! Writers, one per format. [`write()`] streams a whole cloud; PLY and NPY can also be had in pieces, a header
//! and chunks of rows of fixed size, so that whoever sends them knows their length beforehand.

mod archive;
mod las;
mod npy;
mod npz;
mod pcd;
mod ply;
mod rows;
mod stl;
mod text;

use std::io::{self, Write};

pub use archive::{Archive, OpenArchive};
pub use npy::{npy_header, npy_header_by_columns, npy_vector_header};
pub use npz::write_npz;
pub use ply::{FACE_BYTES, PlyEncoding, PlyHeader, encode_faces, ply_columns, ply_header, ply_properties};
pub(in crate::cloud) use ply::{SCALAR_PREFIX, is_plain};
pub use rows::{Column, encode_column, encode_rows};
pub use text::{csv_header, csv_lines};

use super::reader::Format;
use super::{PointCloud, ScalarType};

/// Rows that are encoded together.
const CHUNK_ROWS: usize = 4096;

/// Writes a cloud with its fields and, where the format has them, its faces. PLY is written in binary.
///
/// OBJ, OFF and STL hold points of at most three coordinates, STL none but those of faces; fields are left out.
/// NPY holds the coordinates only, as `n × d` doubles. LAS and LAZ hold finite coordinates of at most three
/// dimensions, to nine digits of the cloud's extent or, where they lie on a grid of a power of ten, as they are.
///
/// # Errors
/// Those of `out`; [`io::ErrorKind::Unsupported`] for clouds that the format cannot hold and for formats that are
/// not among [`Format::WRITTEN`].
pub fn write(cloud: &PointCloud, format: Format, out: &mut impl Write) -> io::Result<()> {
    match format {
        Format::Ply => write_ply(cloud, PlyEncoding::Binary, out),
        Format::Obj => text::write_obj(cloud, out),
        Format::Off => text::write_off(cloud, out),
        Format::Xyz => text::write_table(cloud, text::Table::Xyz, out),
        Format::Csv => text::write_table(cloud, text::Table::Csv, out),
        Format::Las | Format::Laz => las::write_las(cloud, format == Format::Laz, out),
        Format::Stl => stl::write_stl(cloud, out),
        Format::Pcd => pcd::write_pcd(cloud, out),
        Format::E57 => {
            Err(io::Error::new(io::ErrorKind::Unsupported, format!("{format} is read, not written")))
        }
        Format::Npy => {
            out.write_all(&npy_header(cloud.len(), cloud.dimension(), ScalarType::Float64))?;
            cloud.coordinates().chunks(CHUNK_ROWS).try_for_each(|values| {
                let column = Column { values, stride: 1, kind: ScalarType::Float64 };
                out.write_all(&encode_rows(&[column], values.len()))
            })
        }
    }
}

/// Writes a cloud as PLY in the given encoding.
///
/// # Errors
/// Those of `out`.
pub fn write_ply(cloud: &PointCloud, encoding: PlyEncoding, out: &mut impl Write) -> io::Result<()> {
    write_annotated_ply(cloud, encoding, &[], out)
}

/// Writes a cloud as PLY with comments in its header, each on a line of its own.
///
/// # Errors
/// Those of `out`.
pub fn write_annotated_ply(
    cloud: &PointCloud,
    encoding: PlyEncoding,
    comments: &[String],
    out: &mut impl Write,
) -> io::Result<()> {
    let header = PlyHeader::of(cloud, encoding);
    let bytes = header.to_bytes();
    // behind the first two lines: `ply` and the format
    let (head, rest) = bytes
        .split_at(bytes.iter().enumerate().filter(|(_, b)| **b == b'\n').nth(1).map_or(0, |(at, _)| at + 1));
    out.write_all(head)?;
    for comment in comments {
        writeln!(out, "comment {}", comment.replace(['\n', '\r'], " "))?;
    }
    out.write_all(rest)?;
    for rows in header.chunks() {
        out.write_all(&header.encode_rows(&ply_columns(cloud, rows.start), rows.len()))?;
    }
    cloud.faces().chunks(CHUNK_ROWS).try_for_each(|faces| out.write_all(&encode_faces(faces, encoding)))
}

/// Appends the shortest decimal number that reads back as the same double.
fn push_number(value: f64, out: &mut Vec<u8>) {
    if value.is_nan() {
        out.extend_from_slice(b"nan");
        return;
    }
    let mut buffer = [0; <f64 as lexical_core::FormattedSize>::FORMATTED_SIZE_DECIMAL];
    let text = lexical_core::write(value, &mut buffer);
    out.extend_from_slice(text.strip_suffix(b".0").unwrap_or(text));
}

/// Name of a coordinate: `x`, `y`, `z`, then `coordinate_3`, `coordinate_4`…
#[must_use]
pub fn axis_name(axis: usize) -> String {
    ["x", "y", "z"].get(axis).map_or_else(|| format!("coordinate_{axis}"), |&name| name.to_owned())
}

#[cfg(test)]
mod tests;

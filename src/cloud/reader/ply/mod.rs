//! PLY, ASCII and binary, after Turk's specification of 1994.
//!
//! The vertex element gives the coordinates (properties x, y, z, and `coordinate_3`… beyond space, in any order
//! and of any type) and, with its other scalar properties, the fields. Lists on vertices are passed over, and so
//! are elements other than `face` and `tristrips`.
//!
//! The header is parsed here and not by ply-rs-bw 4.0.1, which refuses property names that CloudCompare writes
//! (`scalar_Scalar_field_#2`), lets a repeated property replace the first, so that every later byte is read in
//! the wrong place, and wants comments in UTF-8. Its payload reader builds a map per vertex: 4 MB/s, where slices
//! decoded column by column give gigabytes a second (two cores, millions of vertices with three floats). The tests hold
//! both readers against each other.

mod ascii;
mod binary;
mod faces;
mod header;

use self::header::{Element, Encoding, Header, PropertyKind};
use super::columns::{Column, Columns, Target};
use super::number::rounded;
use super::polygons::Triangles;
use super::{Format, ReadError, ReadOptions};
use crate::cloud::PointCloud;
use crate::cloud::writer::{SCALAR_PREFIX, is_plain};

const FORMAT: Format = Format::Ply;

pub(super) fn read(bytes: &[u8], options: &ReadOptions) -> Result<PointCloud, ReadError> {
    let header = Header::parse(bytes)?;
    let mut ply = Ply::new(&header, options)?;
    match header.encoding {
        Encoding::Ascii => ascii::read(bytes, &header, &mut ply)?,
        Encoding::Binary(order) => binary::read(bytes, &header, order, &mut ply)?,
    }
    ply.columns.notes.extend(header.left_out());
    let wide = header.wide_fields();
    let fields = ply.columns.fields.iter().filter(|field| wide.contains(&field.name));
    ply.columns.notes.extend(fields.filter_map(rounded));
    ply.triangles.finish(ply.columns, options)
}

/// What is taken out of a file, while it is read.
struct Ply {
    points: usize,
    columns: Columns,
    triangles: Triangles,
}

impl Ply {
    fn new(header: &Header, options: &ReadOptions) -> Result<Self, ReadError> {
        let Some(vertex) = header.elements.iter().find(|element| element.name == "vertex") else {
            let message = "no `element vertex` in the header; a cloud has one";
            return Err(ReadError::line(FORMAT, header.lines, message));
        };
        options.limits.points(vertex.count)?;
        let scalars: Vec<Column> = vertex
            .scalars()
            .map(|(name, stored)| Column { name: field_name(name, vertex), kind: stored.scalar_type() })
            .collect();
        let Some(mut columns) = Columns::named(&scalars, &options.limits)? else {
            let message = "the vertex element needs the scalar properties x, y and z, once each";
            return Err(ReadError::line(FORMAT, header.lines, message));
        };
        columns.targets = spread(&columns.targets, vertex);
        let triangles = Triangles::new(&options.limits, columns.bytes_of(vertex.count));
        Ok(Self { points: vertex.count, columns, triangles })
    }
}

/// The field of a property: its name without the prefix by which `CloudCompare` marks scalar fields, unless another
/// property has that name.
fn field_name(name: &str, vertex: &Element) -> String {
    let plain = name.strip_prefix(SCALAR_PREFIX).filter(|rest| !rest.is_empty() && !is_plain(rest));
    let is_free = |plain: &&str| vertex.properties.iter().all(|property| property.name != **plain);
    plain.filter(is_free).unwrap_or(name).to_owned()
}

/// Targets of the scalar properties become targets of all properties: lists are skipped.
fn spread(scalars: &[Target], vertex: &Element) -> Vec<Target> {
    let mut scalars = scalars.iter();
    let target = |kind: &PropertyKind| match kind {
        PropertyKind::Scalar(_) => scalars.next().copied(),
        PropertyKind::List { .. } => Some(Target::Skipped),
    };
    vertex.properties.iter().map(|property| &property.kind).filter_map(target).collect()
}

#[cfg(test)]
mod tests;

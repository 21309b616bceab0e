//! The body of a binary file.
//!
//! Vertices without lists stand at fixed distances and are decoded column by column out of checked slices.

use super::super::decode::{ByteOrder, Place};
use super::super::number::{self, Number, Source};
use super::super::text::shown;
use super::faces::{FaceError, Surface};
use super::header::{Element, Header, PropertyKind};
use super::{FORMAT, Ply, ReadError};
use crate::cloud::reader::Location;
use crate::cloud::scalar::Stored;

pub(super) fn read(bytes: &[u8], header: &Header, order: ByteOrder, ply: &mut Ply) -> Result<(), ReadError> {
    let mut cursor = Cursor { bytes, position: header.body, order };
    let mut vertices_are_read = false;
    for element in header.elements.iter().filter(|element| !element.properties.is_empty()) {
        cursor.check_count(element)?;
        if element.name == "vertex" && !vertices_are_read {
            vertices_are_read = true;
            match element.stride() {
                Some(stride) => read_fixed_vertices(element, stride, &mut cursor, ply)?,
                None => read_vertices(element, &mut cursor, ply)?,
            }
        } else if let Some((surface, list)) = Surface::of(element) {
            read_faces(element, surface, list, &mut cursor, ply)?;
        } else if let Some(stride) = element.stride() {
            cursor.take(stride * element.count, element, 0)?;
        } else {
            for row in 0..element.count {
                for property in &element.properties {
                    cursor.property(property.kind, element, row)?;
                }
            }
        }
    }
    Ok(())
}

/// Rows of fixed length are decoded side by side.
fn read_fixed_vertices(
    element: &Element,
    stride: usize,
    cursor: &mut Cursor<'_>,
    ply: &mut Ply,
) -> Result<(), ReadError> {
    let rows = cursor.take(stride * element.count, element, 0)?;
    ply.columns.zeroed(element.count)?;
    let (mut offset, mut sources) = (0, Vec::with_capacity(element.properties.len()));
    for (_, kind) in element.scalars() {
        sources.push(Source { rows, stride, offset, number: Number::stored(kind, cursor.order) });
        offset += kind.size();
    }
    number::decode_all(&mut ply.columns, &sources);
    Ok(())
}

fn read_vertices(element: &Element, cursor: &mut Cursor<'_>, ply: &mut Ply) -> Result<(), ReadError> {
    ply.columns.reserve(element.count)?;
    let mut values = Vec::with_capacity(element.properties.len());
    for row in 0..element.count {
        values.clear();
        for property in &element.properties {
            let (kind, bytes) = cursor.property(property.kind, element, row)?;
            let is_scalar = matches!(property.kind, PropertyKind::Scalar(_));
            values.push(if is_scalar { cursor.value(bytes, kind) } else { 0.0 });
        }
        ply.columns.push(&values)?;
    }
    Ok(())
}

fn read_faces(
    element: &Element,
    surface: Surface,
    list: usize,
    cursor: &mut Cursor<'_>,
    ply: &mut Ply,
) -> Result<(), ReadError> {
    let (mut indices, mut corners) = (Vec::new(), Vec::new());
    for row in 0..element.count {
        let start = cursor.position;
        for (index, property) in element.properties.iter().enumerate() {
            let (kind, bytes) = cursor.property(property.kind, element, row)?;
            if index != list {
                continue;
            }
            ply.triangles.room_for(bytes.len() / kind.size())?;
            indices.clear();
            indices.extend(bytes.chunks_exact(kind.size()).map(|item| cursor.value(item, kind) as i64));
            surface.push(row, &indices, ply.points, &mut corners, &mut ply.triangles).map_err(|error| {
                match error {
                    FaceError::Message(message) => ReadError::byte(FORMAT, start, message),
                    FaceError::Limit(error) => error,
                }
            })?;
        }
    }
    Ok(())
}

/// A place in the file that moves forward over bytes that are there.
struct Cursor<'a> {
    bytes: &'a [u8],
    position: usize,
    order: ByteOrder,
}

impl<'a> Cursor<'a> {
    /// Refuses a count that the remaining bytes cannot hold.
    fn check_count(&self, element: &Element) -> Result<(), ReadError> {
        let possible = (self.bytes.len() - self.position) / element.stride_min();
        if element.count > possible {
            let name = shown(element.name.as_bytes());
            let message = format!(
                "{} rows of element {name} are announced, {possible} at most are there",
                element.count
            );
            return Err(self.truncated(message));
        }
        Ok(())
    }

    /// The next `count` bytes.
    fn take(&mut self, count: usize, element: &Element, row: usize) -> Result<&'a [u8], ReadError> {
        let rest = &self.bytes[self.position..];
        let Some(taken) = rest.get(..count) else {
            let name = shown(element.name.as_bytes());
            return Err(self.truncated(format!("row {row} of the {} of {name} is incomplete", element.count)));
        };
        self.position += count;
        Ok(taken)
    }

    /// The bytes of a property's value or of its list's items, and their type.
    fn property(
        &mut self,
        kind: PropertyKind,
        element: &Element,
        row: usize,
    ) -> Result<(Stored, &'a [u8]), ReadError> {
        match kind {
            PropertyKind::Scalar(kind) => Ok((kind, self.take(kind.size(), element, row)?)),
            PropertyKind::List { length, item } => {
                let start = self.position;
                let length = self.take(length.size(), element, row).map(|bytes| self.value(bytes, length))?;
                if length < 0.0 {
                    let message =
                        format!("row {row} of {}: a list of {length} items", shown(element.name.as_bytes()));
                    return Err(ReadError::byte(FORMAT, start, message));
                }
                let bytes = (length as usize).saturating_mul(item.size());
                Ok((item, self.take(bytes, element, row)?))
            }
        }
    }

    fn value(&self, bytes: &[u8], kind: Stored) -> f64 {
        let mut value = [0.0];
        let number = Number::stored(kind, self.order);
        Source { rows: bytes, stride: kind.size(), offset: 0, number }.decode(Place::packed(&mut value));
        value[0]
    }

    /// The file ends at its last byte, whatever was to follow.
    fn truncated(&self, message: String) -> ReadError {
        ReadError::Truncated { format: FORMAT, location: Location::Byte(self.bytes.len()), message }
    }
}

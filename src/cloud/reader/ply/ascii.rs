//! The body of an ASCII file: one line per row of an element.

use super::super::text::{Line, Lines, number_at, shown};
use super::faces::{FaceError, Surface};
use super::header::{Element, Header, Property, PropertyKind};
use super::{FORMAT, Ply, ReadError};
use crate::cloud::ScalarType;
use crate::cloud::reader::Location;
use crate::cloud::scalar::Stored;

pub(super) fn read(bytes: &[u8], header: &Header, ply: &mut Ply) -> Result<(), ReadError> {
    let mut lines = Lines::starting_at(&bytes[header.body..], header.lines + 1);
    let mut vertices_are_read = false;
    for element in header.elements.iter().filter(|element| !element.properties.is_empty()) {
        check_count(element, &lines)?;
        if element.name == "vertex" && !vertices_are_read {
            vertices_are_read = true;
            read_vertices(element, &mut lines, ply)?;
        } else if let Some((surface, list)) = Surface::of(element) {
            read_faces(element, surface, list, &mut lines, ply)?;
        } else {
            for row in 0..element.count {
                next(&mut lines, element, row)?;
            }
        }
    }
    ply.columns.note_lines_behind(lines, "rows");
    Ok(())
}

/// A row needs a digit and a blank or line end per property.
fn check_count(element: &Element, lines: &Lines<'_>) -> Result<(), ReadError> {
    let possible = (lines.rest().len() + 1) / (2 * element.properties.len());
    if element.count > possible {
        let message = format!(
            "{} rows of element {} are announced, {possible} at most can follow",
            element.count,
            shown(element.name.as_bytes())
        );
        return Err(truncated(lines, message));
    }
    Ok(())
}

fn read_vertices(element: &Element, lines: &mut Lines<'_>, ply: &mut Ply) -> Result<(), ReadError> {
    ply.columns.reserve(element.count)?;
    let mut row = Vec::new();
    for index in 0..element.count {
        let line = next(lines, element, index)?;
        let mut words = line.words();
        row.clear();
        for property in &element.properties {
            let value = match property.kind {
                PropertyKind::Scalar(kind) => value(words.next(), property, kind, &line)?,
                PropertyKind::List { length, .. } => {
                    let length = value(words.next(), property, length, &line)?;
                    for _ in 0..length as usize {
                        words.next().ok_or_else(|| missing(property, &line))?;
                    }
                    0.0
                }
            };
            row.push(value);
        }
        check_end(words.next(), &line)?;
        ply.columns.push(&row)?;
    }
    ply.columns.settle_types();
    Ok(())
}

fn read_faces(
    element: &Element,
    surface: Surface,
    list: usize,
    lines: &mut Lines<'_>,
    ply: &mut Ply,
) -> Result<(), ReadError> {
    let (mut indices, mut corners) = (Vec::new(), Vec::new());
    for row in 0..element.count {
        let line = next(lines, element, row)?;
        let mut words = line.words();
        for (index, property) in element.properties.iter().enumerate() {
            let (length, item) = match property.kind {
                PropertyKind::Scalar(kind) => (1.0, kind),
                PropertyKind::List { length, item } => (value(words.next(), property, length, &line)?, item),
            };
            indices.clear();
            // No line has more words than every other of its bytes.
            ply.triangles.room_for((length as usize).min(line.text.len()))?;
            for _ in 0..length as usize {
                let value = value(words.next(), property, item, &line)?;
                if index == list {
                    indices.push(value as i64);
                }
            }
            if index == list {
                surface.push(row, &indices, ply.points, &mut corners, &mut ply.triangles).map_err(
                    |error| match error {
                        FaceError::Message(message) => ReadError::line(FORMAT, line.number, message),
                        FaceError::Limit(error) => error,
                    },
                )?;
            }
        }
        check_end(words.next(), &line)?;
    }
    Ok(())
}

fn value(word: Option<&[u8]>, property: &Property, kind: Stored, line: &Line<'_>) -> Result<f64, ReadError> {
    let word = word.ok_or_else(|| missing(property, line))?;
    let value = match word {
        b"true" | b"True" if kind == Stored::Scalar(ScalarType::Uint8) => 1.0,
        b"false" | b"False" if kind == Stored::Scalar(ScalarType::Uint8) => 0.0,
        word => number_at(word, FORMAT, line.number)?,
    };
    if !kind.scalar_type().holds(value) {
        let message = format!(
            "{} does not fit property {} of type {}",
            shown(word),
            shown(property.name.as_bytes()),
            kind.scalar_type().ply_name()
        );
        return Err(ReadError::line(FORMAT, line.number, message));
    }
    Ok(value)
}

fn missing(property: &Property, line: &Line<'_>) -> ReadError {
    let message = format!("the line ends before property {}", shown(property.name.as_bytes()));
    ReadError::line(FORMAT, line.number, message)
}

fn check_end(extra: Option<&[u8]>, line: &Line<'_>) -> Result<(), ReadError> {
    match extra {
        Some(word) => {
            let message = format!("{} is more than the header's properties account for", shown(word));
            Err(ReadError::line(FORMAT, line.number, message))
        }
        None => Ok(()),
    }
}

fn next<'a>(lines: &mut Lines<'a>, element: &Element, row: usize) -> Result<Line<'a>, ReadError> {
    lines.find(|line| !line.text.is_empty()).ok_or_else(|| {
        let message =
            format!("row {row} of the {} of {} is missing", element.count, shown(element.name.as_bytes()));
        truncated(lines, message)
    })
}

fn truncated(lines: &Lines<'_>, message: String) -> ReadError {
    ReadError::Truncated { format: FORMAT, location: Location::Line(lines.number()), message }
}

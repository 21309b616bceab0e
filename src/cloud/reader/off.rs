//! OFF of Geomview: `OFF`, the counts of vertices, faces and edges, the vertices, the faces.
//!
//! Beside `OFF`, the variants with colours (`COFF`) and normals (`NOFF`, `CNOFF`) are read; colours behind the
//! coordinates are taken in plain `OFF` too, since many programs write them so.

use super::columns::{Column, Columns, ragged};
use super::polygons::{Triangles, corner, enough_corners};
use super::text::{Line, Lines, count_at, number_at, shown};
use super::{Format, Location, ReadError, ReadOptions};
use crate::cloud::PointCloud;

const FORMAT: Format = Format::Off;

pub(super) fn read(bytes: &[u8], options: &ReadOptions) -> Result<PointCloud, ReadError> {
    let mut lines = Lines::new(bytes);
    let header = Header::read(&mut lines)?;
    options.limits.points(header.points)?;
    let columns = read_points(&header, &mut lines, options)?;
    let faces = read_faces(&header, &mut lines, columns.bytes_of(header.points), options)?;
    let (triangles, continued) = faces.into_parts();
    Ok(columns.into_cloud(triangles, options)?.with_polygons(continued)?)
}

struct Header {
    points: usize,
    faces: usize,
    has_normals: bool,
}

impl Header {
    fn read(lines: &mut Lines<'_>) -> Result<Self, ReadError> {
        let first = next(lines, "the line `OFF`")?;
        let letters = first.text.iter().take_while(|b| b.is_ascii_alphabetic()).count();
        let (magic, counts) = first.text.split_at(letters);
        if !matches!(magic, b"OFF" | b"COFF" | b"NOFF" | b"CNOFF") {
            let message = format!("{} is not supported; OFF, COFF, NOFF and CNOFF are", shown(first.text));
            return Err(ReadError::line(FORMAT, first.number, message));
        }
        if counts.trim_ascii().eq_ignore_ascii_case(b"BINARY") {
            return Err(ReadError::line(FORMAT, first.number, "binary OFF is not supported; ASCII OFF is"));
        }
        let has_normals = magic.contains(&b'N');
        // ModelNet has files that begin with `OFF490 518 0`.
        let counts = Line { text: counts.trim_ascii(), ..first };
        let counts =
            if counts.text.is_empty() { next(lines, "the counts of vertices and faces")? } else { counts };
        let mut words = counts.words();
        let mut count = |what| count_at(words.next().unwrap_or_default(), what, FORMAT, counts.number);
        let header =
            Self { points: count("number of vertices")?, faces: count("number of faces")?, has_normals };
        // A vertex needs five bytes, three digits and two blanks, and the end of its line.
        let possible = lines.rest().len().div_ceil(6);
        if header.points > possible {
            let message = format!("{} vertices are announced, {possible} at most can follow", header.points);
            return Err(truncated(lines, message));
        }
        Ok(header)
    }
}

fn read_points(header: &Header, lines: &mut Lines<'_>, options: &ReadOptions) -> Result<Columns, ReadError> {
    let mut row = Vec::new();
    let mut columns: Option<Columns> = None;
    for point in 0..header.points {
        let line = next(lines, &format!("vertex {point} of {}", header.points))?;
        row.clear();
        for word in line.words() {
            row.push(number_at(word, FORMAT, line.number)?);
        }
        if row.len() < 3 {
            let message = format!("vertex {point} has {} numbers; 3 or more are accepted", row.len());
            return Err(ReadError::line(FORMAT, line.number, message));
        }
        if columns.is_none() {
            let mut new = Columns::leading(&named(row.len(), header.has_normals), 3, &options.limits)?;
            new.reserve(header.points)?;
            columns = Some(new);
        }
        if let Some(columns) = &mut columns {
            let expected = columns.targets.len();
            if row.len() != expected {
                return Err(ragged(row.len(), expected, lines.rest().is_empty(), FORMAT, line.number));
            }
            columns.push(&row)?;
        }
    }
    columns.ok_or(ReadError::Cloud(crate::cloud::CloudError::Empty))
}

/// Coordinates, then normals if the first line says so, then colours.
fn named(width: usize, has_normals: bool) -> Vec<Column> {
    let mut names = vec!["x", "y", "z"];
    if has_normals && width >= 6 {
        names.extend(["nx", "ny", "nz"]);
    }
    match width - names.len() {
        3 => names.extend(["red", "green", "blue"]),
        4 => names.extend(["red", "green", "blue", "alpha"]),
        _ => {}
    }
    let named = names.iter().map(|&name| Column::text(name));
    named.chain((names.len()..width).map(Column::unnamed)).collect()
}

fn read_faces(
    header: &Header,
    lines: &mut Lines<'_>,
    points_bytes: Option<usize>,
    options: &ReadOptions,
) -> Result<Triangles, ReadError> {
    let mut triangles = Triangles::new(&options.limits, points_bytes);
    let mut corners = Vec::new();
    for face in 0..header.faces {
        let line = next(lines, &format!("face {face} of {}", header.faces))?;
        let at_line = |message| ReadError::line(FORMAT, line.number, message);
        let mut words = line.words();
        let count = count_at(words.next().unwrap_or_default(), "number of corners", FORMAT, line.number)?;
        enough_corners(count, face).map_err(at_line)?;
        triangles.room_for(count.min(line.text.len()))?;
        corners.clear();
        for word in words.take(count) {
            let index = lexical_core::parse(word)
                .map_err(|_| at_line(format!("{} in face {face} is no index", shown(word))))?;
            corners.push(corner(index, header.points, face).map_err(at_line)?);
        }
        if corners.len() < count {
            return Err(at_line(format!("face {face} announces {count} corners and has {}", corners.len())));
        }
        triangles.push_fan(&corners)?;
    }
    Ok(triangles)
}

fn next<'a>(lines: &mut Lines<'a>, missing: &str) -> Result<Line<'a>, ReadError> {
    lines.next_without_comment(b'#').ok_or_else(|| truncated(lines, format!("{missing} is missing")))
}

fn truncated(lines: &Lines<'_>, message: String) -> ReadError {
    ReadError::Truncated { format: FORMAT, location: Location::Line(lines.number()), message }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SQUARE: &str = "OFF # a square\n4 1 0\n0 0 0\n1 0 0\n1 1 0\n\n0 1 0\n4 0 1 2 3 255 0 0\n";

    fn off(text: &str) -> Result<PointCloud, ReadError> {
        read(text.as_bytes(), &ReadOptions::default())
    }

    #[test]
    fn a_polygon_becomes_a_fan_of_triangles() {
        let cloud = off(SQUARE).unwrap();
        assert_eq!(cloud.len(), 4);
        assert_eq!(cloud.faces(), [[0, 1, 2], [0, 2, 3]]);
        assert_eq!(cloud.polygons().map(<[_]>::len).collect::<Vec<_>>(), [2]);
    }

    #[test]
    fn colours_and_normals_become_fields() {
        let cloud = off("CNOFF 1 0 0\n0 0 0 0 0 1 9 8 7 6\n").unwrap();
        let names: Vec<_> = cloud.fields().iter().map(|field| field.name.as_str()).collect();
        assert_eq!(names, ["nx", "ny", "nz", "red", "green", "blue", "alpha"]);
        assert_eq!(off("COFF\n1 0 0\n0 0 0 9 8 7\n").unwrap().fields()[2].values, [7.0]);
    }

    #[test]
    fn counts_directly_behind_the_magic_word_are_read() {
        assert_eq!(off("OFF1 0 0\n1 2 3\n").unwrap().len(), 1);
    }

    #[test]
    fn counts_beyond_the_file_are_refused_before_anything_is_reserved() {
        let error = off("OFF\n4000000 0 0\n1 2 3\n").unwrap_err();
        assert_eq!(
            error.to_string(),
            "OFF, line 2: the file ends too early: 4000000 vertices are announced, 1 at most can follow"
        );
        let error = off("OFF\n99999999999999999999999 0 0\n").unwrap_err();
        assert!(error.to_string().contains("is no number of vertices"), "{error}");
    }

    #[test]
    fn a_malformed_face_is_refused_by_name() {
        let message = |face: &str| off(&SQUARE.replace("4 0 1 2 3 255 0 0", face)).unwrap_err().to_string();
        assert_eq!(message("3 0 1 9"), "OFF, line 8: face 0 names point 9; the file has points 0 to 3");
        assert_eq!(message("3 0 1 -1"), "OFF, line 8: face 0 names point -1; the file has points 0 to 3");
        assert_eq!(message("2 0 1"), "OFF, line 8: face 0 has 2 corners; 3 or more are accepted");
        assert_eq!(message("5 0 1 2"), "OFF, line 8: face 0 announces 5 corners and has 3");
    }

    #[test]
    fn a_file_cut_in_its_vertices_or_faces_is_refused_by_line() {
        let error = off("OFF\n2 0 0\n0 0 0\n1   0").unwrap_err();
        assert!(error.to_string().starts_with("OFF, line 4"), "{error}");
        let error = off("OFF\n1 5 0\n0 0 0\n").unwrap_err();
        assert_eq!(error.to_string(), "OFF, line 3: the file ends too early: face 0 of 5 is missing");
    }

    #[test]
    fn variants_that_are_not_supported_are_named() {
        assert!(off("4OFF\n1 0 0\n").unwrap_err().to_string().contains("OFF, COFF, NOFF and CNOFF are"));
        assert!(off("OFF BINARY\n").unwrap_err().to_string().contains("ASCII OFF is"));
    }
}

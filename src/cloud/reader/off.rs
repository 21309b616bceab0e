//! OFF of Geomview: `OFF`, the counts of vertices, faces and edges, the vertices, the faces.
//!
//! Numbers are read one after another, however they are broken into lines. Besides `OFF`, the variants with texture
//! coordinates (`STOFF`), colors (`COFF`) and normals (`NOFF`) are read; colors behind the coordinates are taken in plain
//! `OFF` too, since many programs write them so. No crate reads binary OFF, or OFF with a limit on what it allocates.

mod binary;

use super::columns::{Column, Columns};
use super::polygons::{Triangles, corner};
use super::text::{Line, Lines, count_at, number_at, shown};
use super::{Format, Location, ReadError, ReadOptions};
use crate::cloud::PointCloud;

const FORMAT: Format = Format::Off;

pub(super) fn read(bytes: &[u8], options: &ReadOptions) -> Result<PointCloud, ReadError> {
    let mut tokens = Tokens { lines: Lines::new(bytes), line: None, rest: &[] };
    let variant = Variant::read(&mut tokens)?;
    if variant.is_binary {
        return binary::read(bytes, binary::body(bytes), variant, options);
    }
    let mut count = |what: &str| {
        let word = tokens.next(|| format!("the {what}"))?;
        count_at(word, what, FORMAT, tokens.number())
    };
    let (points, faces) = (count("number of vertices")?, count("number of faces")?);
    // The number of edges may be missing; nothing needs it.
    tokens.end_line();
    options.limits.points(points)?;
    // A vertex needs five bytes, three digits and two blanks, and the end of its line.
    let possible = tokens.bytes_left().div_ceil(6);
    if points > possible {
        let message = format!("{points} vertices are announced, {possible} at most can follow");
        return Err(tokens.truncated(message));
    }
    let mut columns = read_points(points, variant, &mut tokens, options)?;
    let triangles = read_faces(faces, &mut tokens, &columns, options)?;
    columns.note_lines_behind(tokens.lines, "faces");
    triangles.finish(columns, options)
}

/// What the first word says of the vertices.
#[derive(Debug, Clone, Copy, Default)]
#[allow(clippy::struct_excessive_bools)] // independent letters of one word
struct Variant {
    has_textures: bool,
    has_colors: bool,
    has_normals: bool,
    is_binary: bool,
}

impl Variant {
    fn read(tokens: &mut Tokens<'_>) -> Result<Self, ReadError> {
        let before = tokens.clone();
        let word = tokens.next(|| "the line `OFF`".to_owned())?;
        let letters = word.iter().take_while(|byte| byte.is_ascii_alphabetic()).count();
        let magic = word[..letters].to_ascii_uppercase();
        if magic.is_empty() && lexical_core::parse::<usize>(word).is_ok() {
            // Some programs leave the word out.
            *tokens = before;
            return Ok(Self::default());
        }
        let mut variant = Self::default();
        let mut rest = magic.as_slice();
        for (letters, has) in [
            (&b"ST"[..], &mut variant.has_textures),
            (b"C", &mut variant.has_colors),
            (b"N", &mut variant.has_normals),
        ] {
            if let Some(behind) = rest.strip_prefix(letters) {
                (rest, *has) = (behind, true);
            }
        }
        // `nOFF` has points of n coordinates, `NOFF` normals.
        if rest != b"OFF" || word.windows(4).any(|letters| letters == b"nOFF") {
            let message = format!("{} is not supported; OFF with ST, C and N before it is", shown(word));
            return Err(ReadError::line(FORMAT, tokens.number(), message));
        }
        // ModelNet has files that begin with `OFF490 518 0`.
        tokens.put_back(&word[letters..]);
        if tokens.rest.trim_ascii().eq_ignore_ascii_case(b"BINARY") {
            variant.is_binary = true;
        }
        Ok(variant)
    }

    /// Numbers of a vertex, by the book: colors have four.
    fn width(self) -> usize {
        3 + if self.has_normals { 3 } else { 0 }
            + if self.has_colors { 4 } else { 0 }
            + if self.has_textures { 2 } else { 0 }
    }
}

/// The words of a file, one after another, without comments.
#[derive(Debug, Clone)]
struct Tokens<'a> {
    lines: Lines<'a>,
    line: Option<Line<'a>>,
    /// Of the line, what is not handed out yet.
    rest: &'a [u8],
}

impl<'a> Tokens<'a> {
    fn next(&mut self, missing: impl Fn() -> String) -> Result<&'a [u8], ReadError> {
        while self.rest.is_empty() {
            let Some(line) = self.lines.next_without_comment(b'#') else {
                return Err(self.truncated(format!("{} is missing", missing())));
            };
            (self.line, self.rest) = (Some(line), line.text);
        }
        let end = self.rest.iter().position(u8::is_ascii_whitespace).unwrap_or(self.rest.len());
        let (word, rest) = self.rest.split_at(end);
        self.rest = rest.trim_ascii_start();
        Ok(word)
    }

    /// Hands a part of the last word out again.
    fn put_back(&mut self, part: &'a [u8]) {
        if let (false, Some(line)) = (part.is_empty(), self.line) {
            let start = line.text.len() - self.rest.len();
            let word_end = line.text[..start].trim_ascii_end().len();
            self.rest = &line.text[word_end - part.len()..];
        }
    }

    fn end_line(&mut self) {
        // Numbers of vertices may follow in the same line, behind the number of edges.
        let words = self.rest.split(u8::is_ascii_whitespace).filter(|word| !word.is_empty()).count();
        if words <= 1 {
            self.rest = &[];
        } else {
            let end = self.rest.iter().position(u8::is_ascii_whitespace).unwrap_or(self.rest.len());
            self.rest = self.rest[end..].trim_ascii_start();
        }
    }

    fn number(&self) -> usize {
        self.line.map_or(self.lines.number(), |line| line.number)
    }

    fn bytes_left(&self) -> usize {
        self.rest.len() + self.lines.rest().len()
    }

    fn truncated(&self, message: String) -> ReadError {
        ReadError::Truncated { format: FORMAT, location: Location::Line(self.lines.number()), message }
    }
}

fn read_points(
    points: usize,
    variant: Variant,
    tokens: &mut Tokens<'_>,
    options: &ReadOptions,
) -> Result<Columns, ReadError> {
    let mut row = Vec::new();
    let mut columns: Option<Columns> = None;
    let words = |text: &[u8]| text.split(u8::is_ascii_whitespace).filter(|word| !word.is_empty()).count();
    // Where all vertices stand behind the counts, in their line, lines tell nothing.
    let by_count = points == 1 || words(tokens.rest) >= points.saturating_mul(variant.width());
    for point in 0..points {
        row.clear();
        let width = columns.as_ref().map(|columns| columns.targets.len());
        let mut begun = None;
        let fields_max = options.limits.fields_max;
        loop {
            let word = tokens.next(|| format!("vertex {point} of {points}"))?;
            row.push(number_at(word, FORMAT, tokens.number())?);
            let line = *begun.get_or_insert(tokens.number());
            let is_line_end = tokens.rest.is_empty();
            if row.len() > fields_max.saturating_add(3) {
                return Err(ReadError::TooManyFields { fields: row.len() - 3, fields_max });
            }
            let is_whole = match width {
                Some(width) => row.len() >= width,
                // The first vertex tells by its line, unless that is too short.
                None => (is_line_end && row.len() >= 3) || (by_count && row.len() >= variant.width()),
            };
            if is_whole && (is_line_end || width.is_none() || by_count) {
                break;
            }
            // The first one ended where a line ended with all coordinates, and so do the others: one that is short would
            // take the numbers that it lacks from the next.
            let is_short = is_line_end && row.len() >= 3;
            if let (true, Some(width)) = (is_whole || is_short, width) {
                let found = row.len() + words(tokens.rest);
                let message = format!("vertex {point} has {found} numbers, those before it have {width}");
                return Err(ReadError::line(FORMAT, line, message));
            }
        }
        if columns.is_none() {
            let mut new = Columns::leading(&named(row.len(), variant), 3, &options.limits)?;
            new.reserve(points)?;
            columns = Some(new);
        }
        if let Some(columns) = &mut columns {
            columns.push(&row)?;
        }
    }
    columns.ok_or(ReadError::Cloud(crate::cloud::CloudError::Empty))
}

/// Coordinates, then normals if the first word says so, then colors, then texture coordinates.
fn named(width: usize, variant: Variant) -> Vec<Column> {
    let mut names = vec!["x", "y", "z"];
    if variant.has_normals && width >= 6 {
        names.extend(["nx", "ny", "nz"]);
    }
    let textures = if variant.has_textures && width >= names.len() + 2 { 2 } else { 0 };
    match width - names.len() - textures {
        3 => names.extend(["red", "green", "blue"]),
        4 => names.extend(["red", "green", "blue", "alpha"]),
        _ => {}
    }
    if textures > 0 && names.len() + 2 == width {
        names.extend(["s", "t"]);
    }
    let named = names.iter().map(|&name| Column::text(name));
    named.chain((names.len()..width).map(Column::unnamed)).collect()
}

fn read_faces(
    faces: usize,
    tokens: &mut Tokens<'_>,
    columns: &Columns,
    options: &ReadOptions,
) -> Result<Triangles, ReadError> {
    let points = columns.len();
    let mut triangles = Triangles::new(&options.limits, columns.bytes_of(points));
    let mut corners = Vec::new();
    for face in 0..faces {
        let word = tokens.next(|| format!("face {face} of {faces}"))?;
        let count = count_at(word, "number of corners", FORMAT, tokens.number())?;
        triangles.room_for(count.min(tokens.bytes_left()))?;
        corners.clear();
        for index in 0..count {
            let word = tokens
                .next(|| format!("face {face} of {faces} has {index} of its {count} corners: the next"))?;
            let line = tokens.number();
            let at_line = |message| ReadError::line(FORMAT, line, message);
            let index = lexical_core::parse(word)
                .map_err(|_| at_line(format!("{} in face {face} is not an index", shown(word))))?;
            corners.push(corner(index, points, face).map_err(at_line)?);
        }
        // A color may stand behind the corners.
        tokens.rest = &[];
        triangles.push_fan(&corners)?;
    }
    Ok(triangles)
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
    fn colors_and_normals_become_fields() {
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
        assert!(error.to_string().contains("is not a number of vertices"), "{error}");
    }

    #[test]
    fn a_malformed_face_is_refused_by_name() {
        let message = |face: &str| off(&SQUARE.replace("4 0 1 2 3 255 0 0", face)).unwrap_err().to_string();
        assert_eq!(message("3 0 1 9"), "OFF, line 8: face 0 names point 9; the file has points 0 to 3");
        assert_eq!(message("3 0 1 -1"), "OFF, line 8: face 0 names point -1; the file has points 0 to 3");
        assert!(message("5 0 1 2").contains("face 0 of 1 has 3 of its 5 corners"), "{}", message("5 0 1 2"));
        assert!(message("3 0 1 x").contains("`x` in face 0 is not an index"));
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
        assert!(off("4OFF\n1 0 0\n").unwrap_err().to_string().contains("OFF with ST, C and N before it is"));
    }

    #[test]
    fn faces_and_vertices_may_go_on_in_further_lines() {
        let cloud = off("OFF\n4 1 0\n0 0\n0\n2 0 0\n2 1 0\n0 1 .5\n4 0\n1\n2\n3\n").unwrap();
        assert_eq!((cloud.len(), cloud.faces()), (4, &[[0, 1, 2], [0, 2, 3]][..]));
        let error = off("OFF\n2 0 0\n0 0 0\n1 1 1 9 9 9\n").unwrap_err().to_string();
        assert!(error.contains("vertex 1 has 6 numbers, those before it have 3"), "{error}");
    }

    #[test]
    fn a_vertex_that_is_short_or_long_is_refused_by_its_line() {
        for (text, told) in [
            (
                "OFF\n4 0 0\n0 0 0 9 9 9\n1 1 1\n2 2 2\n3 3 3 9 9 9\n4 4 4 9 9 9\n",
                "4: vertex 1 has 3 numbers, those before it have 6",
            ),
            ("OFF\n3 0 0\n0 0 0\n1 1 1 9\n2 2 2\n", "4: vertex 1 has 4 numbers, those before it have 3"),
            ("OFF\n3 0 0\n0 0 0\n1 1\n2 2 2\n3 3 3\n", "4: vertex 1 has 5 numbers, those before it have 3"),
        ] {
            assert_eq!(off(text).unwrap_err().to_string(), format!("OFF, line {told}"));
        }
    }

    #[test]
    fn a_file_in_one_line_is_read_by_its_counts() {
        for text in [
            "OFF 3 1 0 0 0 0 1 0 0 1 1 0 3 0 1 2",
            "COFF 3 1 0 0 0 0 9 9 9 9 1 0 0 9 9 9 9 1 1 0 9 9 9 9 3 0 1 2\n",
        ] {
            let cloud = off(text).unwrap();
            assert_eq!(
                (cloud.coordinates(), cloud.faces().len()),
                (&[0., 0., 0., 1., 0., 0., 1., 1., 0.][..], 1)
            );
        }
        assert!(off("OFF 3 0 0 0 0 0 1 0 0 1 1").is_err(), "a number is missing");
    }

    #[test]
    fn the_first_word_may_be_in_small_letters_or_missing() {
        for text in
            ["off\n1 0 0\n1 2 3\n", "1 0 0\n1 2 3\n", "OFF 1 0 0 1 2 3\n", "STOFF\n1 0 0\n1 2 3 0.5 0.25\n"]
        {
            assert_eq!(off(text).unwrap().coordinates(), [1.0, 2.0, 3.0], "{text}");
        }
    }

    #[test]
    fn faces_of_fewer_than_three_corners_are_left_out_and_counted() {
        let cloud =
            off(&SQUARE.replace("4 1 0", "4 2 0").replace("4 0 1 2 3 255 0 0", "2 0 1\n3 0 1 2")).unwrap();
        assert_eq!((cloud.faces(), cloud.notes().len()), (&[[0, 1, 2]][..], 1));
    }
}

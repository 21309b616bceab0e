//! Wavefront OBJ: `v` and `f` lines; a note tells of all others, which are passed over.
//!
//! Written here and not taken from a crate: the OBJ crates at hand renumber vertices (they merge, split per
//! texture coordinate, or drop those without a face), and row i of the cloud must be vertex i of the file.

use std::borrow::Cow;

use super::columns::{Column, Columns};
use super::polygons::Triangles;
use super::text::{Line, Lines, before_comment, number_at, shown};
use super::{Format, ReadError, ReadOptions};
use crate::cloud::{CloudError, PointCloud, ScalarType};

const FORMAT: Format = Format::Obj;
/// Bytes of a line with all its continuations.
const CONTINUED_MAX: usize = 1 << 20;

pub(super) fn read(bytes: &[u8], options: &ReadOptions) -> Result<PointCloud, ReadError> {
    let axes = ["x", "y", "z"].map(Column::text);
    let vertices = Lines::new(bytes).filter(|line| is_vertex(line.text)).count();
    let mut columns = Columns::leading(&axes, 3, &options.limits)?;
    columns.reserve(vertices)?;
    // With colors it is twice as much.
    let points_bytes = columns.bytes_of(vertices).and_then(|bytes| bytes.checked_mul(2));
    let mut mesh = Mesh {
        columns,
        vertices,
        colors: [const { Vec::new() }; 4],
        triangles: Triangles::new(&options.limits, points_bytes),
        corners: Vec::new(),
        faces: 0,
        farthest: None,
        passed_over: PassedOver::default(),
    };
    let mut lines = Lines::new(bytes);
    while let Some(line) = lines.next() {
        let joined = continued(line, &mut lines)?;
        let line = Line { text: before_comment(&joined, b'#'), ..line };
        let mut words = line.words();
        match words.next() {
            Some(b"v" | b"V") => mesh.vertex(&line)?,
            Some(b"f" | b"F" | b"fo") => mesh.face(&line)?,
            Some([first, ..]) if first.is_ascii_digit() || matches!(first, b'-' | b'+' | b'.') => {
                let message = "the line begins with a number; OBJ lines begin with a keyword such as v or f";
                return Err(ReadError::line(FORMAT, line.number, message));
            }
            Some(word) => mesh.passed_over.count(word, words.next()),
            None => {}
        }
    }
    mesh.into_cloud(options)
}

fn is_vertex(text: &[u8]) -> bool {
    matches!(text, [b'v' | b'V', b' ' | b'\t', ..])
}

/// A line with those that it goes on in: a backslash at its end joins the next one to it.
fn continued<'a>(line: Line<'a>, lines: &mut Lines<'a>) -> Result<Cow<'a, [u8]>, ReadError> {
    let Some(start) = line.text.strip_suffix(b"\\") else { return Ok(Cow::Borrowed(line.text)) };
    let mut joined = start.to_vec();
    for next in lines.by_ref() {
        joined.push(b' ');
        let (text, goes_on) = match next.text.strip_suffix(b"\\") {
            Some(text) => (text, true),
            None => (next.text, false),
        };
        joined.extend_from_slice(text);
        if joined.len() > CONTINUED_MAX {
            let message = format!("a line and its continuations have more than {CONTINUED_MAX} bytes");
            return Err(ReadError::line(FORMAT, line.number, message));
        }
        if !goes_on {
            break;
        }
    }
    Ok(Cow::Owned(joined))
}

/// A face whose corner may lie beyond the last vertex: vertices may follow their faces.
struct Farthest {
    index: usize,
    face: usize,
    line: usize,
}

/// Lines that are not read, by kind.
#[derive(Debug, Default)]
struct PassedOver {
    textures: usize,
    normals: usize,
    lines: usize,
    curves: usize,
    materials: Vec<String>,
}

impl PassedOver {
    fn count(&mut self, keyword: &[u8], name: Option<&[u8]>) {
        match keyword {
            b"vt" => self.textures += 1,
            b"vn" => self.normals += 1,
            b"l" | b"p" => self.lines += 1,
            b"curv" | b"curv2" | b"surf" | b"vp" => self.curves += 1,
            b"mtllib" if self.materials.len() < 3 => {
                self.materials.push(shown(name.unwrap_or_default()));
            }
            _ => {}
        }
    }

    fn notes(self) -> impl Iterator<Item = String> {
        let counted = [
            (self.textures, "texture coordinates"),
            (self.normals, "vertex normals"),
            (self.lines, "lines and single points"),
            (self.curves, "curves and surfaces"),
        ];
        let counted = counted.into_iter().filter(|(count, _)| *count > 0);
        let counted = counted.map(|(count, what)| format!("{count} {what} were left out"));
        let materials = self.materials.into_iter();
        counted
            .chain(materials.map(|name| format!("the materials of {name} and their textures were left out")))
    }
}

struct Mesh {
    columns: Columns,
    /// Vertices that the file has.
    vertices: usize,
    /// Red, green, blue and alpha of every vertex so far that has them.
    colors: [Vec<f64>; 4],
    triangles: Triangles,
    corners: Vec<u32>,
    faces: usize,
    farthest: Option<Farthest>,
    passed_over: PassedOver,
}

impl Mesh {
    /// `v x y`, `v x y z`, `v x y z w`, `v x y z r g b` or `v x y z r g b a`. The weight w of rational curves is passed
    /// over; vertices of the plane have z = 0.
    fn vertex(&mut self, line: &Line<'_>) -> Result<(), ReadError> {
        let mut values = [0.0; 7];
        let mut count = 0;
        for word in line.words().skip(1) {
            let value = number_at(word, FORMAT, line.number)?;
            if let Some(slot) = values.get_mut(count) {
                *slot = value;
            }
            count += 1;
        }
        match count {
            2..=4 => {}
            6 | 7 => {
                for (channel, &value) in self.colors.iter_mut().zip(&values[3..count]) {
                    channel.reserve_exact(self.vertices.saturating_sub(channel.len()));
                    channel.push(value);
                }
            }
            _ => {
                let message = format!(
                    "a vertex with {count} numbers; x y, x y z, x y z w, x y z r g b and x y z r g b a are accepted"
                );
                return Err(ReadError::line(FORMAT, line.number, message));
            }
        }
        self.columns.push(&values[..3])
    }

    /// `f a b c …`, each corner `v`, `v/vt`, `v//vn` or `v/vt/vn`, indices from 1, or from -1 backwards.
    fn face(&mut self, line: &Line<'_>) -> Result<(), ReadError> {
        self.triangles.room_for(line.text.len() / 2)?;
        self.corners.clear();
        for word in line.words().skip(1) {
            let index = self.corner(word, line)?;
            self.corners.push(index);
        }
        self.triangles.push_fan(&self.corners)?;
        self.faces += 1;
        Ok(())
    }

    fn corner(&mut self, word: &[u8], line: &Line<'_>) -> Result<u32, ReadError> {
        let face = self.faces + 1;
        let refuse = |why: &str| {
            let message = format!("{} in face {face} {why}", shown(word));
            ReadError::line(FORMAT, line.number, message)
        };
        let vertex = word.split(|&b| b == b'/').next().unwrap_or_default();
        let others_are_indices =
            word[vertex.len()..].iter().all(|b| b.is_ascii_digit() || matches!(b, b'/' | b'-'));
        let number: i64 = lexical_core::parse(vertex)
            .ok()
            .filter(|_| others_are_indices)
            .ok_or_else(|| refuse("is not a corner; v, v/vt, v//vn and v/vt/vn are accepted"))?;
        let points = self.columns.len();
        let index = match number {
            0 => return Err(refuse("is index 0; OBJ counts from 1, or backwards from -1")),
            1.. => usize::try_from(number - 1).ok(),
            _ => usize::try_from(number.unsigned_abs()).ok().and_then(|back| points.checked_sub(back)),
        };
        let short = index.and_then(|index| u32::try_from(index).ok());
        let Some(short) = short else {
            return Err(refuse(&format!("names no vertex; {points} precede it")));
        };
        let index = short as usize;
        if index >= points && self.farthest.as_ref().is_none_or(|farthest| index > farthest.index) {
            self.farthest = Some(Farthest { index, face, line: line.number });
        }
        Ok(short)
    }

    fn into_cloud(self, options: &ReadOptions) -> Result<PointCloud, ReadError> {
        let points = self.columns.len();
        if points == 0 {
            return Err(CloudError::Empty.into());
        }
        if let Some(Farthest { index, face, line }) = self.farthest
            && index >= points
        {
            let message = format!("face {face} names vertex {}; the file has {points}", index + 1);
            return Err(ReadError::line(FORMAT, line, message));
        }
        let mut columns = self.columns;
        let is_colored = self.colors[0].len() == points;
        if !is_colored && !self.colors[0].is_empty() {
            let count = self.colors[0].len();
            columns
                .notes
                .push(format!("only {count} of {points} vertices have a color: colors were left out"));
        }
        for (name, values) in ["red", "green", "blue", "alpha"].into_iter().zip(self.colors) {
            if is_colored && values.len() == points && options.limits.fields_max > columns.fields.len() {
                columns.append(name, ScalarType::Float64, values.into())?;
            }
        }
        columns.notes.extend(self.passed_over.notes());
        self.triangles.finish(columns, options)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn obj(text: &str) -> Result<PointCloud, ReadError> {
        read(text.as_bytes(), &ReadOptions::default())
    }

    #[test]
    fn every_way_to_name_a_corner_is_read() {
        let points = "v 0 0 0\nv 1 0 0\nvn 0 0 1\nv 1 1 0 1.0\nv 0 1 0\n";
        for face in [
            "f 1 2 3 4",
            "f 1/1 2/2 3/3 4/4",
            "f 1//1 2//1 3//1 4//1",
            "f -4 -3 -2 -1",
            "f 1/1/1 2/1/1 3/1/1 4/1/1 # q",
        ] {
            let cloud = obj(&format!("{points}{face}\r\n")).unwrap();
            assert_eq!(cloud.len(), 4);
            assert_eq!(cloud.faces(), [[0, 1, 2], [0, 2, 3]], "{face}");
            assert_eq!(cloud.continued(), [1], "{face}");
        }
    }

    #[test]
    fn a_point_outside_every_face_keeps_its_row() {
        let cloud = obj("v 9 9 9\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 2 3 4\n").unwrap();
        assert_eq!(cloud.point(0), [9.0, 9.0, 9.0]);
        assert_eq!(cloud.faces(), [[1, 2, 3]]);
    }

    #[test]
    fn a_face_may_precede_its_vertices() {
        assert_eq!(obj("f 1 2 3\nv 0 0 0\nv 1 0 0\nv 0 1 0\n").unwrap().faces(), [[0, 1, 2]]);
    }

    #[test]
    fn colors_are_kept_when_every_vertex_has_them() {
        let cloud = obj("v 0 0 0 0.1 0.2 0.3\nv 1 0 0 0.4 0.5 0.6\n").unwrap();
        let blue = &cloud.fields()[2];
        assert_eq!((blue.name.as_str(), &blue.values[..]), ("blue", &[0.3, 0.6][..]));
        assert!(obj("v 0 0 0 0.1 0.2 0.3\nv 1 0 0\n").unwrap().fields().is_empty());
    }

    #[test]
    fn a_malformed_line_is_refused_with_its_number_and_the_face() {
        let triangle = "v 0 0 0\nv 1 0 0\nv 0 1 0\n";
        let message = |line: &str| obj(&format!("{triangle}{line}\n")).unwrap_err().to_string();
        assert_eq!(message("f 1 2 9"), "OBJ, line 4: face 1 names vertex 9; the file has 3");
        assert_eq!(
            message("f 1 2 0"),
            "OBJ, line 4: `0` in face 1 is index 0; OBJ counts from 1, or backwards from -1"
        );
        assert_eq!(message("f 1 2 -4"), "OBJ, line 4: `-4` in face 1 names no vertex; 3 precede it");
        assert!(message("f 1 2 x").contains("is not a corner"));
        assert!(message("f 1 2 99999999999999999999").contains("is not a corner"));
        assert!(message("f 1 2 -9223372036854775808").contains("names no vertex"));
        assert!(message("v 1").contains("a vertex with 1 numbers"));
        assert!(message("v 1 2 3 4 5").contains("a vertex with 5 numbers"));
        assert!(message("1 2 3").contains("begins with a number"));
    }

    #[test]
    fn lines_go_on_behind_a_backslash() {
        let cloud = obj("v 0 0 \\\n 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 \\\n3 \\\n4\n").unwrap();
        assert_eq!(cloud.faces(), [[0, 1, 2], [0, 2, 3]]);
        assert!(obj("v 0 0 0\nf 1 1 1 \\").is_ok());
    }

    #[test]
    fn comments_stand_behind_anything() {
        let cloud = obj("v 0 0 0 # 1\nv 2 0 0\t# 2\nv 2 1 0# 3\nf 1 2 3 # the face\n").unwrap();
        assert_eq!((cloud.len(), cloud.faces()), (3, &[[0, 1, 2]][..]));
    }

    #[test]
    fn vertices_of_the_plane_lie_in_space_and_colors_may_have_alpha() {
        assert_eq!(obj("v 0 0\nv 2 0\nv 2 1\nf 1 2 3\n").unwrap().point(2), [2.0, 1.0, 0.0]);
        let cloud = obj("v 0 0 0 0.1 0.2 0.3 0.5\nv 1 0 0 0.4 0.5 0.6 1\n").unwrap();
        assert_eq!((cloud.fields().len(), &cloud.fields()[3].values[..]), (4, &[0.5, 1.0][..]));
    }

    #[test]
    fn faces_of_fewer_than_three_corners_are_left_out_and_counted() {
        let cloud = obj("v 0 0 0\nv 2 0 0\nv 2 1 0\nf 1 2 3\nf 1 2\nf\n").unwrap();
        assert_eq!(cloud.faces(), [[0, 1, 2]]);
        assert_eq!(cloud.notes(), ["2 faces of fewer than three corners were left out"]);
    }

    #[test]
    fn what_is_passed_over_is_told() {
        let text =
            "mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 1\nvn 0 0 1\nf 1/1/1 2/2/1 3/1/1\nl 1 2\n";
        let expected = [
            "2 texture coordinates were left out",
            "1 vertex normals were left out",
            "1 lines and single points were left out",
            "the materials of `a.mtl` and their textures were left out",
        ];
        assert_eq!(obj(text).unwrap().notes(), expected);
    }

    #[test]
    fn a_file_without_vertices_has_no_points() {
        assert_eq!(obj("o empty\n").unwrap_err(), CloudError::Empty.into());
    }

    #[test]
    fn more_triangles_than_the_limit_are_refused() {
        let limits = super::super::Limits { faces_max: 1, ..super::super::Limits::default() };
        let options = ReadOptions { limits, ..ReadOptions::default() };
        let text = b"v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 3 4\n";
        assert_eq!(read(text, &options).unwrap_err(), ReadError::TooManyFaces { faces_max: 1 });
    }
}

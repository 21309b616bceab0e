//! STL, ASCII and binary: a list of triangles, each with corners of its own.
//!
//! Corners at the same position become one point, in the order of their first appearance; that, and not the corner,
//! is a row of the cloud. Written here and not taken from `stl_io`, which takes a binary file whose header begins
//! with `solid`, as many programs write it, for text, and names no line.

use std::collections::HashMap;
use std::collections::hash_map::Entry;
use std::hash::Hash;

use super::polygons::Triangles;
use super::text::{Lines, number_at, shown};
use super::{Format, Limits, Location, ReadError, ReadOptions};
use crate::cloud::{PointCloud, ScalarType};

const FORMAT: Format = Format::Stl;
/// Bytes before the triangles of a binary file: a free text, and their number.
const HEADER: usize = 84;
/// Bytes of a triangle: normal and corners as twelve floats, and two bytes of attributes.
const TRIANGLE: usize = 50;
/// Bytes of a text in which its first facet is looked for.
const TEXT_HEAD: usize = 64 << 10;

/// Whether a file is binary STL by its length, or begins as ASCII STL does.
pub(super) fn is_stl(bytes: &[u8]) -> bool {
    is_binary(bytes) || is_text(bytes)
}

pub(super) fn read(bytes: &[u8], options: &ReadOptions) -> Result<PointCloud, ReadError> {
    if !is_binary(bytes) && is_text(bytes) { read_text(bytes, options) } else { read_binary(bytes, options) }
}

/// The number of triangles that a binary file announces.
fn announced(bytes: &[u8]) -> Option<usize> {
    let &[a, b, c, d] = bytes.get(HEADER - 4..HEADER)?.first_chunk::<4>()?;
    Some(u32::from_le_bytes([a, b, c, d]) as usize)
}

/// Binary files have exactly the length that they announce; text hardly ever does.
fn is_binary(bytes: &[u8]) -> bool {
    announced(bytes).is_some_and(|count| {
        count > 0 && count.checked_mul(TRIANGLE).is_some_and(|body| HEADER + body == bytes.len())
    })
}

/// Whether a file begins as text does: with `solid`, in any case, behind which a line of the first few begins a facet or
/// ends the solid. Binary files may begin with `solid`, too.
fn is_text(bytes: &[u8]) -> bool {
    let begins =
        |text: &[u8], word: &[u8]| text.get(..word.len()).is_some_and(|b| b.eq_ignore_ascii_case(word));
    let text = bytes.trim_ascii_start();
    // A name may be long, and so may be comments before the first facet.
    begins(text, b"solid")
        && Lines::new(&text[..text.len().min(TEXT_HEAD)])
            .skip(1)
            .any(|line| begins(line.text, b"facet") || begins(line.text, b"endsolid"))
}

fn read_binary(bytes: &[u8], options: &ReadOptions) -> Result<PointCloud, ReadError> {
    let body = bytes.get(HEADER..).unwrap_or_default();
    let truncated = |message: String| {
        let location = Location::Byte(bytes.len());
        ReadError::Truncated { format: FORMAT, location, message }
    };
    let Some(count) = announced(bytes) else {
        return Err(truncated(format!("the header of a binary file has {HEADER} bytes")));
    };
    let body = count
        .checked_mul(TRIANGLE)
        .and_then(|length| body.get(..length))
        .ok_or_else(|| truncated(format!("{count} triangles are announced, {} bytes follow", body.len())))?;
    let mut mesh = Mesh::<[u32; 3]>::new(&options.limits);
    for triangle in body.as_chunks::<TRIANGLE>().0 {
        let corner = |corner: usize| {
            [0, 1, 2].map(|axis| {
                let at = 12 + corner * 12 + axis * 4;
                f32::from_le_bytes([triangle[at], triangle[at + 1], triangle[at + 2], triangle[at + 3]])
            })
        };
        // + 0.0 makes −0 and 0 one position.
        let corners = [0, 1, 2].map(corner);
        mesh.push(corners.map(|p| (p.map(|x| (x + 0.0).to_bits()), p.map(f64::from))))?;
    }
    mesh.into_cloud(ScalarType::Float32, options)
}

fn read_text(bytes: &[u8], options: &ReadOptions) -> Result<PointCloud, ReadError> {
    let mut mesh = Mesh::<[u64; 3]>::new(&options.limits);
    let mut corners = Vec::with_capacity(3);
    let mut is_closed = true;
    let mut lines = Lines::new(bytes);
    for line in lines.by_ref() {
        let mut words = line.words();
        let Some(word) = words.next() else { continue };
        let refuse = |message: &str| Err(ReadError::line(FORMAT, line.number, message));
        match word.to_ascii_lowercase().as_slice() {
            b"solid" | b"endsolid" | b"facet" | b"outer" | b"endfacet" => {
                if !corners.is_empty() {
                    return refuse("a facet has three lines `vertex x y z`, then `endloop`");
                }
                is_closed = word.eq_ignore_ascii_case(b"endsolid");
            }
            b"vertex" => {
                let numbers: Vec<f64> =
                    words.map(|word| number_at(word, FORMAT, line.number)).collect::<Result<_, _>>()?;
                let &[x, y, z] = numbers.as_slice() else {
                    return refuse("a vertex has three coordinates");
                };
                if corners.len() == 3 {
                    return refuse("a facet has four vertices or more; STL has triangles only");
                }
                corners.push([x, y, z]);
            }
            b"endloop" => {
                let &[a, b, c] = corners.as_slice() else {
                    return refuse("a facet ends before its third vertex");
                };
                mesh.push([a, b, c].map(|p| (p.map(|x: f64| (x + 0.0).to_bits()), p)))?;
                corners.clear();
            }
            _ => {
                let message = format!("{} is not a line of an STL file", shown(word));
                return Err(ReadError::line(FORMAT, line.number, message));
            }
        }
    }
    if !is_closed || !corners.is_empty() {
        let location = Location::Line(lines.number());
        let message = "the line `endsolid` is missing".to_owned();
        return Err(ReadError::Truncated { format: FORMAT, location, message });
    }
    mesh.into_cloud(ScalarType::Float64, options)
}

/// Triangles while corners become points. K tells positions apart, in the width of the file's numbers.
struct Mesh<K> {
    point_at: HashMap<K, u32>,
    coordinates: Vec<f64>,
    triangles: Triangles,
    limits: Limits,
}

impl<K: Hash + Eq> Mesh<K> {
    fn new(limits: &Limits) -> Self {
        let triangles = Triangles::new(limits, Some(0));
        Self { point_at: HashMap::new(), coordinates: Vec::new(), triangles, limits: *limits }
    }

    fn push(&mut self, corners: [(K, [f64; 3]); 3]) -> Result<(), ReadError> {
        let mut triangle = [0; 3];
        for (index, (key, position)) in triangle.iter_mut().zip(corners) {
            let points = self.point_at.len();
            *index = match self.point_at.entry(key) {
                Entry::Occupied(known) => *known.get(),
                Entry::Vacant(free) => {
                    self.limits.points(points + 1)?;
                    self.coordinates.extend(position);
                    *free.insert(points as u32)
                }
            };
        }
        let [a, b, c] = triangle;
        // A triangle without area in the file's own numbers is none.
        if a != b && b != c && c != a { self.triangles.push(triangle) } else { Ok(()) }
    }

    fn into_cloud(self, kind: ScalarType, options: &ReadOptions) -> Result<PointCloud, ReadError> {
        let cloud = PointCloud::new(3, self.coordinates, options.policy)?;
        Ok(cloud.with_coordinate_type(kind).with_faces(self.triangles.into_list())?)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two triangles that share an edge.
    const CORNERS: [[f32; 3]; 6] = [
        [0.0, 0.0, 0.0],
        [1.5, 0.0, 0.0],
        [0.0, 2.0, 0.0],
        [1.5, 0.0, -0.0],
        [1.5, 2.0, 0.25],
        [0.0, 2.0, 0.0],
    ];

    fn binary(name: &[u8]) -> Vec<u8> {
        let mut bytes = name.to_vec();
        bytes.resize(80, b' ');
        bytes.extend(2_u32.to_le_bytes());
        for triangle in CORNERS.chunks(3) {
            bytes.extend([0; 12]);
            bytes.extend(triangle.as_flattened().iter().flat_map(|x| x.to_le_bytes()));
            bytes.extend([0; 2]);
        }
        bytes
    }

    fn text() -> String {
        let vertex = |[x, y, z]: &[f32; 3]| format!("    vertex {x} {y} {z:e}\n");
        let facet = |t: &[[f32; 3]]| {
            let vertices = t.iter().map(vertex).collect::<Vec<_>>().concat();
            format!(" facet normal 0 0 1\n  outer loop\n{vertices}  endloop\n endfacet\n")
        };
        format!(
            "solid two triangles\n{}endsolid\n",
            CORNERS.chunks(3).map(facet).collect::<Vec<_>>().concat()
        )
    }

    fn message(bytes: &[u8]) -> String {
        read(bytes, &ReadOptions::default()).unwrap_err().to_string()
    }

    #[test]
    fn corners_at_one_position_become_one_point_in_both_encodings() {
        let points = [0.0, 0.0, 0.0, 1.5, 0.0, 0.0, 0.0, 2.0, 0.0, 1.5, 2.0, 0.25];
        for (bytes, kind) in [
            (binary(b"exported by a program"), ScalarType::Float32),
            (binary(b"solid, though binary"), ScalarType::Float32),
            (text().into_bytes(), ScalarType::Float64),
        ] {
            assert!(is_stl(&bytes));
            let cloud = read(&bytes, &ReadOptions::default()).unwrap();
            assert_eq!(cloud.coordinates(), points);
            assert_eq!(cloud.faces(), [[0, 1, 2], [1, 3, 2]]);
            assert_eq!(cloud.coordinate_type(), kind);
        }
    }

    #[test]
    fn text_may_be_in_capitals_in_cr_and_have_a_long_name() {
        let long = text().replace("two triangles", &"name ".repeat(2000));
        for text in [text().to_uppercase(), text().replace('\n', "\r"), long] {
            assert!(is_stl(text.as_bytes()));
            assert_eq!(read(text.as_bytes(), &ReadOptions::default()).unwrap().faces().len(), 2);
        }
    }

    #[test]
    fn a_triangle_whose_corners_meet_is_left_out_but_not_its_points() {
        let text = text().replace("1.5 2 2.5e-1", "0 2 0");
        let cloud = read(text.as_bytes(), &ReadOptions::default()).unwrap();
        assert_eq!((cloud.len(), cloud.faces().len()), (3, 1));
    }

    #[test]
    fn counts_are_held_against_the_bytes_that_are_there() {
        let mut bytes = binary(b"");
        bytes[83] = 0xFF;
        assert!(message(&bytes).contains("triangles are announced, 100 bytes follow"), "{}", message(&bytes));
        assert!(message(&bytes[..83]).contains("has 84 bytes"));
        let limits = Limits { faces_max: 1, ..Limits::default() };
        let options = ReadOptions { limits, ..ReadOptions::default() };
        assert_eq!(read(&binary(b""), &options).unwrap_err(), ReadError::TooManyFaces { faces_max: 1 });
    }

    #[test]
    fn broken_text_is_refused_by_its_line() {
        let text = text();
        assert!(
            message(text.replace("vertex 0 0 0e0\n", "").as_bytes()).contains("line 6: a facet ends before")
        );
        assert!(message(text.replace("1.5 0", "1.5").as_bytes()).contains("line 5: a vertex has three"));
        assert!(message(text.replace("endsolid", "").as_bytes()).contains("`endsolid` is missing"));
        assert!(message(text.replace("outer loop", "uter loop").as_bytes()).contains("`uter` is not a line"));
        let again = "    vertex 9 9 9\n  endloop";
        assert!(message(text.replacen("  endloop", again, 1).as_bytes()).contains("four vertices"));
    }
}

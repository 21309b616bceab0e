//! Binary OFF. Geomview writes big-endian numbers and a number of color components behind every face; other programs leave
//! those out, or write in the order of their machine. The file's length tells which it is.

use super::{FORMAT, Variant, named};
use crate::cloud::PointCloud;
use crate::cloud::ScalarType;
use crate::cloud::reader::columns::{Column, Columns};
use crate::cloud::reader::decode::ByteOrder;
use crate::cloud::reader::number::{self, Number, Source};
use crate::cloud::reader::polygons::{Triangles, corner};
use crate::cloud::reader::{Location, ReadError, ReadOptions};

/// Offset of the counts: behind the first line that is not a comment.
pub(super) fn body(bytes: &[u8]) -> usize {
    let mut at = 0;
    loop {
        let rest = &bytes[at..];
        let end = rest.iter().position(|&byte| byte == b'\n').map_or(rest.len(), |end| end + 1);
        let line = rest[..end].trim_ascii();
        at += end;
        if at >= bytes.len() || !(line.is_empty() || line.starts_with(b"#")) {
            return at;
        }
    }
}

/// How the numbers are written.
#[derive(Debug, Clone, Copy)]
struct Layout {
    order: ByteOrder,
    has_face_colors: bool,
}

/// Vertices, faces, and where the faces begin.
#[derive(Debug, Clone, Copy)]
struct Counts {
    points: usize,
    faces: usize,
    vertices_at: usize,
    faces_at: usize,
}

impl Layout {
    fn integer(self, bytes: &[u8], at: usize) -> Option<usize> {
        let bytes = *bytes.get(at..)?.first_chunk()?;
        let value = match self.order {
            ByteOrder::Big => u32::from_be_bytes(bytes),
            ByteOrder::Little => u32::from_le_bytes(bytes),
        };
        Some(value as usize)
    }

    /// The counts, if vertices and faces of this layout fill the file to its end.
    fn counts(self, bytes: &[u8], body: usize, width: usize) -> Option<Counts> {
        let (points, faces) = (self.integer(bytes, body)?, self.integer(bytes, body + 4)?);
        let vertices_at = body + 12;
        let faces_at = points.checked_mul(4 * width)?.checked_add(vertices_at)?;
        let mut at = faces_at;
        if faces > bytes.len() / 4 {
            return None;
        }
        for _ in 0..faces {
            at = self.behind_face(bytes, at)?;
        }
        (at == bytes.len()).then_some(Counts { points, faces, vertices_at, faces_at })
    }

    fn behind_face(self, bytes: &[u8], at: usize) -> Option<usize> {
        let corners = self.integer(bytes, at)?;
        let mut at = corners.checked_mul(4)?.checked_add(at + 4)?;
        if self.has_face_colors {
            let components = self.integer(bytes, at)?;
            at = components.checked_mul(4)?.checked_add(at + 4)?;
        }
        (at <= bytes.len()).then_some(at)
    }
}

pub(super) fn read(
    bytes: &[u8],
    body: usize,
    variant: Variant,
    options: &ReadOptions,
) -> Result<PointCloud, ReadError> {
    let width = variant.width();
    let layouts = [ByteOrder::Big, ByteOrder::Little]
        .into_iter()
        .flat_map(|order| [true, false].map(|has_face_colors| Layout { order, has_face_colors }));
    let found = layouts.into_iter().find_map(|layout| Some((layout, layout.counts(bytes, body, width)?)));
    let Some((layout, counts)) = found else {
        let message = "the counts behind `BINARY` and the length of the file do not agree".to_owned();
        return Err(ReadError::Truncated { format: FORMAT, location: Location::Byte(bytes.len()), message });
    };
    options.limits.points(counts.points)?;
    let kind = ScalarType::Float32;
    let names: Vec<Column> =
        named(width, variant).into_iter().map(|column| Column { kind, ..column }).collect();
    let mut columns = Columns::leading(&names, 3, &options.limits)?;
    columns.zeroed(counts.points)?;
    let rows = &bytes[counts.vertices_at..counts.faces_at];
    let source = |index: usize| Source {
        rows,
        stride: 4 * width,
        offset: 4 * index,
        number: Number::Scalar(kind, layout.order),
    };
    number::fill(&mut columns, &(0..width).map(source).collect::<Vec<_>>());
    let triangles = faces(bytes, layout, counts, &columns, options)?;
    triangles.finish(columns, options)
}

fn faces(
    bytes: &[u8],
    layout: Layout,
    counts: Counts,
    columns: &Columns,
    options: &ReadOptions,
) -> Result<Triangles, ReadError> {
    let mut triangles = Triangles::new(&options.limits, columns.bytes_of(counts.points));
    let mut corners = Vec::new();
    let mut at = counts.faces_at;
    for face in 0..counts.faces {
        let Some(count) = layout.integer(bytes, at) else { break };
        triangles.room_for(count)?;
        corners.clear();
        for place in 0..count {
            let index = layout.integer(bytes, at + 4 + 4 * place).unwrap_or(usize::MAX);
            let index = i64::try_from(index).unwrap_or(i64::MAX);
            let corner = corner(index, counts.points, face);
            corners.push(corner.map_err(|message| ReadError::byte(FORMAT, at, message))?);
        }
        triangles.push_fan(&corners)?;
        at = layout.behind_face(bytes, at).unwrap_or(bytes.len());
    }
    Ok(triangles)
}

#[cfg(test)]
mod tests {
    use crate::cloud::reader::{Format, ReadOptions, read};

    #[test]
    fn every_layout_that_programs_write_is_read() {
        for (big, has_face_colors) in [(true, true), (true, false), (false, true), (false, false)] {
            let integer = |x: u32| if big { x.to_be_bytes() } else { x.to_le_bytes() };
            let float = |x: f32| if big { x.to_be_bytes() } else { x.to_le_bytes() };
            let mut bytes = b"OFF BINARY\n".to_vec();
            bytes.extend([4, 1, 0].into_iter().flat_map(integer));
            let points = [0.25, 0.0, 1.0, 1.5, 0.0, 2.0, 1.5, 1.25, 3.0, 0.0, 1.75, 4.0];
            bytes.extend(points.into_iter().flat_map(float));
            bytes.extend([3, 0, 1, 2].into_iter().flat_map(integer));
            if has_face_colors {
                bytes.extend(integer(0));
            }
            assert_eq!(Format::sniff(&bytes), Some(Format::Off));
            let cloud = read(&bytes, Format::Off, &ReadOptions::default()).unwrap();
            assert_eq!(cloud.coordinates(), points.map(f64::from));
            assert_eq!(cloud.faces(), [[0, 1, 2]]);
            // Cut by the number of components, it is one without.
            for end in (0..bytes.len()).filter(|end| end + 4 != bytes.len()) {
                assert!(read(&bytes[..end], Format::Off, &ReadOptions::default()).is_err());
            }
        }
    }
}

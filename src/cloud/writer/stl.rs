//! STL: triangles alone. Binary where single precision, all that it has, is enough; text otherwise.

use std::io::{self, Write};

use super::push_number;
use crate::cloud::PointCloud;

/// Share of a mesh's extent that its coordinates resolve in binary.
const EXTENT_RESOLVED: f64 = 1e-6;

/// Writes the faces of a cloud of at most three dimensions.
pub(super) fn write_stl(cloud: &PointCloud, out: &mut impl Write) -> io::Result<()> {
    let unsupported = |message: String| Err(io::Error::new(io::ErrorKind::Unsupported, message));
    if cloud.dimension() > 3 {
        return unsupported(format!("STL has three coordinates; these points have {}", cloud.dimension()));
    }
    if cloud.faces().is_empty() {
        return unsupported("STL holds triangles; this cloud has none".to_owned());
    }
    let corners = cloud.faces().as_flattened();
    if let Some(&row) = corners.iter().find(|&&row| cloud.point(row as usize).iter().any(|x| !x.is_finite()))
    {
        return unsupported(format!("STL has no place for point {row}, which has a non-finite coordinate"));
    }
    if is_resolved(cloud) { write_binary(cloud, out) } else { write_text(cloud, out) }
}

/// Whether single precision tells positions apart to a millionth of the extent.
fn is_resolved(cloud: &PointCloud) -> bool {
    let Some((low, high)) = cloud.bounding_box() else { return true };
    let extent = low.iter().zip(&high).map(|(low, high)| high - low).fold(0.0, f64::max);
    let farthest = low.iter().chain(&high).map(|x| x.abs()).fold(0.0, f64::max);
    farthest * f64::from(f32::EPSILON) <= EXTENT_RESOLVED * extent
}

fn position(cloud: &PointCloud, row: u32) -> [f64; 3] {
    let point = cloud.point(row as usize);
    [0, 1, 2].map(|axis| point.get(axis).copied().unwrap_or(0.0))
}

/// The unit normal of a triangle; 0 of one without area, as the format has it.
fn normal([a, b, c]: [[f64; 3]; 3]) -> [f64; 3] {
    let (u, v) = ([0, 1, 2].map(|i| b[i] - a[i]), [0, 1, 2].map(|i| c[i] - a[i]));
    let cross = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]];
    let length = cross.iter().map(|x| x * x).sum::<f64>().sqrt();
    if length > 0.0 { cross.map(|x| x / length) } else { [0.0; 3] }
}

fn write_binary(cloud: &PointCloud, out: &mut impl Write) -> io::Result<()> {
    let mut head = [b' '; 80];
    let program = concat!("chladni ", env!("CARGO_PKG_VERSION"));
    head[..program.len()].copy_from_slice(program.as_bytes());
    out.write_all(&head)?;
    let count = u32::try_from(cloud.faces().len()).map_err(io::Error::other)?;
    out.write_all(&count.to_le_bytes())?;
    let mut bytes = Vec::with_capacity(50 * super::CHUNK_ROWS);
    for faces in cloud.faces().chunks(super::CHUNK_ROWS) {
        bytes.clear();
        for face in faces {
            let corners = face.map(|row| position(cloud, row));
            let numbers = std::iter::once(normal(corners)).chain(corners).flatten();
            bytes.extend(numbers.flat_map(|x| (x as f32).to_le_bytes()));
            bytes.extend([0, 0]);
        }
        out.write_all(&bytes)?;
    }
    Ok(())
}

fn write_text(cloud: &PointCloud, out: &mut impl Write) -> io::Result<()> {
    let mut text = b"solid chladni\n".to_vec();
    let push = |start: &str, numbers: [f64; 3], text: &mut Vec<u8>| {
        text.extend_from_slice(start.as_bytes());
        for x in numbers {
            text.push(b' ');
            push_number(x, text);
        }
        text.push(b'\n');
    };
    for faces in cloud.faces().chunks(super::CHUNK_ROWS) {
        for face in faces {
            let corners = face.map(|row| position(cloud, row));
            push("facet normal", normal(corners), &mut text);
            text.extend_from_slice(b"outer loop\n");
            for corner in corners {
                push("vertex", corner, &mut text);
            }
            text.extend_from_slice(b"endloop\nendfacet\n");
        }
        out.write_all(&text)?;
        text.clear();
    }
    out.write_all(b"endsolid chladni\n")
}

//! Faces and triangle strips of a PLY file.

use super::super::polygons::{Triangles, corner};
use super::ReadError;
use super::header::{Element, PropertyKind};

/// What the corner list of an element describes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Surface {
    /// One polygon per row.
    Polygons,
    /// Triangle strips, ended by −1, as in the archives of the Stanford scanning repository.
    Strips,
}

impl Surface {
    /// What an element of this name describes, and which of its properties is the corner list.
    pub(super) fn of(element: &Element) -> Option<(Self, usize)> {
        let surface = match element.name.as_str() {
            "face" => Self::Polygons,
            "tristrips" => Self::Strips,
            _ => return None,
        };
        let list = element.properties.iter().position(|property| {
            matches!(property.kind, PropertyKind::List { item, .. } if item.is_integer())
                && matches!(property.name.as_str(), "vertex_indices" | "vertex_index")
        })?;
        Some((surface, list))
    }

    /// Adds the triangles of one row. The error wants a place.
    pub(super) fn push(
        self,
        row: usize,
        indices: &[i64],
        points: usize,
        corners: &mut Vec<u32>,
        triangles: &mut Triangles,
    ) -> Result<(), FaceError> {
        match self {
            Self::Polygons => {
                corners.clear();
                for &index in indices {
                    corners.push(corner(index, points, row)?);
                }
                triangles.push_fan(corners)?;
            }
            Self::Strips => push_strips(indices, points, corners, triangles)?,
        }
        Ok(())
    }
}

/// Either a text that wants a place, or an error that is complete.
pub(super) enum FaceError {
    Message(String),
    Limit(ReadError),
}

impl From<String> for FaceError {
    fn from(message: String) -> Self {
        Self::Message(message)
    }
}

impl From<ReadError> for FaceError {
    fn from(error: ReadError) -> Self {
        Self::Limit(error)
    }
}

/// Every index after the second of a strip makes a triangle with the two before it; every other one is turned
/// round, so that all have the orientation of the first. Strips repeat indices to turn corners: triangles
/// without area are left out.
fn push_strips(
    indices: &[i64],
    points: usize,
    corners: &mut Vec<u32>,
    triangles: &mut Triangles,
) -> Result<(), FaceError> {
    let mut strip = 0;
    corners.clear();
    for &index in indices {
        if index < 0 {
            strip += 1;
            corners.clear();
            continue;
        }
        let third = corner(index, points, strip).map_err(|message| format!("triangle strip: {message}"))?;
        corners.push(third);
        if let [.., first, second, third] = corners[..]
            && first != second
            && second != third
            && third != first
        {
            let is_turned = corners.len().is_multiple_of(2);
            triangles.push(if is_turned { [second, first, third] } else { [first, second, third] })?;
        }
    }
    Ok(())
}

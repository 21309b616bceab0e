//! Faces of files become triangles.

use super::{Limits, ReadError};

/// Corner indices of a face, checked, and the triangles so far.
#[derive(Debug)]
pub(super) struct Triangles {
    triangles: Vec<[u32; 3]>,
    faces_max: usize,
}

impl Triangles {
    pub(super) fn new(limits: &Limits) -> Self {
        Self { triangles: Vec::new(), faces_max: limits.faces_max }
    }

    /// Adds a polygon as a fan around its first corner: `(0, 1, 2), (0, 2, 3), …`, in the polygon's orientation.
    pub(super) fn push_fan(&mut self, corners: &[u32]) -> Result<(), ReadError> {
        let triangles = corners.len().saturating_sub(2);
        if self.triangles.len() + triangles > self.faces_max {
            return Err(ReadError::TooManyFaces { faces_max: self.faces_max });
        }
        // At once: grown by and by, a polygon of a million corners takes twice what it needs.
        self.triangles.reserve(triangles);
        self.triangles.extend(corners.windows(2).skip(1).map(|pair| [corners[0], pair[0], pair[1]]));
        Ok(())
    }

    /// Adds a triangle.
    pub(super) fn push(&mut self, triangle: [u32; 3]) -> Result<(), ReadError> {
        if self.triangles.len() >= self.faces_max {
            return Err(ReadError::TooManyFaces { faces_max: self.faces_max });
        }
        self.triangles.push(triangle);
        Ok(())
    }

    /// All triangles.
    pub(super) fn into_vec(self) -> Vec<[u32; 3]> {
        self.triangles
    }
}

/// Index of a corner of a face with 0-based indices; the error's text when it names no point.
pub(super) fn corner(index: i64, points: usize, face: usize) -> Result<u32, String> {
    let inside = u32::try_from(index).ok().filter(|&i| (i as usize) < points);
    inside.ok_or_else(|| match points {
        0 => format!("face {face} names point {index}, but the file has no points"),
        _ => format!("face {face} names point {index}; the file has points 0 to {}", points - 1),
    })
}

/// Refuses a face with fewer than three corners.
pub(super) fn enough_corners(corners: usize, face: usize) -> Result<(), String> {
    if corners < 3 {
        return Err(format!("face {face} has {corners} corners; 3 or more are accepted"));
    }
    Ok(())
}

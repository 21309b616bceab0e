//! Faces of files become triangles.

use super::columns::Columns;
use super::{Limits, ReadError, ReadOptions};
use crate::cloud::PointCloud;

/// Bytes that a triangle, or a corner of a polygon while that is read, takes at most: a triangle itself is twelve and its
/// place in a polygon four, and the lists of them are copied into ones of twice the size when they grow.
const BYTES_EACH: usize = 48;

/// Corner indices of a face, checked, and the triangles so far.
#[derive(Debug)]
pub(super) struct Triangles {
    list: Vec<[u32; 3]>,
    /// Those that continue the polygon of the one before.
    continued: Vec<u32>,
    /// Faces of fewer than three corners.
    left_out: usize,
    limits: Limits,
    points_bytes: usize,
}

impl Triangles {
    /// None yet, beside points that take `bytes` of memory.
    pub(super) fn new(limits: &Limits, points_bytes: Option<usize>) -> Self {
        let points_bytes = points_bytes.unwrap_or(usize::MAX);
        Self { list: Vec::new(), continued: Vec::new(), left_out: 0, limits: *limits, points_bytes }
    }

    /// Refuses a list of too many corners before it is read: as indices, and as the triangles that it becomes.
    pub(super) fn room_for(&self, corners: usize) -> Result<(), ReadError> {
        let each = corners.checked_mul(2).and_then(|more| self.list.len().checked_add(more));
        let bytes = each.and_then(|each| each.checked_mul(BYTES_EACH)?.checked_add(self.points_bytes));
        self.limits.memory(bytes)
    }

    /// Adds a polygon as a fan around its first corner: `(0, 1, 2), (0, 2, 3), …`, in the polygon's orientation. One of
    /// fewer than three corners has no area: it is left out and counted.
    pub(super) fn push_fan(&mut self, corners: &[u32]) -> Result<(), ReadError> {
        if corners.len() < 3 {
            self.left_out += 1;
            return Ok(());
        }
        let triangles = corners.len().saturating_sub(2);
        self.room_for(triangles)?;
        if self.list.len() + triangles > self.limits.faces_max {
            return Err(ReadError::TooManyFaces { faces_max: self.limits.faces_max });
        }
        // At once: grown by and by, a polygon of a million corners takes twice what it needs.
        self.list.reserve(triangles);
        let first = self.list.len() as u32;
        self.continued.extend((first..first + triangles as u32).skip(1));
        self.list.extend(corners.windows(2).skip(1).map(|pair| [corners[0], pair[0], pair[1]]));
        Ok(())
    }

    /// Adds a triangle.
    pub(super) fn push(&mut self, triangle: [u32; 3]) -> Result<(), ReadError> {
        if self.list.len() >= self.limits.faces_max {
            return Err(ReadError::TooManyFaces { faces_max: self.limits.faces_max });
        }
        self.room_for(1)?;
        self.list.push(triangle);
        Ok(())
    }

    /// The cloud of these points and triangles.
    pub(super) fn finish(self, mut points: Columns, options: &ReadOptions) -> Result<PointCloud, ReadError> {
        if self.left_out > 0 {
            let count = self.left_out;
            points.notes.push(format!("{count} faces of fewer than three corners were left out"));
        }
        Ok(points.into_cloud(self.list, options)?.with_polygons(self.continued)?)
    }

    /// The triangles alone.
    pub(super) fn into_list(self) -> Vec<[u32; 3]> {
        self.list
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

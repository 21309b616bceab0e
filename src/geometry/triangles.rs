//! The triangles of an upload on the points that stand for its rows.

use super::metric::TriangleMetric;
use super::points::Points;
use crate::cloud::PointCloud;

/// Triangles whose area is less than this share of their longest squared side have no angles to speak of: the middle
/// corner of three on a line is rounded off it by about 1e-16 of the cloud's extent, 1e-8 of short sides.
const SLIVER: f64 = 1e-8;

/// Triangles as indices of points.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Triangles {
    list: Vec<[u32; 3]>,
    shares: Vec<f64>,
}

impl Triangles {
    /// The cloud's faces, those left out that have no area: a corner twice (duplicates are merged), a corner without a
    /// point (non-finite rows), or corners on a line.
    #[must_use]
    pub fn of(cloud: &PointCloud, points: &Points) -> Self {
        let place = |row: u32| points.of_row(row as usize).map(|point| point as u32);
        let merged = |&[a, b, c]: &[u32; 3]| Some([place(a)?, place(b)?, place(c)?]);
        let mut triangles = Self { list: Vec::new(), shares: vec![0.0; points.len()] };
        let mut corners = Vec::new();
        for polygon in cloud.polygons() {
            corners.clear();
            let mut area_of_all = 0.0;
            for triangle in polygon.iter().filter_map(merged) {
                corners.extend(triangle);
                if has_area(points, triangle) {
                    triangles.list.push(triangle);
                    area_of_all += area(points, triangle);
                }
            }
            corners.sort_unstable();
            corners.dedup();
            for &corner in &corners {
                triangles.shares[corner as usize] += area_of_all / corners.len() as f64;
            }
        }
        triangles
    }

    /// The area of every face divided equally among its corners, `∑ Area(t)/#t` over the faces t of a point [MESH eq. 1];
    /// that of a polygon is the area of the triangles that it became. In length², none when the cloud has no faces.
    #[must_use]
    pub fn shares(&self) -> &[f64] {
        &self.shares
    }

    /// All triangles.
    pub fn iter(&self) -> impl Iterator<Item = [u32; 3]> {
        self.list.iter().copied()
    }

    /// Whether there is none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.list.is_empty()
    }
}

fn has_area(points: &Points, corners: [u32; 3]) -> bool {
    let triangle = TriangleMetric::accurate(points, corners);
    triangle.area() > SLIVER * triangle.squared_sides().into_iter().fold(0.0, f64::max)
}

/// Area of a triangle in length².
#[must_use]
pub fn area(points: &Points, corners: [u32; 3]) -> f64 {
    TriangleMetric::accurate(points, corners).area()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cloud::NonFinite;

    #[test]
    fn corners_on_a_line_have_no_area_wherever_the_line_lies() {
        // the middle corner at random places of slanted sides: exact on paper, rounded here
        let mut left_out = 0;
        for seed in 0_u32..200 {
            let share = f64::from(seed + 1) / 207.0;
            let (a, b) = ([0.3, -1.7, 0.9], [f64::from(seed).sin(), 2.3, f64::from(seed).cos()]);
            let middle: Vec<f64> = a.iter().zip(b).map(|(a, b)| a + share * (b - a)).collect();
            let rows = [&a[..], &b, &middle, &[5.0, 5.0, 5.0], &[-5.0, 5.0, 0.0], &[0.0, -5.0, 5.0]].concat();
            let cloud = PointCloud::new(3, rows, NonFinite::Reject).unwrap();
            let cloud = cloud.with_faces(vec![[0, 2, 1], [3, 4, 5]]).unwrap();
            let points = Points::prepare(&cloud, 2).unwrap();
            left_out += 2 - Triangles::of(&cloud, &points).iter().count();
        }
        assert_eq!(left_out, 200);
    }

    #[test]
    fn a_needle_a_ten_millionth_as_wide_as_long_is_a_triangle_with_its_area() {
        let rows = vec![0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.4, 1e-7, 0.0, 0.0, 2.0, 0.0, 2.0, 0.0, 1.0];
        let cloud = PointCloud::new(3, rows, NonFinite::Reject).unwrap();
        let cloud = cloud.with_faces(vec![[0, 1, 2]]).unwrap();
        let points = Points::prepare(&cloud, 2).unwrap();
        let triangles: Vec<_> = Triangles::of(&cloud, &points).iter().collect();
        assert_eq!(triangles.len(), 1);
        let unit = points.unit();
        assert!((area(&points, triangles[0]) * unit * unit / 0.5e-7 - 1.0).abs() < 1e-6);
    }
}

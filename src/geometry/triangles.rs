//! The triangles of an upload on the points that stand for its rows.

use super::points::Points;
use crate::cloud::PointCloud;

/// Triangles whose area is less than this share of their longest squared side have no angles to speak of.
const SLIVER: f64 = 1e-12;

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

fn has_area(points: &Points, [a, b, c]: [u32; 3]) -> bool {
    let side = |p: u32, q: u32| points.squared_distance(p as usize, q as usize);
    area(points, [a, b, c]) > SLIVER * side(a, b).max(side(b, c)).max(side(c, a))
}

/// Area of a triangle in length².
#[must_use]
pub fn area(points: &Points, [a, b, c]: [u32; 3]) -> f64 {
    let side = |q: u32| points.point(q as usize).iter().zip(points.point(a as usize)).map(|(q, a)| q - a);
    let (squared_b, squared_c): (f64, f64) = (side(b).map(|x| x * x).sum(), side(c).map(|x| x * x).sum());
    let product: f64 = side(b).zip(side(c)).map(|(x, y)| x * y).sum();
    0.5 * (squared_b * squared_c - product * product).max(0.0).sqrt()
}

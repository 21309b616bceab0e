//! Triangles of a cloud with faces: numbers and normals between the corners change linearly.

use crate::cloud::PointCloud;

use super::color::{self, Rgb};
use super::raster::{Pixel, Raster};
use super::shading;
use super::{Map, Scale};

/// A triangle in the picture.
#[derive(Debug, Clone, Copy)]
pub(super) struct Triangle {
    /// Places of the corners in pixels from the top left, and their nearness.
    at: [[f32; 3]; 3],
    /// Normals at the corners, as seen: right, up, towards the viewer.
    normals: [[f32; 3]; 3],
    /// Place of the corners' values in the map of colors, 0 to 1; NaN without a value.
    shares: [f32; 3],
}

/// The triangles of a cloud whose corners all have a place, and whether each row is a corner of one of them.
pub(super) fn of_cloud(
    cloud: &PointCloud,
    places: &[Option<[f32; 3]>],
    scale: Option<&Scale<'_>>,
) -> (Vec<Triangle>, Vec<bool>) {
    let normals = vertex_normals(cloud, places);
    let mut is_corner = vec![false; cloud.len()];
    let mut triangles = Vec::with_capacity(cloud.faces().len());
    for face in cloud.faces() {
        let rows = face.map(|row| row as usize);
        let [Some(a), Some(b), Some(c)] = rows.map(|row| places[row]) else { continue };
        for row in rows {
            is_corner[row] = true;
        }
        let shares = rows.map(|row| scale.map_or(0.0, |scale| scale.share(row) as f32));
        triangles.push(Triangle { at: [a, b, c], normals: rows.map(|row| normals[row]), shares });
    }
    (triangles, is_corner)
}

/// Sums of the normals of the triangles around every row, the longer the larger the triangle.
fn vertex_normals(cloud: &PointCloud, places: &[Option<[f32; 3]>]) -> Vec<[f32; 3]> {
    let mut sums = vec![[0.0_f32; 3]; cloud.len()];
    for face in cloud.faces() {
        let rows = face.map(|row| row as usize);
        let [Some(a), Some(b), Some(c)] = rows.map(|row| places[row]) else { continue };
        // Rows of pixels run downwards.
        let side = |p: [f32; 3]| [p[0] - a[0], a[1] - p[1], p[2] - a[2]];
        let ([ux, uy, uz], [vx, vy, vz]) = (side(b), side(c));
        let normal = [uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx];
        for row in rows {
            for (sum, part) in sums[row].iter_mut().zip(normal) {
                *sum += part;
            }
        }
    }
    sums.into_iter().map(unit).collect()
}

fn unit(v: [f32; 3]) -> [f32; 3] {
    let length = v.iter().map(|x| x * x).sum::<f32>().sqrt();
    if length > 0.0 { v.map(|x| x / length) } else { [0.0, 0.0, 1.0] }
}

impl Raster {
    /// Draws triangles; `map` has the colors of their shares, without one all are plain.
    pub(super) fn fill(&mut self, triangles: &[Triangle], map: Option<&Map>) {
        let width = self.width;
        let rows_of = |triangle: &Triangle| {
            let rows = triangle.at.map(|corner| corner[1]);
            [
                rows.into_iter().fold(f32::INFINITY, f32::min),
                rows.into_iter().fold(f32::NEG_INFINITY, f32::max),
            ]
        };
        self.in_bands(triangles, rows_of, |rows, band, triangles| {
            for triangle in triangles {
                let [top, bottom] = rows_of(triangle);
                let first = (top.max(0.0) as usize).max(rows.start);
                let last = (bottom.max(0.0).ceil() as usize).min(rows.end);
                for row in first..last {
                    triangle.fill_row(row, &mut band[(row - rows.start) * width..][..width], map);
                }
            }
        });
    }
}

impl Triangle {
    /// Fills what the triangle has of a row of pixels.
    fn fill_row(&self, row: usize, pixels: &mut [Pixel], map: Option<&Map>) {
        let [a, b, c] = self.at;
        let area = (b[0] - a[0]) * (c[1] - a[1]) - (c[0] - a[0]) * (b[1] - a[1]);
        if area == 0.0 {
            return;
        }
        let columns = self.at.map(|corner| corner[0]);
        let left = columns.into_iter().fold(f32::INFINITY, f32::min).max(0.0) as usize;
        let right = columns.into_iter().fold(0.0, f32::max).ceil() as usize;
        let grain = (0.5 * area.abs()).sqrt().max(1.0);
        let y = row as f32 + 0.5;
        for (column, pixel) in pixels.iter_mut().enumerate().take(right).skip(left) {
            let x = column as f32 + 0.5;
            let of = |p: [f32; 3], q: [f32; 3]| ((p[0] - x) * (q[1] - y) - (q[0] - x) * (p[1] - y)) / area;
            let weights = [of(b, c), of(c, a), of(a, b)];
            // A seam between triangles belongs to both: no pixel is left out.
            if weights.iter().any(|&weight| weight < -1e-4) {
                continue;
            }
            let mixed = |values: [f32; 3]| (0..3).map(|i| weights[i] * values[i]).sum::<f32>();
            let depth = mixed(self.at.map(|corner| corner[2]));
            if depth > pixel.depth {
                let normal = [0, 1, 2].map(|axis| mixed(self.normals.map(|normal| normal[axis])));
                let facing = shading::facing(unit(normal));
                *pixel = Pixel { depth, grain, facing, color: shown(map, mixed(self.shares)) };
            }
        }
    }
}

fn shown(map: Option<&Map>, share: f32) -> Rgb {
    match map {
        None => color::PLAIN,
        Some(_) if share.is_nan() => color::ABSENT,
        Some(map) => map.at(f64::from(share)),
    }
}

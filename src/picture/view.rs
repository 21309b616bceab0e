//! The camera: view direction and projection.

use crate::arguments::{arguments, words};
use crate::cloud::PointCloud;

/// Share of the picture that is left free around the cloud.
const MARGIN: f64 = 0.04;
/// Radius of a disc in pixels at least, and at most as a share of the picture's shorter side.
const RADIUS_LEAST: f64 = 0.8;
const RADIUS_MOST: f64 = 0.05;

words! {
    /// The axis that points up in the picture.
    #[derive(Default)]
    #[non_exhaustive]
    pub enum Up {
        /// x.
        X,
        /// y, as most scanned objects have it.
        Y,
        /// z, as surveys have it.
        #[default]
        Z,
    }
}

words! {
    /// What is behind the points.
    #[derive(Default)]
    #[non_exhaustive]
    pub enum Background {
        /// White.
        #[default]
        White,
        /// Black.
        Black,
        /// Nothing.
        Transparent,
    }
}

/// Most pixels along either side of a picture.
const SIDE_MAX: usize = 16_384;

arguments! {
    /// A view of a cloud, and the size of its picture.
    #[derive(Debug, Clone, Copy, PartialEq)]
    pub struct View {
        /// Of pictures (png): degrees about the axis that points up, from the next axis in the order x, y, z, x on (as in
        /// Matplotlib).
        azimuth: f64 = range(-360.0, 360.0), default -60.0;
        /// Of pictures: degrees above the plane of the other two axes.
        elevation: f64 = range(-90.0, 90.0), default 20.0;
        /// Of pictures: the axis that points up.
        up: Up = word(Up), default Up::Z;
        /// Of pictures: pixels of a row.
        width: usize = integer(1, SIDE_MAX), default 800;
        /// Of pictures: rows of pixels.
        height: usize = integer(1, SIDE_MAX), default 600;
        /// Of pictures: what is behind the points.
        background: Background = word(Background), default Background::White;
        /// Of pictures that are colored by numbers: adds the color bar with values, what is shown and its unit.
        legend: bool = switch, default false;
    }
}

/// An orthographic projection that fits a cloud into a picture.
pub(super) struct Camera {
    /// Directions to the right, up and towards the viewer.
    axes: [[f64; 3]; 3],
    /// What falls into the middle of the picture.
    center: [f64; 3],
    /// Pixels per unit of length.
    scale: f64,
    width: usize,
    height: usize,
}

impl Camera {
    /// Fits all finite points, with `oversampling` times the pixels of the view along either side.
    pub(super) fn new(cloud: &PointCloud, view: &View, oversampling: usize) -> Self {
        let (sin_a, cos_a) = view.azimuth.to_radians().sin_cos();
        let (sin_e, cos_e) = view.elevation.to_radians().sin_cos();
        let right = [-sin_a, cos_a, 0.0];
        let up = [-sin_e * cos_a, -sin_e * sin_a, cos_e];
        let towards = [cos_e * cos_a, cos_e * sin_a, sin_e];
        // Turning the names of the axes in a circle keeps hands right.
        let turn = match view.up {
            Up::X => 2,
            Up::Y => 1,
            Up::Z => 0,
        };
        let axes = [right, up, towards].map(|axis| [0, 1, 2].map(|i| axis[(i + turn) % 3]));
        let (width, height) = (view.width.max(1) * oversampling, view.height.max(1) * oversampling);
        let mut camera = Self { axes, center: [0.0; 3], scale: 1.0, width, height };
        let (mut low, mut high) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
        for row in 0..cloud.len() {
            let Some(at) = position(cloud.point(row)).map(|p| camera.seen(p)) else { continue };
            for axis in 0..3 {
                low[axis] = low[axis].min(at[axis]);
                high[axis] = high[axis].max(at[axis]);
            }
        }
        if low[0] > high[0] {
            return camera;
        }
        let middle = [0, 1, 2].map(|axis| low[axis] + 0.5 * (high[axis] - low[axis]));
        camera.center = [0, 1, 2].map(|i| (0..3).map(|axis| middle[axis] * axes[axis][i]).sum());
        let room = |pixels: usize, extent: f64| pixels as f64 * (1.0 - 2.0 * MARGIN) / extent;
        let scale = room(width, high[0] - low[0]).min(room(height, high[1] - low[1]));
        camera.scale = if scale.is_finite() { scale } else { 1.0 };
        camera
    }

    pub(super) fn width(&self) -> usize {
        self.width
    }

    pub(super) fn height(&self) -> usize {
        self.height
    }

    /// Place in the picture in pixels from the top left, and distance towards the viewer in pixels; `None` for points
    /// without a position.
    pub(super) fn project(&self, point: &[f64]) -> Option<[f32; 3]> {
        let [right, up, towards] = self.seen(position(point)?).map(|x| x * self.scale);
        Some([right + 0.5 * self.width as f64, 0.5 * self.height as f64 - up, towards].map(|x| x as f32))
    }

    fn seen(&self, p: [f64; 3]) -> [f64; 3] {
        self.axes.map(|axis| (0..3).map(|i| axis[i] * (p[i] - self.center[i])).sum())
    }

    /// Radius of a disc in pixels, where it has `radius` in units of the cloud; `None` where that is not known.
    pub(super) fn radius_in_pixels(&self, radius: Option<f64>) -> f32 {
        let most = (RADIUS_MOST * self.width.min(self.height) as f64).max(RADIUS_LEAST);
        let pixels = radius.map_or(0.2 * most, |radius| radius * self.scale);
        pixels.clamp(RADIUS_LEAST, most) as f32
    }
}

/// Three coordinates; `None` unless all are finite.
fn position(point: &[f64]) -> Option<[f64; 3]> {
    let p = [0, 1, 2].map(|axis| point.get(axis).copied().unwrap_or(0.0));
    p.iter().all(|x| x.is_finite()).then_some(p)
}

#[cfg(test)]
#[allow(clippy::float_cmp)] // the middle is exact
mod tests {
    use super::*;
    use crate::cloud::NonFinite;

    /// The corners of a box of 2 × 4 × 6 far from the origin, and a point at its center.
    fn block() -> PointCloud {
        let corner = |i: usize| [i & 1, i >> 1 & 1, i >> 2].map(|side| 2.0 * side as f64 - 1.0);
        let far = |[x, y, z]: [f64; 3]| [1e6 + x, 2e6 + 2.0 * y, 3.0 * z];
        let points = (0..8).map(corner).chain([[0.0; 3]]).flat_map(far).collect();
        PointCloud::new(3, points, NonFinite::Reject).unwrap()
    }

    fn seen(view: View, row: usize) -> [f32; 3] {
        Camera::new(&block(), &view, 1).project(block().point(row)).unwrap()
    }

    #[test]
    fn the_cloud_is_centered_and_fills_the_picture() {
        let view = View { azimuth: -90.0, elevation: 0.0, ..View::default() };
        assert_eq!(seen(view, 8), [400.0, 300.0, 0.0]);
        // Seen along y, z is up: 6 units in 600 pixels less the margin.
        let pixels = 600.0 * (1.0 - 2.0 * MARGIN as f32) / 6.0;
        let [x, y, _] = seen(view, 0);
        assert!((x - (400.0 - pixels)).abs() < 1e-3 && (y - (300.0 + 3.0 * pixels)).abs() < 1e-3, "{x} {y}");
    }

    #[test]
    fn every_axis_can_point_up() {
        for (up, axis, length) in [(Up::X, 0, 2.0), (Up::Y, 1, 4.0), (Up::Z, 2, 6.0)] {
            let view = View { azimuth: 0.0, elevation: 0.0, up, ..View::default() };
            let camera = Camera::new(&block(), &view, 1);
            let (low, high) = (
                camera.project(block().point(0)).unwrap(),
                camera.project(block().point(1 << axis)).unwrap(),
            );
            assert!(
                (f64::from(low[1] - high[1]) - length * camera.scale).abs() < 1e-2,
                "{up:?}: {low:?} {high:?}"
            );
            assert!((low[0] - high[0]).abs() < 1e-2);
        }
    }

    #[test]
    fn what_is_nearer_is_nearer() {
        let view = View { azimuth: 0.0, elevation: 0.0, ..View::default() };
        // From azimuth 0 the viewer stands on +x.
        assert!(seen(view, 1)[2] > seen(view, 0)[2]);
        let above = View { elevation: 90.0, ..view };
        assert!(seen(above, 4)[2] > seen(above, 0)[2]);
    }

    #[test]
    fn a_single_place_and_a_row_without_one_are_no_obstacle() {
        let cloud = PointCloud::new(2, vec![1.0, 1.0, f64::NAN, 0.0], NonFinite::Drop).unwrap();
        let camera = Camera::new(&cloud, &View::default(), 1);
        assert!(camera.project(cloud.point(0)).unwrap().iter().all(|x| x.is_finite()));
        assert_eq!(camera.project(cloud.point(1)), None);
        assert!(camera.radius_in_pixels(None) > 0.0);
    }
}

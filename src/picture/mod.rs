//! Pictures: clouds as shaded points coloured by a function, and spectra as plots.
//!
//! ```
//! use chladni::cloud::shapes::{SampleRequest, Shape, sample};
//! use chladni::picture::{Paint, Picture, View};
//!
//! let sphere = sample(&SampleRequest::new(Shape::Sphere, 2_000))?;
//! let height: Vec<f64> = (0..sphere.len()).map(|row| sphere.point(row)[2]).collect();
//! let picture = Picture::draw(&sphere, &Paint::Diverging(&height), &[], &View::default());
//! let bytes = picture.to_png("the sphere's height")?;
//! assert!(bytes.starts_with(b"\x89PNG"));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod color;
mod file;
mod plot;
mod raster;
mod shading;
mod view;

pub use color::{Map, Rgb};
pub use plot::{Spectrum, plot_spectrum};
pub use view::{Background, Up, View};

use rayon::prelude::*;

use crate::cloud::PointCloud;
use raster::{Raster, Splat};
use view::Camera;

/// Pixels per pixel of the picture, along either side: edges are smooth.
const OVERSAMPLING: usize = 2;
/// Share of the magnitudes that the colours tell apart; what lies above has the last colour. A few peaks would
/// otherwise leave everything else pale.
const COLORED_SHARE: f64 = 0.995;
/// Radius of the marks of feature points, as a share of the picture's shorter side.
const MARK_RADIUS: f64 = 0.016;

/// What points are coloured by.
#[derive(Debug, Clone, Copy)]
pub enum Paint<'a> {
    /// Nothing: shape alone.
    Plain,
    /// One number per row about zero, as of a basis: zero is pale, the signs are blue and orange. NaN is grey.
    Diverging(&'a [f64]),
    /// One number per row from the least to the greatest, dark to bright. NaN is grey.
    Sequential(&'a [f64]),
}

/// A drawn picture: `width × height` pixels of red, green, blue and opacity, row by row from the top, sRGB.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Picture {
    /// Pixels of a row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Four bytes per pixel.
    pub pixels: Vec<u8>,
}

impl Picture {
    /// Draws the finite points of a cloud, orthographically, and marks at some of its rows. Of points in more than
    /// three dimensions the first three coordinates are drawn; missing ones are 0.
    #[must_use]
    pub fn draw(cloud: &PointCloud, paint: &Paint<'_>, marks: &[usize], view: &View) -> Self {
        let camera = Camera::new(cloud, view, OVERSAMPLING);
        let colors = paint.colors(cloud.len());
        let color = |row: usize| colors.as_ref().map_or(color::PLAIN, |colors| colors[row]);
        let radius = camera.splat_radius(cloud);
        let splats: Vec<Splat> = (0..cloud.len())
            .into_par_iter()
            .filter_map(|row| {
                Some(Splat { at: camera.project(cloud.point(row))?, radius, color: color(row) })
            })
            .collect();
        let mut raster = Raster::new(camera.width(), camera.height());
        raster.splat(&splats);
        let shade = shading::shade(&raster, radius);
        let mark_radius = (MARK_RADIUS * camera.width().min(camera.height()) as f64).max(3.0) as f32;
        let marks: Vec<Splat> = marks
            .iter()
            .filter_map(|&row| camera.project(cloud.point(row)))
            .map(|at| Splat { at, radius: mark_radius, color: color::MARK })
            .collect();
        let shade = raster.mark(&marks, shade);
        raster.picture(&shade, OVERSAMPLING, view.background)
    }
}

impl Paint<'_> {
    /// A colour per row; `None` when all are alike.
    fn colors(&self, rows: usize) -> Option<Vec<Rgb>> {
        let (values, map) = match *self {
            Self::Plain => return None,
            Self::Diverging(values) => (values, Map::diverging()),
            Self::Sequential(values) => (values, Map::sequential()),
        };
        let range = if matches!(self, Self::Sequential(_)) {
            extent(values)
        } else {
            let most = magnitude(values);
            (-most, most)
        };
        let (low, width) = (range.0, (range.1 - range.0).max(f64::MIN_POSITIVE));
        let color = |row: usize| match values.get(row) {
            Some(value) if !value.is_nan() => map.at((value - low) / width),
            _ => color::ABSENT,
        };
        Some((0..rows).map(color).collect())
    }
}

/// The magnitude that [`COLORED_SHARE`] of the values do not exceed.
fn magnitude(values: &[f64]) -> f64 {
    let mut magnitudes: Vec<f64> = values.iter().filter(|x| x.is_finite()).map(|x| x.abs()).collect();
    if magnitudes.is_empty() {
        return 1.0;
    }
    let place = ((magnitudes.len() - 1) as f64 * COLORED_SHARE).ceil() as usize;
    *magnitudes.select_nth_unstable_by(place, f64::total_cmp).1
}

/// Least and greatest value, without the same share of outliers at either end.
fn extent(values: &[f64]) -> (f64, f64) {
    let mut finite: Vec<f64> = values.iter().copied().filter(|x| x.is_finite()).collect();
    if finite.is_empty() {
        return (0.0, 1.0);
    }
    let place = ((finite.len() - 1) as f64 * COLORED_SHARE).ceil() as usize;
    let high = *finite.select_nth_unstable_by(place, f64::total_cmp).1;
    let mirrored = finite.len() - 1 - place;
    let low = *finite.select_nth_unstable_by(mirrored, f64::total_cmp).1;
    (low, high)
}

#[cfg(test)]
mod tests;

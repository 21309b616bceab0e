//! Pictures: clouds as shaded points or triangles colored by a function, and spectra as plots.
//!
//! Drawn here, because a server has no GPU, which crates for scenes want, and crates for charts and vectors know no depth.

mod color;
mod file;
mod legend;
mod letters;
mod plot;
mod raster;
mod shading;
mod spacing;
mod triangles;
mod view;

pub use color::{ABSENT, MARK, Map, PLAIN, Rgb, srgb};
pub use legend::{Legend, legend_of_basis};
pub use plot::{Spectrum, plot_spectrum};
pub use view::{Background, Up, View};

use rayon::prelude::*;

use crate::cloud::PointCloud;
use raster::{Raster, Splat};
use view::Camera;

/// Pixels per pixel of the picture, along either side: edges are smooth.
const OVERSAMPLING: usize = 2;
/// Share of the magnitudes that the colors tell apart; what lies above has the last color. A few peaks would
/// otherwise leave everything else pale.
const COLORED_SHARE: f64 = 0.995;
/// Radius of the marks of feature points, as a share of the picture's shorter side.
const MARK_RADIUS: f64 = 0.016;

/// Radius of a mark in pixels from which its number can be read.
const NUMBERED: f32 = 5.0;

/// What points are colored by.
#[derive(Debug, Clone, Copy)]
#[non_exhaustive]
pub enum Paint<'a> {
    /// Nothing: shape alone.
    Plain,
    /// One number per row about zero, as of a basis: zero is pale, the signs are blue and orange. NaN is gray.
    Diverging(&'a [f64]),
    /// One number per row from the least to the greatest, dark to bright. NaN is gray.
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
    /// Draws the finite points of a cloud, or its triangles where it has faces, orthographically, and numbered marks at
    /// some of its rows. Of points in more than three dimensions the first three coordinates are drawn; missing ones
    /// are 0.
    ///
    /// A point's disc is as large as the distance to the points around it: a cloud has no holes where it is sparse.
    #[must_use]
    pub fn draw(cloud: &PointCloud, paint: &Paint<'_>, marks: &[usize], view: &View) -> Self {
        let empty = Self { width: 0, height: 0, pixels: Vec::new() };
        Self::draw_while(cloud, paint, marks, view, || true).unwrap_or(empty)
    }

    /// The same, for as long as somebody waits for it: `is_wanted` is asked between its stages. `None` when nobody does.
    #[must_use]
    pub fn draw_while(
        cloud: &PointCloud,
        paint: &Paint<'_>,
        marks: &[usize],
        view: &View,
        is_wanted: impl Fn() -> bool,
    ) -> Option<Self> {
        let go_on = || is_wanted().then_some(());
        let camera = Camera::new(cloud, view, OVERSAMPLING);
        let places: Vec<Option<[f32; 3]>> =
            (0..cloud.len()).into_par_iter().map(|row| camera.project(cloud.point(row))).collect();
        let scale = paint.scale();
        let (triangles, is_corner) = triangles::of_cloud(cloud, &places, scale.as_ref());
        go_on()?;
        let mut raster = Raster::new(camera.width(), camera.height());
        raster.fill(&triangles, scale.as_ref().map(|scale| &scale.map));
        go_on()?;
        if triangles.is_empty() || is_corner.contains(&false) {
            let splats = splats(cloud, &camera, &places, &is_corner, scale.as_ref());
            go_on()?;
            raster.splat(&splats);
        }
        go_on()?;
        let mut shade = shading::shade(&raster);
        let radius = (MARK_RADIUS * camera.width().min(camera.height()) as f64).max(3.0) as f32;
        let (ranks, marks): (Vec<usize>, Vec<Splat>) = (1..)
            .zip(marks)
            .filter_map(|(rank, &row)| Some((rank, Splat { at: places[row]?, radius, color: color::MARK })))
            .unzip();
        let seen = raster.mark(&marks, &mut shade);
        go_on()?;
        let mut picture = raster.picture(&shade, OVERSAMPLING, view.background);
        for ((rank, mark), _) in ranks.into_iter().zip(marks).zip(seen).filter(|(_, seen)| *seen) {
            picture.number(rank, mark);
        }
        Some(picture)
    }

    /// Writes a mark's number on it.
    fn number(&mut self, rank: usize, mark: Splat) {
        let [x, y, radius] = [mark.at[0], mark.at[1], mark.radius].map(|pixels| pixels / OVERSAMPLING as f32);
        if radius < NUMBERED {
            return;
        }
        let text = rank.to_string();
        let size = radius * [1.5, 1.25, 0.95][(text.len() - 1).min(2)];
        let ink = letters::Ink { size, color: [255; 3] };
        letters::write(self, &text, [x, y + 0.31 * size], letters::Align::Middle, ink);
    }
}

/// A disc for every row with a place that is not a corner of a triangle.
fn splats(
    cloud: &PointCloud,
    camera: &Camera,
    places: &[Option<[f32; 3]>],
    is_corner: &[bool],
    scale: Option<&Scale<'_>>,
) -> Vec<Splat> {
    let radii = spacing::radii(cloud);
    let radius = |row: usize| camera.radius_in_pixels(radii.as_ref().map(|radii| f64::from(radii[row])));
    let color = |row: usize| scale.map_or(color::PLAIN, |scale| scale.color(row));
    (0..cloud.len())
        .into_par_iter()
        .filter(|&row| !is_corner[row])
        .filter_map(|row| Some(Splat { at: places[row]?, radius: radius(row), color: color(row) }))
        .collect()
}

/// Numbers with the colors that stand for them.
pub(crate) struct Scale<'a> {
    values: &'a [f64],
    map: Map,
    /// The value of the first color, and that of the last.
    low: f64,
    high: f64,
    /// Whether some rows have no value.
    is_gappy: bool,
}

impl Scale<'_> {
    /// Place of a row's value in the map of colors; NaN without a value.
    fn share(&self, row: usize) -> f64 {
        let value = self.values.get(row).copied().unwrap_or(f64::NAN);
        (value - self.low) / (self.high - self.low).max(f64::MIN_POSITIVE)
    }

    fn color(&self, row: usize) -> Rgb {
        let share = self.share(row);
        if share.is_nan() { color::ABSENT } else { self.map.at(share) }
    }
}

impl Paint<'_> {
    /// The values and their colors; `None` when all rows are alike.
    pub(crate) fn scale(&self) -> Option<Scale<'_>> {
        let (values, map, [low, high]) = match *self {
            Self::Plain => return None,
            Self::Diverging(values) => {
                let most = magnitude(values);
                (values, Map::diverging(), [-most, most])
            }
            Self::Sequential(values) => (values, Map::sequential(), extent(values).into()),
        };
        Some(Scale { values, map, low, high, is_gappy: values.iter().any(|value| value.is_nan()) })
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

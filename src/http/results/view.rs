//! Pictures of clouds.

use crate::cloud::PointCloud;
use crate::http::wire::download;
use crate::http::wire::problem::Problem;
use crate::jobs::Wanted;
use crate::picture::{Legend, Paint, Picture, View};

/// Bytes of a point as it is projected, shaded, sorted into bands and drawn.
const DRAWN_POINT_BYTES: u64 = 96;
/// Bytes of a pixel: four samples of a depth, a grain, a facing, a color in three numbers and a shade; and the four bytes
/// that are made of them, twice, beside what they are packed into.
const DRAWN_PIXEL_BYTES: u64 = 4 * 28 + 2 * 4 + 4;

/// Bytes of memory that drawing a cloud takes beside the cloud: discs and their places, depth and color of
/// every pixel, and the pixels as they are sent.
pub(crate) fn bytes(view: &View, points: u64) -> u64 {
    points * DRAWN_POINT_BYTES + (view.width * view.height) as u64 * DRAWN_PIXEL_BYTES
}

/// Everything that decides what a picture looks like, for its tag.
pub(crate) fn key(view: &View) -> String {
    format!("{view:?}")
}

/// Draws a picture as a PNG file; its title is that of the color bar too.
///
/// # Errors
/// A problem: its client has left, or it cannot be written.
pub(crate) fn png(
    cloud: &PointCloud,
    paint: &Paint<'_>,
    marks: &[usize],
    view: &View,
    title: &str,
    wanted: &Wanted,
) -> Result<Vec<u8>, Problem> {
    png_with(cloud, paint, marks, view, (title, &Legend { title, unit: "" }), wanted)
}

/// The same with a color bar of its own.
///
/// # Errors
/// As [`png`].
pub(crate) fn png_with(
    cloud: &PointCloud,
    paint: &Paint<'_>,
    marks: &[usize],
    view: &View,
    (title, legend): (&str, &Legend<'_>),
    wanted: &Wanted,
) -> Result<Vec<u8>, Problem> {
    let drawn = Picture::draw_while(cloud, paint, marks, view, || wanted.is_wanted());
    let mut picture = drawn.ok_or_else(download::abandoned)?;
    if view.legend {
        picture.add_legend(legend, paint, view.background);
    }
    picture.to_png(title).map_err(|error| Problem::internal(&error))
}

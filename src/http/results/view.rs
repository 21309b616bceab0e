//! From where a picture is looked at, as arguments.

use crate::cloud::PointCloud;
use crate::http::wire::problem::Problem;
use crate::http::wire::query::{Accepts, Argument, Arguments};
use crate::picture::{Background, Legend, Paint, Picture, Up, View};

/// Most pixels along either side.
const SIDE_MAX: u64 = 2048;

/// Bytes of a point as it is projected, shaded, sorted into bands and drawn.
const DRAWN_POINT_BYTES: u64 = 96;
/// Bytes of a pixel: two depths, a color in three numbers, four bytes, and what they are packed into.
const DRAWN_PIXEL_BYTES: u64 = 32;

/// The arguments that every picture takes.
pub(crate) const VIEW: &[Argument] = &[
    Argument {
        name: "azimuth",
        alias: None,
        accepts: Accepts::Range(-360.0, 360.0),
        default: "-60",
        meaning: "Of pictures (png): degrees about the axis that points up, as in Matplotlib.",
    },
    Argument {
        name: "elevation",
        alias: None,
        accepts: Accepts::Range(-90.0, 90.0),
        default: "20",
        meaning: "Of pictures: degrees above the plane of the other two axes.",
    },
    Argument {
        name: "up",
        alias: None,
        accepts: Accepts::Word(&Up::NAMES),
        default: "z",
        meaning: "Of pictures: the axis that points up.",
    },
    Argument {
        name: "width",
        alias: None,
        accepts: Accepts::Integer(1, SIDE_MAX),
        default: "800",
        meaning: "Of pictures: pixels of a row.",
    },
    Argument {
        name: "height",
        alias: None,
        accepts: Accepts::Integer(1, SIDE_MAX),
        default: "600",
        meaning: "Of pictures: rows of pixels.",
    },
    Argument {
        name: "background",
        alias: None,
        accepts: Accepts::Word(&Background::NAMES),
        default: "white",
        meaning: "Of pictures: what is behind the points.",
    },
    Argument {
        name: "legend",
        alias: None,
        accepts: Accepts::Switch,
        default: "false",
        meaning: "Of pictures that are colored by numbers: adds the color bar with values, what is shown and its unit.",
    },
];

/// The view that the arguments of [`VIEW`] describe.
pub(crate) fn read(arguments: &Arguments) -> View {
    let default = View::default();
    View {
        azimuth: arguments.number("azimuth").unwrap_or(default.azimuth),
        elevation: arguments.number("elevation").unwrap_or(default.elevation),
        up: arguments.word("up").and_then(Up::from_name).unwrap_or(default.up),
        width: arguments.integer("width").map_or(default.width, |pixels| pixels as usize),
        height: arguments.integer("height").map_or(default.height, |pixels| pixels as usize),
        background: arguments
            .word("background")
            .and_then(Background::from_name)
            .unwrap_or(default.background),
        legend: arguments.switch("legend").unwrap_or(default.legend),
    }
}

/// Bytes of memory that drawing a cloud of so many points takes beside the cloud: discs and their places, depth and color of
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
/// A problem of ours when it cannot be written.
pub(crate) fn png(
    cloud: &PointCloud,
    paint: &Paint<'_>,
    marks: &[usize],
    view: &View,
    title: &str,
) -> Result<Vec<u8>, Problem> {
    png_with(cloud, paint, marks, view, (title, &Legend { title, unit: "" }))
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
) -> Result<Vec<u8>, Problem> {
    let mut picture = Picture::draw(cloud, paint, marks, view);
    if view.legend {
        picture.add_legend(legend, paint, view.background);
    }
    picture.to_png(title).map_err(|error| Problem::internal(&error))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stated_defaults_are_the_defaults() {
        let query = VIEW.iter().map(|argument| format!("{}={}", argument.name, argument.default));
        let uri = format!("/x?{}", query.collect::<Vec<_>>().join("&")).parse().unwrap();
        assert_eq!(read(&Arguments::from_query(&uri, &[VIEW]).unwrap()), View::default());
    }
}

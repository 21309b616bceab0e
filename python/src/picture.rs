//! Pictures of clouds.

use chladni::picture::{Background, Legend, Paint, Picture, Up, View, legend_of_basis};
use numpy::{PyReadonlyArray1, PyUntypedArrayMethods};
use pyo3::prelude::*;
use pyo3::types::PyBytes;

use crate::cloud::Cloud;
use crate::words::word;
use crate::{refused, threads};

/// Most pixels of a side.
const SIDE_MAX: usize = 16_384;

/// What the colors stand for: a basis with its number and λ, which may have either sign; or a title of the caller's.
#[derive(FromPyObject)]
pub(crate) enum Shown {
    Basis((usize, Option<f64>)),
    Values(String),
}

/// From where and how large; what is absent is the view of the command line.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub(crate) struct Sight {
    azimuth: Option<f64>,
    elevation: Option<f64>,
    up: Option<String>,
    width: Option<usize>,
    height: Option<usize>,
    background: Option<String>,
    legend: bool,
}

impl Sight {
    fn view(&self) -> PyResult<View> {
        let default = View::default();
        let up = self.up.as_deref().map(|up| word("up", up, &Up::NAMES, Up::from_name)).transpose()?;
        let background = self
            .background
            .as_deref()
            .map(|background| word("background", background, &Background::NAMES, Background::from_name));
        let view = View {
            azimuth: self.azimuth.unwrap_or(default.azimuth),
            elevation: self.elevation.unwrap_or(default.elevation),
            up: up.unwrap_or(default.up),
            width: self.width.unwrap_or(default.width),
            height: self.height.unwrap_or(default.height),
            background: background.transpose()?.unwrap_or(default.background),
            legend: self.legend,
        };
        if [view.width, view.height].iter().any(|side| !(1..=SIDE_MAX).contains(side)) {
            return Err(refused(format!("width and height must be from 1 to {SIDE_MAX} pixels")));
        }
        if !(view.azimuth.is_finite() && view.elevation.is_finite()) {
            return Err(refused("azimuth and elevation must be finite numbers of degrees"));
        }
        Ok(view)
    }
}

/// Draws a cloud, colored by one value per row, as PNG.
#[pyfunction]
#[pyo3(signature = (cloud, values, shown, sight))]
pub(crate) fn draw<'py>(
    py: Python<'py>,
    cloud: &Bound<'py, Cloud>,
    values: Option<PyReadonlyArray1<'py, f64>>,
    shown: Shown,
    sight: Sight,
) -> PyResult<Bound<'py, PyBytes>> {
    let view = sight.view()?;
    let cloud = &*cloud.get().inner;
    if let Some(values) = values.as_ref().filter(|values| values.len() != cloud.len()) {
        return Err(refused(format!(
            "values has {} numbers; the cloud has {} points",
            values.len(),
            cloud.len()
        )));
    }
    let paint = match (&values, &shown) {
        (Some(values), Shown::Basis(_)) => Paint::Diverging(values.as_slice()?),
        (Some(values), Shown::Values(_)) => Paint::Sequential(values.as_slice()?),
        (None, _) => Paint::Plain,
    };
    let (title, unit) = match shown {
        Shown::Basis((index, eigenvalue)) => (legend_of_basis(index, eigenvalue), "1/length"),
        Shown::Values(title) => (title, ""),
    };
    let png = threads::detached(py, || {
        let mut picture = Picture::draw(cloud, &paint, &[], &view);
        if view.legend {
            picture.add_legend(&Legend { title: &title, unit }, &paint, view.background);
        }
        picture.to_png("chladni").map_err(refused)
    })?;
    Ok(PyBytes::new(py, &png))
}

//! Pictures of clouds.

use chladni::picture::{Legend, Paint, Picture, View, legend_of_basis};
use numpy::{PyReadonlyArray1, PyUntypedArrayMethods};
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict};

use crate::arguments;
use crate::cloud::Cloud;
use crate::{refused, threads};

/// What the colors stand for: a basis with its number and λ, which may have either sign; or a title of the caller's.
#[derive(FromPyObject)]
pub(crate) enum Shown {
    Basis((usize, Option<f64>)),
    Values(String),
}

/// Draws a cloud, colored by one value per row, as PNG; `view` is that of the command line.
#[pyfunction]
#[pyo3(signature = (cloud, values, shown, view))]
pub(crate) fn draw<'py>(
    py: Python<'py>,
    cloud: &Bound<'py, Cloud>,
    values: Option<PyReadonlyArray1<'py, f64>>,
    shown: Shown,
    view: &Bound<'py, PyDict>,
) -> PyResult<Bound<'py, PyBytes>> {
    let view: View = arguments::read(view)?;
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

//! Sample shapes with known geometry.

use chladni::cloud::shapes::{self, SampleRequest, Sampling, Shape};
use pyo3::prelude::*;

use crate::arguments::named;
use crate::cloud::Cloud;
use crate::{refused, threads};

/// Draws a number of points from a shape.
#[pyfunction]
#[pyo3(signature = (shape, points, sampling, noise, seed, angle))]
pub(crate) fn sample(
    py: Python<'_>,
    shape: &str,
    points: usize,
    sampling: &str,
    noise: f64,
    seed: u64,
    angle: f64,
) -> PyResult<Cloud> {
    let shape = named("shape", shape, &Shape::ALL.map(Shape::name), Shape::from_name)?;
    let sampling = named("sampling", sampling, &Sampling::ALL.map(Sampling::name), Sampling::from_name)?;
    let request = SampleRequest { shape, points, sampling, noise, seed, angle };
    threads::detached(py, || Ok(shapes::sample(&request).map_err(refused)?.into()))
}

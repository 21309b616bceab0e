//! What the bases are for: transform, filters, signatures, distances, feature points, invariants, pictures.
//!
//! Bases stay in NumPy's memory, row by row; the library works on columns, so that blocks of rows are turned as they are
//! needed. The blocks are those of the command line: the same numbers come out, to the last bit.

use chladni::analysis::Report;
use chladni::harmonics::distances::DistanceRequest;
use chladni::harmonics::features::{self as salient, Feature, FeatureRequest};
use chladni::harmonics::functions::first_nonfinite;
use chladni::harmonics::shape_dna::{self, Comparison};
use chladni::harmonics::signatures::SignatureRequest;
use chladni::harmonics::{
    Block, Distance, Filter, Function, Neighborhoods, Signature, Transfer, Transformed, filtered, invariants,
    transform,
};
use numpy::{PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2, PyUntypedArrayMethods};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use rayon::prelude::*;

use crate::cloud::Cloud;
use crate::{arguments, refused, threads};

/// Rows that are worked on together.
const BLOCK_ROWS: usize = 8192;

/// Report and eigenvalues of a set of bases.
#[pyclass(frozen, module = "chladni._chladni")]
pub(crate) struct Modes {
    report: Report,
    modes: chladni::harmonics::Modes,
}

/// Bases in rows.
#[derive(Clone, Copy)]
struct Rows<'a> {
    values: &'a [f64],
    bases: usize,
}

impl<'a> Rows<'a> {
    fn of(vectors: &'a PyReadonlyArray2<'_, f64>) -> PyResult<Self> {
        Ok(Self { values: vectors.as_slice()?, bases: vectors.shape()[1] })
    }

    /// What `work` makes of every block of rows, in their order.
    fn map<T: Send>(self, work: impl Fn(&Block<Vec<f64>>) -> T + Sync) -> Vec<T> {
        let blocks = self.values.par_chunks(BLOCK_ROWS * self.bases.max(1)).enumerate();
        let turned = |(number, rows): (usize, &[f64])| {
            let column = |j: usize| rows.iter().skip(j).step_by(self.bases).copied().collect();
            work(&Block { first: number * BLOCK_ROWS, columns: (0..self.bases).map(column).collect() })
        };
        blocks.map(turned).collect()
    }

    /// Columns of all rows, from those that `work` makes of every block, as n × m row by row.
    fn columns(self, work: impl Fn(&Block<Vec<f64>>) -> Vec<Vec<f64>> + Sync) -> (Vec<f64>, usize) {
        let blocks = self.map(work);
        let count = blocks.first().map_or(0, Vec::len);
        let rows = blocks.iter().flat_map(|columns| {
            let length = columns.first().map_or(0, Vec::len);
            (0..length).flat_map(move |row| columns.iter().map(move |column| column[row]))
        });
        (rows.collect(), count)
    }

    fn basis(self, j: usize) -> Vec<f64> {
        self.values.iter().skip(j).step_by(self.bases).copied().collect()
    }
}

#[pymethods]
impl Modes {
    /// From a report as JSON.
    #[new]
    fn new(report: &str) -> PyResult<Self> {
        let report: Report = serde_json::from_str(report).map_err(refused)?;
        let spectrum =
            report.spectrum.as_ref().ok_or_else(|| refused("the report is of an operator without bases"))?;
        let modes = chladni::harmonics::Modes::of(spectrum);
        Ok(Self { report, modes })
    }

    /// Coefficients (k × m) of functions (n × m).
    #[staticmethod]
    fn transform<'py>(
        py: Python<'py>,
        vectors: PyReadonlyArray2<'py, f64>,
        mass: PyReadonlyArray1<'py, f64>,
        functions: PyReadonlyArray2<'py, f64>,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let (rows, mass) = (Rows::of(&vectors)?, mass.as_slice()?);
        let functions = columns_of(&functions, mass)?;
        let found = threads::detached(py, || Ok(transformed(rows, mass, &functions)))?;
        let (count, width) = (rows.bases, found.len());
        let flat =
            (0..count).flat_map(|i| found.iter().map(move |function| function.coefficients[i])).collect();
        array(py, flat, [count, width])
    }

    /// Functions (n × m) from coefficients (at most k × m).
    #[staticmethod]
    fn synthesize<'py>(
        py: Python<'py>,
        vectors: PyReadonlyArray2<'py, f64>,
        coefficients: PyReadonlyArray2<'py, f64>,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let rows = Rows::of(&vectors)?;
        let (count, width) = (coefficients.shape()[0], coefficients.shape()[1]);
        if count > rows.bases {
            return Err(refused(format!("{count} coefficients for {} bases", rows.bases)));
        }
        let values = coefficients.as_slice()?;
        let lists: Vec<Vec<f64>> =
            (0..width).map(|j| values.iter().skip(j).step_by(width).copied().collect()).collect();
        let lists: Vec<&[f64]> = lists.iter().map(Vec::as_slice).collect();
        let (flat, width) =
            threads::detached(py, || Ok(rows.columns(|block| transform::synthesize(block, &lists))))?;
        array(py, flat, [vectors.shape()[0], width])
    }

    /// Gain of every mode, and the factor on what lies outside of the span of the bases.
    fn transfer(&self, filter: &Bound<'_, PyDict>) -> PyResult<(Vec<f64>, f64)> {
        let filter: Filter = arguments::read(filter)?;
        let transfer = filter.transfer(&self.modes).map_err(refused)?;
        Ok((transfer.gains, transfer.outside))
    }

    /// Functions (n × m) filtered by gains; modes behind their end are treated as what lies outside.
    fn filter<'py>(
        &self,
        py: Python<'py>,
        vectors: PyReadonlyArray2<'py, f64>,
        mass: PyReadonlyArray1<'py, f64>,
        functions: PyReadonlyArray2<'py, f64>,
        gains: Vec<f64>,
        outside: f64,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let (rows, mass) = (Rows::of(&vectors)?, mass.as_slice()?);
        let functions = columns_of(&functions, mass)?;
        let transfer = Transfer::from_gains(gains, outside, &self.modes).map_err(refused)?;
        let (flat, width) = threads::detached(py, || {
            let found = transformed(rows, mass, &functions);
            Ok(rows.columns(|block| filtered::rows(block, &functions, &found, &transfer)))
        })?;
        array(py, flat, [vectors.shape()[0], width])
    }

    /// `count` times (`hks`) or energies (`wks`), spread over the spectrum.
    fn scales(&self, request: &Bound<'_, PyDict>) -> PyResult<Vec<f64>> {
        Ok(self.signature_of(request, None)?.scales)
    }

    /// Heat or wave kernel signatures (n × s) at given scales, or at those of the request, spread over the spectrum.
    #[pyo3(signature = (vectors, request, scales))]
    fn signature<'py>(
        &self,
        py: Python<'py>,
        vectors: PyReadonlyArray2<'py, f64>,
        request: &Bound<'py, PyDict>,
        scales: Option<Vec<f64>>,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let signature = self.signature_of(request, scales)?;
        let rows = Rows::of(&vectors)?;
        let (flat, width) = threads::detached(py, || Ok(rows.columns(|block| signature.values(block))))?;
        array(py, flat, [vectors.shape()[0], width])
    }

    /// Distances of all rows from one.
    fn distances<'py>(
        &self,
        py: Python<'py>,
        vectors: PyReadonlyArray2<'py, f64>,
        request: &Bound<'py, PyDict>,
    ) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let DistanceRequest { from: row, kind, time } = arguments::read(request)?;
        let rows = Rows::of(&vectors)?;
        let origin = rows.values.get(row * rows.bases..(row + 1) * rows.bases);
        let origin = origin.ok_or_else(|| refused(format!("row {row}: there are {}", vectors.shape()[0])))?;
        let distance = Distance::from(kind, origin.to_vec(), time, &self.modes);
        let distance = distance
            .ok_or_else(|| refused(format!("row {row} has no result, or no eigenvalue is above 0")))?;
        let blocks = threads::detached(py, || Ok(rows.map(|block| distance.values(block))))?;
        Ok(PyArray1::from_vec(py, blocks.concat()))
    }

    /// Feature points as JSON, most persistent first.
    fn features(
        &self,
        py: Python<'_>,
        cloud: &Bound<'_, Cloud>,
        vectors: PyReadonlyArray2<'_, f64>,
        mass: PyReadonlyArray1<'_, f64>,
        request: &Bound<'_, PyDict>,
    ) -> PyResult<String> {
        let wanted: FeatureRequest = arguments::read(request)?;
        let (cloud, rows, mass) = (&*cloud.get().inner, Rows::of(&vectors)?, mass.as_slice()?);
        let radius = wanted.radius(self.report.sampling.epsilon);
        threads::detached(py, || {
            let neighborhoods = Neighborhoods::find(cloud, mass, radius).map_err(refused)?;
            let area: f64 = mass.iter().filter(|mass| !mass.is_nan()).sum();
            let count = wanted.modes(self.modes.len());
            let first = self.modes.zero_modes().min(count);
            let extrema: Vec<_> = (first..count)
                .into_par_iter()
                .map(|j| salient::extrema(&rows.basis(j), &neighborhoods, area))
                .collect();
            let mut places = salient::features(&extrema, first, &neighborhoods, wanted.persistence);
            places.truncate(wanted.limit.unwrap_or(usize::MAX));
            let found: Vec<Feature> =
                places.iter().map(|place| place.in_cloud(&neighborhoods, cloud)).collect();
            serde_json::to_string(&found).map_err(refused)
        })
    }

    /// Area, boundary length and Euler characteristic as JSON.
    fn invariants(&self) -> PyResult<String> {
        if !self.report.is_of_surface() {
            return Err(refused(
                "invariants are those of surfaces; graphs, curves and volumes have other heat traces",
            ));
        }
        serde_json::to_string(&invariants::measure(&self.modes, &self.report.sampling)).map_err(refused)
    }

    /// Distance of two spectra (`ShapeDNA`) as JSON.
    fn similarity(&self, other: &Bound<'_, Self>, comparison: &Bound<'_, PyDict>) -> PyResult<String> {
        let Comparison { modes, sized } = arguments::read(comparison)?;
        let other = other.get();
        let areas = [self.report.sampling.area, other.report.sampling.area];
        let found = shape_dna::compare([&self.modes, &other.modes], areas, sized, modes);
        let found = found.ok_or_else(|| refused("one of the spectra has no eigenvalue above 0"))?;
        serde_json::to_string(&found).map_err(refused)
    }
}

impl Modes {
    fn signature_of(&self, request: &Bound<'_, PyDict>, scales: Option<Vec<f64>>) -> PyResult<Signature> {
        let request: SignatureRequest = arguments::read(request)?;
        let signature = match scales {
            Some(scales) => Signature::at(request.kind, scales, &self.modes)
                .map(|signature| if request.scaled { signature.scaled() } else { signature }),
            None => Signature::of(request, &self.modes),
        };
        signature.ok_or_else(|| {
            refused(
                "scales must be finite numbers, times above 0, and one mode must have an eigenvalue above 0",
            )
        })
    }
}

fn transformed(rows: Rows<'_>, mass: &[f64], functions: &[Function]) -> Vec<Transformed> {
    let values: Vec<&[f64]> = functions.iter().map(|function| function.values.as_slice()).collect();
    transform::total(&rows.map(|block| transform::partial(block, mass, &values)))
}

/// The columns of functions (n × m), finite wherever there is mass.
fn columns_of(functions: &PyReadonlyArray2<'_, f64>, mass: &[f64]) -> PyResult<Vec<Function>> {
    let (rows, count) = (functions.shape()[0], functions.shape()[1]);
    if rows != mass.len() {
        return Err(refused(format!("functions have {rows} rows; the cloud has {}", mass.len())));
    }
    let all = functions.as_slice()?;
    let column = |j: usize| {
        let values: Vec<f64> = all.iter().skip(j).step_by(count).copied().collect();
        match first_nonfinite(&values, mass) {
            Some(row) => Err(refused(format!("function {j} is not finite in row {row}"))),
            None => Ok(Function::new(j.to_string(), values)),
        }
    };
    (0..count).map(column).collect()
}

fn array(py: Python<'_>, values: Vec<f64>, shape: [usize; 2]) -> PyResult<Bound<'_, PyArray2<f64>>> {
    PyArray1::from_vec(py, values).reshape(shape)
}

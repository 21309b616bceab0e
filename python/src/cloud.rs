//! Point clouds: from arrays and files, and back.

use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use chladni::cloud::reader::{self, Format, Limits, ReadRequest};
use chladni::cloud::writer::{self, PlyEncoding};
use chladni::cloud::{Grid, NonFinite, Origin, PointCloud, ScalarField, ScalarType};
use numpy::{PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2, PyUntypedArrayMethods};
use pyo3::exceptions::PyOSError;
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict};

use crate::arguments::{self, named};
use crate::bases_ply::write_bases_ply;
use crate::{refused, threads};

/// A point cloud with its fields and faces, as the library holds it. It never changes.
#[pyclass(frozen, module = "chladni._chladni")]
pub(crate) struct Cloud {
    pub(crate) inner: Arc<PointCloud>,
}

impl From<PointCloud> for Cloud {
    fn from(cloud: PointCloud) -> Self {
        Self { inner: Arc::new(cloud) }
    }
}

#[pymethods]
impl Cloud {
    /// A cloud from n × d coordinates, the type in which they are written, and, for a mesh, m × 3 corners.
    #[staticmethod]
    #[pyo3(signature = (points, kind, faces, nonfinite))]
    fn from_arrays(
        py: Python<'_>,
        points: PyReadonlyArray2<'_, f64>,
        kind: &str,
        faces: Option<PyReadonlyArray2<'_, i64>>,
        nonfinite: &str,
    ) -> PyResult<Self> {
        let (dimension, kind, policy) = (points.shape()[1], scalar_type(kind)?, policy(nonfinite)?);
        let coordinates = points.as_slice()?;
        let faces = faces.as_ref().map(triangles).transpose()?;
        threads::detached(py, || {
            let cloud = PointCloud::new(dimension, coordinates.to_vec(), policy).map_err(refused)?;
            let cloud = cloud.with_coordinate_type(kind);
            let cloud = faces.map_or(Ok(cloud.clone()), |faces| cloud.with_faces(faces)).map_err(refused)?;
            Ok(cloud.into())
        })
    }

    /// Reads a file; how, is said as on the command line.
    #[staticmethod]
    fn read(py: Python<'_>, path: PathBuf, reading: &Bound<'_, PyDict>) -> PyResult<Self> {
        let reading: ReadRequest = arguments::read(reading)?;
        let options = reading.options(Limits::OF_THE_MACHINE);
        threads::detached(py, || {
            let bytes = std::fs::read(&path).map_err(|error| of_file(&path, &error))?;
            let refused = |error: &dyn std::fmt::Display| refused(format!("{}: {error}", path.display()));
            let name = path.file_name().and_then(|name| name.to_str());
            let Some(format) = reading.format.or_else(|| Format::of_file(name, &bytes)) else {
                return Err(match reader::foreign(&bytes) {
                    Some(error) => refused(&error),
                    None => {
                        refused(&format!("unknown format; name it with format= ({})", names().join(", ")))
                    }
                });
            };
            Ok(reader::read(&bytes, format, &options).map_err(|error| refused(&error))?.into())
        })
    }

    /// Writes a file; the format follows from its name unless it is given.
    #[pyo3(signature = (path, format, ascii))]
    fn write(&self, py: Python<'_>, path: PathBuf, format: Option<&str>, ascii: bool) -> PyResult<()> {
        let format = written_format(&path, format, ascii)?;
        let cloud = &*self.inner;
        threads::detached(py, || {
            let file = File::create(&path).map_err(|error| of_file(&path, &error))?;
            let mut out = BufWriter::new(file);
            let written = if ascii {
                writer::write_ply(cloud, PlyEncoding::Ascii, &mut out)
            } else {
                writer::write(cloud, format, &mut out)
            };
            written.and_then(|()| out.flush()).map_err(|error| of_file(&path, &error))
        })
    }

    /// The bytes of a binary PLY file with fields and faces.
    fn to_ply<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyBytes>> {
        let cloud = &*self.inner;
        let bytes = threads::detached(py, || {
            let mut bytes = Vec::new();
            writer::write(cloud, Format::Ply, &mut bytes).map_err(refused)?;
            Ok(bytes)
        })?;
        Ok(PyBytes::new(py, &bytes))
    }

    /// Writes a binary PLY with a single-precision property `basis_j` per column of `vectors`.
    fn write_bases(&self, py: Python<'_>, path: PathBuf, vectors: PyReadonlyArray2<'_, f64>) -> PyResult<()> {
        let (rows, bases) = (vectors.shape()[0], vectors.shape()[1]);
        if rows != self.inner.len() {
            return Err(refused(format!("vectors have {rows} rows; the cloud has {}", self.inner.len())));
        }
        let (cloud, values) = (&*self.inner, vectors.as_slice()?);
        threads::detached(py, || {
            write_bases_ply(cloud, values, bases, &path).map_err(|error| of_file(&path, &error))
        })
    }

    /// The same cloud with these fields in place of its own: names, types and one array each.
    fn with_fields(&self, fields: Vec<(String, String, PyReadonlyArray1<'_, f64>)>) -> PyResult<Self> {
        let field = |(name, kind, values): (String, String, PyReadonlyArray1<'_, f64>)| {
            Ok(ScalarField { name, kind: scalar_type(&kind)?, values: values.as_slice()?.to_vec().into() })
        };
        let fields = fields.into_iter().map(field).collect::<PyResult<Vec<_>>>()?;
        Ok(PointCloud::clone(&self.inner).with_fields(fields).map_err(refused)?.into())
    }

    /// The same cloud with what a file told beside points, fields and triangles: polygons, grids, and the rest as JSON.
    fn with_origin(
        &self,
        continued: Vec<u32>,
        grids: Option<[(f64, f64); 3]>,
        origin: &str,
    ) -> PyResult<Self> {
        let origin: Origin = serde_json::from_str(origin).map_err(refused)?;
        let grids = grids.map(|grids| grids.map(|(scale, offset)| Grid { scale, offset }));
        let cloud = PointCloud::clone(&self.inner).with_grids(grids).with_origin(origin);
        Ok(cloud.with_polygons(continued).map_err(refused)?.into())
    }

    /// What [`Self::with_origin`] takes.
    #[allow(clippy::type_complexity)] // the arguments of another function
    fn origin(&self) -> PyResult<(Vec<u32>, Option<[(f64, f64); 3]>, String)> {
        let origin = serde_json::to_string(self.inner.origin()).map_err(refused)?;
        Ok((self.inner.continued().to_vec(), self.grids(), origin))
    }

    /// Coordinates, n × d.
    fn points<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let shape = [self.inner.len(), self.inner.dimension()];
        PyArray1::from_slice(py, self.inner.coordinates()).reshape(shape)
    }

    /// Type in which the coordinates are written.
    fn kind(&self) -> PyResult<String> {
        scalar_name(self.inner.coordinate_type())
    }

    /// Number of coordinates d.
    fn dimension(&self) -> usize {
        self.inner.dimension()
    }

    /// Triangles, m × 3.
    fn faces<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<i64>>> {
        let corners = self.inner.faces().as_flattened().iter().map(|&corner| i64::from(corner));
        PyArray1::from_iter(py, corners).reshape([self.inner.faces().len(), 3])
    }

    /// Name and type of every field.
    fn field_types(&self) -> PyResult<Vec<(String, String)>> {
        self.inner.fields().iter().map(|field| Ok((field.name.clone(), scalar_name(field.kind)?))).collect()
    }

    /// Values of a field, by its place.
    fn field<'py>(&self, py: Python<'py>, place: usize) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let field = self.inner.fields().get(place).ok_or_else(|| refused(format!("no field {place}")))?;
        Ok(PyArray1::from_slice(py, &field.values))
    }

    /// Scale and offset of x, y and z, for files of scaled integers.
    fn grids(&self) -> Option<[(f64, f64); 3]> {
        self.inner.grids().map(|grids| grids.map(|grid| (grid.scale, grid.offset)))
    }

    /// What was left out of the file, and what was not taken word for word; a sentence each.
    fn notes(&self) -> Vec<String> {
        self.inner.origin().notes.clone()
    }

    fn __len__(&self) -> usize {
        self.inner.len()
    }
}

/// An error of a file: the exception that Python has for it, with the file's name.
fn of_file(path: &Path, error: &std::io::Error) -> PyErr {
    match error.raw_os_error() {
        // with number and name Python chooses FileNotFoundError, PermissionError and their like
        Some(number) => PyOSError::new_err((number, without_number(error), path.to_owned())),
        None if error.kind() == std::io::ErrorKind::Unsupported => refused(error),
        None => PyOSError::new_err(format!("{}: {error}", path.display())),
    }
}

fn without_number(error: &std::io::Error) -> String {
    let text = error.to_string();
    text.split(" (os error").next().unwrap_or(&text).to_owned()
}

fn policy(nonfinite: &str) -> PyResult<NonFinite> {
    named("nonfinite", nonfinite, &["reject", "drop"], |word| match word {
        "reject" => Some(NonFinite::Reject),
        "drop" => Some(NonFinite::Drop),
        _ => None,
    })
}

fn scalar_type(name: &str) -> PyResult<ScalarType> {
    serde_json::from_value(name.into()).map_err(refused)
}

fn scalar_name(kind: ScalarType) -> PyResult<String> {
    serde_json::to_value(kind).and_then(serde_json::from_value).map_err(refused)
}

fn triangles(faces: &PyReadonlyArray2<'_, i64>) -> PyResult<Vec<[u32; 3]>> {
    if faces.shape()[1] != 3 {
        return Err(refused(format!("faces must have the shape (m, 3), not {:?}", faces.shape())));
    }
    let corner = |&corner: &i64| {
        u32::try_from(corner)
            .map_err(|_| refused(format!("faces must be indices of points from 0, not {corner}")))
    };
    let corners = faces.as_slice()?.iter().map(corner).collect::<PyResult<Vec<u32>>>()?;
    Ok(corners.as_chunks().0.to_vec())
}

fn format_named(name: &str) -> PyResult<Format> {
    named("format", name, &names(), Format::from_name)
}

fn names() -> [&'static str; Format::ALL.len()] {
    Format::ALL.map(Format::name)
}

/// The format of a file to be written.
fn written_format(path: &Path, named: Option<&str>, ascii: bool) -> PyResult<Format> {
    let of_name = || path.extension().and_then(|ending| Format::from_extension(ending.to_str()?));
    let written = Format::WRITTEN.map(Format::name).join(", ");
    let format = match named {
        Some(name) => format_named(name)?,
        None => of_name().ok_or_else(|| {
            refused(format!("{}: unknown format; name it with format= ({written})", path.display()))
        })?,
    };
    if !Format::WRITTEN.contains(&format) {
        return Err(refused(format!("{format} is read, not written; written are {written}")));
    }
    if ascii && format != Format::Ply {
        return Err(refused(format!("ascii is a choice of PLY; {format} has one encoding")));
    }
    Ok(format)
}

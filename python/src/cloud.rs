//! Point clouds: from arrays and files, and back.

use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::PathBuf;
use std::sync::Arc;

use chladni::cloud::reader::{Format, Limits, ReadOptions, read};
use chladni::cloud::writer::{
    Column, PlyEncoding, PlyHeader, encode_column, encode_faces, ply_columns, write, write_ply,
};
use chladni::cloud::{NonFinite, PointCloud, ScalarField, ScalarType};
use numpy::{PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2, PyUntypedArrayMethods};
use pyo3::exceptions::PyOSError;
use pyo3::prelude::*;

use crate::refused;

/// A point cloud with its fields and faces, as the library holds it.
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
    /// A cloud from n × d coordinates and, for a mesh, m × 3 corners.
    #[staticmethod]
    #[pyo3(signature = (points, faces, nonfinite))]
    fn from_arrays(
        py: Python<'_>,
        points: PyReadonlyArray2<'_, f64>,
        faces: Option<PyReadonlyArray2<'_, i64>>,
        nonfinite: &str,
    ) -> PyResult<Self> {
        let dimension = points.shape()[1];
        let coordinates = points.as_slice()?.to_vec();
        let faces = faces.as_ref().map(triangles).transpose()?;
        let policy = policy(nonfinite)?;
        py.detach(move || {
            let cloud = PointCloud::new(dimension, coordinates, policy).map_err(refused)?;
            let cloud = match faces {
                Some(faces) => cloud.with_faces(faces).map_err(refused)?,
                None => cloud,
            };
            Ok(cloud.into())
        })
    }

    /// Reads a file; the format follows from its name or content unless it is given.
    #[staticmethod]
    #[pyo3(signature = (path, format, coordinates, scan, nonfinite))]
    fn read(
        py: Python<'_>,
        path: PathBuf,
        format: Option<&str>,
        coordinates: Option<usize>,
        scan: Option<usize>,
        nonfinite: &str,
    ) -> PyResult<Self> {
        let policy = policy(nonfinite)?;
        let named = format.map(format_named).transpose()?;
        py.detach(move || {
            let shown = path.display();
            let bytes = std::fs::read(&path)?;
            let format = named.or_else(|| of_extension(&path)).or_else(|| Format::sniff(&bytes));
            let format =
                format.ok_or_else(|| refused(format!("{shown}: unknown format; name it: {}", names())))?;
            // The service's limits protect it from strangers; here the caller's own machine is the limit.
            let limits = Limits {
                points_max: u32::MAX as usize,
                faces_max: u32::MAX as usize,
                fields_max: usize::MAX,
                ..Limits::default()
            };
            let options = ReadOptions { policy, dimension: coordinates, scan, limits };
            let cloud =
                read(&bytes, format, &options).map_err(|error| refused(format!("{shown}: {error}")))?;
            Ok(cloud.into())
        })
    }

    /// Writes a file; the format follows from its name unless it is given.
    #[pyo3(signature = (path, format, ascii))]
    fn write(&self, py: Python<'_>, path: PathBuf, format: Option<&str>, ascii: bool) -> PyResult<()> {
        let named = format.map(format_named).transpose()?.or_else(|| of_extension(&path));
        let format = named
            .ok_or_else(|| refused(format!("{}: unknown format; name it: {}", path.display(), names())))?;
        let cloud = Arc::clone(&self.inner);
        py.detach(move || {
            let mut out = BufWriter::new(File::create(&path)?);
            let written = if format == Format::Ply && ascii {
                write_ply(&cloud, PlyEncoding::Ascii, &mut out)
            } else {
                write(&cloud, format, &mut out)
            };
            written.and_then(|()| out.flush()).map_err(|error| match error.kind() {
                std::io::ErrorKind::Unsupported => refused(error),
                _ => PyOSError::new_err(error.to_string()),
            })
        })
    }

    /// Writes a binary PLY with a single-precision property `basis_j` per column of `vectors`.
    fn write_bases(&self, path: PathBuf, vectors: PyReadonlyArray2<'_, f64>) -> PyResult<()> {
        let (rows, bases) = (vectors.shape()[0], vectors.shape()[1]);
        if rows != self.inner.len() {
            return Err(refused(format!("vectors have {rows} rows; the cloud has {}", self.inner.len())));
        }
        let (cloud, values) = (&*self.inner, vectors.as_slice()?);
        let (encoding, kind) = (PlyEncoding::BinaryLittleEndian, ScalarType::Float32);
        let header = (0..bases).fold(PlyHeader::of(cloud, encoding), |header, j| {
            header.with_property(format!("basis_{j}"), kind)
        });
        let width = header.stride();
        let mut encoded = vec![0; rows * width];
        let mut offset = 0;
        for column in ply_columns(cloud, 0) {
            encode_column(column, &mut encoded, width, offset);
            offset += column.kind.size();
        }
        for j in 0..bases {
            encode_column(Column { values: &values[j..], stride: bases, kind }, &mut encoded, width, offset);
            offset += kind.size();
        }
        let mut out = File::create(path)?;
        out.write_all(&header.to_bytes())?;
        out.write_all(&encoded)?;
        out.write_all(&encode_faces(cloud.faces(), encoding))?;
        Ok(())
    }

    /// The same cloud with these fields in place of its own: names, types and one array each.
    fn with_fields(&self, fields: Vec<(String, String, PyReadonlyArray1<'_, f64>)>) -> PyResult<Self> {
        let field = |(name, kind, values): (String, String, PyReadonlyArray1<'_, f64>)| {
            let kind = serde_json::from_value(serde_json::Value::String(kind)).map_err(refused)?;
            Ok(ScalarField { name, kind, values: values.as_slice()?.to_vec() })
        };
        let fields = fields.into_iter().map(field).collect::<PyResult<Vec<_>>>()?;
        let cloud = PointCloud::clone(&self.inner).with_fields(fields).map_err(refused)?;
        Ok(cloud.into())
    }

    /// Coordinates, n × d.
    fn points<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let shape = [self.inner.len(), self.inner.dimension()];
        PyArray1::from_slice(py, self.inner.coordinates()).reshape(shape)
    }

    /// Triangles, m × 3.
    fn faces<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<i64>>> {
        let corners: Vec<i64> =
            self.inner.faces().iter().flatten().map(|&corner| i64::from(corner)).collect();
        PyArray1::from_vec(py, corners).reshape([self.inner.faces().len(), 3])
    }

    /// Name and type of every field.
    fn field_types(&self) -> Vec<(String, String)> {
        let kind =
            |kind: ScalarType| serde_json::to_value(kind).ok().and_then(|v| v.as_str().map(str::to_owned));
        self.inner
            .fields()
            .iter()
            .map(|field| (field.name.clone(), kind(field.kind).unwrap_or_default()))
            .collect()
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

    fn __len__(&self) -> usize {
        self.inner.len()
    }
}

fn policy(nonfinite: &str) -> PyResult<NonFinite> {
    match nonfinite {
        "reject" => Ok(NonFinite::Reject),
        "drop" => Ok(NonFinite::Drop),
        other => Err(refused(format!("nonfinite is \"reject\" or \"drop\", not \"{other}\""))),
    }
}

fn triangles(faces: &PyReadonlyArray2<'_, i64>) -> PyResult<Vec<[u32; 3]>> {
    if faces.shape()[1] != 3 {
        return Err(refused(format!("faces have the shape (m, 3), not {:?}", faces.shape())));
    }
    let corner = |&corner: &i64| {
        u32::try_from(corner)
            .map_err(|_| refused(format!("faces are indices of points from 0, not {corner}")))
    };
    let corners = faces.as_slice()?.iter().map(corner).collect::<PyResult<Vec<u32>>>()?;
    Ok(corners.chunks_exact(3).map(|face| [face[0], face[1], face[2]]).collect())
}

fn format_named(name: &str) -> PyResult<Format> {
    Format::from_name(name)
        .ok_or_else(|| refused(format!("unknown format \"{name}\"; there are {}", names())))
}

fn of_extension(path: &std::path::Path) -> Option<Format> {
    Format::from_extension(path.extension()?.to_str()?)
}

fn names() -> String {
    Format::ALL.map(Format::name).join(", ")
}

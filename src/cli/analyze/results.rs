//! The files of an analysis.

use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom, Write};
use std::path::PathBuf;

use chladni::analysis::{Analysis, JobKind};
use chladni::cloud::writer::{Column, PlyEncoding, PlyHeader, encode_column, encode_faces, encode_rows};
use chladni::cloud::writer::{npy_header_by_columns, npy_vector_header, ply_columns};
use chladni::cloud::{PointCloud, ScalarType};

use super::run::Ran;
use super::{Failure, output};
use crate::cli::source::{SOURCE, Source};

/// Writes all files, or none when the caller cancels meanwhile.
pub(super) fn write(
    mut directory: output::Directory,
    cloud: &PointCloud,
    kind: JobKind,
    functions: Option<&[Vec<f64>]>,
    ran: &Ran,
) -> Result<Vec<PathBuf>, Failure> {
    let Ran { analysis, progress, .. } = ran;
    let canceled = || progress.checkpoint().map_err(Failure::other);
    directory.write("report.json", |out| json(&analysis.report, out))?;
    directory.write("mass.npy", |out| vector(&analysis.mass(), out))?;
    canceled()?;
    match kind {
        JobKind::Operator => {
            if let Some(matrix) = analysis.operator_matrix() {
                directory.write("operator.mtx", |out| {
                    matrix
                        .write_matrix_market("Q: Laplace-Beltrami is Q divided, row by row, by mass.npy", out)
                })?;
            }
            let applied: Vec<_> =
                functions.unwrap_or(&[]).iter().filter_map(|f| analysis.laplacian_of(f)).collect();
            if !applied.is_empty() {
                directory.write("laplacian.npy", |out| columns_npy(&applied, cloud.len(), out))?;
            }
        }
        JobKind::Eigen => {
            directory.write("spectrum.json", |out| json(&analysis.report.spectrum, out))?;
            directory.write("bases.npy", |out| bases_npy(analysis, cloud.len(), out))?;
            canceled()?;
            let bases = directory.path().join("bases.npy");
            let bases = &mut File::open(&bases).map_err(Failure::other)?;
            directory.write("bases.ply", |out| bases_ply(bases, analysis.bases(), cloud, out))?;
            if let Some(source) = Source::of(cloud) {
                directory.write(SOURCE, |out| json(&source, out))?;
            }
        }
    }
    canceled()?;
    directory.finish()
}

fn json(value: &impl serde::Serialize, out: &mut impl Write) -> io::Result<()> {
    serde_json::to_writer_pretty(&mut *out, value)?;
    writeln!(out)
}

fn doubles(values: &[f64]) -> Vec<u8> {
    encode_rows(&[Column { values, stride: 1, kind: ScalarType::Float64 }], values.len())
}

fn vector(values: &[f64], out: &mut impl Write) -> io::Result<()> {
    out.write_all(&npy_vector_header(values.len(), ScalarType::Float64))?;
    out.write_all(&doubles(values))
}

/// n×m, column by column.
fn columns_npy(columns: &[Vec<f64>], rows: usize, out: &mut impl Write) -> io::Result<()> {
    out.write_all(&npy_header_by_columns(rows, columns.len(), ScalarType::Float64))?;
    columns.iter().try_for_each(|column| out.write_all(&doubles(column)))
}

/// n×k, column by column: one basis in memory at a time.
fn bases_npy(analysis: &Analysis, rows: usize, out: &mut impl Write) -> io::Result<()> {
    out.write_all(&npy_header_by_columns(rows, analysis.bases(), ScalarType::Float64))?;
    (0..analysis.bases()).try_for_each(|j| out.write_all(&doubles(&analysis.basis(j))))
}

/// Rows that are put together at a time: bases come one by one, and rows hold all of them.
const ROWS: usize = 1 << 16;

/// The cloud with a float property per basis, so that viewers can color by it, from a file of bases that [`bases_npy`] wrote: a
/// file need not be read through for every stretch of rows, as what the bases come from may have to be.
fn bases_ply(npy: &mut File, bases: usize, cloud: &PointCloud, out: &mut impl Write) -> io::Result<()> {
    let encoding = PlyEncoding::Binary;
    let kind = ScalarType::Float32;
    let header = (0..bases)
        .fold(PlyHeader::of(cloud, encoding), |header, j| header.with_property(format!("basis_{j}"), kind));
    let width = header.stride();
    out.write_all(&header.to_bytes())?;
    let begin = npy_header_by_columns(cloud.len(), bases, ScalarType::Float64).len();
    let (mut bytes, mut values) = (Vec::new(), Vec::new());
    for first in (0..cloud.len()).step_by(ROWS) {
        let end = cloud.len().min(first + ROWS);
        let mut rows = vec![0; (end - first) * width];
        let mut offset = 0;
        for column in ply_columns(cloud, first) {
            encode_column(column, &mut rows, width, offset);
            offset += column.kind.size();
        }
        for j in 0..bases {
            let before = j as u64 * cloud.len() as u64 + first as u64;
            let place = begin as u64 + size_of::<f64>() as u64 * before;
            bytes.resize(size_of::<f64>() * (end - first), 0);
            npy.seek(SeekFrom::Start(place))?;
            npy.read_exact(&mut bytes)?;
            values.clear();
            values.extend(bytes.as_chunks().0.iter().map(|bytes| f64::from_le_bytes(*bytes)));
            encode_column(Column { values: &values, stride: 1, kind }, &mut rows, width, offset);
            offset += kind.size();
        }
        out.write_all(&rows)?;
    }
    out.write_all(&encode_faces(cloud.faces(), encoding))
}

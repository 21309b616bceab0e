//! The files of an analysis.

use std::io::{self, Write};
use std::path::PathBuf;

use chladni::analysis::{Analysis, JobKind, SparseMatrix};
use chladni::cloud::writer::{Column, PlyEncoding, PlyHeader, encode_column, encode_faces, encode_rows};
use chladni::cloud::writer::{npy_header_by_columns, npy_vector_header, ply_columns};
use chladni::cloud::{PointCloud, ScalarType};

use super::run::Ran;
use super::{Failure, output};

/// Writes all files, or none when the caller cancels meanwhile.
pub(super) fn write(
    mut directory: output::Directory,
    cloud: &PointCloud,
    kind: JobKind,
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
                directory.write("operator.mtx", |out| matrix_market(&matrix, out))?;
            }
        }
        JobKind::Eigen => {
            directory.write("spectrum.json", |out| json(&analysis.report.spectrum, out))?;
            directory.write("bases.npy", |out| bases_npy(analysis, cloud.len(), out))?;
            canceled()?;
            directory.write("bases.ply", |out| bases_ply(analysis, cloud, out))?;
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

/// n×k, column by column: one basis in memory at a time.
fn bases_npy(analysis: &Analysis, rows: usize, out: &mut impl Write) -> io::Result<()> {
    out.write_all(&npy_header_by_columns(rows, analysis.bases(), ScalarType::Float64))?;
    (0..analysis.bases()).try_for_each(|j| out.write_all(&doubles(&analysis.basis(j))))
}

/// The cloud with a float property per basis, so that viewers can colour by it. The rows are put together in
/// memory, since bases come one by one and rows hold all of them.
fn bases_ply(analysis: &Analysis, cloud: &PointCloud, out: &mut impl Write) -> io::Result<()> {
    let encoding = PlyEncoding::BinaryLittleEndian;
    let kind = ScalarType::Float32;
    let header = (0..analysis.bases())
        .fold(PlyHeader::of(cloud, encoding), |header, j| header.with_property(format!("basis_{j}"), kind));
    let width = header.stride();
    let mut rows = vec![0; cloud.len() * width];
    let mut offset = 0;
    for column in ply_columns(cloud, 0) {
        encode_column(column, &mut rows, width, offset);
        offset += column.kind.size();
    }
    for j in 0..analysis.bases() {
        encode_column(Column { values: &analysis.basis(j), stride: 1, kind }, &mut rows, width, offset);
        offset += kind.size();
    }
    out.write_all(&header.to_bytes())?;
    out.write_all(&rows)?;
    out.write_all(&encode_faces(cloud.faces(), encoding))
}

/// The lower triangle of Q in Matrix Market's coordinate format, indices from 1.
fn matrix_market(matrix: &SparseMatrix, out: &mut impl Write) -> io::Result<()> {
    let rows = matrix.offsets.len() - 1;
    let lower = || {
        matrix.offsets.windows(2).enumerate().flat_map(|(row, bounds)| {
            (bounds[0] as usize..bounds[1] as usize)
                .map(move |entry| (row, matrix.columns[entry] as usize, matrix.values[entry]))
                .filter(|&(row, column, _)| column <= row)
        })
    };
    writeln!(out, "%%MatrixMarket matrix coordinate real symmetric")?;
    writeln!(
        out,
        "% Q, symmetric, zero row sums, negative semi-definite; Laplace-Beltrami is Q divided by mass.npy"
    )?;
    writeln!(out, "{rows} {rows} {}", lower().count())?;
    lower().try_for_each(|(row, column, value)| writeln!(out, "{} {} {value:e}", row + 1, column + 1))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_symmetric_matrix_is_written_as_its_lower_triangle() {
        let matrix = SparseMatrix {
            offsets: vec![0, 2, 4, 4],
            columns: vec![0, 1, 0, 1],
            values: vec![-0.1, 0.1, 0.1, -0.1],
        };
        let mut text = Vec::new();
        matrix_market(&matrix, &mut text).unwrap();
        let text = String::from_utf8(text).unwrap();
        let lines: Vec<_> = text.lines().filter(|line| !line.starts_with('%')).collect();
        assert_eq!(lines, ["3 3 3", "1 1 -1e-1", "2 1 1e-1", "2 2 -1e-1"]);
    }
}

//! `bases.ply` of a directory of results: the cloud with a property per basis.

use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::Path;

use chladni::cloud::writer::{Column, PlyEncoding, PlyHeader, encode_faces, encode_rows, ply_columns};
use chladni::cloud::{PointCloud, ScalarType};

/// Rows that are encoded together.
const BLOCK_ROWS: usize = 8192;

/// Writes a binary PLY with a single-precision property `basis_j` per column of the n × k `vectors`.
pub(crate) fn write_bases_ply(
    cloud: &PointCloud,
    vectors: &[f64],
    bases: usize,
    path: &Path,
) -> io::Result<()> {
    let (encoding, kind) = (PlyEncoding::Binary, ScalarType::Float32);
    let header = (0..bases)
        .fold(PlyHeader::of(cloud, encoding), |header, j| header.with_property(format!("basis_{j}"), kind));
    let mut out = BufWriter::new(File::create(path)?);
    out.write_all(&header.to_bytes())?;
    for first in (0..cloud.len()).step_by(BLOCK_ROWS) {
        let mut columns = ply_columns(cloud, first);
        let basis = |j: usize| Column { values: &vectors[first * bases + j..], stride: bases, kind };
        columns.extend((0..bases).map(basis));
        out.write_all(&encode_rows(&columns, BLOCK_ROWS.min(cloud.len() - first)))?;
    }
    out.write_all(&encode_faces(cloud.faces(), encoding))?;
    out.flush()
}

//! NumPy archives: `points` (n × d doubles), a vector per field in its own type, and `faces` (m × 3) if there are any.

use std::io::{self, Cursor, Write};

use npyz::zip::write::FileOptions;
use npyz::zip::{CompressionMethod, DateTime, ZipWriter};

use super::{Column, encode_rows, npy_header, npy_vector_header};
use crate::cloud::{PointCloud, ScalarType};

/// Rows that are encoded together.
const CHUNK_ROWS: usize = 4096;

/// Writes a cloud as an archive that `numpy.load` opens. Slashes in the names of fields are written as `_`.
///
/// # Errors
/// Those of `out`.
pub fn write_npz(cloud: &PointCloud, out: &mut impl Write) -> io::Result<()> {
    let mut archive = Archive(ZipWriter::new(Cursor::new(Vec::new())));
    let kind = ScalarType::Float64;
    archive.add("points", &npy_header(cloud.len(), cloud.dimension(), kind), cloud.coordinates(), kind)?;
    for field in cloud.fields() {
        let name = field.name.replace(['/', '\\'], "_");
        archive.add(&name, &npy_vector_header(cloud.len(), field.kind), &field.values, field.kind)?;
    }
    if !cloud.faces().is_empty() {
        let kind = ScalarType::Uint32;
        let corners: Vec<f64> = cloud.faces().as_flattened().iter().map(|&corner| corner.into()).collect();
        archive.add("faces", &npy_header(cloud.faces().len(), 3, kind), &corners, kind)?;
    }
    out.write_all(&archive.0.finish().map_err(io::Error::other)?.into_inner())
}

struct Archive(ZipWriter<Cursor<Vec<u8>>>);

impl Archive {
    fn add(&mut self, name: &str, header: &[u8], values: &[f64], kind: ScalarType) -> io::Result<()> {
        // Stored, not packed, as numpy.savez does; without a time, so that the same cloud gives the same file.
        let options = FileOptions::default()
            .compression_method(CompressionMethod::Stored)
            .last_modified_time(DateTime::default())
            .large_file(values.len() as u64 * kind.size() as u64 > u64::from(u32::MAX) / 2);
        self.0.start_file(format!("{name}.npy"), options).map_err(io::Error::other)?;
        self.0.write_all(header)?;
        values.chunks(CHUNK_ROWS).try_for_each(|values| {
            self.0.write_all(&encode_rows(&[Column { values, stride: 1, kind }], values.len()))
        })
    }
}

//! Sparse matrices as files: Matrix Market, and the archive that SciPy loads.

use std::io::{self, Cursor};

use npyz::npz::NpzWriter;
use npyz::zip::write::FileOptions;
use npyz::zip::{CompressionMethod, DateTime};
use npyz::{AutoSerialize, DType, WriterBuilder};

use crate::analysis::SparseMatrix;
use crate::http::wire::download::unwritten;
use crate::http::wire::problem::Problem;
use crate::jobs::{Wanted, WantedWriter};
use crate::store::JobRecord;

/// Bytes of an entry in memory: its column and value.
pub(crate) const ENTRY_BYTES: u64 = 4 + 8;

/// Bytes of memory that Q of a job takes, and B beside it.
pub(crate) fn bytes_of(job: &JobRecord) -> u64 {
    let nonzeros = job.report.as_ref().map_or(0, |report| report.nonzeros as u64);
    nonzeros * ENTRY_BYTES + job.points * 2 * 8
}

/// Matrix Market, indices from 1: `coordinate real symmetric` with the lower triangle, or `general` with all entries of a
/// matrix without symmetry.
///
/// # Errors
/// A problem of ours when the text cannot be written.
pub(crate) fn matrix_market(matrix: &SparseMatrix, wanted: &Wanted) -> Result<Vec<u8>, Problem> {
    let mut text = Vec::new();
    let written = matrix.write_matrix_market("", &mut wanted.writer(&mut text));
    written.map_err(|error| unwritten(&error))?;
    Ok(text)
}

/// What `scipy.sparse.load_npz` reads: `format`, `shape`, `data`, `indices`, `indptr` of a CSR matrix.
///
/// # Errors
/// A problem of ours when the archive cannot be written.
pub(crate) fn scipy_archive(matrix: &SparseMatrix, wanted: &Wanted) -> Result<Vec<u8>, Problem> {
    let mut file = Vec::with_capacity(12 * matrix.values.len() + 8 * matrix.offsets.len() + 2048);
    write_csr(matrix, wanted.writer(Cursor::new(&mut file))).map_err(|error| unwritten(&error))?;
    Ok(file)
}

type File<'a> = WantedWriter<Cursor<&'a mut Vec<u8>>>;

fn write_csr(matrix: &SparseMatrix, file: File<'_>) -> io::Result<()> {
    let mut archive = NpzWriter::new(file);
    let n = (matrix.offsets.len() as u64).cast_signed() - 1;
    let letters = DType::Plain("|S3".parse().map_err(io::Error::other)?);
    let mut format = archive.array("format", options(3))?.dtype(letters).shape(&[]).begin_nd()?;
    format.push(b"csr".as_slice())?;
    drop(format);
    add(&mut archive, "shape", [n; 2].into_iter())?;
    add(&mut archive, "data", matrix.values.iter().copied())?;
    // SciPy keeps both kinds of index in one type, and prefers the shorter.
    if i32::try_from(matrix.values.len()).is_ok() {
        add(&mut archive, "indices", matrix.columns.iter().map(|&column| column.cast_signed()))?;
        add(&mut archive, "indptr", matrix.offsets.iter().map(|&offset| offset as i32))
    } else {
        add(&mut archive, "indices", matrix.columns.iter().map(|&column| i64::from(column)))?;
        add(&mut archive, "indptr", matrix.offsets.iter().map(|&offset| offset.cast_signed()))
    }
}

fn add<T: AutoSerialize>(
    archive: &mut NpzWriter<File<'_>>,
    name: &str,
    values: impl ExactSizeIterator<Item = T>,
) -> io::Result<()> {
    let length = values.len() as u64;
    let array = archive.array(name, options(length * size_of::<T>() as u64))?;
    array.default_dtype().shape(&[length]).begin_nd()?.extend(values)
}

/// Stored, not packed: numbers hardly become smaller, and packing them takes seconds. Without a time: the same matrix gives
/// the same file.
fn options(bytes: u64) -> FileOptions {
    FileOptions::default()
        .compression_method(CompressionMethod::Stored)
        .last_modified_time(DateTime::default())
        .large_file(bytes > u64::from(u32::MAX) / 2)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_archive_reads_back_as_the_matrix() {
        let bytes = scipy_archive(&SparseMatrix::path(), &Wanted::default()).unwrap();
        let mut archive = npyz::npz::NpzArchive::new(Cursor::new(bytes)).unwrap();
        let csr = npyz::sparse::Csr::<f64>::from_npz(&mut archive).unwrap();
        assert_eq!(csr.shape, [4, 4]);
        assert_eq!(csr.data, SparseMatrix::path().values);
        assert_eq!(csr.indices, [0, 1, 0, 1, 2, 1, 2]);
        assert_eq!(csr.indptr, [0, 2, 5, 7, 7]);
    }

    #[test]
    fn the_archive_holds_its_members_as_they_are_and_no_time() {
        let bytes = scipy_archive(&SparseMatrix::path(), &Wanted::default()).unwrap();
        let mut archive = npyz::zip::ZipArchive::new(Cursor::new(bytes)).unwrap();
        for index in 0..archive.len() {
            let member = archive.by_index(index).unwrap();
            assert_eq!(member.compression(), CompressionMethod::Stored);
            assert_eq!(member.last_modified().year(), 1980);
        }
    }
}

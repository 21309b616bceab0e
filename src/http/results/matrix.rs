//! Sparse matrices as files: Matrix Market, and the archive that SciPy loads.

use std::io::Cursor;

use npyz::npz::NpzWriter;
use npyz::sparse::CsrBase;

use crate::analysis::SparseMatrix;
use crate::http::wire::problem::Problem;

/// Matrix Market, indices from 1: `coordinate real symmetric` with the lower triangle, or `general` with all entries of a
/// matrix without symmetry.
///
/// # Errors
/// A problem of ours when the text cannot be written.
pub(crate) fn matrix_market(matrix: &SparseMatrix) -> Result<Vec<u8>, Problem> {
    let mut text = Vec::new();
    matrix.write_matrix_market("", &mut text).map_err(|error| Problem::internal(&error))?;
    Ok(text)
}

/// What `scipy.sparse.load_npz` reads: `format`, `shape`, `data`, `indices`, `indptr` of a CSR matrix.
///
/// # Errors
/// A problem of ours when the archive cannot be written.
pub(crate) fn scipy_archive(matrix: &SparseMatrix) -> Result<Vec<u8>, Problem> {
    let n = matrix.offsets.len() as u64 - 1;
    let csr = CsrBase {
        shape: [n, n],
        data: matrix.values.as_slice(),
        indices: matrix.columns.iter().map(|&column| u64::from(column)).collect::<Vec<_>>(),
        indptr: matrix.offsets.iter().map(|&offset| offset as usize).collect::<Vec<_>>(),
    };
    let mut file = Cursor::new(Vec::new());
    csr.write_npz(&mut NpzWriter::new(&mut file)).map_err(|error| Problem::internal(&error))?;
    Ok(file.into_inner())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A path graph of two edges, weights 2 and 3, and an isolated row.
    fn path() -> SparseMatrix {
        SparseMatrix {
            offsets: vec![0, 2, 5, 7, 7],
            columns: vec![0, 1, 0, 1, 2, 1, 2],
            values: vec![-2.0, 2.0, 2.0, -5.0, 3.0, 3.0, -3.0],
        }
    }

    #[test]
    fn the_archive_reads_back_as_the_matrix() {
        let bytes = scipy_archive(&path()).unwrap();
        let mut archive = npyz::npz::NpzArchive::new(Cursor::new(bytes)).unwrap();
        let csr = npyz::sparse::Csr::<f64>::from_npz(&mut archive).unwrap();
        assert_eq!(csr.shape, [4, 4]);
        assert_eq!(csr.data, path().values);
        assert_eq!(csr.indices, [0, 1, 0, 1, 2, 1, 2]);
        assert_eq!(csr.indptr, [0, 2, 5, 7, 7]);
    }
}

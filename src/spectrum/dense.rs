//! All eigenpairs at once, for small problems.

use faer::{Mat, MatRef};

use super::general::{self, GeneralPairs};
use super::orthogonal::eigen;
use super::vectors::block::Block;
use super::{Eigenpairs, Problem, SpectrumError};
use crate::operator::Structure;

/// Problems of at most this many points are solved densely.
const DENSE_POINTS: usize = 500;

/// Larger shares `k/n` of the spectrum than this are solved densely.
const DENSE_SHARE: f64 = 0.2;

/// Largest order that is solved densely: 8 n² bytes thrice and 10 n³ operations.
pub const DENSE_POINTS_MAX: usize = 5_000;

/// The same for operators without symmetry, which take 25 n³ operations.
pub const DENSE_POINTS_MAX_GENERAL: usize = 1_500;

/// Whether `count` pairs of a semi-definite problem of `n` points are computed from the dense matrix.
#[must_use]
pub fn is_dense(n: usize, count: usize) -> bool {
    n <= DENSE_POINTS || (count as f64 > DENSE_SHARE * n as f64 && n <= DENSE_POINTS_MAX)
}

/// Whether `count` pairs of an operator that is not positive semi-definite are computed from the dense matrix.
pub(super) fn is_dense_general(n: usize, count: usize) -> bool {
    n <= DENSE_POINTS || count as f64 > DENSE_SHARE * n as f64
}

/// The `count` smallest eigenpairs. The null space is taken as known, so that it is exact and splits by component.
///
/// # Errors
/// [`SpectrumError::Dense`].
pub fn solve(problem: &Problem, count: usize) -> Result<Eigenpairs, SpectrumError> {
    let (n, zero_modes) = (problem.size(), problem.zero_modes());
    let mut nulls = Block::<f64>::zeros(n, zero_modes);
    problem.write_null_vectors(&mut nulls, 0..zero_modes);
    // lifting the null space above the rest leaves the other eigenpairs as they are
    let lift =
        4.0 * (0..n).map(|i| problem.matrix.row(i).1.iter().map(|v| v.abs()).sum()).fold(0.0_f64, f64::max);
    let mut dense = filled(problem);
    let label = &problem.components.label;
    for i in 0..n {
        for j in (0..n).filter(|&j| label[i] == label[j]) {
            let component = label[i] as usize;
            dense[(i, j)] += lift * nulls.row(i)[component] * nulls.row(j)[component];
        }
    }
    let (values, vectors) = eigen(dense.as_ref())?;
    let zeros = zero_modes.min(count);
    let mut result = Eigenpairs::real(vec![0.0; count], Block::zeros(n, count));
    problem.write_null_vectors(&mut result.vectors, 0..zeros);
    result.values[zeros..].copy_from_slice(&values[..count - zeros]);
    result.vectors.for_each_row(|i, row| {
        for (k, x) in row[zeros..].iter_mut().enumerate() {
            *x = vectors[(i, k)];
        }
    });
    Ok(result)
}

/// The `count` eigenpairs with the smallest real parts of an operator that is not semi-definite, one more where that
/// would cut a conjugate pair; the columns are the eigenvectors' parts.
///
/// # Errors
/// [`SpectrumError::Dense`].
pub fn solve_general(problem: &Problem, count: usize) -> Result<(GeneralPairs, Block), SpectrumError> {
    let pairs = ritz(problem.structure, filled(problem).as_ref(), count)?;
    let mut vectors = Block::zeros(problem.size(), pairs.real.len());
    vectors.for_each_row(|i, row| row.iter_mut().enumerate().for_each(|(j, x)| *x = pairs.columns[(i, j)]));
    Ok((pairs, vectors))
}

/// Eigenpairs of a small matrix: real, with orthonormal columns, when the operator is symmetric.
///
/// # Errors
/// [`SpectrumError::Dense`].
pub(super) fn ritz(
    structure: Structure,
    matrix: MatRef<'_, f64>,
    count: usize,
) -> Result<GeneralPairs, SpectrumError> {
    if structure == Structure::General {
        return general::eigen(matrix, count);
    }
    let (mut real, vectors) = eigen((0.5 * (matrix + matrix.transpose())).as_ref())?;
    real.truncate(count);
    Ok(GeneralPairs { imaginary: vec![0.0; count], real, columns: vectors.subcols(0, count).to_owned() })
}

fn filled(problem: &Problem) -> Mat<f64> {
    let n = problem.size();
    let mut dense = Mat::zeros(n, n);
    for i in 0..n {
        let (columns, values) = problem.matrix.row(i);
        for (&j, &value) in columns.iter().zip(values) {
            dense[(i, j as usize)] = value;
        }
    }
    dense
}

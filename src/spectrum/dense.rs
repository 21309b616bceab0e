//! All eigenpairs at once, for small problems.

use faer::{Mat, MatRef};

use super::block::Block;
use super::general::{self, GeneralPairs};
use super::orthogonal::eigen;
use super::{Eigenpairs, Problem, SpectrumError};
use crate::operator::Structure;

/// The `count` smallest eigenpairs. The null space is taken as known, so that it is exact and splits by component.
///
/// # Errors
/// [`SpectrumError::Dense`].
pub fn solve(problem: &Problem, count: usize) -> Result<Eigenpairs, SpectrumError> {
    let (n, zero_modes) = (problem.size(), problem.zero_modes());
    let mut nulls = Block::zeros(n, zero_modes);
    problem.write_null_vectors(&mut nulls, zero_modes);
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
    problem.write_null_vectors(&mut result.vectors, zeros);
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

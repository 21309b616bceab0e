//! All eigenpairs at once, for small problems.

use faer::Mat;

use super::block::Block;
use super::orthogonal::eigen;
use super::{Eigenpairs, Problem, SpectrumError};

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
    let mut dense = Mat::zeros(n, n);
    for i in 0..n {
        let (columns, values) = problem.matrix.row(i);
        for (&j, &value) in columns.iter().zip(values) {
            dense[(i, j as usize)] = value;
        }
    }
    let label = &problem.components.label;
    for i in 0..n {
        for j in (0..n).filter(|&j| label[i] == label[j]) {
            let component = label[i] as usize;
            dense[(i, j)] += lift * nulls.row(i)[component] * nulls.row(j)[component];
        }
    }
    let (values, vectors) = eigen(dense.as_ref())?;
    let zeros = zero_modes.min(count);
    let mut result = Eigenpairs { values: vec![0.0; count], vectors: Block::zeros(n, count) };
    problem.write_null_vectors(&mut result.vectors, zeros);
    result.values[zeros..].copy_from_slice(&values[..count - zeros]);
    result.vectors.for_each_row(|i, row| {
        for (k, x) in row[zeros..].iter_mut().enumerate() {
            *x = vectors[(i, k)];
        }
    });
    Ok(result)
}

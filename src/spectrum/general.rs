//! Eigenpairs of small matrices without symmetry, in real arithmetic.

use faer::{Mat, MatRef};

use super::SpectrumError;

/// Eigenvalues by ascending real part, and real columns that span the same spaces as their eigenvectors: real and
/// imaginary part for a conjugate pair, whose two eigenvalues follow each other, the one with positive imaginary part
/// first.
pub struct GeneralPairs {
    /// Real parts.
    pub real: Vec<f64>,
    /// Imaginary parts.
    pub imaginary: Vec<f64>,
    /// One column per eigenvalue.
    pub columns: Mat<f64>,
}

/// The `count` eigenvalues with the smallest real parts, one more where that would cut a conjugate pair.
///
/// # Errors
/// [`SpectrumError::Dense`].
pub fn eigen(matrix: MatRef<'_, f64>, count: usize) -> Result<GeneralPairs, SpectrumError> {
    let order = matrix.nrows();
    let eigen = matrix.eigen().map_err(|_| SpectrumError::Dense { order })?;
    let values: Vec<_> = eigen.S().column_vector().iter().copied().collect();
    let mut ascending: Vec<usize> = (0..order).collect();
    ascending.sort_by(|&a, &b| {
        let key = |k: usize| (values[k].re, values[k].im.abs());
        let (a_key, b_key) = (key(a), key(b));
        a_key
            .0
            .total_cmp(&b_key.0)
            .then(a_key.1.total_cmp(&b_key.1))
            .then(values[b].im.total_cmp(&values[a].im))
    });
    let cut = ascending.get(count - 1).is_some_and(|&k| values[k].im > 0.0);
    ascending.truncate(count + usize::from(cut));
    let columns = Mat::from_fn(order, ascending.len(), |i, j| {
        let k = ascending[j];
        // the second of a pair repeats the first's conjugate, of which the imaginary part is still missing
        if values[k].im < 0.0 { -eigen.U()[(i, k)].im } else { eigen.U()[(i, k)].re }
    });
    Ok(GeneralPairs {
        real: ascending.iter().map(|&k| values[k].re).collect(),
        imaginary: ascending.iter().map(|&k| values[k].im).collect(),
        columns,
    })
}

/// An orthonormal basis of the columns whose leading columns span the same as theirs.
#[must_use]
pub fn orthonormal(columns: MatRef<'_, f64>) -> Mat<f64> {
    columns.qr().compute_thin_Q()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_rotation_among_real_modes_gives_a_conjugate_pair_and_its_plane() {
        // blocks: 0.5; rotation-like with eigenvalues 1 ± 2i; 3
        let matrix = Mat::from_fn(4, 4, |i, j| match (i, j) {
            (0, 0) => 3.0,
            (1, 1) | (2, 2) => 1.0,
            (1, 2) => -2.0,
            (2, 1) => 2.0,
            (3, 3) => 0.5,
            _ => 0.0,
        });
        let pairs = eigen(matrix.as_ref(), 2).unwrap();
        assert_eq!(pairs.real.len(), 3, "the pair is not cut");
        for (found, expected) in pairs.real.iter().zip([0.5, 1.0, 1.0]) {
            assert!((found - expected).abs() < 1e-14);
        }
        assert!((pairs.imaginary[1] - 2.0).abs() < 1e-14 && (pairs.imaginary[2] + 2.0).abs() < 1e-14);
        // A u = a u − b v and A v = b u + a v
        let (u, v) = (pairs.columns.col(1), pairs.columns.col(2));
        assert!((&matrix * u - (u - 2.0 * v)).norm_max() < 1e-14);
        assert!((&matrix * v - (2.0 * u + v)).norm_max() < 1e-14);
    }
}

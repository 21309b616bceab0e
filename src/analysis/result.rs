//! An analysis with its arrays, in rows of the upload.

use std::io::{self, Write};

use rayon::prelude::*;

use super::Report;
use crate::geometry::Points;
use crate::operator::Sparse;
use crate::spectrum::Eigenbasis;

/// An operator and, for [`super::JobKind::Eigen`], its eigenbasis; arrays are handed out in rows of the upload.
#[derive(Debug)]
pub struct Analysis {
    /// Everything but the arrays.
    pub report: Report,
    pub(super) points: Points,
    /// For every point its place among those analyzed, or [`NO_PLACE`].
    pub(super) place: Vec<u32>,
    pub(super) mass: Vec<f64>,
    pub(super) stiffness: Option<Sparse>,
    pub(super) eigenbasis: Option<Eigenbasis>,
}

/// Marks a point in a component too small to analyze.
pub(super) const NO_PLACE: u32 = u32::MAX;

/// A sparse matrix in rows of the upload, compressed by rows, columns ascending.
#[derive(Debug, Clone, PartialEq)]
pub struct SparseMatrix {
    /// n+1 offsets.
    pub offsets: Vec<u64>,
    /// Column of every entry.
    pub columns: Vec<u32>,
    /// Value of every entry.
    pub values: Vec<f64>,
}

impl SparseMatrix {
    /// Whether `a_ij = a_ji` to the last bit.
    #[must_use]
    pub fn is_symmetric(&self) -> bool {
        let row = |i: usize| self.offsets[i] as usize..self.offsets[i + 1] as usize;
        (0..self.offsets.len() - 1).all(|i| {
            row(i).all(|entry| {
                let other = row(self.columns[entry] as usize);
                self.columns[other.clone()].binary_search(&(i as u32)).is_ok_and(|place| {
                    self.values[other.start + place].to_bits() == self.values[entry].to_bits()
                })
            })
        })
    }
}

impl SparseMatrix {
    /// Columns and values of a row.
    fn row(&self, i: usize) -> impl Iterator<Item = (usize, f64)> + '_ {
        let entries = self.offsets[i] as usize..self.offsets[i + 1] as usize;
        entries.map(|entry| (self.columns[entry] as usize, self.values[entry]))
    }

    /// Writes the matrix in Matrix Market's coordinate format, indices from 1: `symmetric` with the lower triangle, or
    /// `general`. `comment` is a line of its own unless it is empty.
    ///
    /// # Errors
    /// Those of `out`.
    pub fn write_matrix_market(&self, comment: &str, out: &mut impl Write) -> io::Result<()> {
        let n = self.offsets.len() - 1;
        let symmetric = self.is_symmetric();
        let written = |i: usize| self.row(i).filter(move |&(j, _)| !symmetric || j <= i);
        let entries: usize = (0..n).map(|i| written(i).count()).sum();
        writeln!(
            out,
            "%%MatrixMarket matrix coordinate real {}",
            if symmetric { "symmetric" } else { "general" }
        )?;
        if !comment.is_empty() {
            writeln!(out, "% {comment}")?;
        }
        writeln!(out, "{n} {n} {entries}")?;
        (0..n).try_for_each(|i| {
            written(i).try_for_each(|(j, value)| writeln!(out, "{} {} {value:e}", i + 1, j + 1))
        })
    }

    /// Δf for values of a function, one per row: `B⁻¹ Q f` with this matrix as `Q` and the diagonal `mass` of `B`. Rows
    /// without mass (duplicates, rows without a result) are NaN.
    ///
    /// # Panics
    /// Unless `f` and `mass` have one value per row.
    #[must_use]
    pub fn laplacian_of(&self, mass: &[f64], f: &[f64]) -> Vec<f64> {
        let n = self.offsets.len() - 1;
        assert!(mass.len() == n && f.len() == n);
        (0..n)
            .into_par_iter()
            .with_min_len(1024)
            .map(|i| match mass[i] {
                b if b > 0.0 => self.row(i).map(|(j, value)| value * f[j]).sum::<f64>() / b,
                _ => f64::NAN,
            })
            .collect()
    }
}

impl Analysis {
    /// Place of a row's point among those analyzed.
    fn place_of_row(&self, row: usize) -> Option<usize> {
        let place = self.place[self.points.of_row(row)?];
        (place != NO_PLACE).then_some(place as usize)
    }

    /// Mass B of every row, in `length^k`: 0 for a duplicate (its first occurrence carries the mass), NaN for a
    /// row without a result.
    #[must_use]
    pub fn mass(&self) -> Vec<f64> {
        (0..self.points.rows())
            .map(|row| match self.place_of_row(row) {
                None => f64::NAN,
                Some(_) if self.points.of_row(row).is_some_and(|point| self.points.row(point) != row) => 0.0,
                Some(place) => self.mass[place],
            })
            .collect()
    }

    /// Number of bases; 0 for operator jobs.
    #[must_use]
    pub fn bases(&self) -> usize {
        self.eigenbasis.as_ref().map_or(0, Eigenbasis::len)
    }

    /// Basis `j`, one value per row: duplicates repeat their first occurrence, NaN without a result.
    ///
    /// # Panics
    /// When `j` is not below [`Self::bases`], or the file cannot be read that bases for which there was no memory are in.
    #[must_use]
    pub fn basis(&self, j: usize) -> Vec<f64> {
        assert!(j < self.bases(), "basis {j} of {}", self.bases());
        let Some(eigenbasis) = &self.eigenbasis else { return Vec::new() };
        let basis = eigenbasis.basis(j);
        let rows = 0..self.points.rows();
        rows.map(|row| self.place_of_row(row).map_or(f64::NAN, |place| basis.at(place))).collect()
    }

    /// Q = −S: for most operators symmetric with zero row sums and negative semi-definite. Empty rows for duplicates and
    /// rows without a result. Present for [`super::JobKind::Operator`].
    #[must_use]
    pub fn operator_matrix(&self) -> Option<SparseMatrix> {
        let stiffness = self.stiffness.as_ref()?;
        let mut row_of_place = vec![0_u32; stiffness.rows()];
        for (point, &place) in self.place.iter().enumerate().filter(|(_, place)| **place != NO_PLACE) {
            row_of_place[place as usize] = self.points.row(point) as u32;
        }
        let mut matrix = SparseMatrix {
            offsets: vec![0],
            columns: Vec::with_capacity(stiffness.nonzeros()),
            values: Vec::with_capacity(stiffness.nonzeros()),
        };
        let mut entries: Vec<(u32, f64)> = Vec::new();
        for row in 0..self.points.rows() {
            let place = self.place_of_row(row).filter(|&place| row_of_place[place] as usize == row);
            if let Some(place) = place {
                let (columns, values) = stiffness.row(place);
                entries.clear();
                // 0 − x, because −x would give −0
                entries
                    .extend(columns.iter().zip(values).map(|(&j, &s)| (row_of_place[j as usize], 0.0 - s)));
                entries.sort_unstable_by_key(|&(column, _)| column);
                matrix.columns.extend(entries.iter().map(|&(column, _)| column));
                matrix.values.extend(entries.iter().map(|&(_, value)| value));
            }
            matrix.offsets.push(matrix.columns.len() as u64);
        }
        Some(matrix)
    }

    /// Δf for values of a function, one per row. Duplicates repeat their first occurrence, NaN without a result.
    /// Present for [`super::JobKind::Operator`].
    ///
    /// # Panics
    /// Unless `f` has one value per row.
    #[must_use]
    pub fn laplacian_of(&self, f: &[f64]) -> Option<Vec<f64>> {
        let mut values = self.operator_matrix()?.laplacian_of(&self.mass(), f);
        for row in 0..values.len() {
            if let Some(point) = self.points.of_row(row) {
                values[row] = values[self.points.row(point)];
            }
        }
        Some(values)
    }
}

#[cfg(test)]
impl SparseMatrix {
    /// A path graph of two edges, weights 2 and 3, and an isolated row.
    pub(crate) fn path() -> Self {
        Self {
            offsets: vec![0, 2, 5, 7, 7],
            columns: vec![0, 1, 0, 1, 2, 1, 2],
            values: vec![-2.0, 2.0, 2.0, -5.0, 3.0, 3.0, -3.0],
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn text(matrix: &SparseMatrix) -> String {
        let mut text = Vec::new();
        matrix.write_matrix_market("", &mut text).unwrap();
        String::from_utf8(text).unwrap()
    }

    #[test]
    fn a_symmetric_matrix_is_written_as_its_lower_triangle_counting_from_one() {
        assert_eq!(
            text(&SparseMatrix::path()),
            "%%MatrixMarket matrix coordinate real symmetric\n4 4 5\n1 1 -2e0\n2 1 2e0\n2 2 -5e0\n3 2 3e0\n3 3 -3e0\n"
        );
    }

    #[test]
    fn a_matrix_without_symmetry_is_written_whole() {
        let skew =
            SparseMatrix { offsets: vec![0, 1, 3], columns: vec![1, 0, 1], values: vec![1.0, 2.0, 3.0] };
        assert!(!skew.is_symmetric());
        assert_eq!(
            text(&skew),
            "%%MatrixMarket matrix coordinate real general\n2 2 3\n1 2 1e0\n2 1 2e0\n2 2 3e0\n"
        );
    }

    #[test]
    fn the_laplacian_divides_by_the_mass_and_rows_without_are_not_numbers() {
        let found = SparseMatrix::path().laplacian_of(&[1.0, 2.0, 4.0, f64::NAN], &[1.0, 2.0, 4.0, 9.0]);
        assert_eq!(found[..3], [2.0, 2.0, -1.5]);
        assert!(found[3].is_nan());
    }
}

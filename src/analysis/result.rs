//! An analysis with its arrays, in rows of the upload.

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
    /// For every point its place among those analysed, or [`NO_PLACE`].
    pub(super) place: Vec<u32>,
    pub(super) mass: Vec<f64>,
    pub(super) stiffness: Option<Sparse>,
    pub(super) eigenbasis: Option<Eigenbasis>,
}

/// Marks a point in a component too small to analyse.
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

impl Analysis {
    /// Place of a row's point among those analysed.
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
    /// When `j` is not below [`Self::bases`].
    #[must_use]
    pub fn basis(&self, j: usize) -> Vec<f64> {
        assert!(j < self.bases(), "basis {j} of {}", self.bases());
        let value = |place| self.eigenbasis.as_ref().map_or(f64::NAN, |basis| basis.at(place, j));
        (0..self.points.rows()).map(|row| self.place_of_row(row).map_or(f64::NAN, value)).collect()
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

    /// Δf for values of a function, one per row: `−B⁻¹ S f`. Duplicates repeat their first occurrence, NaN without a
    /// result. Present for [`super::JobKind::Operator`].
    ///
    /// # Panics
    /// Unless `f` has one value per row.
    #[must_use]
    pub fn laplacian_of(&self, f: &[f64]) -> Option<Vec<f64>> {
        assert_eq!(f.len(), self.points.rows());
        let stiffness = self.stiffness.as_ref()?;
        let mut values = vec![0.0; stiffness.rows()];
        for (point, &place) in self.place.iter().enumerate().filter(|(_, place)| **place != NO_PLACE) {
            values[place as usize] = f[self.points.row(point)];
        }
        let product = stiffness.product(&values);
        let laplacian = |place: usize| 0.0 - product[place] / self.mass[place];
        Some((0..f.len()).map(|row| self.place_of_row(row).map_or(f64::NAN, laplacian)).collect())
    }
}

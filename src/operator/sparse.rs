//! A symmetric sparse matrix, both triangles stored, compressed by rows.

use rayon::prelude::*;

/// Rows assembled or multiplied by one task.
const ROWS_PER_TASK: usize = 512;

/// An n×n symmetric matrix; the columns of every row ascend and contain the diagonal.
#[derive(Debug, Clone, PartialEq)]
pub struct SymmetricSparse {
    offsets: Vec<usize>,
    columns: Vec<u32>,
    values: Vec<f64>,
}

impl SymmetricSparse {
    /// A stiffness matrix from symmetric non-negative weights: `−w_ij` beside the diagonal, row sums zero.
    ///
    /// `weights(i, row)` appends the neighbours `j ≠ i` of row `i` with their weights, by ascending index; it must
    /// give the same bits for `(i, j)` and `(j, i)`. `rows_done` is called after every stretch of rows and may stop
    /// the assembly.
    ///
    /// # Errors
    /// Those of `rows_done`.
    pub fn stiffness<T: Send, E>(
        n: usize,
        scratch: impl Fn() -> T + Sync + Send,
        weights: impl Fn(usize, &mut T, &mut Vec<(u32, f64)>) + Sync + Send,
        mut rows_done: impl FnMut(usize) -> Result<(), E>,
    ) -> Result<Self, E> {
        let mut matrix = Self { offsets: vec![0], columns: Vec::new(), values: Vec::new() };
        matrix.offsets.reserve_exact(n);
        let stretch = 32 * ROWS_PER_TASK;
        for start in (0..n).step_by(stretch) {
            rows_done(start)?;
            let end = n.min(start + stretch);
            let tasks: Vec<(Vec<usize>, Vec<u32>, Vec<f64>)> = (start..end)
                .step_by(ROWS_PER_TASK)
                .collect::<Vec<_>>()
                .into_par_iter()
                .map_init(
                    || (scratch(), Vec::new()),
                    |(scratch, row), first| {
                        assemble(
                            first..end.min(first + ROWS_PER_TASK),
                            |i, row| weights(i, scratch, row),
                            row,
                        )
                    },
                )
                .collect();
            for (lengths, columns, values) in tasks {
                let mut last = matrix.columns.len();
                matrix.offsets.extend(lengths.iter().map(|length| {
                    last += length;
                    last
                }));
                matrix.columns.extend_from_slice(&columns);
                matrix.values.extend_from_slice(&values);
            }
        }
        matrix.columns.shrink_to_fit();
        matrix.values.shrink_to_fit();
        Ok(matrix)
    }

    /// Number of rows n.
    #[must_use]
    pub fn rows(&self) -> usize {
        self.offsets.len() - 1
    }

    /// Number of stored entries, the diagonal included.
    #[must_use]
    pub fn nonzeros(&self) -> usize {
        self.columns.len()
    }

    /// Columns and values of row `i`.
    #[must_use]
    pub fn row(&self, i: usize) -> (&[u32], &[f64]) {
        let range = self.offsets[i]..self.offsets[i + 1];
        (&self.columns[range.clone()], &self.values[range])
    }

    /// Columns of row `i`.
    pub fn neighbors(&self, i: usize) -> impl Iterator<Item = u32> {
        self.row(i).0.iter().copied().filter(move |&j| j as usize != i)
    }

    /// Offsets of the rows, n+1.
    #[must_use]
    pub fn offsets(&self) -> &[usize] {
        &self.offsets
    }

    /// Columns of all entries.
    #[must_use]
    pub fn columns(&self) -> &[u32] {
        &self.columns
    }

    /// Values of all entries.
    #[must_use]
    pub fn values(&self) -> &[f64] {
        &self.values
    }

    /// `D A D` for the diagonal matrix `D`, in place.
    pub fn scale_both_sides(&mut self, diagonal: &[f64]) {
        for i in 0..self.rows() {
            for k in self.offsets[i]..self.offsets[i + 1] {
                // in this order (i, j) and (j, i) round alike
                self.values[k] *= diagonal[i] * diagonal[self.columns[k] as usize];
            }
        }
    }

    /// The principal submatrix of the rows in `keep` (ascending).
    #[must_use]
    pub fn restricted_to(&self, keep: &[u32]) -> Self {
        let mut place = vec![u32::MAX; self.rows()];
        for (new, &old) in keep.iter().enumerate() {
            place[old as usize] = new as u32;
        }
        let mut kept = Self { offsets: vec![0], columns: Vec::new(), values: Vec::new() };
        for &i in keep {
            let (columns, values) = self.row(i as usize);
            for (&j, &value) in columns.iter().zip(values) {
                if place[j as usize] != u32::MAX {
                    kept.columns.push(place[j as usize]);
                    kept.values.push(value);
                }
            }
            kept.offsets.push(kept.columns.len());
        }
        kept
    }
}

/// Rows `rows` of a stiffness matrix: their lengths, columns and values.
fn assemble(
    rows: std::ops::Range<usize>,
    mut weights: impl FnMut(usize, &mut Vec<(u32, f64)>),
    row: &mut Vec<(u32, f64)>,
) -> (Vec<usize>, Vec<u32>, Vec<f64>) {
    let (mut lengths, mut columns, mut values) = (Vec::with_capacity(rows.len()), Vec::new(), Vec::new());
    for i in rows {
        row.clear();
        weights(i, row);
        let diagonal: f64 = row.iter().map(|&(_, w)| w).sum();
        let before = row.partition_point(|&(j, _)| (j as usize) < i);
        let mut push = |j: u32, value: f64| {
            columns.push(j);
            values.push(value);
        };
        row[..before].iter().for_each(|&(j, w)| push(j, -w));
        push(i as u32, diagonal);
        row[before..].iter().for_each(|&(j, w)| push(j, -w));
        lengths.push(row.len() + 1);
    }
    (lengths, columns, values)
}

//! A square sparse matrix, compressed by rows.

use rayon::prelude::*;

/// Rows assembled or multiplied by one task.
const ROWS_PER_TASK: usize = 512;

/// An n×n matrix; the columns of every row ascend and contain the diagonal. Of a symmetric matrix both triangles are
/// stored.
#[derive(Debug, Clone, PartialEq)]
pub struct Sparse {
    offsets: Vec<usize>,
    columns: Vec<u32>,
    values: Vec<f64>,
}

impl Sparse {
    /// A stiffness matrix from non-negative weights: `−w_ij` beside the diagonal, row sums zero.
    ///
    /// `weights(i, scratch, row)` appends the neighbors `j ≠ i` of row `i` with their weights, by ascending index;
    /// for a symmetric matrix it must give the same bits for `(i, j)` and `(j, i)`. `rows_done` is called after every
    /// stretch of rows and may stop the assembly.
    ///
    /// # Errors
    /// Those of `rows_done`.
    pub fn stiffness<T: Send, E>(
        n: usize,
        scratch: impl Fn() -> T + Sync + Send,
        weights: impl Fn(usize, &mut T, &mut Vec<(u32, f64)>) + Sync + Send,
        rows_done: impl FnMut(usize) -> Result<(), E>,
    ) -> Result<Self, E> {
        Self::from_rows(
            n,
            scratch,
            |i, scratch, row| {
                weights(i, scratch, row);
                merge_repeated(row);
                let diagonal: f64 = row.iter().map(|&(_, w)| w).sum();
                for (_, w) in row.iter_mut() {
                    *w = -*w;
                }
                let before = row.partition_point(|&(j, _)| (j as usize) < i);
                row.insert(before, (i as u32, diagonal));
            },
            rows_done,
        )
    }

    /// A matrix from its rows: `entries(i, scratch, row)` appends the entries of row `i`, the diagonal among them, by
    /// ascending column. `rows_done` is called before every stretch of rows and at the end: an `entries` that gives up
    /// because of what `rows_done` will say leaves no matrix behind.
    ///
    /// # Errors
    /// Those of `rows_done`.
    pub fn from_rows<T: Send, E>(
        n: usize,
        scratch: impl Fn() -> T + Sync + Send,
        entries: impl Fn(usize, &mut T, &mut Vec<(u32, f64)>) + Sync + Send,
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
                            |i, row| entries(i, scratch, row),
                            row,
                        )
                    },
                )
                .collect();
            if start == 0 {
                // the other rows are expected to be as long: doubling would take twice the room for a moment
                let entries: usize = tasks.iter().map(|(_, columns, _)| columns.len()).sum();
                let expected = (entries as f64 * 1.02 * n as f64 / end as f64) as usize;
                matrix.columns.reserve_exact(expected);
                matrix.values.reserve_exact(expected);
            }
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
        rows_done(n)?;
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

    /// For every row the columns in which it occurs without containing them itself, with the values there.
    #[must_use]
    pub fn seen_from_elsewhere(&self) -> Vec<Vec<(u32, f64)>> {
        let one_sided = |i: usize| {
            let (columns, values) = self.row(i);
            let is_seen_back = move |j: u32| self.row(j as usize).0.binary_search(&(i as u32)).is_ok();
            let entries = columns.iter().zip(values).filter(move |(j, _)| !is_seen_back(**j));
            entries.map(move |(&j, &value)| (j, i as u32, value))
        };
        let few: Vec<(u32, u32, f64)> =
            (0..self.rows()).into_par_iter().with_min_len(512).flat_map_iter(one_sided).collect();
        let mut unseen = vec![Vec::new(); self.rows()];
        for (j, i, value) in few {
            unseen[j as usize].push((i, value));
        }
        unseen
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
        self.rewrite(|i, columns, values| {
            for (&j, value) in columns.iter().zip(values) {
                // in this order (i, j) and (j, i) round alike
                *value *= diagonal[i] * diagonal[j as usize];
            }
        });
    }

    /// `D A` for the diagonal matrix `D`, in place.
    pub fn scale_rows(&mut self, diagonal: &[f64]) {
        for (i, d) in diagonal.iter().enumerate() {
            self.values[self.offsets[i]..self.offsets[i + 1]].iter_mut().for_each(|x| *x *= d);
        }
    }

    /// Multiplies all values by `factor`.
    pub fn scale(&mut self, factor: f64) {
        self.values.iter_mut().for_each(|x| *x *= factor);
    }

    /// Replaces the values, row by row: `rewrite(i, columns, values)`.
    pub fn rewrite(&mut self, rewrite: impl Fn(usize, &[u32], &mut [f64]) + Sync + Send) {
        let mut rows: Vec<(&[u32], &mut [f64])> = Vec::with_capacity(self.rows());
        let (mut columns, mut values) = (self.columns.as_slice(), self.values.as_mut_slice());
        for pair in self.offsets.windows(2) {
            let (row, rest) = columns.split_at(pair[1] - pair[0]);
            let (entries, others) = values.split_at_mut(pair[1] - pair[0]);
            (columns, values) = (rest, others);
            rows.push((row, entries));
        }
        rows.into_par_iter()
            .with_min_len(ROWS_PER_TASK)
            .enumerate()
            .for_each(|(i, (columns, values))| rewrite(i, columns, values));
    }

    /// `½(A + Aᵀ)`.
    #[must_use]
    pub fn symmetric_part(&self) -> Self {
        let n = self.rows();
        let mut transposed: Vec<Vec<(u32, f64)>> = vec![Vec::new(); n];
        for i in 0..n {
            let (columns, values) = self.row(i);
            for (&j, &value) in columns.iter().zip(values) {
                transposed[j as usize].push((i as u32, value));
            }
        }
        let mut sum = Self { offsets: vec![0], columns: Vec::new(), values: Vec::new() };
        for (i, other) in transposed.iter().enumerate() {
            let (columns, values) = self.row(i);
            let mut other = other.iter().copied().peekable();
            let mut push = |j: u32, value: f64| {
                sum.columns.push(j);
                sum.values.push(0.5 * value);
            };
            for (&j, &value) in columns.iter().zip(values) {
                while let Some((k, extra)) = other.next_if(|&(k, _)| k < j) {
                    push(k, extra);
                }
                let extra = other.next_if(|&(k, _)| k == j).map_or(0.0, |(_, extra)| extra);
                push(j, value + extra);
            }
            other.for_each(|(k, extra)| push(k, extra));
            sum.offsets.push(sum.columns.len());
        }
        sum
    }

    /// `A x`.
    ///
    /// # Panics
    /// Unless `x` has n entries.
    #[must_use]
    pub fn product(&self, x: &[f64]) -> Vec<f64> {
        assert_eq!(x.len(), self.rows());
        (0..self.rows())
            .into_par_iter()
            .with_min_len(ROWS_PER_TASK)
            .map(|i| {
                let (columns, values) = self.row(i);
                columns.iter().zip(values).map(|(&j, value)| value * x[j as usize]).sum()
            })
            .collect()
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

/// Sorts the entries of a row by column and adds up those of the same column: solvers rely on every column occurring once.
fn merge_repeated(row: &mut Vec<(u32, f64)>) {
    if row.is_sorted_by(|a, b| a.0 < b.0) {
        return;
    }
    row.sort_by_key(|&(column, _)| column);
    row.dedup_by(|later, sum| {
        let same = later.0 == sum.0;
        if same {
            sum.1 += later.1;
        }
        same
    });
}

/// Rows `rows`: their lengths, columns and values.
fn assemble(
    rows: std::ops::Range<usize>,
    mut entries: impl FnMut(usize, &mut Vec<(u32, f64)>),
    row: &mut Vec<(u32, f64)>,
) -> (Vec<usize>, Vec<u32>, Vec<f64>) {
    let (mut lengths, mut columns, mut values) = (Vec::with_capacity(rows.len()), Vec::new(), Vec::new());
    for i in rows {
        row.clear();
        entries(i, row);
        merge_repeated(row);
        columns.extend(row.iter().map(|&(j, _)| j));
        values.extend(row.iter().map(|&(_, value)| value));
        lengths.push(row.len());
    }
    (lengths, columns, values)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn matrix(rows: &[&[(u32, f64)]]) -> Sparse {
        let all = |i: usize, (): &mut (), row: &mut Vec<(u32, f64)>| row.extend_from_slice(rows[i]);
        Sparse::from_rows(rows.len(), || (), all, |_| Ok::<(), ()>(())).unwrap()
    }

    #[test]
    fn the_symmetric_part_averages_a_matrix_with_its_transpose() {
        let skew = matrix(&[&[(0, 1.0), (1, 4.0)], &[(1, 2.0), (2, 6.0)], &[(0, 8.0), (2, 3.0)]]);
        let expected = matrix(&[
            &[(0, 1.0), (1, 2.0), (2, 4.0)],
            &[(0, 2.0), (1, 2.0), (2, 3.0)],
            &[(0, 4.0), (1, 3.0), (2, 3.0)],
        ]);
        assert_eq!(skew.symmetric_part(), expected);
    }

    #[test]
    fn rewriting_gives_every_row_its_own_columns_and_values() {
        let mut skew = matrix(&[&[(0, 1.0), (1, 4.0)], &[], &[(0, 8.0), (2, 3.0)]]);
        skew.rewrite(|i, columns, values| {
            columns.iter().zip(values).for_each(|(&j, x)| *x += 10.0 * i as f64 + 100.0 * f64::from(j));
        });
        assert_eq!(skew, matrix(&[&[(0, 1.0), (1, 104.0)], &[], &[(0, 28.0), (2, 223.0)]]));
    }

    #[test]
    fn entries_of_one_column_are_added_up_and_columns_sorted() {
        let repeated = matrix(&[&[(1, 4.0), (0, 1.0), (1, 0.5)], &[(1, 2.0)]]);
        assert_eq!(repeated, matrix(&[&[(0, 1.0), (1, 4.5)], &[(1, 2.0)]]));
        let weights = |i: usize, (): &mut (), row: &mut Vec<(u32, f64)>| {
            row.extend([(1 - i as u32, 1.0), (1 - i as u32, 2.0)]);
        };
        let stiffness = Sparse::stiffness(2, || (), weights, |_| Ok::<(), ()>(())).unwrap();
        assert_eq!(stiffness, matrix(&[&[(0, 3.0), (1, -3.0)], &[(0, -3.0), (1, 3.0)]]));
    }

    #[test]
    fn a_product_with_a_vector_sums_along_rows() {
        let skew = matrix(&[&[(0, 1.0), (1, 4.0)], &[(1, 2.0)]]);
        assert_eq!(skew.product(&[1.0, 10.0]), [41.0, 20.0]);
    }
}

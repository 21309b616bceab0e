//! Bases a block of rows at a time: n × k numbers need not fit into memory.

/// Rows `first..` of every basis, one column per basis, all of the same length.
///
/// A row is NaN in all columns or in none: rows without a result carry no basis.
#[derive(Debug, Clone)]
pub struct Block<C> {
    /// Row of the upload that the columns begin with.
    pub first: usize,
    /// Values of the bases, in 1/length on a surface; `HᵀBH = I` over all blocks.
    pub columns: Vec<C>,
}

impl<C: AsRef<[f64]>> Block<C> {
    /// Number of rows.
    #[must_use]
    pub fn rows(&self) -> usize {
        self.columns.first().map_or(0, |column| column.as_ref().len())
    }

    /// Number of bases.
    #[must_use]
    pub fn bases(&self) -> usize {
        self.columns.len()
    }

    /// Values of basis `j`.
    #[must_use]
    pub fn column(&self, j: usize) -> &[f64] {
        self.columns[j].as_ref()
    }

    /// Whether a row carries bases.
    #[must_use]
    pub fn is_used(&self, row: usize) -> bool {
        self.columns.first().is_some_and(|column| !column.as_ref()[row].is_nan())
    }
}

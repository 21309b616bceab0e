//! The inverse of a shifted operator, as Krylov spaces are built with it.

use super::factor::Cholesky;
use super::vectors::block::Block;
use crate::progress::{Canceled, Progress};

/// Vectors multiplied together.
pub(super) const BLOCK: usize = 16;

/// The eigenvalues nearest to a shift.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Nearest {
    /// How many below it.
    pub below: usize,
    /// How many above it.
    pub above: usize,
}

impl Nearest {
    /// How many in all.
    #[must_use]
    pub fn count(self) -> usize {
        self.below + self.above
    }
}

/// `(A − sI)⁻¹`, exactly or nearly.
pub trait Inverse {
    /// `X ← (A − sI)⁻¹ X`.
    ///
    /// # Errors
    /// [`Canceled`].
    fn solve(&self, x: &mut Block, progress: &Progress) -> Result<(), Canceled>;

    /// Whether solutions come in single precision: a Krylov space of them needs no more either.
    fn is_single(&self) -> bool;
}

impl Inverse for Cholesky<'_> {
    fn solve(&self, x: &mut Block, progress: &Progress) -> Result<(), Canceled> {
        Cholesky::solve(self, x, progress)
    }

    fn is_single(&self) -> bool {
        !self.is_exact()
    }
}

/// `(A − sI)⁻¹` and its shift.
#[derive(Clone, Copy)]
pub struct Shifted<'a> {
    /// The inverse.
    pub inverse: &'a dyn Inverse,
    /// s, negative for a positive definite matrix.
    pub shift: f64,
}

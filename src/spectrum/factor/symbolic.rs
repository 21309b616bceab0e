//! The pattern of a sparse Cholesky factor, known before any of its numbers.

use faer::Side;
use faer::perm::PermRef;
use faer::sparse::SymbolicSparseColMatRef;
use faer::sparse::linalg::SupernodalThreshold;
use faer::sparse::linalg::cholesky::{
    CholeskySymbolicParams, SymbolicCholeskyRaw, SymmetricOrdering, factorize_symbolic_cholesky,
};

use super::FactorError;
use super::elimination::{Elimination, nested_dissection};
use super::supernodes::Supernodes;
use crate::operator::Sparse;
use crate::progress::Progress;

/// The pattern of a factor, and what it will cost, known before it is made.
pub struct Symbolic {
    pub(super) nodes: Supernodes,
    /// The row eliminated k-th.
    pub(super) order: Vec<u32>,
    /// When row i is eliminated.
    pub(super) place: Vec<u32>,
}

impl Symbolic {
    /// Analyzes the pattern of `matrix`, whose row `i` is at `position(i)`, in an elimination order by nested dissection.
    ///
    /// # Errors
    /// As [`Self::analyze`].
    pub fn by_position<'a>(
        matrix: &Sparse,
        position: impl Fn(u32) -> &'a [f64] + Sync,
        progress: &Progress,
    ) -> Result<Self, FactorError> {
        let elimination = nested_dissection(matrix, position, progress)?;
        let symbolic = Self::analyze(matrix, elimination, progress)?;
        progress.checkpoint()?;
        Ok(symbolic)
    }

    /// Analyzes the pattern of `matrix` for an elimination order.
    ///
    /// # Errors
    /// [`FactorError::Matrix`] when the matrix or its factor has more entries than can be indexed,
    /// [`FactorError::Canceled`].
    pub fn analyze(
        matrix: &Sparse,
        elimination: impl Into<Elimination>,
        progress: &Progress,
    ) -> Result<Self, FactorError> {
        let Elimination { order, parts } = elimination.into();
        let fail = |what: &str| FactorError::Matrix(format!("symbolic analysis: {what}"));
        if u32::try_from(matrix.nonzeros()).is_err() {
            return Err(fail("more than 2^32 entries"));
        }
        let n = matrix.rows();
        let offsets: Vec<u32> = matrix.offsets().iter().map(|&o| o as u32).collect();
        let mut place = vec![0_u32; n];
        for (k, &row) in order.iter().enumerate() {
            place[row as usize] = k as u32;
        }
        let pattern = SymbolicSparseColMatRef::new_checked(n, n, &offsets, None, matrix.columns());
        let structure = factorize_symbolic_cholesky(
            pattern,
            Side::Lower,
            SymmetricOrdering::Custom(PermRef::new_checked(&order, &place, n)),
            CholeskySymbolicParams {
                supernodal_flop_ratio_threshold: SupernodalThreshold::FORCE_SUPERNODAL,
                ..CholeskySymbolicParams::default()
            },
        )
        .map_err(|error| fail(&format!("{error:?}")))?;
        progress.checkpoint()?;
        match structure.raw() {
            SymbolicCholeskyRaw::Supernodal(symbolic) => {
                Ok(Self { nodes: Supernodes::new(symbolic, &parts), order, place })
            }
            SymbolicCholeskyRaw::Simplicial(_) => Err(fail("no supernodes")),
        }
    }

    /// Entries of the factor.
    #[must_use]
    pub fn factor_entries(&self) -> usize {
        self.nodes.entries()
    }
}

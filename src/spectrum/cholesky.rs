//! Sparse Cholesky factors of shifted stiffness matrices, with signs where the shift makes them indefinite, by faer's
//! supernodal factorisation.

use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::cholesky::ldlt::factor::LdltRegularization;
use faer::perm::PermRef;
use faer::sparse::linalg::SupernodalThreshold;
use faer::sparse::linalg::cholesky::supernodal::SymbolicSupernodalCholesky;
use faer::sparse::linalg::cholesky::{
    CholeskySymbolicParams, SymbolicCholesky, SymbolicCholeskyRaw, SymmetricOrdering,
    factorize_symbolic_cholesky,
};
use faer::sparse::{SparseColMatRef, SymbolicSparseColMatRef};
use faer::{Par, Side};
use rayon::prelude::*;

use super::block::Block;
use super::substitution::{Signed, WIDTH_MAX, WIDTH_MIN};
use super::{SpectrumError, substitution};
use crate::operator::Sparse;

/// Largest relative residual of the probe after a factorisation. A release of the kernel library once gave silently
/// wrong factors.
const PROBE_MAX: f64 = 1e-6;

/// What a factorisation will cost, known before it is made.
pub struct Symbolic {
    structure: SymbolicCholesky<u32>,
    offsets: Vec<u32>,
    /// The row eliminated k-th.
    order: Vec<u32>,
    /// When row i is eliminated.
    place: Vec<u32>,
}

impl Symbolic {
    /// Analyses the pattern of `matrix` for the elimination order `order`.
    ///
    /// # Errors
    /// [`SpectrumError::Factorization`] when the matrix or its factor has more entries than can be indexed.
    pub fn analyze(matrix: &Sparse, order: Vec<u32>) -> Result<Self, SpectrumError> {
        let fail = |what: &str| SpectrumError::Factorization(format!("symbolic analysis: {what}"));
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
        match structure.raw() {
            SymbolicCholeskyRaw::Supernodal(_) => Ok(Self { structure, offsets, order, place }),
            SymbolicCholeskyRaw::Simplicial(_) => Err(fail("no supernodes")),
        }
    }

    fn supernodes(&self) -> &SymbolicSupernodalCholesky<u32> {
        match self.structure.raw() {
            SymbolicCholeskyRaw::Supernodal(symbolic) => symbolic,
            SymbolicCholeskyRaw::Simplicial(_) => unreachable!("refused by the analysis"),
        }
    }

    /// Entries of the factor.
    #[must_use]
    pub fn factor_entries(&self) -> usize {
        self.structure.len_val()
    }

    /// Factors `A + shift·I` for a positive semi-definite `A` of the analysed pattern and `shift > 0`.
    ///
    /// # Errors
    /// [`SpectrumError::Factorization`] when the matrix is not positive definite or the probe fails.
    pub fn factor(&self, matrix: &Sparse, shift: f64) -> Result<Cholesky<'_>, SpectrumError> {
        match self.factor_indefinite(matrix, shift)? {
            Some(cholesky) if cholesky.negative.is_empty() => Ok(cholesky),
            Some(_) => Err(SpectrumError::Factorization("not positive definite".into())),
            None => {
                Err(SpectrumError::Factorization("a pivot is zero, or the probe |Ax−b|/|b| fails".into()))
            }
        }
    }

    /// Factors `A + shift·I`, which may have negative eigenvalues; `None` when a pivot is zero or the factor fails its
    /// probe (`−shift` too near an eigenvalue).
    ///
    /// # Errors
    /// [`SpectrumError::Factorization`] when memory cannot be had.
    pub fn factor_indefinite(
        &self,
        matrix: &Sparse,
        shift: f64,
    ) -> Result<Option<Cholesky<'_>>, SpectrumError> {
        let values = shifted(matrix, shift);
        let a = SparseColMatRef::new(self.pattern(matrix), &values);
        let mut factor = vec![0.0; self.structure.len_val()];
        let spec = faer::Spec::default();
        let mut memory = allocate(self.structure.factorize_numeric_ldlt_scratch::<f64>(Par::Seq, spec))?;
        let factored = self.structure.factorize_numeric_ldlt(
            &mut factor,
            a,
            Side::Lower,
            LdltRegularization::default(),
            Par::Seq,
            MemStack::new(&mut memory),
            spec,
        );
        if factored.is_err() {
            return Ok(None);
        }
        drop((memory, values));
        let negative = self.divide_pivots(&mut factor);
        let cholesky = Cholesky { symbolic: self, factor, negative };
        let relative = probe(matrix, shift, |x| cholesky.solve(x));
        Ok((relative <= PROBE_MAX).then_some(cholesky))
    }

    /// Turns `L D Lᵀ` into `(L |D|^½) sign(D) (L |D|^½)ᵀ`, and tells the negative pivots' places.
    fn divide_pivots(&self, factor: &mut [f64]) -> Vec<u32> {
        let supernodes = self.supernodes();
        let mut negative = Vec::new();
        for s in 0..supernodes.n_supernodes() {
            let start = supernodes.supernode_begin()[s];
            let width = (supernodes.supernode_end()[s] - start) as usize;
            let height = width + supernodes.nnz_per_super()[s] as usize;
            let values = &mut factor[supernodes.col_ptr_for_val()[s] as usize..][..width * height];
            for (k, column) in values.chunks_exact_mut(height).enumerate() {
                let pivot = column[k];
                if pivot < 0.0 {
                    negative.push(start + k as u32);
                }
                let root = pivot.abs().sqrt();
                column[k] = root;
                column[k + 1..].iter_mut().for_each(|x| *x *= root);
            }
        }
        negative
    }

    /// Number of eigenvalues of `A` below `bound`, by Sylvester's law of inertia from the signs of the pivots of
    /// `A − bound·I`; `None` when it cannot be factored (`bound` too near an eigenvalue).
    ///
    /// # Errors
    /// [`SpectrumError::Factorization`] when memory cannot be had.
    pub fn eigenvalues_below(&self, matrix: &Sparse, bound: f64) -> Result<Option<usize>, SpectrumError> {
        Ok(self.factor_indefinite(matrix, -bound)?.map(|cholesky| cholesky.negative_eigenvalues()))
    }

    fn pattern<'a>(&'a self, matrix: &'a Sparse) -> SymbolicSparseColMatRef<'a, u32> {
        let n = matrix.rows();
        SymbolicSparseColMatRef::new_checked(n, n, &self.offsets, None, matrix.columns())
    }
}

fn allocate(size: faer::dyn_stack::StackReq) -> Result<MemBuffer, SpectrumError> {
    MemBuffer::try_new(size).map_err(|_| {
        SpectrumError::Factorization(format!(
            "{} MiB of scratch memory cannot be had",
            size.size_bytes() >> 20
        ))
    })
}

/// Values of `A + shift·I`.
fn shifted(matrix: &Sparse, shift: f64) -> Vec<f64> {
    let mut values = matrix.values().to_vec();
    for (i, span) in matrix.offsets().windows(2).enumerate() {
        let columns = &matrix.columns()[span[0]..span[1]];
        let diagonal = columns.partition_point(|&j| (j as usize) < i);
        values[span[0] + diagonal] += shift;
    }
    values
}

/// `|(A + shift·I) x − b| / |b|` for the solution of a system whose right-hand side touches every row.
fn probe(matrix: &Sparse, shift: f64, solve: impl FnOnce(&mut Block)) -> f64 {
    let n = matrix.rows();
    let b = |i: usize| super::start::hashed(i, usize::MAX);
    let mut x = Block::zeros(n, 1);
    x.for_each_row(|i, row| row[0] = b(i));
    solve(&mut x);
    let x = x.column(0);
    let (mut error, mut size) = (0.0, 0.0);
    for (i, product) in matrix.product(&x).into_iter().enumerate() {
        error += (product + shift * x[i] - b(i)).powi(2);
        size += b(i).powi(2);
    }
    (error / size).sqrt()
}

/// `A + shift·I = L S Lᵀ` with signs `S`, all positive where the matrix is definite.
pub struct Cholesky<'a> {
    symbolic: &'a Symbolic,
    factor: Vec<f64>,
    /// Places of the negative signs.
    negative: Vec<u32>,
}

impl Cholesky<'_> {
    /// Number of eigenvalues of the factored matrix below 0, by Sylvester's law of inertia.
    #[must_use]
    pub fn negative_eigenvalues(&self) -> usize {
        self.negative.len()
    }

    /// `X ← (A + shift·I)⁻¹ X`, groups of columns in parallel.
    pub fn solve(&self, x: &mut Block) {
        let Symbolic { order, place, .. } = self.symbolic;
        // two narrow passes rather than one wide one where they can run side by side
        let width = if x.columns() > WIDTH_MAX { WIDTH_MAX } else { WIDTH_MIN };
        let groups: Vec<usize> = (0..x.columns()).step_by(width).collect();
        let source = &*x;
        let solved: Vec<Vec<f64>> = groups
            .par_iter()
            .map(|&first| {
                let count = width.min(source.columns() - first);
                let mut group = vec![0.0; source.rows() * width];
                for (row, &i) in group.chunks_exact_mut(width).zip(order) {
                    row[..count].copy_from_slice(&source.row(i as usize)[first..first + count]);
                }
                let factor = Signed { values: &self.factor, negative: &self.negative };
                substitution::solve(self.symbolic.supernodes(), factor, &mut group, width);
                group
            })
            .collect();
        x.for_each_row(|i, row| {
            let place = place[i] as usize;
            for (group, part) in solved.iter().zip(row.chunks_mut(width)) {
                part.copy_from_slice(&group[place * width..][..part.len()]);
            }
        });
    }
}

//! Sparse Cholesky factors of shifted stiffness matrices, with faer's supernodal factorisation.

use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::cholesky::ldlt::factor::LdltRegularization;
use faer::linalg::cholesky::llt::factor::LltRegularization;
use faer::perm::PermRef;
use faer::sparse::linalg::SupernodalThreshold;
use faer::sparse::linalg::cholesky::supernodal::{SupernodalLdltRef, SymbolicSupernodalCholesky};
use faer::sparse::linalg::cholesky::{
    CholeskySymbolicParams, LdltRef, SymbolicCholesky, SymbolicCholeskyRaw, SymmetricOrdering,
    factorize_symbolic_cholesky,
};
use faer::sparse::{SparseColMatRef, SymbolicSparseColMatRef};
use faer::{Conj, Mat, Par, Side};
use rayon::prelude::*;

use super::block::Block;
use super::substitution::{WIDTH_MAX, WIDTH_MIN};
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
        let values = shifted(matrix, shift);
        let a = SparseColMatRef::new(self.pattern(matrix), &values);
        let mut factor = vec![0.0; self.structure.len_val()];
        let mut memory =
            allocate(self.structure.factorize_numeric_llt_scratch::<f64>(Par::Seq, faer::Spec::default()))?;
        self.structure
            .factorize_numeric_llt(
                &mut factor,
                a,
                Side::Lower,
                LltRegularization::default(),
                Par::Seq,
                MemStack::new(&mut memory),
                faer::Spec::default(),
            )
            .map_err(|error| SpectrumError::Factorization(format!("not positive definite: {error:?}")))?;
        let cholesky = Cholesky { symbolic: self, factor };
        let relative = probe(matrix, shift, |x| cholesky.solve(x));
        if relative.is_nan() || relative > PROBE_MAX {
            return Err(SpectrumError::Factorization(format!("the probe |Ax−b|/|b| is {relative:e}")));
        }
        Ok(cholesky)
    }

    /// Number of eigenvalues of `A` below `bound`, by Sylvester's law of inertia from the signs of `D` in
    /// `A − bound·I = L D Lᵀ`; `None` when the factor fails its probe (`bound` too near an eigenvalue).
    ///
    /// # Errors
    /// [`SpectrumError::Factorization`] when memory cannot be had.
    pub fn eigenvalues_below(&self, matrix: &Sparse, bound: f64) -> Result<Option<usize>, SpectrumError> {
        let values = shifted(matrix, -bound);
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
        let relative = probe(matrix, -bound, |x| {
            let mut column = Mat::from_fn(x.rows(), 1, |i, _| x.row(i)[0]);
            let mut memory = MemBuffer::new(self.structure.solve_in_place_scratch::<f64>(1, Par::Seq));
            LdltRef::new(&self.structure, &factor).solve_in_place_with_conj(
                Conj::No,
                column.as_mut(),
                Par::Seq,
                MemStack::new(&mut memory),
            );
            x.for_each_row(|i, row| row[0] = column[(i, 0)]);
        });
        let ldlt = SupernodalLdltRef::new(self.supernodes(), &factor);
        let negative = |s: usize| {
            let diagonal = ldlt.supernode(s).val();
            (0..diagonal.ncols()).filter(|&k| diagonal[(k, k)] < 0.0).count()
        };
        Ok((relative <= PROBE_MAX).then(|| (0..self.supernodes().n_supernodes()).map(negative).sum()))
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

/// A factor of `A + shift·I`.
pub struct Cholesky<'a> {
    symbolic: &'a Symbolic,
    factor: Vec<f64>,
}

impl Cholesky<'_> {
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
                substitution::solve(self.symbolic.supernodes(), &self.factor, &mut group, width);
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

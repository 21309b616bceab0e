//! Sparse Cholesky factors of shifted stiffness matrices, with faer's supernodal factorisation.

use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::cholesky::ldlt::factor::LdltRegularization;
use faer::linalg::cholesky::llt::factor::LltRegularization;
use faer::perm::PermRef;
use faer::sparse::linalg::cholesky::{
    CholeskySymbolicParams, LdltRef, LltRef, SymbolicCholesky, SymmetricOrdering, factorize_symbolic_cholesky,
};
use faer::sparse::{SparseColMatRef, SymbolicSparseColMatRef};
use faer::{Conj, Mat, Par, Side};
use rayon::prelude::*;

use super::SpectrumError;
use super::block::Block;
use crate::operator::Sparse;

/// Right-hand sides solved together by one thread: enough to make the factor's reading worth while, few enough to
/// stay in cache. A fixed number, since a column's last bits depend on the width of its group.
const COLUMNS_TOGETHER: usize = 8;

/// Largest relative residual of the probe after a factorisation. A release of the kernel library once gave silently
/// wrong factors.
const PROBE_MAX: f64 = 1e-6;

/// What a factorisation will cost, known before it is made.
pub struct Symbolic {
    symbolic: SymbolicCholesky<u32>,
    offsets: Vec<u32>,
}

impl Symbolic {
    /// Analyses the pattern of `matrix` for the elimination order `order`.
    ///
    /// # Errors
    /// [`SpectrumError::Factorization`] when the matrix or its factor has more entries than can be indexed.
    pub fn analyze(matrix: &Sparse, order: &[u32]) -> Result<Self, SpectrumError> {
        let fail = |what: &str| SpectrumError::Factorization(format!("symbolic analysis: {what}"));
        if u32::try_from(matrix.nonzeros()).is_err() {
            return Err(fail("more than 2^32 entries"));
        }
        let n = matrix.rows();
        let offsets: Vec<u32> = matrix.offsets().iter().map(|&o| o as u32).collect();
        let mut inverse = vec![0_u32; n];
        for (place, &row) in order.iter().enumerate() {
            inverse[row as usize] = place as u32;
        }
        let pattern = SymbolicSparseColMatRef::new_checked(n, n, &offsets, None, matrix.columns());
        let symbolic = factorize_symbolic_cholesky(
            pattern,
            Side::Lower,
            SymmetricOrdering::Custom(PermRef::new_checked(order, &inverse, n)),
            CholeskySymbolicParams::default(),
        )
        .map_err(|error| fail(&format!("{error:?}")))?;
        Ok(Self { symbolic, offsets })
    }

    /// Entries of the factor.
    #[must_use]
    pub fn factor_entries(&self) -> usize {
        self.symbolic.len_val()
    }

    /// Factors `A + shift·I` for a positive semi-definite `A` of the analysed pattern and `shift > 0`.
    ///
    /// # Errors
    /// [`SpectrumError::Factorization`] when the matrix is not positive definite or the probe fails.
    pub fn factor(&self, matrix: &Sparse, shift: f64) -> Result<Cholesky<'_>, SpectrumError> {
        let values = shifted(matrix, shift);
        let a = SparseColMatRef::new(self.pattern(matrix), &values);
        let mut factor = vec![0.0; self.symbolic.len_val()];
        let mut memory =
            allocate(self.symbolic.factorize_numeric_llt_scratch::<f64>(Par::Seq, faer::Spec::default()))?;
        self.symbolic
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
        let cholesky = Cholesky { symbolic: &self.symbolic, factor };
        let relative = probe(matrix, shift, |x| cholesky.solve_columns(x));
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
        let mut factor = vec![0.0; self.symbolic.len_val()];
        let spec = faer::Spec::default();
        let mut memory = allocate(self.symbolic.factorize_numeric_ldlt_scratch::<f64>(Par::Seq, spec))?;
        let factored = self.symbolic.factorize_numeric_ldlt(
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
            let mut memory = MemBuffer::new(self.symbolic.solve_in_place_scratch::<f64>(x.ncols(), Par::Seq));
            LdltRef::new(&self.symbolic, &factor).solve_in_place_with_conj(
                Conj::No,
                x.as_mut(),
                Par::Seq,
                MemStack::new(&mut memory),
            );
        });
        Ok((relative <= PROBE_MAX).then(|| self.pivots(&factor).filter(|&pivot| pivot < 0.0).count()))
    }

    fn pivots<'a>(&'a self, factor: &'a [f64]) -> Box<dyn Iterator<Item = f64> + 'a> {
        use faer::sparse::linalg::cholesky::SymbolicCholeskyRaw;
        match self.symbolic.raw() {
            SymbolicCholeskyRaw::Simplicial(symbolic) => {
                Box::new(symbolic.col_ptr()[..symbolic.ncols()].iter().map(|&start| factor[start as usize]))
            }
            SymbolicCholeskyRaw::Supernodal(symbolic) => {
                let ldlt =
                    faer::sparse::linalg::cholesky::supernodal::SupernodalLdltRef::new(symbolic, factor);
                Box::new((0..symbolic.n_supernodes()).flat_map(move |s| {
                    let diagonal = ldlt.supernode(s).val();
                    (0..diagonal.ncols()).map(move |k| diagonal[(k, k)])
                }))
            }
        }
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
fn probe(matrix: &Sparse, shift: f64, solve: impl FnOnce(&mut Mat<f64>)) -> f64 {
    let n = matrix.rows();
    let b = |i: usize| super::start::hashed(i, usize::MAX);
    let mut x = Mat::from_fn(n, 1, |i, _| b(i));
    solve(&mut x);
    let (mut error, mut size) = (0.0, 0.0);
    for i in 0..n {
        let (columns, values) = matrix.row(i);
        let product: f64 = columns.iter().zip(values).map(|(&j, v)| v * x[(j as usize, 0)]).sum();
        error += (product + shift * x[(i, 0)] - b(i)).powi(2);
        size += b(i).powi(2);
    }
    (error / size).sqrt()
}

/// A factor of `A + shift·I`.
pub struct Cholesky<'a> {
    symbolic: &'a SymbolicCholesky<u32>,
    factor: Vec<f64>,
}

impl Cholesky<'_> {
    /// `X ← (A + shift·I)⁻¹ X`, groups of columns in parallel.
    pub fn solve(&self, x: &mut Block) {
        let groups: Vec<usize> = (0..x.columns()).step_by(COLUMNS_TOGETHER).collect();
        let source = &*x;
        let solved: Vec<Mat<f64>> = groups
            .par_iter()
            .map(|&first| {
                let count = COLUMNS_TOGETHER.min(source.columns() - first);
                let mut columns = Mat::from_fn(source.rows(), count, |i, j| source.row(i)[first + j]);
                self.solve_columns(&mut columns);
                columns
            })
            .collect();
        x.for_each_row(|i, row| {
            for (group, &first) in solved.iter().zip(&groups) {
                for j in 0..group.ncols() {
                    row[first + j] = group[(i, j)];
                }
            }
        });
    }

    fn solve_columns(&self, x: &mut Mat<f64>) {
        let mut memory = MemBuffer::new(self.symbolic.solve_in_place_scratch::<f64>(x.ncols(), Par::Seq));
        LltRef::new(self.symbolic, &self.factor).solve_in_place_with_conj(
            Conj::No,
            x.as_mut(),
            Par::Seq,
            MemStack::new(&mut memory),
        );
    }
}

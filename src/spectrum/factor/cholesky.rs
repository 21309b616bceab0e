//! Sparse Cholesky factors of shifted stiffness matrices, with signs where the shift makes them indefinite.

use rayon::prelude::*;

use super::factorization::{Factor, Reordered, factorize};
use super::substitution::WIDTH;
use super::symbolic::Symbolic;
use super::{FactorError, substitution};
use crate::operator::Sparse;
use crate::progress::{Canceled, Progress};
use crate::spectrum::vectors::block::{Block, column_norms};
use crate::spectrum::vectors::scalar::Scalar;
use crate::spectrum::vectors::sparse_product::sparse_product;
use crate::spectrum::vectors::start;

/// Largest relative residual of the probe after a factorization. A release of the kernel library once gave silently
/// wrong factors.
const PROBE_MAX: f64 = 1e-6;

/// Least reduction of the error by a solve in single precision that is worth repeating.
const CONTRACTION_MAX: f64 = 0.1;

/// Rows that are copied by one task, at the least.
const ROWS_MIN: usize = 4_096;

impl Symbolic {
    /// Factors `A + shift·I` for a positive semi-definite `A` of the analyzed pattern and `shift > 0`: in single precision
    /// where that leaves a small share of the error.
    ///
    /// # Errors
    /// [`FactorError::Matrix`] when the matrix is not positive definite or the probe fails,
    /// [`FactorError::Canceled`].
    pub fn factor<'a>(
        &'a self,
        matrix: &'a Sparse,
        shift: f64,
        progress: &Progress,
    ) -> Result<Cholesky<'a>, FactorError> {
        if let Some(factor) = self.factorize(matrix, shift, progress)? {
            let factor = Precision::Single(factor);
            let mut cholesky = Cholesky { symbolic: self, matrix, shift, factor, contraction: 0.0 };
            cholesky.contraction = cholesky.contraction(progress)?;
            if cholesky.contraction <= CONTRACTION_MAX && cholesky.negative_eigenvalues() == 0 {
                return Ok(cholesky);
            }
        }
        self.factor_double(matrix, shift, progress)
    }

    /// Factors in single precision for solutions that are only steps of an iteration, and looks at none of them; none when a
    /// pivot is zero or negative.
    ///
    /// # Errors
    /// [`FactorError::Canceled`].
    pub fn factor_roughly<'a>(
        &'a self,
        matrix: &'a Sparse,
        shift: f64,
        progress: &Progress,
    ) -> Result<Option<Cholesky<'a>>, FactorError> {
        let factor = self.factorize(matrix, shift, progress)?.filter(|factor| factor.negative.is_empty());
        let with = |factor| {
            let factor = Precision::Single(factor);
            Cholesky { symbolic: self, matrix, shift, factor, contraction: CONTRACTION_MAX }
        };
        Ok(factor.map(with))
    }

    /// As [`Self::factor`], in double precision.
    ///
    /// # Errors
    /// The same.
    pub fn factor_double<'a>(
        &'a self,
        matrix: &'a Sparse,
        shift: f64,
        progress: &Progress,
    ) -> Result<Cholesky<'a>, FactorError> {
        match self.factor_indefinite(matrix, shift, progress)? {
            Some(cholesky) if cholesky.negative_eigenvalues() == 0 => Ok(cholesky),
            Some(_) => Err(FactorError::Matrix("not positive definite".into())),
            None => Err(FactorError::Matrix("a pivot is zero, or the probe |Ax−b|/|b| fails".into())),
        }
    }

    /// Factors `A + shift·I`, which may have negative eigenvalues; `None` when a pivot is zero or the factor fails its
    /// probe (`−shift` too near an eigenvalue).
    ///
    /// # Errors
    /// [`FactorError::Canceled`].
    pub fn factor_indefinite<'a>(
        &'a self,
        matrix: &'a Sparse,
        shift: f64,
        progress: &Progress,
    ) -> Result<Option<Cholesky<'a>>, FactorError> {
        let Some(factor) = self.factorize(matrix, shift, progress)? else { return Ok(None) };
        let factor = Precision::Double(factor);
        let cholesky = Cholesky { symbolic: self, matrix, shift, factor, contraction: 0.0 };
        let relative = probe(matrix, shift, |x| cholesky.solve(x, progress))?;
        progress.checkpoint()?;
        Ok((relative <= PROBE_MAX).then_some(cholesky))
    }

    fn factorize<T: Scalar>(
        &self,
        matrix: &Sparse,
        shift: f64,
        progress: &Progress,
    ) -> Result<Option<Factor<T>>, FactorError> {
        progress.afford_beside((self.factor_entries() * size_of::<T>()) as u64)?;
        let reordered = Reordered { matrix, shift, order: &self.order, place: &self.place };
        Ok(factorize(&self.nodes, reordered, progress)?)
    }

    /// Number of eigenvalues of `A` below `bound`, by Sylvester's law of inertia from the signs of the pivots of
    /// `A − bound·I`; `None` when it cannot be factored (`bound` too near an eigenvalue).
    ///
    /// # Errors
    /// [`FactorError::Canceled`].
    pub fn eigenvalues_below(
        &self,
        matrix: &Sparse,
        bound: f64,
        progress: &Progress,
    ) -> Result<Option<usize>, FactorError> {
        let factor = self.factor_indefinite(matrix, -bound, progress)?;
        Ok(factor.map(|cholesky| cholesky.negative_eigenvalues()))
    }

    /// The same from a factor in single precision: right where no eigenvalue is nearer to `bound` than its rounding, which
    /// is of the size of 10⁻⁷ of the largest.
    ///
    /// # Errors
    /// [`FactorError::Canceled`].
    pub fn eigenvalues_roughly_below(
        &self,
        matrix: &Sparse,
        bound: f64,
        progress: &Progress,
    ) -> Result<Option<usize>, FactorError> {
        let factor: Option<Factor<f32>> = self.factorize(matrix, -bound, progress)?;
        Ok(factor.map(|factor| factor.negative.len()))
    }
}

/// `|(A + shift·I) x − b| / |b|` for the solution of a system whose right-hand side touches every row.
fn probe(
    matrix: &Sparse,
    shift: f64,
    solve: impl FnOnce(&mut Block) -> Result<(), Canceled>,
) -> Result<f64, Canceled> {
    let n = matrix.rows();
    let b = |i: usize| start::hashed(i, usize::MAX);
    let mut x = Block::zeros(n, 1);
    x.for_each_row(|i, row| row[0] = b(i));
    solve(&mut x)?;
    let x = x.column(0);
    let (mut error, mut size) = (0.0, 0.0);
    for (i, product) in matrix.product(&x).into_iter().enumerate() {
        error += (product + shift * x[i] - b(i)).powi(2);
        size += b(i).powi(2);
    }
    Ok((error / size).sqrt())
}

/// `A + shift·I = L S Lᵀ` with signs `S`, all positive where the matrix is definite.
pub struct Cholesky<'a> {
    symbolic: &'a Symbolic,
    matrix: &'a Sparse,
    shift: f64,
    factor: Precision,
    /// What a solution with the factor leaves of the error, as a share; 0 where one is as good as it gets.
    contraction: f64,
}

/// A factor as it is stored. What is read limits the speed of solving: two solves in single precision take no longer than
/// one in double, and half of the memory.
enum Precision {
    Single(Factor<f32>),
    Double(Factor<f64>),
}

impl Cholesky<'_> {
    /// What was added to the diagonal.
    #[must_use]
    pub fn shift(&self) -> f64 {
        self.shift
    }

    /// Number of eigenvalues of the factored matrix below 0, by Sylvester's law of inertia.
    #[must_use]
    pub fn negative_eigenvalues(&self) -> usize {
        match &self.factor {
            Precision::Single(factor) => factor.negative.len(),
            Precision::Double(factor) => factor.negative.len(),
        }
    }

    /// Whether [`Self::solve`] solves as well as double precision can.
    #[must_use]
    pub fn is_exact(&self) -> bool {
        self.contraction == 0.0
    }

    /// What one more solution with the factor adds to `x`.
    fn correction(&self, b: &Block, x: &Block, progress: &Progress) -> Result<Block, Canceled> {
        let mut rest = Block::zeros(x.rows(), x.columns());
        sparse_product(&mut rest, self.matrix, x);
        rest.for_each_row(|i, row| {
            for ((r, b), x) in row.iter_mut().zip(b.row(i)).zip(x.row(i)) {
                *r = b - *r - self.shift * x;
            }
        });
        progress.checkpoint()?;
        self.solve(&mut rest, progress)?;
        Ok(rest)
    }

    /// By how much one more solution with the factor reduces the error, of vectors that are drawn to what is nearest to
    /// the shift, where it is largest.
    fn contraction(&self, progress: &Progress) -> Result<f64, Canceled> {
        let mut b = Block::zeros(self.matrix.rows(), WIDTH);
        start::fill(&mut b, 1 << 22);
        let mut x = b.clone();
        self.solve(&mut x, progress)?;
        let mut worst = 0.0_f64;
        let mut sizes = column_norms(&x);
        for _ in 0..2 {
            let correction = self.correction(&b, &x, progress)?;
            add(&mut x, &correction);
            let next = column_norms(&correction);
            let ratio =
                |(next, size): (&f64, &f64)| if next.is_finite() { next / size } else { f64::INFINITY };
            worst = next.iter().zip(&sizes).map(ratio).fold(worst, f64::max);
            sizes = next;
        }
        Ok(worst)
    }

    /// `X ← (L S Lᵀ)⁻¹ X`, which is as good an inverse as the factor.
    ///
    /// # Errors
    /// [`Canceled`].
    pub fn solve(&self, x: &mut Block, progress: &Progress) -> Result<(), Canceled> {
        match &self.factor {
            Precision::Single(factor) => self.substitute_with(factor, x, &mut Vec::new(), progress),
            Precision::Double(factor) => self.substitute_with(factor, x, &mut Vec::new(), progress),
        }
    }

    /// The same of vectors in single precision; `buffer` is kept from one solution to the next.
    ///
    /// # Errors
    /// [`Canceled`].
    pub fn solve_single(
        &self,
        x: &mut Block<f32>,
        buffer: &mut Vec<f32>,
        progress: &Progress,
    ) -> Result<(), Canceled> {
        match &self.factor {
            Precision::Single(factor) => self.substitute_with(factor, x, buffer, progress),
            Precision::Double(factor) => self.substitute_with(factor, x, &mut Vec::new(), progress),
        }
    }

    fn substitute_with<T: Scalar, U: Scalar>(
        &self,
        factor: &Factor<T>,
        x: &mut Block<U>,
        buffer: &mut Vec<T>,
        progress: &Progress,
    ) -> Result<(), Canceled> {
        let Symbolic { nodes, order, place } = self.symbolic;
        let most = x.rows() * substitution::width(x.columns());
        buffer.resize(most.max(buffer.len()), T::nearest(0.0));
        let mut first = 0;
        while first < x.columns() {
            let width = substitution::width(x.columns() - first);
            let count = width.min(x.columns() - first);
            let group = &mut buffer[..x.rows() * width];
            group.par_chunks_exact_mut(width).zip(order).with_min_len(ROWS_MIN).for_each(|(group, &i)| {
                let row = &x.row(i as usize)[first..first + count];
                group.iter_mut().zip(row).for_each(|(g, &x)| *g = T::nearest(x.into()));
            });
            substitution::solve(nodes, factor, group, width, progress);
            progress.checkpoint()?;
            let group = &*group;
            x.for_each_row(|i, row| {
                let group = &group[place[i] as usize * width..];
                row[first..first + count].iter_mut().zip(group).for_each(|(x, &g)| *x = U::nearest(g.into()));
            });
            first += count;
        }
        Ok(())
    }
}

fn add(x: &mut Block, y: &Block) {
    x.for_each_row(|i, row| row.iter_mut().zip(y.row(i)).for_each(|(x, y)| *x += y));
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::spectrum::factor::{Elimination, nested_dissection};
    use crate::spectrum::grid::{grid, grid_eigenvalues};
    use crate::spectrum::vectors::start;

    const SIDE: usize = 150;

    fn dissected(matrix: &Sparse, progress: &Progress) -> Result<Elimination, Canceled> {
        let positions: Vec<[f64; 2]> =
            (0..SIDE * SIDE).map(|i| [(i % SIDE) as f64, (i / SIDE) as f64]).collect();
        nested_dissection(matrix, |i| &positions[i as usize], progress)
    }

    /// The analysis of a grid that is large enough for parts.
    fn analyzed() -> (crate::spectrum::Problem, Symbolic) {
        let problem = grid(SIDE);
        let elimination = dissected(&problem.matrix, &Progress::new()).unwrap();
        assert!(elimination.parts.len() > 1);
        let symbolic = Symbolic::analyze(&problem.matrix, elimination, &Progress::new()).unwrap();
        // most rows are in parts, some in none
        assert!((1..SIDE * SIDE / 10).contains(&symbolic.nodes.top_rows()));
        (problem, symbolic)
    }

    fn relative_error(matrix: &Sparse, shift: f64, solve: impl Fn(&mut Block)) -> f64 {
        let mut b = Block::zeros(matrix.rows(), 19);
        start::fill(&mut b, 0);
        let mut x = b.clone();
        solve(&mut x);
        let mut product = Block::zeros(matrix.rows(), 19);
        sparse_product(&mut product, matrix, &x);
        product.for_each_row(|i, row| {
            for ((p, x), b) in row.iter_mut().zip(x.row(i)).zip(b.row(i)) {
                *p += shift * x - b;
            }
        });
        let (rest, size) = (column_norms(&product), column_norms(&b));
        rest.iter().zip(size).map(|(r, b)| r / b).fold(0.0, f64::max)
    }

    #[test]
    fn a_supernode_of_many_columns_is_cut_into_several() {
        let n = 1_100;
        let weights = |i: usize, (): &mut (), row: &mut Vec<(u32, f64)>| {
            row.extend((0..n).filter(|&j| j != i).map(|j| (j as u32, 1.0)));
        };
        let matrix = Sparse::stiffness(n, || (), weights, |_| Ok::<_, std::convert::Infallible>(())).unwrap();
        let order: Vec<u32> = (0..n as u32).collect();
        let symbolic = Symbolic::analyze(&matrix, order, &Progress::new()).unwrap();
        assert_eq!((symbolic.nodes.len(), symbolic.nodes.widest()), (3, 367));
        let factor = symbolic.factor_double(&matrix, 0.5, &Progress::new()).unwrap();
        assert!(relative_error(&matrix, 0.5, |x| factor.solve(x, &Progress::new()).unwrap()) < 1e-11);
        // of the eigenvalues 0 and n, the latter n − 1 times
        assert_eq!(symbolic.eigenvalues_below(&matrix, 0.5, &Progress::new()).unwrap(), Some(1));
    }

    #[test]
    fn parts_of_the_order_do_not_touch() {
        let (problem, symbolic) = analyzed();
        let mut rows = vec![(); SIDE * SIDE];
        let spans = symbolic.nodes.by_parts(&mut rows, |part| symbolic.nodes.columns_of(part));
        let columns: Vec<_> = spans.iter().map(|(part, _)| symbolic.nodes.columns_of(part)).collect();
        assert!(columns.len() > 1);
        let part_of = |place: usize| columns.iter().position(|columns| columns.contains(&place));
        for (k, &row) in symbolic.order.iter().enumerate() {
            for j in problem.matrix.neighbors(row as usize) {
                let (one, other) = (part_of(k), part_of(symbolic.place[j as usize] as usize));
                assert!(one == other || one.is_none() || other.is_none(), "{k} {one:?} {other:?}");
            }
        }
    }

    #[test]
    fn solutions_in_single_precision_are_refined_by_corrections() {
        let (problem, symbolic) = analyzed();
        let (matrix, shift) = (&problem.matrix, problem.shift);
        let single = symbolic.factor(matrix, shift, &Progress::new()).unwrap();
        assert!(!single.is_exact());
        let double = symbolic.factor_double(matrix, shift, &Progress::new()).unwrap();
        assert!(double.is_exact());
        let rough = relative_error(matrix, shift, |x| single.solve(x, &Progress::new()).unwrap());
        let refined = relative_error(matrix, shift, |x| {
            let b = x.clone();
            single.solve(x, &Progress::new()).unwrap();
            for _ in 0..8 {
                add(x, &single.correction(&b, x, &Progress::new()).unwrap());
            }
        });
        let exact = relative_error(matrix, shift, |x| double.solve(x, &Progress::new()).unwrap());
        assert!(rough > 1e-6 && refined < 1e-8 && exact < 1e-10, "{rough} {refined} {exact}");
    }

    #[test]
    fn negative_pivots_count_eigenvalues_and_their_signs_solve() {
        let (problem, symbolic) = analyzed();
        let exact = grid_eigenvalues(SIDE);
        // in gaps between different eigenvalues, near the end and in the middle
        for k in [1, 10, 500, 11_000] {
            let next = (k..exact.len() - 1).find(|&k| exact[k + 1] - exact[k] > 1e-9).unwrap();
            let bound = 0.5 * (exact[next] + exact[next + 1]);
            let factor =
                symbolic.factor_indefinite(&problem.matrix, -bound, &Progress::new()).unwrap().unwrap();
            assert_eq!(factor.negative_eigenvalues(), next + 1);
            let error =
                relative_error(&problem.matrix, -bound, |x| factor.solve(x, &Progress::new()).unwrap());
            assert!(error < 1e-6, "{k}: {error}");
        }
    }

    #[test]
    fn bits_do_not_depend_on_the_number_of_threads() {
        let (problem, symbolic) = analyzed();
        let solved = |threads| {
            rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap().install(|| {
                let factor = symbolic.factor(&problem.matrix, problem.shift, &Progress::new()).unwrap();
                let mut x = Block::zeros(problem.size(), 20);
                start::fill(&mut x, 0);
                factor.solve(&mut x, &Progress::new()).unwrap();
                x
            })
        };
        let (one, three) = (solved(1), solved(3));
        assert!((0..problem.size()).all(|i| one.row(i) == three.row(i)));
    }

    #[test]
    fn canceled_factorizations_and_solutions_end() {
        let (problem, symbolic) = analyzed();
        let progress = Progress::new();
        let factor = symbolic.factor(&problem.matrix, problem.shift, &progress).unwrap();
        progress.cancel();
        assert_eq!(factor.solve(&mut Block::zeros(problem.size(), 1), &progress), Err(Canceled));
        let canceled = symbolic.factor(&problem.matrix, problem.shift, &progress);
        assert_eq!(canceled.err(), Some(FactorError::Canceled(Canceled)));
        // in the middle of the first split: all points are compared
        let canceled = dissected(&problem.matrix, &Progress::canceled_after(10_000));
        assert_eq!(canceled, Err(Canceled));
    }
}

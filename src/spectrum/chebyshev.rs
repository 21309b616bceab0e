//! The inverse of an operator that is too wide to factor, as a polynomial in its preconditioned self.

use faer::Mat;

use super::inverse::Inverse;
use super::orthogonal::eigen;
use super::preconditioner::Preconditioner;
use super::vectors::block::{Block, column_products};
use super::vectors::sparse_product::sparse_product;
use super::vectors::start;
use super::{Problem, SpectrumError};
use crate::progress::{Canceled, Progress};

/// Steps, and start vectors, of the conjugate gradients that find the ends of the preconditioned spectrum.
const STEPS: usize = 10;
const VECTORS: usize = 8;

/// How much farther apart the ends are taken than they were found: the ends of a Krylov space lie inside.
const MARGIN: f64 = 1.05;

/// Chebyshev semi-iteration (Golub and Varga 1961) for `(A + σI) X = B` with the preconditioner M, to a fixed number of
/// steps: `B ↦ p(M(A+σI)) M B` is as symmetric an operator as `M` is, whose eigenvectors are those of `A` but for the error
/// of `p`.
pub struct Chebyshev<'a> {
    problem: &'a Problem,
    preconditioner: &'a Preconditioner<'a>,
    /// Ends of the spectrum of `M(A+σI)`.
    ends: [f64; 2],
    steps: usize,
}

impl<'a> Chebyshev<'a> {
    /// The fewest steps that leave a share `error` of a right-hand side, in the norm of the preconditioned operator; none
    /// when the ends of its spectrum cannot be found.
    ///
    /// # Errors
    /// [`SpectrumError::Dense`], [`SpectrumError::Canceled`].
    pub fn new(
        problem: &'a Problem,
        preconditioner: &'a Preconditioner<'a>,
        error: f64,
        progress: &Progress,
    ) -> Result<Option<Self>, SpectrumError> {
        let Some([low, high]) = ends(problem, preconditioner, progress)? else {
            return Ok(None);
        };
        let ends = [low / MARGIN, high * MARGIN];
        let root = (ends[1] / ends[0]).sqrt();
        // 2 qᵐ for q = (√κ − 1)/(√κ + 1)
        let steps = ((0.5 * error).ln() / ((root - 1.0) / (root + 1.0)).ln()).ceil();
        Ok(Some(Self { problem, preconditioner, ends, steps: steps.max(1.0) as usize }))
    }

    /// Applications of the preconditioner to every right-hand side.
    #[must_use]
    pub fn steps(&self) -> usize {
        self.steps
    }
}

impl Inverse for Chebyshev<'_> {
    fn is_single(&self) -> bool {
        false
    }

    fn solve(&self, b: &mut Block, progress: &Progress) -> Result<(), Canceled> {
        let columns = b.columns();
        let (middle, half) = (0.5 * (self.ends[0] + self.ends[1]), 0.5 * (self.ends[1] - self.ends[0]));
        let sigma = self.problem.shift;
        let mut residual = b.clone();
        let mut direction = residual.clone();
        self.preconditioner.apply(&mut direction, progress)?;
        direction.for_each_row(|_, row| row.iter_mut().for_each(|x| *x /= middle));
        b.for_each_row(|i, row| row.copy_from_slice(direction.row(i)));
        let mut product = Block::zeros(b.rows(), columns);
        let mut rho = half / middle;
        for _ in 1..self.steps {
            progress.checkpoint()?;
            sparse_product(&mut product, &self.problem.matrix, &direction);
            residual.for_each_row(|i, row| {
                for ((r, p), d) in row.iter_mut().zip(product.row(i)).zip(direction.row(i)) {
                    *r -= p + sigma * d;
                }
            });
            product.for_each_row(|i, row| row.copy_from_slice(residual.row(i)));
            self.preconditioner.apply(&mut product, progress)?;
            let next = 1.0 / (2.0 * middle / half - rho);
            direction.for_each_row(|i, row| {
                for (d, z) in row.iter_mut().zip(product.row(i)) {
                    *d = next * rho * *d + 2.0 * next / half * z;
                }
            });
            rho = next;
            b.for_each_row(|i, row| row.iter_mut().zip(direction.row(i)).for_each(|(x, d)| *x += d));
        }
        progress.checkpoint()
    }
}

/// Smallest and largest eigenvalue of `M(A+σI)` beside the null space, from inside: those of the tridiagonal matrices of
/// conjugate gradients (Golub and Van Loan, §11.3); none when these have ended before.
fn ends(
    problem: &Problem,
    preconditioner: &Preconditioner<'_>,
    progress: &Progress,
) -> Result<Option<[f64; 2]>, SpectrumError> {
    let n = problem.size();
    let mut residual = Block::zeros(n, VECTORS);
    start::fill(&mut residual, 1 << 21);
    problem.project_out_null(&mut residual);
    let precondition = |residual: &Block| {
        let mut z = residual.clone();
        preconditioner.apply(&mut z, progress)?;
        problem.project_out_null(&mut z);
        Ok::<_, Canceled>(z)
    };
    let mut z = precondition(&residual)?;
    let mut direction = z.clone();
    let mut squared = column_products(&residual, &z);
    let mut product = Block::zeros(n, VECTORS);
    let mut tridiagonals = vec![Mat::<f64>::zeros(STEPS, STEPS); VECTORS];
    let mut last = [(0.0, 0.0); VECTORS];
    for step in 0..STEPS {
        progress.checkpoint()?;
        sparse_product(&mut product, &problem.matrix, &direction);
        product.for_each_row(|i, row| {
            row.iter_mut().zip(direction.row(i)).for_each(|(p, d)| *p += problem.shift * d);
        });
        let curvature = column_products(&direction, &product);
        let alpha: Vec<f64> = squared.iter().zip(&curvature).map(|(s, c)| s / c).collect();
        residual.for_each_row(|i, row| {
            for (j, r) in row.iter_mut().enumerate() {
                *r -= alpha[j] * product.row(i)[j];
            }
        });
        z = precondition(&residual)?;
        let next = column_products(&residual, &z);
        let beta: Vec<f64> = next.iter().zip(&squared).map(|(n, s)| n / s).collect();
        direction.for_each_row(|i, row| {
            for (j, d) in row.iter_mut().enumerate() {
                *d = z.row(i)[j] + beta[j] * *d;
            }
        });
        for (j, t) in tridiagonals.iter_mut().enumerate() {
            let (alpha_before, beta_before) = last[j];
            t[(step, step)] = 1.0 / alpha[j] + if step > 0 { beta_before / alpha_before } else { 0.0 };
            if step + 1 < STEPS {
                t[(step + 1, step)] = beta[j].sqrt() / alpha[j];
                t[(step, step + 1)] = t[(step + 1, step)];
            }
            last[j] = (alpha[j], beta[j]);
        }
        squared = next;
    }
    let mut ends = [f64::INFINITY, 0.0_f64];
    for t in &tridiagonals {
        if !t.as_ref().is_all_finite() {
            return Ok(None);
        }
        let (values, _) = eigen(t.as_ref())?;
        ends = [ends[0].min(values[0]), ends[1].max(values[STEPS - 1])];
    }
    Ok((ends[0] > 0.0).then_some(ends))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::operator::{LaplaceBeltrami, Sparse};
    use crate::spectrum::factor::Symbolic;
    use crate::spectrum::vectors::block::gram;

    /// Paths of `side` points times each other, with weight 1 along the axes and `diagonal` across.
    fn grid(side: usize, diagonal: f64) -> Sparse {
        let weights = |i: usize, (): &mut (), row: &mut Vec<(u32, f64)>| {
            let near = |k: usize| k.saturating_sub(1)..side.min(k + 2);
            let (x, y) = (i % side, i / side);
            for (v, u) in near(y).flat_map(|v| near(x).map(move |u| (v, u))) {
                if (u, v) != (x, y) {
                    row.push(((v * side + u) as u32, if u == x || v == y { 1.0 } else { diagonal }));
                }
            }
        };
        Sparse::stiffness(side * side, || (), weights, |_| Ok::<_, std::convert::Infallible>(())).unwrap()
    }

    #[test]
    fn the_polynomial_is_a_symmetric_inverse_up_to_its_error() {
        let side = 40;
        let n = side * side;
        let first = 4.0 * std::f64::consts::PI / n as f64;
        let problem =
            Problem::new(LaplaceBeltrami::narrow(grid(side, 0.3), vec![1.0; n]), first, &Progress::new())
                .unwrap();
        let order: Vec<u32> = (0..n as u32).collect();
        let exact = Symbolic::analyze(&problem.matrix, order.clone(), &Progress::new()).unwrap();
        let exact = exact.factor_double(&problem.matrix, problem.shift, &Progress::new()).unwrap();
        let narrow = grid(side, 0.0);
        let symbolic = Symbolic::analyze(&narrow, order, &Progress::new()).unwrap();
        let factor = symbolic.factor_double(&narrow, problem.shift, &Progress::new()).unwrap();
        let preconditioner = Preconditioner { factor: &factor, t: 0.0 };
        let mut steps = Vec::new();
        for error in [1e-2, 1e-5] {
            let polynomial =
                Chebyshev::new(&problem, &preconditioner, error, &Progress::new()).unwrap().unwrap();
            steps.push(polynomial.steps());
            let mut b = Block::zeros(n, 3);
            start::fill(&mut b, 0);
            problem.project_out_null(&mut b);
            let (mut x, mut nearly) = (b.clone(), b.clone());
            exact.solve(&mut x, &Progress::new()).unwrap();
            polynomial.solve(&mut nearly, &Progress::new()).unwrap();
            let symmetric = gram(&b, &nearly);
            assert!((symmetric[(0, 1)] - symmetric[(1, 0)]).abs() < 1e-12 * symmetric[(0, 0)]);
            let sizes = column_products(&x, &b);
            nearly.for_each_row(|i, row| row.iter_mut().zip(x.row(i)).for_each(|(y, x)| *y -= x));
            let mut product = Block::zeros(n, 3);
            sparse_product(&mut product, &problem.matrix, &nearly);
            product.for_each_row(|i, row| {
                row.iter_mut().zip(nearly.row(i)).for_each(|(p, x)| *p += problem.shift * x);
            });
            // in the norm of the operator, where the bound holds
            for (defect, size) in column_products(&nearly, &product).iter().zip(&sizes) {
                assert!((defect / size).sqrt() < error, "{defect} {size}");
            }
        }
        assert!(steps[0] > 1 && steps[0] < steps[1], "{steps:?}");
    }
}

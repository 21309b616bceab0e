//! A search for eigenvalues that an iteration missed.

use faer::Mat;

use super::factor::Cholesky;
use super::orthogonal::{eigen, orthonormalize};
use super::preconditioner::Preconditioner;
use super::vectors::block::{Block, add_product, gram};
use super::vectors::sparse_product::sparse_product;
use super::vectors::start;
use super::{Problem, SpectrumError};
use crate::progress::Progress;

const VECTORS: usize = 8;

/// Steps at least and at most: between them it goes on until the smallest value settles.
const STEPS: [usize; 2] = [4, 24];

/// Relative change of the smallest value in one step at which it has settled.
const SETTLED: f64 = 0.01;

/// What draws vectors towards the small eigenvalues.
pub(super) enum Towards<'a> {
    /// The inverse of the shifted operator.
    Inverse(&'a Cholesky<'a>),
    /// A preconditioner `M` of a heat kernel: `−M (1/t − A)` amplifies what is near the shift, and at the top, where
    /// `M ≈ t` and `A ≈ 1/t`, nothing is left.
    Preconditioned(&'a Preconditioner<'a>),
}

/// Vectors orthogonal to the pairs that were found and to the null space, and their Ritz values: an eigenvalue that the
/// iteration missed shows up as one below those found.
pub(super) struct Probe {
    values: Vec<f64>,
    /// Their span.
    pub(super) vectors: Block,
}

impl Probe {
    /// Steps from hashed vectors until the smallest value settles. What a probe does not find may be there all the same:
    /// unlike a count by inertia it is not a proof.
    ///
    /// # Errors
    /// [`SpectrumError::Dense`], [`SpectrumError::Canceled`].
    pub(super) fn beside(
        problem: &Problem,
        towards: &Towards<'_>,
        found: &Block,
        progress: &Progress,
    ) -> Result<Self, SpectrumError> {
        let mut vectors = Block::zeros(problem.size(), VECTORS);
        start::fill(&mut vectors, 1 << 20);
        let mut values = Vec::new();
        let mut product = Block::zeros(problem.size(), VECTORS);
        let nothing = Block::<f64>::zeros(problem.size(), 0);
        for step in 0..STEPS[1] {
            progress.advance(step as f64 / STEPS[1] as f64)?;
            match towards {
                Towards::Inverse(factor) => factor.solve(&mut vectors, progress)?,
                Towards::Preconditioned(preconditioner) => {
                    let identity = Mat::<f64>::identity(VECTORS, VECTORS);
                    sparse_product(&mut product, &problem.matrix, &vectors);
                    add_product(&mut product, -(1.0 / preconditioner.t), &vectors, identity.as_ref());
                    preconditioner.apply(&mut product, progress)?;
                    std::mem::swap(&mut vectors, &mut product);
                }
            }
            problem.project_out_null(&mut vectors);
            // once: rounding leaves as little of what was found as a probe takes no notice of
            let along = gram(found, &vectors);
            progress.checkpoint()?;
            add_product(&mut vectors, -1.0, found, along.as_ref());
            orthonormalize(&mut vectors, &nothing, progress)?;
            sparse_product(&mut product, &problem.matrix, &vectors);
            let (next, _) = eigen(gram(&vectors, &product).as_ref())?;
            let before: Vec<f64> = std::mem::replace(&mut values, next);
            let settled = before
                .first()
                .zip(values.first())
                .is_some_and(|(before, now)| (before - now).abs() <= SETTLED * now.abs());
            if settled && step + 1 >= STEPS[0] {
                break;
            }
        }
        Ok(Self { values, vectors })
    }

    /// How many eigenvalues below `bound` there are at least (Courant and Fischer).
    pub(super) fn below(&self, bound: f64) -> usize {
        self.values.iter().filter(|&&value| value < bound).count()
    }
}

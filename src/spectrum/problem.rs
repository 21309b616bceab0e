//! The eigenproblem in the form that the solvers work on.

use std::ops::Range;

use rayon::prelude::*;

use super::vectors::block::Block;
use super::vectors::scalar::Scalar;
use crate::geometry::{Components, components};
use crate::operator::{LaplaceBeltrami, Sparse, Structure};
use crate::progress::{Canceled, Progress};

/// Rows summed by one task; fixed, so that sums repeat bit for bit.
const ROWS_PER_TASK: usize = 8_192;

/// Share of the first non-zero eigenvalue's size that is taken as the shift σ.
const SHIFT: f64 = 0.3;

/// `A = B^-½ S B^-½` with its known null space: for a semi-definite operator one vector per connected component,
/// `B^½ 1` unless the operator names another function.
#[derive(Debug, Clone)]
pub struct Problem {
    /// `A`, in the unit of μ.
    pub matrix: Sparse,
    /// What `A` is.
    pub structure: Structure,
    /// Roots of the masses.
    pub root_mass: Vec<f64>,
    /// Connected components of the operator's graph.
    pub components: Components,
    /// σ > 0 in the unit of μ: keeps shifted matrices away from the null space.
    pub shift: f64,
    /// The null vectors, of norm 1 on every component.
    null: Vec<f64>,
}

impl Problem {
    /// Scales the stiffness of an operator whose first non-zero eigenvalues are of the size of `first_eigenvalue`.
    ///
    /// # Errors
    /// [`Canceled`].
    pub fn new(
        laplacian: LaplaceBeltrami,
        first_eigenvalue: f64,
        progress: &Progress,
    ) -> Result<Self, Canceled> {
        let stiffness = &laplacian.stiffness;
        let found = components(stiffness.rows(), |i| stiffness.neighbors(i), progress)?;
        Ok(Self::with_components(laplacian, found, first_eigenvalue))
    }

    /// The same where the components are known.
    #[must_use]
    pub fn with_components(laplacian: LaplaceBeltrami, found: Components, first_eigenvalue: f64) -> Self {
        let LaplaceBeltrami { stiffness: mut matrix, mass, structure, harmonic, .. } = laplacian;
        let root_mass: Vec<f64> = mass.iter().map(|m| m.sqrt()).collect();
        let inverse: Vec<f64> = root_mass.iter().map(|m| 1.0 / m).collect();
        matrix.scale_both_sides(&inverse);
        let mut null = root_mass.clone();
        if let Some(harmonic) = harmonic {
            null.iter_mut().zip(harmonic).for_each(|(x, h)| *x *= h);
        }
        let mut squared = vec![0.0; found.size.len()];
        found.label.iter().zip(&null).for_each(|(&label, x)| squared[label as usize] += x * x);
        null.iter_mut().zip(&found.label).for_each(|(x, &label)| *x /= squared[label as usize].sqrt());
        Self { matrix, structure, root_mass, components: found, shift: SHIFT * first_eigenvalue, null }
    }

    /// The problem of a semi-definite operator with the same masses and null space.
    #[must_use]
    pub fn with_matrix(&self, matrix: Sparse) -> Self {
        Self {
            matrix,
            structure: Structure::SemiDefinite,
            root_mass: self.root_mass.clone(),
            components: self.components.clone(),
            shift: self.shift,
            null: self.null.clone(),
        }
    }

    /// Number of points n.
    #[must_use]
    pub fn size(&self) -> usize {
        self.root_mass.len()
    }

    /// Number of zero eigenvalues.
    #[must_use]
    pub fn zero_modes(&self) -> usize {
        self.components.size.len()
    }

    /// Writes the null vectors of some components into the first columns of `block`.
    pub fn write_null_vectors<T: Scalar>(&self, block: &mut Block<T>, components: Range<usize>) {
        block.for_each_row(|i, row| {
            let component = self.components.label[i] as usize;
            row[..components.len()].fill(T::nearest(0.0));
            if components.contains(&component) {
                row[component - components.start] = T::nearest(self.null[i]);
            }
        });
    }

    /// The component of point `i`, and what its null vector is there.
    pub(super) fn null_entry(&self, i: usize) -> (usize, f64) {
        (self.components.label[i] as usize, self.null[i])
    }

    /// Removes the null space from every column.
    pub fn project_out_null(&self, block: &mut Block) {
        let (width, zero_modes) = (block.columns(), self.zero_modes());
        let tasks: Vec<usize> = (0..block.rows()).step_by(ROWS_PER_TASK).collect();
        let partial: Vec<Vec<f64>> = tasks
            .into_par_iter()
            .fold_chunks(
                self.tasks_per_sum(),
                || vec![0.0; zero_modes * width],
                |mut sums, first| {
                    for i in first..block.rows().min(first + ROWS_PER_TASK) {
                        let entry = self.null[i];
                        let start = self.components.label[i] as usize * width;
                        for (sum, x) in sums[start..start + width].iter_mut().zip(block.row(i)) {
                            *sum += entry * x;
                        }
                    }
                    sums
                },
            )
            .collect();
        let mut total = vec![0.0; zero_modes * width];
        for sums in partial {
            for (t, s) in total.iter_mut().zip(sums) {
                *t += s;
            }
        }
        block.for_each_row(|i, row| {
            let entry = self.null[i];
            let start = self.components.label[i] as usize * width;
            for (x, t) in row.iter_mut().zip(&total[start..start + width]) {
                *x -= entry * t;
            }
        });
    }

    /// Tasks that share one table of sums: with many components the tables would outgrow the block.
    fn tasks_per_sum(&self) -> usize {
        1 + self.zero_modes() / 64
    }
}

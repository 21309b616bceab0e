//! Systems with a matrix of which no factor fits: sweeps take what is rough, a thinned sample what is smooth.

use super::weights::{Transposed, Weights};
use crate::progress::{Canceled, Progress};
use crate::spectrum::factor::Cholesky;
use crate::spectrum::shifted_system::{NearInverse, Room, System};
use crate::spectrum::vectors::block::Block;
use crate::spectrum::vectors::sparse_product::{Finish, finished_product};

/// One cycle: sweeps, what they leave solved on the sample, sweeps.
pub(super) struct TwoGrid<'a> {
    weights: &'a Weights,
    /// From residuals at the points to those of the sample.
    transposed: Transposed<'a>,
    factor: &'a Cholesky<'a>,
    coarse: Block<f32>,
    buffer: Vec<f32>,
}

impl<'a> TwoGrid<'a> {
    /// With the factor of a sample of `points` points, whose values `weights` brings to all points, and room for `columns`
    /// vectors.
    ///
    /// # Errors
    /// [`Canceled`].
    pub(super) fn new(
        weights: &'a Weights,
        factor: &'a Cholesky<'a>,
        points: usize,
        columns: usize,
        progress: &Progress,
    ) -> Result<Self, Canceled> {
        let transposed = weights.transposed(progress)?;
        Ok(Self { weights, transposed, factor, coarse: Block::zeros(points, columns), buffer: Vec::new() })
    }
}

impl NearInverse for TwoGrid<'_> {
    fn apply(&mut self, system: &System<'_>, room: &mut Room, progress: &Progress) -> Result<(), Canceled> {
        let columns = room.residual.columns();
        system.sweep(room, true, progress)?;
        system.defect(room);
        progress.checkpoint()?;
        let rest = room.other.columns_from(0, columns);
        self.transposed.product(&mut self.coarse, rest);
        progress.checkpoint()?;
        self.factor.solve_single(&mut self.coarse, &mut self.buffer, progress)?;
        let solved = self.coarse.columns_from(0, columns);
        finished_product(&mut room.other, self.weights, solved, Finish::Product);
        progress.checkpoint()?;
        room.correct();
        system.sweep(room, false, progress)
    }
}

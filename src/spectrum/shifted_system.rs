//! Systems with `A + σI` for many right sides, by conjugate gradients in single precision: what nearly inverts the matrix may
//! go too far on some functions, as weights of a thinned sample do at rims, and still helps.

use rayon::prelude::*;

use super::Problem;
use super::factor::Cholesky;
use super::vectors::block::Block;
use super::vectors::pair::added;
use super::vectors::sparse_product::{Finish, Rows, finished_product};
use crate::progress::{Canceled, Progress};

/// Vectors of a group, and the points up to which there are so many: the more points, the less room there is for them.
const WIDTHS: [(usize, usize); 2] = [(32, 1 << 20), (16, 6 << 20)];
const WIDTH_MIN: usize = 8;

/// Vectors of a group of right sides that are held for each of these.
pub const HELD: usize = 4;

/// Sweeps of Jacobi's iteration before and after a solution of what they leave, and the part of the spectrum that they are made
/// for, as a share of its upper end: what a sample of every ninth point knows nothing of.
const SWEEPS: usize = 3;
const SWEPT_FROM: f64 = 0.1;

/// Partial sums; a fixed number, so that the result is independent of the threads.
const PARTIAL_SUMS: usize = 16;

/// Right sides that are worked on together.
#[must_use]
pub fn width(points: usize) -> usize {
    WIDTHS.iter().find(|(_, most)| points <= *most).map_or(WIDTH_MIN, |&(width, _)| width)
}

/// `A + σI` of a problem in single precision, with what relaxes it.
pub(super) struct System<'a> {
    pub(super) problem: &'a Problem,
    values: Vec<f32>,
    /// One over the sum of the sizes of a row's entries, in the scale of the row: `A` times it has its spectrum between
    /// 0 and 1 (Gershgorin), whatever the entries' signs.
    relaxation: Vec<f64>,
}

/// Something that nearly solves systems with `A + σI`: a symmetric positive definite matrix.
pub(super) trait NearInverse {
    /// Makes what nearly solves with the residuals in `room` its correction.
    ///
    /// # Errors
    /// [`Canceled`].
    fn apply(&mut self, system: &System<'_>, room: &mut Room, progress: &Progress) -> Result<(), Canceled>;
}

/// By the factor of the shifted matrix itself or, `smoothed`, of one with a similar lower end of its spectrum.
pub(super) struct ByFactor<'a> {
    factor: &'a Cholesky<'a>,
    smoothed: bool,
    buffer: Vec<f32>,
}

/// A group of right sides, and room to solve with them.
pub(super) struct Room {
    /// What is left of the right sides.
    pub(super) residual: Block<f32>,
    /// What nearly solves with it.
    pub(super) correction: Block<f32>,
    /// Used up by whatever works on the others.
    pub(super) other: Block<f32>,
    /// Where the last step went.
    direction: Block<f32>,
    /// Products of residual and correction before the last step; none before the first.
    before: Vec<f64>,
}

/// One step of every column along its direction.
pub(super) struct Step {
    /// How far.
    pub(super) lengths: Vec<f64>,
    /// What it took from the square of the residual's norm by `(A + σ)⁻¹`.
    pub(super) gains: Vec<f64>,
}

impl<'a> System<'a> {
    pub(super) fn new(problem: &'a Problem) -> Self {
        let (matrix, root) = (&problem.matrix, &problem.root_mass);
        let sizes = |i: usize| -> f64 {
            let (columns, values) = matrix.row(i);
            columns.iter().zip(values).map(|(&j, value)| value.abs() * root[j as usize] / root[i]).sum()
        };
        let single = |&value: &f64| value as f32;
        Self {
            problem,
            values: matrix.values().par_iter().with_min_len(1 << 14).map(single).collect(),
            relaxation: (0..problem.size())
                .into_par_iter()
                .with_min_len(1 << 12)
                .map(|i| 1.0 / sizes(i))
                .collect(),
        }
    }

    fn rows(&self) -> Rows<'_, f32> {
        let matrix = &self.problem.matrix;
        Rows { offsets: matrix.offsets(), columns: matrix.columns(), values: &self.values }
    }

    /// What the correction leaves of the residual, in the place of `other`.
    pub(super) fn defect(&self, Room { residual, correction, other, .. }: &mut Room) {
        let columns = residual.columns();
        let right = Finish::Defect(residual.columns_from(0, columns));
        finished_product(other, self.rows(), correction.columns_from(0, columns), right);
        let shift = self.problem.shift as f32;
        other.for_each_row(|i, row| {
            row.iter_mut().zip(correction.row(i)).for_each(|(d, z)| *d -= shift * z);
        });
    }

    /// Takes what is rough out of the error of the correction, which is still 0 where that `begins`.
    pub(super) fn sweep(
        &self,
        Room { residual, correction, other, .. }: &mut Room,
        begins: bool,
        progress: &Progress,
    ) -> Result<(), Canceled> {
        let columns = residual.columns();
        let mut scale = vec![0.0_f32; self.relaxation.len()];
        for sweep in 0..SWEEPS {
            progress.checkpoint()?;
            let omega = relaxation(SWEPT_FROM, 1.0, sweep, SWEEPS);
            let scaled = scale.par_iter_mut().zip(&self.relaxation).with_min_len(1 << 12);
            scaled.for_each(|(scale, relaxation)| *scale = (omega * relaxation) as f32);
            if begins && sweep == 0 {
                correction.for_each_row(|i, row| {
                    row.iter_mut().zip(residual.row(i)).for_each(|(z, r)| *z = scale[i] * r);
                });
                continue;
            }
            let finish = Finish::Relaxed(residual.columns_from(0, columns), &scale);
            finished_product(other, self.rows(), correction.columns_from(0, columns), finish);
            std::mem::swap(correction, other);
        }
        Ok(())
    }
}

impl<'a> ByFactor<'a> {
    pub(super) fn new(factor: &'a Cholesky<'a>, smoothed: bool) -> Self {
        Self { factor, smoothed, buffer: Vec::new() }
    }
}

impl NearInverse for ByFactor<'_> {
    fn apply(&mut self, system: &System<'_>, room: &mut Room, progress: &Progress) -> Result<(), Canceled> {
        if !self.smoothed {
            room.correction.copy_columns(0, &room.residual, 0, room.residual.columns());
            self.factor.solve_single(&mut room.correction, &mut self.buffer, progress)?;
            return progress.checkpoint();
        }
        system.sweep(room, true, progress)?;
        system.defect(room);
        progress.checkpoint()?;
        self.factor.solve_single(&mut room.other, &mut self.buffer, progress)?;
        room.correct();
        system.sweep(room, false, progress)
    }
}

impl Room {
    pub(super) fn new(points: usize, width: usize) -> Self {
        let block = || Block::zeros(points, width);
        Self {
            residual: block(),
            correction: block(),
            other: block(),
            direction: block(),
            before: Vec::new(),
        }
    }

    /// Begins to solve with the right sides that stand in the place of the residual.
    pub(super) fn begin(&mut self) {
        let columns = self.residual.columns();
        for block in [&mut self.correction, &mut self.other, &mut self.direction] {
            block.set_columns(columns);
        }
        self.before.clear();
    }

    /// Adds `other` to the correction.
    pub(super) fn correct(&mut self) {
        let Self { correction, other, .. } = self;
        correction.for_each_row(|i, row| row.iter_mut().zip(other.row(i)).for_each(|(z, x)| *z += x));
    }

    /// Where the last step went.
    pub(super) fn direction(&self) -> &Block<f32> {
        &self.direction
    }

    /// One step of conjugate gradients (Hestenes and Stiefel 1952).
    ///
    /// # Errors
    /// [`Canceled`].
    pub(super) fn step(
        &mut self,
        system: &System<'_>,
        inverse: &mut dyn NearInverse,
        progress: &Progress,
    ) -> Result<Step, Canceled> {
        inverse.apply(system, self, progress)?;
        let columns = self.residual.columns();
        let products = inner_products(&mut self.correction, &self.residual);
        let kept = |j: usize| match self.before.get(j) {
            Some(&before) if before > 0.0 => (products[j] / before) as f32,
            _ => 0.0,
        };
        let kept: Vec<f32> = (0..columns).map(kept).collect();
        let Self { residual, correction, other, direction, .. } = self;
        direction.for_each_row(|i, row| {
            for (j, (p, y)) in row.iter_mut().zip(correction.row(i)).enumerate() {
                // what stands there before the first step is no number of its own
                *p = if kept[j] == 0.0 { *y } else { y + kept[j] * *p };
            }
        });
        let shift = vec![-system.problem.shift as f32; columns];
        let along = direction.columns_from(0, columns);
        finished_product(other, system.rows(), along, Finish::Residual(&shift));
        let sizes = inner_products(direction, other);
        let falls = inner_products(direction, residual);
        let lengths: Vec<f64> = falls
            .iter()
            .zip(&sizes)
            .map(|(&fall, &size)| if fall > 0.0 && size > 0.0 { fall / size } else { 0.0 })
            .collect();
        residual.for_each_row(|i, row| {
            for ((d, q), length) in row.iter_mut().zip(other.row(i)).zip(&lengths) {
                *d -= *length as f32 * q;
            }
        });
        self.before = products;
        let gains = lengths.iter().zip(&falls).map(|(length, fall)| length * fall).collect();
        progress.checkpoint()?;
        Ok(Step { lengths, gains })
    }

    /// Squared norms of what is left of the right sides.
    pub(super) fn squares(&mut self) -> Vec<f64> {
        column_sums(&mut self.residual, |sums, _, row| {
            sums.iter_mut().zip(row).for_each(|(sum, &d)| *sum += f64::from(d) * f64::from(d));
        })
    }
}

/// `xᵀy` of every column.
fn inner_products(x: &mut Block<f32>, y: &Block<f32>) -> Vec<f64> {
    column_sums(x, |sums, i, row| {
        for (sum, (x, y)) in sums.iter_mut().zip(row.iter().zip(y.row(i))) {
            *sum += f64::from(*x) * f64::from(*y);
        }
    })
}

/// Sums of every column, to which `add` adds those of a row.
fn column_sums(x: &mut Block<f32>, add: impl Fn(&mut [f64], usize, &[f32]) + Sync + Send) -> Vec<f64> {
    let columns = x.columns();
    let parts = x.map_stretches(PARTIAL_SUMS, |first, rows, width| {
        let mut sums = vec![0.0; columns];
        rows.chunks(width).enumerate().for_each(|(k, row)| add(&mut sums, first + k, &row[..columns]));
        sums
    });
    added(columns, parts)
}

/// The relaxation ω of one of `steps` steps that leave the least of what is multiplied by `1 − ω y` for `y` from `low` to
/// `high` (Chebyshev), the larger ones first.
pub(super) fn relaxation(low: f64, high: f64, step: usize, steps: usize) -> f64 {
    let (middle, half) = (0.5 * (low + high), 0.5 * (high - low));
    1.0 / (middle - half * (std::f64::consts::PI * (step as f64 + 0.5) / steps as f64).cos())
}

//! The way to one level's vectors: those of the coarser level, corrected.

use std::ops::Range;

use super::ROUNDED;
use super::correction::{Correction, GROUP};
use super::level::Level;
use super::weights::Weights;
use crate::progress::Progress;
use crate::spectrum::certificates::{self, Measured};
use crate::spectrum::factor::Cholesky;
use crate::spectrum::ritz::rayleigh_ritz_beside;
use crate::spectrum::shifted_system::relaxation;
use crate::spectrum::solution::Vectors;
use crate::spectrum::vectors::block::Block;
use crate::spectrum::{Eigenpairs, Problem, SpectrumError};

/// What is added to the estimate of the preconditioned matrix's largest eigenvalue, and the largest with which corrections
/// are worth their time.
const MARGIN: f64 = 0.05;
const UPPER_END_MAX: f64 = 2.5;

/// A residual after the first Rayleigh–Ritz step that shows that the surface is another one on the coarser level.
const DISAPPOINTING: f64 = 1e-2;

/// Rounds of corrections after the first, and the share of the tolerance from which on a vector takes part in them.
const ROUNDS_MAX: usize = 4;
const LOCKED: f64 = 0.5;

/// What a level begins with: vectors of the coarser level, and how its points' values come of them.
pub(super) struct Start<'a> {
    pub(super) weights: &'a Weights,
    pub(super) vectors: Block<f32>,
    /// Eigenvalues where they are expected.
    pub(super) values: Vec<f64>,
}

impl<'a> Start<'a> {
    /// Null vectors of parts that the finer level connects come first, for they are no null vectors there. `t` is the time
    /// of the heat kernel whose eigenvalues are expected.
    pub(super) fn of(level: &'a Level, pairs: &Eigenpairs, t: Option<f64>) -> Self {
        Self::with(level, &pairs.values, |i, row| row.copy_from_slice(pairs.vectors.row(i)), t)
    }

    /// The same of a level that was solved by itself.
    pub(super) fn of_sample(level: &'a Level, values: &[f64], vectors: &Vectors, t: Option<f64>) -> Self {
        let root = &level.problem.root_mass;
        Self::with(level, values, |i, row| vectors.write_row(i, root[i], row), t)
    }

    fn with(
        level: &'a Level,
        values: &[f64],
        write_row: impl Fn(usize, &mut [f64]) + Sync + Send,
        t: Option<f64>,
    ) -> Self {
        let zeros = level.problem.zero_modes();
        let which: Vec<usize> = level.apart.iter().copied().chain(zeros..values.len()).collect();
        let mut vectors = Block::<f32>::zeros(level.problem.size(), which.len());
        vectors.for_each_stretch(|first, rows, width| {
            let mut all = vec![0.0; values.len()];
            for (i, row) in (first..).zip(rows.chunks_mut(width)) {
                write_row(i, &mut all);
                row.iter_mut().zip(&which).for_each(|(x, &j)| *x = all[j] as f32);
            }
        });
        let expected = |&j: &usize| t.map_or(values[j], |t| -(-t * values[j]).exp_m1() / t);
        Self { weights: &level.weights, vectors, values: which.iter().map(expected).collect() }
    }
}

/// The way to one level's vectors.
pub(super) struct Ascent<'a> {
    problem: &'a Problem,
    correction: Correction<'a>,
    /// Upper end of the spectrum of the preconditioned matrix.
    upper_end: f64,
    /// Vectors beside the null space that are wanted: the first of all.
    wanted: usize,
}

impl<'a> Ascent<'a> {
    /// By the factor of the level's own matrix or, `smoothed`, of a narrower one; none where that is too far from it.
    pub(super) fn new(
        problem: &'a Problem,
        factor: &'a Cholesky<'a>,
        smoothed: bool,
        wanted: usize,
        progress: &Progress,
    ) -> Result<Option<Self>, SpectrumError> {
        let mut correction = Correction::new(problem, factor, smoothed);
        let mut upper_end = correction.upper_end(progress)?;
        if smoothed {
            upper_end = (1.0 + MARGIN) * upper_end.max(1.0);
        }
        Ok((upper_end <= UPPER_END_MAX).then_some(Self { problem, correction, upper_end, wanted }))
    }

    /// Columns that are corrected in double precision: whole groups with wanted ones.
    fn corrected_columns(&self, all: usize) -> usize {
        self.wanted.next_multiple_of(ROUNDED).min(all)
    }

    /// Where the spectrum begins that a vector of value `mu` still has to be rid of, after preconditioning.
    fn lower_end(&self, mu: f64, top: f64) -> f64 {
        ((top - mu) / (top + self.correction.shift())).clamp(0.1, 0.98)
    }

    /// The null vectors, then Ritz vectors: `steps` corrections in single precision of those near the guards, fewer of the
    /// others, and `last` of all wanted ones in double.
    pub(super) fn pairs(
        &mut self,
        start: &Start<'_>,
        steps: [usize; 3],
        last: usize,
        share: impl Fn(f64) -> f64,
        progress: &Progress,
    ) -> Result<Eigenpairs, SpectrumError> {
        let (n, all) = (self.problem.size(), start.values.len());
        let zeros = self.problem.zero_modes();
        let corrected = self.corrected_columns(all);
        let groups = || (0..all).step_by(GROUP).map(|from| from..all.min(from + GROUP));
        let steps_of = |group: &Range<usize>| match group {
            group if group.end <= self.wanted => steps[0],
            group if group.start < corrected => steps[1],
            _ => steps[2],
        };
        let top = start.values[all - 1];
        let relaxed = |step: usize, group: &Range<usize>| -> Vec<f64> {
            let of =
                |&mu: &f64| relaxation(self.lower_end(mu, top), self.upper_end, step, steps_of(group) + last);
            start.values[group.clone()].iter().map(of).collect()
        };
        let plans: Vec<(Range<usize>, Vec<Vec<f64>>)> = groups()
            .map(|group| {
                let omegas = (0..steps_of(&group) + last).map(|step| relaxed(step, &group)).collect();
                (group, omegas)
            })
            .collect();
        let mut vectors = Block::zeros(n, zeros + all);
        self.problem.write_null_vectors(&mut vectors, 0..zeros);
        let mut x = Block::<f32>::zeros(n, GROUP);
        for (group, omegas) in &plans {
            progress.advance(share(group.start as f64 / (all + corrected) as f64))?;
            let values = &start.values[group.clone()];
            let coarse = start.vectors.columns_from(group.start, group.len());
            self.correction.start(&mut x, start.weights, coarse, values, progress)?;
            for omega in &omegas[..omegas.len() - last] {
                self.correction.in_single(&mut x, values, omega, progress)?;
            }
            vectors.copy_columns(zeros + group.start, &x, 0, group.len());
        }
        drop(x);
        for (group, omegas) in plans.iter().filter(|(group, _)| group.start < corrected) {
            progress.advance(share((all + group.start) as f64 / (all + corrected) as f64))?;
            let values = &start.values[group.clone()];
            for omega in &omegas[omegas.len() - last..] {
                self.correction.in_double(&mut vectors, zeros + group.start, values, omega, progress)?;
            }
        }
        let values = rayleigh_ritz_beside(self.problem, &mut vectors, progress)?;
        Ok(Eigenpairs::real(values, vectors))
    }

    /// Corrects pairs until the wanted ones have residuals of at most `tolerance`, and what was measured of these; none
    /// where that does not come to an end.
    pub(super) fn corrected(
        &mut self,
        first: Result<Eigenpairs, SpectrumError>,
        tolerance: f64,
        progress: &Progress,
    ) -> Result<Option<(Eigenpairs, Measured)>, SpectrumError> {
        let zeros = self.problem.zero_modes();
        let mut pairs = match first {
            Ok(pairs) => pairs,
            // numbers that are none
            Err(SpectrumError::Dense { .. }) => return Ok(None),
            Err(error) => return Err(error),
        };
        for round in 0..=ROUNDS_MAX {
            progress.advance(0.8 + 0.2 * round as f64 / (ROUNDS_MAX + 1) as f64)?;
            let all = pairs.values.len();
            if all < zeros + self.wanted {
                return Ok(None);
            }
            pairs.vectors.set_columns(zeros + self.wanted);
            let measured = certificates::measure(self.problem, &pairs, progress)?;
            pairs.vectors.set_columns(all);
            let reached = measured.residual();
            if reached <= tolerance {
                return Ok(Some((pairs, measured)));
            }
            if reached > DISAPPOINTING || reached.is_nan() {
                return Ok(None);
            }
            let rough = |from: &usize| {
                let end = (from + ROUNDED).min(self.wanted);
                measured.residuals[zeros + from..zeros + end].iter().any(|r| *r > LOCKED * tolerance)
            };
            let rough: Vec<usize> = (0..self.wanted).step_by(ROUNDED).filter(rough).collect();
            for from in rough.chunk_by(|a, b| a + ROUNDED == *b).flat_map(|run| run.chunks(GROUP / ROUNDED)) {
                let group = zeros + from[0]..all.min(zeros + from[0] + from.len() * ROUNDED);
                let values = pairs.values[group.clone()].to_vec();
                let top = pairs.values[all - 1];
                let omega: Vec<f64> =
                    values.iter().map(|&mu| 2.0 / (self.lower_end(mu, top) + self.upper_end)).collect();
                self.correction.in_double(&mut pairs.vectors, group.start, &values, &omega, progress)?;
            }
            pairs.values = rayleigh_ritz_beside(self.problem, &mut pairs.vectors, progress)?;
        }
        Ok(None)
    }
}

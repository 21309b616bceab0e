//! What residuals say of eigenvalues: their dual norm, which does not grow with the number of points.
//!
//! For a vector `y` with its Rayleigh quotient μ let `r = A y − μ y` and `ρ = ‖r‖_{(A+σ)⁻¹} / √(μ + σ)`. Expanded in
//! eigenvectors, `ρ² (μ+σ) = Σ ((λ−μ)/(λ+σ))² (λ+σ) c²` and `Σ (λ+σ) c² = μ+σ`: some eigenvalue λ has
//! `|λ − μ|/(λ + σ) ≤ ρ`.
//!
//! What is reported is a bound of ρ. For any `z`, and `d = r − (A+σ) z`, it is
//! `‖r‖²_{(A+σ)⁻¹} = zᵀ(r + d) + ‖d‖²_{(A+σ)⁻¹} ≤ zᵀ(r + d) + ‖d‖²/σ`, because nothing of `A` is below 0; `z` need not be
//! more than nearly a solution.

use rayon::prelude::*;

use super::Problem;
use super::factor::Cholesky;
use super::vectors::block::Block;
use super::vectors::pair::rounded_residual;
use super::vectors::single::added;
use super::vectors::sparse_product::{Finish, Rows, finished_product};
use crate::progress::{Canceled, Progress};

/// Improvements of `z` at most; another is made where what is left of `d` is more than a share of the bound's square, and ρ
/// more than what is as good as nothing.
const ROUNDS_MAX: usize = 5;
const LEFT_MAX: f64 = 0.4;
const NEGLIGIBLE: f64 = 2e-5;

/// Vectors of a group at most and at least, and numbers of one about which it may have.
const WIDTHS: [usize; 2] = [16, 32];
const NUMBERS: usize = 32 << 20;

/// Sweeps of Jacobi's iteration in one improvement, and the part of the spectrum that they are made for, as a share of its
/// upper end: what a sample of every ninth point knows nothing of.
const SWEEPS: usize = 3;
const SWEPT_FROM: f64 = 0.1;

/// Partial sums; a fixed number, so that the result is independent of the threads.
const PARTIAL_SUMS: usize = 16;

/// Vectors that are worked on together: three groups of them are held.
#[must_use]
pub fn width(points: usize) -> usize {
    (NUMBERS / points.max(1) / 16 * 16).clamp(WIDTHS[0], WIDTHS[1])
}

/// `A + σI` of a problem in single precision, with what relaxes it.
pub(super) struct System<'a> {
    problem: &'a Problem,
    values: Vec<f32>,
    /// One over the sum of the sizes of a row's entries, in the scale of the row: `A` times it has its spectrum between
    /// 0 and 1 (Gershgorin), whatever the entries' signs.
    relaxation: Vec<f64>,
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

    /// `out ← r − (A + σI) z`.
    pub(super) fn defect(&self, out: &mut Block<f32>, z: &Block<f32>, r: &Block<f32>) {
        let columns = r.columns();
        let right = Finish::Defect(r.columns_from(0, columns));
        finished_product(out, self.rows(), z.columns_from(0, columns), right);
        let shift = self.problem.shift as f32;
        out.for_each_row(|i, row| row.iter_mut().zip(z.row(i)).for_each(|(d, z)| *d -= shift * z));
    }

    /// Takes what is rough out of the error of `z`, of which `A z = r` is wanted; `other` is used up.
    pub(super) fn sweep(
        &self,
        z: &mut Block<f32>,
        r: &Block<f32>,
        other: &mut Block<f32>,
        progress: &Progress,
    ) -> Result<(), Canceled> {
        let columns = r.columns();
        let mut scale = vec![0.0_f32; self.relaxation.len()];
        for sweep in 0..SWEEPS {
            progress.checkpoint()?;
            let omega = relaxation(SWEPT_FROM, 1.0, sweep, SWEEPS);
            let scaled = scale.par_iter_mut().zip(&self.relaxation).with_min_len(1 << 12);
            scaled.for_each(|(scale, relaxation)| *scale = (omega * relaxation) as f32);
            let finish = Finish::Relaxed(r.columns_from(0, columns), &scale);
            finished_product(other, self.rows(), z.columns_from(0, columns), finish);
            std::mem::swap(z, other);
        }
        Ok(())
    }
}

/// Something that nearly solves systems with `A + σI`.
pub(super) trait Improve {
    /// Brings `z` nearer to the solution of `(A + σI) z = r`, from zero where it has not `begun`; `other` is used up.
    ///
    /// # Errors
    /// [`Canceled`].
    fn improve(
        &mut self,
        system: &System<'_>,
        z: &mut Block<f32>,
        r: &Block<f32>,
        other: &mut Block<f32>,
        begun: bool,
        progress: &Progress,
    ) -> Result<(), Canceled>;
}

/// By the factor of the shifted matrix itself or, `smoothed`, of one with a similar lower end of its spectrum.
pub(super) struct ByFactor<'a> {
    factor: &'a Cholesky<'a>,
    smoothed: bool,
    buffer: Vec<f32>,
}

impl<'a> ByFactor<'a> {
    pub(super) fn new(factor: &'a Cholesky<'a>, smoothed: bool) -> Self {
        Self { factor, smoothed, buffer: Vec::new() }
    }
}

impl Improve for ByFactor<'_> {
    fn improve(
        &mut self,
        system: &System<'_>,
        z: &mut Block<f32>,
        r: &Block<f32>,
        other: &mut Block<f32>,
        begun: bool,
        progress: &Progress,
    ) -> Result<(), Canceled> {
        if begun || self.smoothed {
            if self.smoothed {
                system.sweep(z, r, other, progress)?;
            }
            system.defect(other, z, r);
        } else {
            other.copy_columns(0, r, 0, r.columns());
        }
        progress.checkpoint()?;
        self.factor.solve_single(other, &mut self.buffer, progress)?;
        add(z, other);
        if self.smoothed { system.sweep(z, r, other, progress) } else { progress.checkpoint() }
    }
}

pub(super) fn add(z: &mut Block<f32>, more: &Block<f32>) {
    z.for_each_row(|i, row| row.iter_mut().zip(more.row(i)).for_each(|(z, x)| *z += x));
}

/// Room for the vectors of a group.
pub(super) struct Room {
    pub(super) residual: Block<f32>,
    pub(super) solution: Block<f32>,
    pub(super) other: Block<f32>,
}

impl Room {
    pub(super) fn new(points: usize, width: usize) -> Self {
        let block = || Block::zeros(points, width);
        Self { residual: block(), solution: block(), other: block() }
    }

    /// Sets the solution of the residual at hand to zero.
    pub(super) fn begin(&mut self) {
        let columns = self.residual.columns();
        self.solution.set_columns(columns);
        self.other.set_columns(columns);
        self.solution.for_each_row(|_, row| row.fill(0.0));
    }
}

/// Bounds of ρ for orthonormal vectors of these values, in double precision.
///
/// # Errors
/// [`Canceled`].
pub(super) fn bounds(
    problem: &Problem,
    values: &[f64],
    vectors: &Block,
    mut inverse: Option<&mut dyn Improve>,
    progress: &Progress,
) -> Result<Vec<f64>, Canceled> {
    let system = System::new(problem);
    let mut room = Room::new(problem.size(), width(problem.size()).min(values.len()));
    let mut found = Vec::with_capacity(values.len());
    for first in (0..values.len()).step_by(room.residual.columns()) {
        let some = &values[first..values.len().min(first + width(problem.size()))];
        progress.advance(first as f64 / values.len() as f64)?;
        rounded_residual(&mut room.residual, &problem.matrix, vectors.columns_from(first, some.len()), some);
        // lent to every group anew
        let inverse = inverse.as_mut().map(|inverse| &mut **inverse as &mut dyn Improve);
        found.extend(bounds_of_group(&system, some, inverse, &mut room, progress)?);
    }
    Ok(found)
}

/// The same of the residuals in `room`; without an `inverse` `‖r‖²/σ` alone.
pub(super) fn bounds_of_group(
    system: &System<'_>,
    values: &[f64],
    inverse: Option<&mut dyn Improve>,
    room: &mut Room,
    progress: &Progress,
) -> Result<Vec<f64>, Canceled> {
    let shift = system.problem.shift;
    room.begin();
    let Room { residual, solution, other } = room;
    let mut bounds: Vec<f64> =
        products(solution, residual, residual).iter().map(|[_, rest]| rest / shift).collect();
    let mut inverse = inverse;
    for round in 0..if inverse.is_some() { ROUNDS_MAX } else { 0 } {
        let Some(inverse) = inverse.as_mut() else { break };
        progress.checkpoint()?;
        inverse.improve(system, solution, residual, other, round > 0, progress)?;
        system.defect(other, solution, residual);
        let products = products(solution, residual, other);
        for (bound, [known, rest]) in bounds.iter_mut().zip(&products) {
            let found = known + rest / shift;
            if found < *bound {
                *bound = found.max(0.0);
            }
        }
        let mut all = bounds.iter().zip(&products).zip(values);
        let is_enough = |((bound, [_, rest]), value): ((&f64, &[f64; 2]), &f64)| {
            rest / shift <= LEFT_MAX * bound || *bound <= NEGLIGIBLE.powi(2) * (value + shift)
        };
        if all.all(is_enough) {
            break;
        }
    }
    Ok(bounds.iter().zip(values).map(|(bound, value)| (bound / (value.max(0.0) + shift)).sqrt()).collect())
}

/// `zᵀr` of every column.
pub(super) fn inner_products(z: &mut Block<f32>, r: &Block<f32>) -> Vec<f64> {
    products(z, r, r).iter().map(|[twice, _]| 0.5 * twice).collect()
}

/// `zᵀ(r + d)` and `‖d‖²` of every column.
fn products(z: &mut Block<f32>, r: &Block<f32>, d: &Block<f32>) -> Vec<[f64; 2]> {
    let m = r.columns();
    let sums = z.map_stretches(PARTIAL_SUMS, |first, rows, width| {
        let mut sums = vec![0.0; 2 * m];
        for (k, z) in rows.chunks(width).enumerate() {
            let (r, d) = (r.row(first + k), d.row(first + k));
            let (known, rest) = sums.split_at_mut(m);
            for j in 0..m {
                let left = f64::from(d[j]);
                known[j] += f64::from(z[j]) * (f64::from(r[j]) + left);
                rest[j] += left * left;
            }
        }
        sums
    });
    let sums = added(2 * m, sums);
    (0..m).map(|j| [sums[j], sums[m + j]]).collect()
}

/// The relaxation ω of one of `steps` steps that leave the least of what is multiplied by `1 − ω y` for `y` from `low` to
/// `high` (Chebyshev), the larger ones first.
pub(super) fn relaxation(low: f64, high: f64, step: usize, steps: usize) -> f64 {
    let (middle, half) = (0.5 * (low + high), 0.5 * (high - low));
    1.0 / (middle - half * (std::f64::consts::PI * (step as f64 + 0.5) / steps as f64).cos())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::spectrum::Eigenpairs;
    use crate::spectrum::certificates::measure;
    use crate::spectrum::factor::Symbolic;
    use crate::spectrum::grid::grid;

    const SIDE: usize = 60;

    /// An eigenvector of the grid, numbered by its waves along the axes, and its eigenvalue: products of
    /// `cos(π a (x + ½)/side)`, of the eigenvalue `2 − 2 cos(π a/side)` of a path (Strang 1999).
    fn wave(a: usize, b: usize) -> (f64, Vec<f64>) {
        let along =
            |k: usize, x: usize| (std::f64::consts::PI * k as f64 * (x as f64 + 0.5) / SIDE as f64).cos();
        let value = |k: usize| 2.0 - 2.0 * (std::f64::consts::PI * k as f64 / SIDE as f64).cos();
        let mut vector: Vec<f64> =
            (0..SIDE * SIDE).map(|i| along(a, i % SIDE) * along(b, i / SIDE)).collect();
        let norm = vector.iter().map(|x| x * x).sum::<f64>().sqrt();
        for x in &mut vector {
            *x /= norm;
        }
        (value(a) + value(b), vector)
    }

    /// A vector near an eigenvector, with some of others, its Rayleigh quotient, and its ρ by the definition.
    fn mixed(shift: f64, others: &[(usize, usize, f64)]) -> (f64, Vec<f64>, f64) {
        let rest: f64 = others.iter().map(|(_, _, c)| c * c).sum();
        let parts: Vec<(f64, Vec<f64>, f64)> = [(2, 1, (1.0 - rest).sqrt())]
            .iter()
            .chain(others)
            .map(|&(a, b, c)| (wave(a, b).0, wave(a, b).1, c))
            .collect();
        let mu: f64 = parts.iter().map(|(lambda, _, c)| c * c * lambda).sum();
        let vector = (0..SIDE * SIDE).map(|i| parts.iter().map(|(_, v, c)| c * v[i]).sum()).collect();
        let square: f64 =
            parts.iter().map(|(lambda, _, c)| (c * (lambda - mu)).powi(2) / (lambda + shift)).sum();
        (mu, vector, (square / (mu + shift)).sqrt())
    }

    #[test]
    fn bounds_are_above_the_dual_norm_and_near_it_where_systems_are_solved() {
        let problem = grid(SIDE);
        let rough = mixed(problem.shift, &[(50, 40, 1e-3), (59, 58, 1e-3)]);
        let smooth = mixed(problem.shift, &[(7, 3, 1e-3), (4, 9, 2e-3)]);
        let mut vectors = Block::zeros(SIDE * SIDE, 2);
        vectors.for_each_row(|i, row| row.copy_from_slice(&[rough.1[i], smooth.1[i]]));
        let values = [rough.0, smooth.0];
        let order: Vec<u32> = (0..(SIDE * SIDE) as u32).collect();
        let symbolic = Symbolic::analyze(&problem.matrix, order, &Progress::new()).unwrap();
        for shift in [problem.shift, 4.0 * values[0]] {
            let factor = symbolic.factor(&problem.matrix, shift, &Progress::new()).unwrap();
            for smoothed in [false, true] {
                let mut inverse = ByFactor::new(&factor, smoothed);
                let found =
                    bounds(&problem, &values, &vectors, Some(&mut inverse), &Progress::new()).unwrap();
                for (bound, exact) in found.iter().zip([rough.2, smooth.2]) {
                    assert!((0.9999 * exact..1.3 * exact).contains(bound), "{shift}: {bound} {exact}");
                }
            }
        }
        // nothing but the 2-norm is known
        let found = bounds(&problem, &values, &vectors, None, &Progress::new()).unwrap();
        let pairs = Eigenpairs::real(values.to_vec(), vectors);
        let residuals = measure(&problem, &pairs, &Progress::new()).unwrap().residuals;
        for ((bound, residual), mu) in found.iter().zip(residuals).zip(values) {
            let expected = residual * ((mu + problem.shift) / problem.shift).sqrt();
            assert!((bound / expected - 1.0).abs() < 1e-5, "{bound} {expected}");
        }
    }

    #[test]
    fn some_eigenvalue_is_within_the_bound() {
        let problem = grid(SIDE);
        let (mu, vector, dual) = mixed(problem.shift, &[(2, 2, 0.1), (5, 5, 0.05)]);
        let off = |lambda: f64| (lambda - mu).abs() / (lambda + problem.shift);
        let nearest = (0..SIDE * SIDE).map(|k| off(wave(k % SIDE, k / SIDE).0)).fold(f64::INFINITY, f64::min);
        assert!(nearest <= dual && nearest > 0.01 * dual && vector.len() == SIDE * SIDE, "{nearest} {dual}");
    }
}

//! What residuals say of eigenvalues: their dual norm, which does not grow with the number of points.
//!
//! For a vector `y` with its Rayleigh quotient μ let `r = A y − μ y` and `ρ = ‖r‖_{(A+σ)⁻¹} / √(μ + σ)`. Expanded in
//! eigenvectors, `ρ² (μ+σ) = Σ ((λ−μ)/(λ+σ))² (λ+σ) c²` and `Σ (λ+σ) c² = μ+σ`: some eigenvalue λ has
//! `|λ − μ|/(λ + σ) ≤ ρ`.
//!
//! What is reported is a bound of ρ. Steps `α p` take `2α pᵀd − α² pᵀ(A+σ)p` from `‖d‖²_{(A+σ)⁻¹}`, where d is what is left of r,
//! and what is left in the end is at most `‖d‖²/σ`, because nothing of `A` is below 0.

use super::Problem;
use super::shifted_system::{NearInverse, Room, System, width};
use super::vectors::block::Block;
use super::vectors::pair::rounded_residual;
use crate::progress::{Canceled, Progress};

/// Steps at most; another is made where what is left may be more than a share of the bound's square, and ρ more than what is as
/// good as nothing.
const STEPS_MAX: usize = 6;
const LEFT_MAX: f64 = 0.4;
const NEGLIGIBLE: f64 = 2e-5;

/// What residuals tell.
pub(super) struct Judged {
    /// Their 2-norms.
    pub(super) norms: Vec<f64>,
    /// Bounds of ρ.
    pub(super) bounds: Vec<f64>,
}

/// Residuals of orthonormal vectors of these values, in double precision, and bounds of ρ.
///
/// # Errors
/// [`Canceled`].
pub(super) fn bounds(
    problem: &Problem,
    values: &[f64],
    vectors: &Block,
    mut inverse: Option<&mut dyn NearInverse>,
    progress: &Progress,
) -> Result<Judged, Canceled> {
    let system = System::new(problem);
    let columns = width(problem.size()).min(values.len());
    let mut room = Room::new(problem.size(), columns);
    let mut norms = Vec::with_capacity(values.len());
    let mut found = Vec::with_capacity(values.len());
    for first in (0..values.len()).step_by(columns) {
        let some = &values[first..values.len().min(first + columns)];
        progress.advance(first as f64 / values.len() as f64)?;
        let x = vectors.columns_from(first, some.len());
        let squares = rounded_residual(&mut room.residual, &problem.matrix, x, some);
        norms.extend(squares.into_iter().map(f64::sqrt));
        progress.checkpoint()?;
        // lent to every group anew
        let inverse = inverse.as_mut().map(|inverse| &mut **inverse as &mut dyn NearInverse);
        found.extend(bounds_of_group(&system, some, inverse, &mut room, progress)?);
    }
    Ok(Judged { norms, bounds: found })
}

/// The same of the residuals in `room`; without an `inverse` `‖r‖²/σ` alone.
pub(super) fn bounds_of_group(
    system: &System<'_>,
    values: &[f64],
    mut inverse: Option<&mut dyn NearInverse>,
    room: &mut Room,
    progress: &Progress,
) -> Result<Vec<f64>, Canceled> {
    let shift = system.problem.shift;
    room.begin();
    let mut taken = vec![0.0; values.len()];
    let mut left: Vec<f64> = room.squares().iter().map(|square| square / shift).collect();
    let mut bounds = left.clone();
    for _ in 0..STEPS_MAX {
        let is_enough = |((bound, left), value): ((&f64, &f64), &f64)| {
            *left <= LEFT_MAX * bound || *bound <= NEGLIGIBLE.powi(2) * (value.max(0.0) + shift)
        };
        if bounds.iter().zip(&left).zip(values).all(is_enough) {
            break;
        }
        let Some(inverse) = inverse.as_mut() else { break };
        let step = room.step(system, &mut **inverse, progress)?;
        left = room.squares().iter().map(|square| square / shift).collect();
        for (j, bound) in bounds.iter_mut().enumerate() {
            taken[j] += step.gains[j];
            *bound = bound.min(taken[j] + left[j]);
        }
    }
    Ok(bounds.iter().zip(values).map(|(bound, value)| (bound / (value.max(0.0) + shift)).sqrt()).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::spectrum::Eigenpairs;
    use crate::spectrum::certificates::measure;
    use crate::spectrum::factor::Symbolic;
    use crate::spectrum::grid::grid;
    use crate::spectrum::shifted_system::ByFactor;

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
                    bounds(&problem, &values, &vectors, Some(&mut inverse), &Progress::new()).unwrap().bounds;
                for (bound, exact) in found.iter().zip([rough.2, smooth.2]) {
                    assert!((0.9999 * exact..1.3 * exact).contains(bound), "{shift}: {bound} {exact}");
                }
            }
        }
        // nothing but the 2-norm is known
        let found = bounds(&problem, &values, &vectors, None, &Progress::new()).unwrap().bounds;
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

//! From coarse points to fine ones: moving least squares of degree two in the coarse points' tangent planes.

use nalgebra::{Matrix6, Vector6};
use rayon::prelude::*;

use crate::operator::Sparse;
use crate::progress::{Canceled, Progress};
use crate::spectrum::vectors::sparse_product::Rows;

/// Coarse points that a function is fitted to at most: two rings.
const CANDIDATES: usize = 19;

/// The fit reaches so far beyond its tenth point, as a ratio of squared distances.
const REACH: f64 = 1.7;
const TENTH: usize = 9;

/// Weights that a well-placed fit does not have, and the most that their sum may be off: elsewhere weights are positive.
const WEIGHT_MAX: f64 = 2.0;
const DEFECT_MAX: f64 = 0.05;

/// Points of one task.
const POINTS_PER_TASK: usize = 4_096;

/// For every fine point the coarse points that it depends on, with their weights, in single precision: what they leave is
/// smoothed before it is used.
pub(super) struct Weights {
    offsets: Vec<usize>,
    columns: Vec<u32>,
    values: Vec<f32>,
}

impl Weights {
    pub(super) fn rows(&self) -> Rows<'_, f32> {
        Rows { offsets: &self.offsets, columns: &self.columns, values: &self.values }
    }

    /// The transposed matrix, for `coarse` coarse points.
    ///
    /// # Errors
    /// [`Canceled`].
    pub(super) fn transposed(&self, coarse: usize, progress: &Progress) -> Result<Self, Canceled> {
        let mut offsets = vec![0; coarse + 1];
        self.columns.iter().for_each(|&c| offsets[c as usize + 1] += 1);
        (0..coarse).for_each(|c| offsets[c + 1] += offsets[c]);
        let mut next = offsets.clone();
        let (mut columns, mut values) = (vec![0; self.columns.len()], vec![0.0; self.columns.len()]);
        for (i, span) in self.offsets.windows(2).enumerate() {
            if i % POINTS_PER_TASK == 0 {
                progress.checkpoint()?;
            }
            for k in span[0]..span[1] {
                let place = &mut next[self.columns[k] as usize];
                columns[*place] = i as u32;
                values[*place] = self.values[k];
                *place += 1;
            }
        }
        Ok(Self { offsets, columns, values })
    }

    /// Weights of the coarse points at fine ones; fine point `i` is at `fine(i)` near the coarse point `owner(i)`.
    /// `graph` couples the coarse points, `planes` are their tangent planes, and `scale(i, c)` multiplies their weights.
    ///
    /// # Errors
    /// [`Canceled`].
    #[allow(clippy::too_many_arguments)] // two samples and what relates them
    pub(super) fn fit<'a>(
        points: usize,
        fine: impl Fn(usize) -> &'a [f64] + Sync,
        owner: impl Fn(usize) -> usize + Sync,
        coarse: &[[f64; 3]],
        planes: &[[[f64; 3]; 2]],
        graph: &Sparse,
        scale: impl Fn(usize, usize) -> f64 + Sync,
        progress: &Progress,
    ) -> Result<Self, Canceled> {
        let near: Vec<Vec<u32>> = (0..coarse.len())
            .into_par_iter()
            .with_min_len(256)
            .map(|c| two_rings(graph, coarse, c))
            .collect();
        let task = |first: usize| {
            let (mut lengths, mut columns, mut values) = (Vec::new(), Vec::new(), Vec::new());
            let mut fitted = Vec::with_capacity(CANDIDATES);
            let end = if progress.is_canceled() { first } else { points.min(first + POINTS_PER_TASK) };
            for i in first..end {
                let c = owner(i);
                weigh(fine(i), &near[c], coarse, &planes[c], &mut fitted);
                columns.extend(fitted.iter().map(|&(c, _)| c));
                values.extend(fitted.iter().map(|&(c, weight)| (weight * scale(i, c as usize)) as f32));
                lengths.push(fitted.len());
            }
            (lengths, columns, values)
        };
        let tasks: Vec<usize> = (0..points).step_by(POINTS_PER_TASK).collect();
        let tasks: Vec<(Vec<usize>, Vec<u32>, Vec<f32>)> = tasks.into_par_iter().map(task).collect();
        progress.checkpoint()?;
        let mut all = Self { offsets: vec![0], columns: Vec::new(), values: Vec::new() };
        let mut end = 0;
        for (lengths, columns, values) in tasks {
            all.offsets.extend(lengths.iter().map(|length| {
                end += length;
                end
            }));
            all.columns.extend(columns);
            all.values.extend(values);
        }
        Ok(all)
    }
}

/// Point `c` with its neighbors and theirs, nearest first.
fn two_rings(graph: &Sparse, points: &[[f64; 3]], c: usize) -> Vec<u32> {
    let mut found: Vec<u32> =
        graph.neighbors(c).flat_map(|j| graph.row(j as usize).0.iter().copied()).collect();
    found.push(c as u32);
    found.sort_unstable();
    found.dedup();
    let squared = |j: u32| squared_length(offset(&points[j as usize], &points[c]));
    found.sort_by(|&a, &b| squared(a).total_cmp(&squared(b)));
    found.truncate(CANDIDATES);
    found
}

fn offset(q: &[f64], p: &[f64]) -> [f64; 3] {
    [q[0] - p[0], q[1] - p[1], q[2] - p[2]]
}

fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn squared_length(a: [f64; 3]) -> f64 {
    dot(a, a)
}

/// Weights at `p` of the coarse points `near`, into `fitted`.
fn weigh(p: &[f64], near: &[u32], points: &[[f64; 3]], plane: &[[f64; 3]; 2], fitted: &mut Vec<(u32, f64)>) {
    fitted.clear();
    let mut offsets = [[0.0; 3]; CANDIDATES];
    let mut squared = [0.0; CANDIDATES];
    for (k, &c) in near.iter().enumerate() {
        offsets[k] = offset(&points[c as usize], p);
        squared[k] = squared_length(offsets[k]);
        if squared[k] == 0.0 {
            fitted.push((c, 1.0));
            return;
        }
    }
    let (offsets, squared) = (&offsets[..near.len()], &squared[..near.len()]);
    let mut sorted = [0.0; CANDIDATES];
    let sorted = &mut sorted[..near.len()];
    sorted.copy_from_slice(squared);
    sorted.sort_unstable_by(f64::total_cmp);
    let radius = sorted[TENTH.min(sorted.len() - 1)];
    let influence = |squared: f64| {
        let rest = 1.0 - squared / (REACH * radius);
        if rest > 0.0 { rest * rest / (squared / radius + 1e-3) } else { 0.0 }
    };
    let length = radius.sqrt();
    let basis = |offset: [f64; 3]| {
        let [x, y] = plane.map(|axis| dot(axis, offset) / length);
        Vector6::new(1.0, x, y, x * x, x * y, y * y)
    };
    let mut normal = Matrix6::zeros();
    for (offset, &squared) in offsets.iter().zip(squared) {
        let (b, w) = (basis(*offset), influence(squared));
        for j in 0..6 {
            for i in j..6 {
                normal[(i, j)] += w * b[i] * b[j];
            }
        }
    }
    let trace = normal.trace();
    (0..6).for_each(|k| normal[(k, k)] += 1e-10 * trace);
    let mut first = Vector6::zeros();
    first[0] = 1.0;
    if let Some(factor) = normal.cholesky() {
        factor.solve_mut(&mut first);
        let weight = |(offset, &squared): (&[f64; 3], &f64)| influence(squared) * basis(*offset).dot(&first);
        fitted.extend(near.iter().copied().zip(offsets.iter().zip(squared).map(weight)));
        let sum: f64 = fitted.iter().map(|(_, weight)| weight).sum();
        let sound = (sum - 1.0).abs() < DEFECT_MAX && fitted.iter().all(|(_, w)| w.abs() < WEIGHT_MAX);
        if sound {
            fitted.retain(|&(_, weight)| weight != 0.0);
            for (_, weight) in fitted.iter_mut() {
                *weight /= sum;
            }
            return;
        }
        fitted.clear();
    }
    // too few points, or on a conic
    let sum: f64 = squared.iter().map(|&squared| influence(squared)).sum();
    fitted.extend(near.iter().zip(squared).map(|(&c, &squared)| (c, influence(squared) / sum)));
    fitted.retain(|&(_, weight)| weight != 0.0);
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A hexagonal patch of the plane through the origin that `axes` span, unit spacing.
    fn patch(axes: [[f64; 3]; 2]) -> Vec<[f64; 3]> {
        let place = |a: i32, b: i32| [f64::from(a) + 0.5 * f64::from(b), f64::from(b) * 0.75_f64.sqrt()];
        let in_space = |[u, v]: [f64; 2]| std::array::from_fn(|k| u * axes[0][k] + v * axes[1][k]);
        let all =
            (-2_i32..=2).flat_map(|a| (-2..=2).map(move |b| (a, b))).filter(|(a, b)| (a + b).abs() <= 2);
        all.map(|(a, b)| in_space(place(a, b))).collect()
    }

    #[test]
    fn the_transposed_matrix_has_the_entries_at_their_other_places() {
        let weights = Weights {
            offsets: vec![0, 2, 2, 4],
            columns: vec![2, 0, 2, 1],
            values: vec![0.75, 0.25, 1.5, -0.5],
        };
        let transposed = weights.transposed(3, &Progress::new()).unwrap();
        assert_eq!(transposed.offsets, [0, 1, 2, 4]);
        assert_eq!(transposed.columns, [0, 2, 0, 2]);
        assert_eq!(transposed.values, [0.25, -0.5, 0.75, 1.5]);
    }

    #[test]
    fn quadratic_functions_are_reproduced_and_conics_leave_positive_weights() {
        let half = 0.5_f64.sqrt();
        let axes = [[half, 0.0, half], [0.0, 1.0, 0.0]];
        let points = patch(axes);
        assert_eq!(points.len(), CANDIDATES);
        let near: Vec<u32> = (0..points.len() as u32).collect();
        let quadratic = |p: &[f64]| 1.0 + p[0] - 2.0 * p[1] + 0.5 * p[0] * p[2] + p[1] * p[1] - p[1] * p[2];
        let mut fitted = Vec::new();
        for p in [[0.2, 0.3, 0.2], [-0.1, 0.45, -0.1], [0.3, -0.2, 0.3]] {
            weigh(&p, &near, &points, &axes, &mut fitted);
            let value: f64 = fitted.iter().map(|&(c, w)| w * quadratic(&points[c as usize])).sum();
            assert!((value - quadratic(&p)).abs() < 1e-7, "{value} {}", quadratic(&p));
        }
        weigh(&points[4], &near, &points, &axes, &mut fitted);
        assert_eq!(fitted, [(4, 1.0)]);
        weigh(&[0.2, 0.3, 0.2], &near[..4], &points, &axes, &mut fitted);
        let sum: f64 = fitted.iter().map(|(_, weight)| weight).sum();
        assert!((sum - 1.0).abs() < 1e-12 && fitted.iter().all(|&(_, weight)| weight > 0.0));
    }
}

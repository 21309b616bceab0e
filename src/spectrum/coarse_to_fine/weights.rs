//! From coarse points to fine ones: moving least squares of degree two in the coarse points' tangent planes.

#![expect(clippy::inline_always, reason = "functions of another instruction set are not inlined otherwise")]

use nalgebra::{Matrix6, Vector6};
use pulp::Arch;
use rayon::prelude::*;

use crate::operator::Sparse;
use crate::progress::{Canceled, Progress};
use crate::spectrum::vectors::block::{Block, Columns};
use crate::spectrum::vectors::sparse_product::Matrix;

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
/// smoothed before it is used. All points that one coarse point stands for depend on the same ones, which are kept once.
pub(super) struct Weights {
    /// The coarse point that stands for every fine one.
    owner: Vec<u32>,
    /// Where the coarse points around each of them begin, and the last ones end.
    offsets: Vec<u32>,
    near: Vec<u32>,
    /// [`CANDIDATES`] of every fine point, those that it does not depend on with 0.
    values: Vec<f32>,
}

/// Fine points by what they depend on.
pub(super) struct Transposed<'a> {
    weights: &'a Weights,
    /// Where the fine points of every coarse one begin, and the last ones end.
    begins: Vec<u32>,
    members: Vec<u32>,
    /// For every coarse point the ones around which it is, and its place there.
    offsets: Vec<u32>,
    around: Vec<(u32, u8)>,
}

impl Matrix<f32> for &Weights {
    #[inline]
    fn row(&self, i: usize) -> (&[u32], &[f32]) {
        let near = self.near(self.owner[i] as usize);
        (near, &self.values[i * CANDIDATES..][..near.len()])
    }
}

impl Weights {
    fn near(&self, c: usize) -> &[u32] {
        &self.near[self.offsets[c] as usize..self.offsets[c + 1] as usize]
    }

    /// The transposed matrix.
    ///
    /// # Errors
    /// [`Canceled`].
    pub(super) fn transposed(&self, progress: &Progress) -> Result<Transposed<'_>, Canceled> {
        let coarse = self.offsets.len() - 1;
        let (begins, members) = grouped(coarse, || self.owner.iter().copied());
        progress.checkpoint()?;
        let (offsets, places) = grouped(coarse, || self.near.iter().copied());
        progress.checkpoint()?;
        let mut center = vec![0_u32; self.near.len()];
        for (c, span) in self.offsets.windows(2).enumerate() {
            center[span[0] as usize..span[1] as usize].fill(c as u32);
        }
        let around = |&k: &u32| {
            let c = center[k as usize];
            (c, (k - self.offsets[c as usize]) as u8)
        };
        let around = places.iter().map(around).collect();
        Ok(Transposed { weights: self, begins, members, offsets, around })
    }

    /// Weights of the coarse points at fine ones; fine point `i` is at `fine(i)` near the coarse point `owner[i]`.
    /// `graph` couples the coarse points, `planes` are their tangent planes, and `scale(i, c)` multiplies their weights.
    ///
    /// # Errors
    /// [`Canceled`].
    pub(super) fn fit<'a>(
        fine: impl Fn(usize) -> &'a [f64] + Sync,
        owner: Vec<u32>,
        coarse: &[[f64; 3]],
        planes: &[[[f64; 3]; 2]],
        graph: &Sparse,
        scale: impl Fn(usize, usize) -> f64 + Sync,
        progress: &Progress,
    ) -> Result<Self, Canceled> {
        let rings: Vec<Vec<u32>> = (0..coarse.len())
            .into_par_iter()
            .with_min_len(256)
            .map(|c| if progress.is_canceled() { Vec::new() } else { two_rings(graph, coarse, c) })
            .collect();
        progress.checkpoint()?;
        let (mut offsets, mut near) = (vec![0], Vec::with_capacity(CANDIDATES * coarse.len()));
        for ring in &rings {
            near.extend_from_slice(ring);
            offsets.push(near.len() as u32);
        }
        drop(rings);
        let values = vec![0.0_f32; CANDIDATES * owner.len()];
        let mut all = Self { owner, offsets, near, values };
        let mut values = std::mem::take(&mut all.values);
        let tasks = values.par_chunks_mut(CANDIDATES * POINTS_PER_TASK).enumerate();
        tasks.for_each(|(task, rows)| {
            let mut fitted = [0.0; CANDIDATES];
            for (k, row) in rows.chunks_exact_mut(CANDIDATES).enumerate() {
                if progress.is_canceled() {
                    return;
                }
                let i = task * POINTS_PER_TASK + k;
                let c = all.owner[i] as usize;
                let near = all.near(c);
                weigh(fine(i), near, coarse, &planes[c], &mut fitted[..near.len()]);
                for ((out, &c), weight) in row.iter_mut().zip(near).zip(fitted) {
                    *out = (weight * scale(i, c as usize)) as f32;
                }
            }
        });
        progress.checkpoint()?;
        all.values = values;
        Ok(all)
    }
}

impl Transposed<'_> {
    /// `Y = Wᵀ X`, sums in the order of the coarse points and of their fine ones.
    pub(super) fn product(&self, y: &mut Block<f32>, x: Columns<'_, f32>) {
        y.set_columns(x.count());
        let arch = Arch::new();
        y.for_each_stretch(|first, rows, width| {
            arch.dispatch(|| {
                for (k, row) in rows.chunks_mut(width).enumerate() {
                    self.add_row(first + k, x, &mut row[..x.count()]);
                }
            });
        });
    }

    #[inline(always)]
    fn add_row(&self, a: usize, x: Columns<'_, f32>, sums: &mut [f32]) {
        sums.fill(0.0);
        let around = &self.around[self.offsets[a] as usize..self.offsets[a + 1] as usize];
        for &(c, place) in around {
            let members = self.begins[c as usize] as usize..self.begins[c as usize + 1] as usize;
            for &i in &self.members[members] {
                let weight = self.weights.values[i as usize * CANDIDATES + usize::from(place)];
                if weight != 0.0 {
                    sums.iter_mut().zip(x.row(i as usize)).for_each(|(sum, x)| *sum += weight * x);
                }
            }
        }
    }
}

/// The numbers of all `labels`, by label: where those of every label begin, and they themselves, ascending.
fn grouped<I: Iterator<Item = u32>>(count: usize, labels: impl Fn() -> I) -> (Vec<u32>, Vec<u32>) {
    let mut begins = vec![0_u32; count + 1];
    labels().for_each(|label| begins[label as usize + 1] += 1);
    (0..count).for_each(|label| begins[label + 1] += begins[label]);
    let mut next = begins.clone();
    let mut numbers = vec![0_u32; begins[count] as usize];
    for (k, label) in labels().enumerate() {
        numbers[next[label as usize] as usize] = k as u32;
        next[label as usize] += 1;
    }
    (begins, numbers)
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

/// Weights at `p` of the coarse points `near`, into `fitted`, of as many numbers.
fn weigh(p: &[f64], near: &[u32], points: &[[f64; 3]], plane: &[[f64; 3]; 2], fitted: &mut [f64]) {
    let mut offsets = [[0.0; 3]; CANDIDATES];
    let mut squared = [0.0; CANDIDATES];
    for (k, &c) in near.iter().enumerate() {
        offsets[k] = offset(&points[c as usize], p);
        squared[k] = squared_length(offsets[k]);
        if squared[k] == 0.0 {
            fitted.fill(0.0);
            fitted[k] = 1.0;
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
        let weights = offsets.iter().zip(squared).map(weight);
        fitted.iter_mut().zip(weights).for_each(|(fitted, weight)| *fitted = weight);
        let sum: f64 = fitted.iter().sum();
        let sound = (sum - 1.0).abs() < DEFECT_MAX && fitted.iter().all(|w| w.abs() < WEIGHT_MAX);
        if sound {
            for weight in fitted {
                *weight /= sum;
            }
            return;
        }
    }
    // too few points, or on a conic
    let sum: f64 = squared.iter().map(|&squared| influence(squared)).sum();
    fitted.iter_mut().zip(squared).for_each(|(fitted, &squared)| *fitted = influence(squared) / sum);
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
        // three coarse points, of which the second stands for nothing, and five fine ones
        let owner = vec![0, 2, 0, 2, 2];
        let (offsets, near) = (vec![0, 2, 2, 5], vec![0, 1, 2, 1, 0]);
        let mut values = vec![0.0; 5 * CANDIDATES];
        let rows: [&[f32]; 5] = [&[0.75, 0.25], &[1.5, -0.5, 0.0], &[0.5, 0.5], &[0.25, 0.5, 0.25], &[1.0]];
        for (i, row) in rows.iter().enumerate() {
            values[i * CANDIDATES..][..row.len()].copy_from_slice(row);
        }
        let weights = Weights { owner, offsets, near, values };
        let rows = &weights;
        assert_eq!(rows.row(3), (&[2, 1, 0][..], &[0.25, 0.5, 0.25][..]));
        let mut dense = [[0.0_f32; 3]; 5];
        for (i, row) in dense.iter_mut().enumerate() {
            let (columns, values) = rows.row(i);
            columns.iter().zip(values).for_each(|(&c, &weight)| row[c as usize] = weight);
        }
        let mut x = Block::<f32>::zeros(5, 9);
        x.for_each_row(|i, row| row.iter_mut().enumerate().for_each(|(j, x)| *x = (i * i + j) as f32));
        let mut y = Block::<f32>::zeros(3, 9);
        weights.transposed(&Progress::new()).unwrap().product(&mut y, x.columns_from(2, 7));
        for c in 0..3 {
            for j in 0..7 {
                // all of these numbers are whole multiples of 1/4
                let of_row = |(i, row): (usize, &[f32; 3])| row[c] * x.row(i)[j + 2];
                let expected: f32 = dense.iter().enumerate().map(of_row).sum();
                assert_eq!(y.row(c)[j].to_bits(), (expected + 0.0).to_bits(), "{c} {j}");
            }
        }
    }

    #[test]
    fn quadratic_functions_are_reproduced_and_conics_leave_positive_weights() {
        let half = 0.5_f64.sqrt();
        let axes = [[half, 0.0, half], [0.0, 1.0, 0.0]];
        let points = patch(axes);
        assert_eq!(points.len(), CANDIDATES);
        let near: Vec<u32> = (0..points.len() as u32).collect();
        let quadratic = |p: &[f64]| 1.0 + p[0] - 2.0 * p[1] + 0.5 * p[0] * p[2] + p[1] * p[1] - p[1] * p[2];
        let mut fitted = [0.0; CANDIDATES];
        for p in [[0.2, 0.3, 0.2], [-0.1, 0.45, -0.1], [0.3, -0.2, 0.3]] {
            weigh(&p, &near, &points, &axes, &mut fitted);
            let value: f64 = fitted.iter().zip(&points).map(|(w, at)| w * quadratic(at)).sum();
            assert!((value - quadratic(&p)).abs() < 1e-7, "{value} {}", quadratic(&p));
        }
        weigh(&points[4], &near, &points, &axes, &mut fitted);
        let mut alone = [0.0; CANDIDATES];
        alone[4] = 1.0;
        assert_eq!(fitted.map(f64::to_bits), alone.map(f64::to_bits));
        weigh(&[0.2, 0.3, 0.2], &near[..4], &points, &axes, &mut fitted[..4]);
        let sum: f64 = fitted[..4].iter().sum();
        assert!((sum - 1.0).abs() < 1e-12 && fitted[..4].iter().all(|&weight| weight > 0.0));
    }
}

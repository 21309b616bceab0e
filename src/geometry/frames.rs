//! Tangent planes by principal component analysis.

use nalgebra::{DMatrix, Matrix3, SymmetricEigen};
use rayon::prelude::*;

use super::neighborhoods::NearestNeighbors;
use super::points::{GeometryError, Points};
use crate::progress::Progress;

/// Intrinsic dimension k of a surface.
pub const SURFACE: usize = 2;

/// Bound on the QR sweeps of a 3×3 to 8×8 eigenproblem; they take fewer than 10 as a rule.
const SWEEPS_MAX: usize = 1_000;

/// An orthonormal basis of the tangent plane of every point.
///
/// The handedness of each is arbitrary until they are oriented along the surface ([`Frames::flip`]).
#[derive(Debug, Clone)]
pub struct Frames {
    dimension: usize,
    /// `n × 2 × d`.
    tangents: Vec<f64>,
    /// Median over the points of the third over the second principal variance.
    thickness: f64,
}

/// Tangent planes through every point by PCA of its nearest neighbours.
///
/// The papers state a 2-approximation of the best plane for the proof and use PCA through the point in their own
/// experiments [PCD §4]. They take a ball of radius 10ε, which on scans spans whole features: we take the nearest
/// neighbours.
///
/// # Errors
/// [`GeometryError::Canceled`].
pub fn frames(
    points: &Points,
    nearest: &NearestNeighbors,
    progress: &Progress,
) -> Result<Frames, GeometryError> {
    progress.advance(0.75)?;
    let d = points.dimension();
    let mut tangents = vec![0.0; points.len() * SURFACE * d];
    let mut ratios: Vec<f64> = tangents
        .par_chunks_mut(SURFACE * d)
        .enumerate()
        .map(|(i, frame)| {
            if d == 2 {
                frame.copy_from_slice(&[1.0, 0.0, 0.0, 1.0]);
                0.0
            } else if d == 3 {
                frame_in_space(points, i, nearest.of(i), frame)
            } else {
                frame_in_any_dimension(points, i, nearest.of(i), frame)
            }
        })
        .collect();
    let middle = ratios.len() / 2;
    let thickness = *ratios.select_nth_unstable_by(middle, f64::total_cmp).1;
    Ok(Frames { dimension: d, tangents, thickness })
}

/// Writes the frame; returns the third over the second principal variance.
fn frame_in_space(points: &Points, i: usize, neighbors: &[u32], frame: &mut [f64]) -> f64 {
    let p = points.point(i);
    let mut scatter = Matrix3::<f64>::zeros();
    for &q in neighbors {
        let q = points.point(q as usize);
        let v = nalgebra::Vector3::new(q[0] - p[0], q[1] - p[1], q[2] - p[2]);
        scatter += v * v.transpose();
    }
    // the eigenvectors do not depend on the scale, the iteration's stopping rule does
    let scale = scatter.trace();
    let eigen = SymmetricEigen::try_new(scatter / scale, f64::EPSILON, SWEEPS_MAX);
    let Some(eigen) = eigen else {
        frame.copy_from_slice(&[1.0, 0.0, 0.0, 0.0, 1.0, 0.0]);
        return 0.0;
    };
    let order = descending(eigen.eigenvalues.as_slice());
    for (tangent, &axis) in frame.chunks_exact_mut(3).zip(&order) {
        tangent.copy_from_slice(eigen.eigenvectors.column(axis).as_slice());
    }
    ratio(eigen.eigenvalues.as_slice(), &order)
}

/// Writes the frame; returns the third over the second principal variance.
fn frame_in_any_dimension(points: &Points, i: usize, neighbors: &[u32], frame: &mut [f64]) -> f64 {
    let (p, d) = (points.point(i), points.dimension());
    let offsets =
        DMatrix::from_fn(d, neighbors.len(), |axis, j| points.point(neighbors[j] as usize)[axis] - p[axis]);
    let scatter = &offsets * offsets.transpose();
    let scale = scatter.trace();
    let Some(eigen) = SymmetricEigen::try_new(scatter / scale, f64::EPSILON, SWEEPS_MAX) else {
        frame.fill(0.0);
        frame[0] = 1.0;
        frame[d + 1] = 1.0;
        return 0.0;
    };
    let order = descending(eigen.eigenvalues.as_slice());
    for (tangent, &axis) in frame.chunks_exact_mut(d).zip(&order) {
        tangent.copy_from_slice(eigen.eigenvectors.column(axis).as_slice());
    }
    ratio(eigen.eigenvalues.as_slice(), &order)
}

/// The third over the second of the values; 0 where the second is (points on a line).
fn ratio(values: &[f64], order: &[usize]) -> f64 {
    let (second, third) = (values[order[1]], values[order[2]]);
    if second > 0.0 { third.max(0.0) / second } else { 0.0 }
}

/// Indices of the values, largest first.
fn descending(values: &[f64]) -> Vec<usize> {
    let mut order: Vec<usize> = (0..values.len()).collect();
    order.sort_by(|&a, &b| values[b].total_cmp(&values[a]).then(a.cmp(&b)));
    order
}

impl Frames {
    fn tangent(&self, i: usize, axis: usize) -> &[f64] {
        let start = (i * SURFACE + axis) * self.dimension;
        &self.tangents[start..start + self.dimension]
    }

    /// Median of the third over the second principal variance of the neighbourhoods: far below 1 on a surface, near 1
    /// in a volume.
    #[must_use]
    pub fn thickness(&self) -> f64 {
        self.thickness
    }

    /// Coordinates of `q − p_i` in the tangent plane of point `i`.
    #[must_use]
    pub fn project(&self, points: &Points, i: usize, q: usize) -> [f64; SURFACE] {
        let (p, q) = (points.point(i), points.point(q));
        std::array::from_fn(|axis| {
            self.tangent(i, axis).iter().zip(p.iter().zip(q)).map(|(t, (p, q))| t * (q - p)).sum()
        })
    }

    /// Determinant of `T_iᵀ T_j`: in space `n_i · n_j` of the frames' normals; in any dimension the product of the
    /// cosines of the principal angles, negative when the handedness differs.
    #[must_use]
    pub fn agreement(&self, i: usize, j: usize) -> f64 {
        let entry = |a: usize, b: usize| -> f64 {
            self.tangent(i, a).iter().zip(self.tangent(j, b)).map(|(x, y)| x * y).sum()
        };
        entry(0, 0) * entry(1, 1) - entry(0, 1) * entry(1, 0)
    }

    /// Turns the handedness of frame `i` around.
    pub fn flip(&mut self, i: usize) {
        let start = i * SURFACE * self.dimension;
        for x in &mut self.tangents[start..start + self.dimension] {
            *x = -*x;
        }
    }
}

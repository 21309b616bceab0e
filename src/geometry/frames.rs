//! Tangent spaces by principal component analysis.

use nalgebra::{DMatrix, Matrix3, SymmetricEigen};
use rayon::prelude::*;

use super::neighborhoods::{NearestNeighbors, Neighbor};
use super::points::{GeometryError, Points};
use super::polytope::determinant;
use crate::cloud::DIMENSION_MAX;
use crate::progress::Progress;

/// Largest intrinsic dimension k.
pub const INTRINSIC_MAX: usize = 3;

/// Bound on the QR sweeps of a 3×3 to 8×8 eigenproblem; they take fewer than 10 as a rule.
pub(super) const SWEEPS_MAX: usize = 1_000;

/// A principal variance this many times the next ends the tangent space: neighborhoods of 20 points on a surface
/// have ratios below 4 along it and far above across it, unless their noise is as large as their spacing.
const GAP: f64 = 5.0;

/// An orthonormal basis of the tangent space of every point.
///
/// The handedness of each is arbitrary until they are oriented along the surface ([`Frames::flip`]).
#[derive(Debug, Clone)]
pub struct Frames {
    pub(super) ambient: usize,
    pub(super) intrinsic: usize,
    /// `n × k × d`.
    pub(super) tangents: Vec<f64>,
    /// Nearest neighbors that each plane was laid through; empty when all have the same number.
    pub(super) counts: Vec<u32>,
    thickness: f64,
    dimension_estimate: usize,
}

/// What the principal variances of one neighborhood say.
struct Spread {
    /// The (k+1)-th over the k-th principal variance.
    thickness: f64,
    /// Number of variances before the first gap.
    dimension: usize,
}

/// Tangent spaces of dimension `intrinsic` through every point by PCA of its nearest neighbors.
///
/// The papers state a 2-approximation of the best plane for the proof and use PCA through the point in their own
/// experiments [PCD §4]. They take a ball of radius 10ε, which on scans spans whole features: we take the nearest
/// neighbors.
///
/// # Errors
/// [`GeometryError::Canceled`].
///
/// # Panics
/// Unless `intrinsic` is at least 1 and at most the ambient dimension and [`INTRINSIC_MAX`].
pub fn frames(
    points: &Points,
    nearest: &NearestNeighbors,
    intrinsic: usize,
    progress: &Progress,
) -> Result<Frames, GeometryError> {
    progress.advance(0.75)?;
    let ambient = points.dimension();
    assert!((1..=INTRINSIC_MAX.min(ambient)).contains(&intrinsic), "intrinsic dimension {intrinsic}");
    let mut tangents = vec![0.0; points.len() * intrinsic * ambient];
    let spreads: Vec<Spread> = tangents
        .par_chunks_mut(intrinsic * ambient)
        .enumerate()
        .map(|(i, frame)| {
            if progress.is_canceled() {
                return Spread { thickness: 0.0, dimension: 0 };
            }
            principal_axes(points, i, nearest.of(i), frame)
        })
        .collect();
    progress.checkpoint()?;
    let mut thickness: Vec<f64> = spreads.iter().map(|spread| spread.thickness).collect();
    let middle = thickness.len() / 2;
    let mut votes = [0_usize; DIMENSION_MAX + 1];
    for spread in &spreads {
        votes[spread.dimension] += 1;
    }
    // the smallest of those with most votes
    let most = votes.iter().copied().max().unwrap_or(0);
    Ok(Frames {
        ambient,
        intrinsic,
        tangents,
        counts: Vec::new(),
        thickness: *thickness.select_nth_unstable_by(middle, f64::total_cmp).1,
        dimension_estimate: votes.iter().position(|&count| count == most).unwrap_or(intrinsic),
    })
}

/// Writes the leading principal axes of the neighbors' offsets from point `i` into `frame`.
fn principal_axes(points: &Points, i: usize, neighbors: &[u32], frame: &mut [f64]) -> Spread {
    let d = points.dimension();
    let intrinsic = frame.len() / d;
    let offset = |j: usize, axis: usize| points.point(neighbors[j] as usize)[axis] - points.point(i)[axis];
    let axes = if d == 3 {
        axes_in_space((0..neighbors.len()).map(|j| std::array::from_fn(|axis| offset(j, axis))))
    } else {
        axes_in_any_dimension(d, neighbors.len(), offset)
    };
    match &axes {
        Some(axes) if intrinsic < d => frame.copy_from_slice(&axes.vectors[..frame.len()]),
        _ => (0..intrinsic).for_each(|axis| frame[axis * d + axis] = 1.0),
    }
    let variances = axes.map_or([0.0; DIMENSION_MAX], |axes| axes.variances);
    let ratio =
        |k: usize| if variances[k - 1] > 0.0 { variances[k].max(0.0) / variances[k - 1] } else { 0.0 };
    Spread {
        thickness: if intrinsic < d { ratio(intrinsic) } else { 0.0 },
        dimension: (1..d).find(|&k| ratio(k) * GAP < 1.0).unwrap_or(d),
    }
}

/// Principal variances, largest first, and their unit vectors, one after the other.
pub(super) struct Axes {
    pub(super) variances: [f64; DIMENSION_MAX],
    pub(super) vectors: [f64; DIMENSION_MAX * DIMENSION_MAX],
}

pub(super) fn axes_in_space(offsets: impl Iterator<Item = [f64; 3]>) -> Option<Axes> {
    let mut scatter = Matrix3::<f64>::zeros();
    for offset in offsets {
        let v = nalgebra::Vector3::from(offset);
        scatter += v * v.transpose();
    }
    // the eigenvectors do not depend on the scale, the iteration's stopping rule does
    let scale = scatter.trace();
    let eigen = SymmetricEigen::try_new(scatter / scale, f64::EPSILON, SWEEPS_MAX)?;
    Some(sorted(eigen.eigenvalues.as_slice(), eigen.eigenvectors.as_slice()))
}

/// Axes of `count` offsets from the point, given by `offset(j, axis)`.
pub(super) fn axes_in_any_dimension(
    d: usize,
    count: usize,
    offset: impl Fn(usize, usize) -> f64,
) -> Option<Axes> {
    let offsets = DMatrix::from_fn(d, count, |axis, j| offset(j, axis));
    let scatter = &offsets * offsets.transpose();
    let scale = scatter.trace();
    let eigen = SymmetricEigen::try_new(scatter / scale, f64::EPSILON, SWEEPS_MAX)?;
    Some(sorted(eigen.eigenvalues.as_slice(), eigen.eigenvectors.as_slice()))
}

/// The frame of one point, `intrinsic` unit vectors one after the other, by PCA of `neighbors` weighted by a function of
/// their squared distance.
pub fn weighted_frame(
    points: &Points,
    i: usize,
    neighbors: &[Neighbor],
    weight: impl Fn(f64) -> f64,
    intrinsic: usize,
    frame: &mut Vec<f64>,
) {
    let (p, d) = (points.point(i), points.dimension());
    let roots: Vec<f64> = neighbors.iter().map(|q| weight(q.squared_distance).sqrt()).collect();
    let offset =
        |j: usize, axis: usize| roots[j] * (points.point(neighbors[j].index as usize)[axis] - p[axis]);
    frame.clear();
    if let Some(axes) = axes_in_any_dimension(d, neighbors.len(), offset) {
        frame.extend_from_slice(&axes.vectors[..intrinsic * d]);
    } else {
        frame.resize(intrinsic * d, 0.0);
        (0..intrinsic).for_each(|axis| frame[axis * d + axis] = 1.0);
    }
}

/// Sorts eigenpairs, the vectors being columns one after the other.
fn sorted(values: &[f64], vectors: &[f64]) -> Axes {
    let d = values.len();
    let mut order: Vec<usize> = (0..d).collect();
    order.sort_by(|&a, &b| values[b].total_cmp(&values[a]).then(a.cmp(&b)));
    let mut axes = Axes { variances: [0.0; DIMENSION_MAX], vectors: [0.0; DIMENSION_MAX * DIMENSION_MAX] };
    for (to, &from) in order.iter().enumerate() {
        axes.variances[to] = values[from];
        axes.vectors[to * d..(to + 1) * d].copy_from_slice(&vectors[from * d..(from + 1) * d]);
    }
    axes
}

impl Frames {
    /// Intrinsic dimension k.
    #[must_use]
    pub fn intrinsic(&self) -> usize {
        self.intrinsic
    }

    /// Unit vector of one axis of the frame of point `i`.
    #[must_use]
    pub fn tangent(&self, i: usize, axis: usize) -> &[f64] {
        let start = (i * self.intrinsic + axis) * self.ambient;
        &self.tangents[start..start + self.ambient]
    }

    /// Median of the (k+1)-th over the k-th principal variance of the neighborhoods: far below 1 on a k-manifold,
    /// near 1 when the points fill more dimensions.
    #[must_use]
    pub fn thickness(&self) -> f64 {
        self.thickness
    }

    /// Intrinsic dimension that most neighborhoods look like: the number of principal variances before the first
    /// that falls by more than a factor of 5.
    #[must_use]
    pub fn dimension_estimate(&self) -> usize {
        self.dimension_estimate
    }

    /// Coordinates of `q − p_i` in the tangent space of point `i`; `K` is the intrinsic dimension.
    #[must_use]
    pub fn project<const K: usize>(&self, points: &Points, i: usize, q: usize) -> [f64; K] {
        debug_assert_eq!(K, self.intrinsic);
        let (p, q) = (points.point(i), points.point(q));
        std::array::from_fn(|axis| {
            self.tangent(i, axis).iter().zip(p.iter().zip(q)).map(|(t, (p, q))| t * (q - p)).sum()
        })
    }

    /// Determinant of `T_iᵀ T_j`: for surfaces in space `n_i · n_j` of the frames' normals; in any dimension the
    /// product of the cosines of the principal angles, negative when the handedness differs.
    #[must_use]
    pub fn agreement(&self, i: usize, j: usize) -> f64 {
        let entry = |a: usize, b: usize| -> f64 {
            self.tangent(i, a).iter().zip(self.tangent(j, b)).map(|(x, y)| x * y).sum()
        };
        match self.intrinsic {
            1 => entry(0, 0),
            2 => entry(0, 0) * entry(1, 1) - entry(0, 1) * entry(1, 0),
            _ => determinant::<3>(&std::array::from_fn(|a| std::array::from_fn(|b| entry(a, b)))),
        }
    }

    /// Turns the handedness of frame `i` around.
    pub fn flip(&mut self, i: usize) {
        let start = i * self.intrinsic * self.ambient;
        for x in &mut self.tangents[start..start + self.ambient] {
            *x = -*x;
        }
    }
}

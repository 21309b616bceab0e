//! How densely and how evenly the surface is sampled.

use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::cells::{CellKind, Cells};
use super::neighborhoods::NearestNeighbors;
use super::points::Points;
use crate::progress::{Canceled, Progress};

/// Measures of the sampling, in the cloud's unit of length.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "server", derive(utoipa::ToSchema))]
pub struct Sampling {
    /// Covering radius ε [PBMHB Definition 3.1]: the 99 % quantile of the cells' radii.
    pub epsilon: f64,
    /// Smallest distance of two points ζ.
    pub zeta: f64,
    /// Mean spacing h, the k-th root of the mean cell volume.
    pub spacing: f64,
    /// Ratio of the 99 % to the 1 % quantile of cell volumes: how much denser the densest parts are.
    pub density_ratio: f64,
    /// Total volume of the cells, in `length^k`: the area of a surface, the length of a curve.
    pub area: f64,
    /// Cells open to a rim, measured inside the local triangulation.
    pub rim_cells: usize,
    /// Cells that could not be measured; their volume is the mean of the others.
    pub invalid_cells: usize,
}

/// A rim cannot be shorter than so many root-mean spacings of the whole surface: `√n` of them go once across it.
const RIM_SHARE: f64 = 0.5;

impl Sampling {
    /// Whether so many cells lie on a rim that a surface is taken for an open one.
    #[must_use]
    pub fn is_open(&self) -> bool {
        let cells = (self.area / (self.spacing * self.spacing)).max(1.0);
        self.rim_cells as f64 > RIM_SHARE * cells.sqrt()
    }

    /// Leaves out the cells of points that carry no result: area, spacing and counts are those of the others.
    pub fn keep(&mut self, cells: &Cells, intrinsic: usize, keep: impl Fn(usize) -> bool) {
        let kept: Vec<usize> = (0..cells.volume.len()).filter(|&i| keep(i)).collect();
        if kept.len() == cells.volume.len() || kept.is_empty() {
            return;
        }
        let count = |kind: CellKind| kept.iter().filter(|&&i| cells.kind[i] == kind).count();
        self.area = kept.iter().map(|&i| cells.volume[i]).sum();
        self.spacing = (self.area / kept.len() as f64).powf(1.0 / intrinsic as f64);
        self.rim_cells = count(CellKind::Rim);
        self.invalid_cells = count(CellKind::Invalid);
    }

    /// Takes the measures; the paper gives no estimator of ε, the quantile is ours.
    ///
    /// # Errors
    /// [`Canceled`].
    pub fn measure(
        points: &Points,
        nearest: &NearestNeighbors,
        intrinsic: usize,
        cells: &Cells,
        progress: &Progress,
    ) -> Result<Self, Canceled> {
        let valid = |i: &usize| cells.kind[*i] != CellKind::Invalid;
        let closed = |i: &usize| cells.kind[*i] == CellKind::Closed;
        let n = points.len();
        let mut radii: Vec<f64> = (0..n).filter(closed).map(|i| cells.radius[i]).collect();
        if radii.is_empty() {
            radii = (0..n).filter(valid).map(|i| cells.radius[i]).collect();
        }
        let radius = quantile(&mut radii, 0.99);
        drop(radii);
        progress.checkpoint()?;
        let mut areas: Vec<f64> = (0..n).filter(valid).map(|i| cells.volume[i]).collect();
        let (sparse, dense) = (quantile(&mut areas, 0.99), quantile(&mut areas, 0.01));
        drop(areas);
        progress.checkpoint()?;
        let squared_nearest = |i: usize| points.squared_distance(i, nearest.of(i)[0] as usize);
        let least = (0..n).into_par_iter().with_min_len(1 << 12).map(squared_nearest);
        let zeta = least.reduce(|| f64::INFINITY, f64::min).sqrt();
        let area: f64 = cells.volume.iter().sum();
        let spacing = (area / n as f64).powf(1.0 / intrinsic as f64);
        progress.checkpoint()?;
        Ok(Self {
            epsilon: radius.unwrap_or(spacing),
            zeta,
            spacing,
            density_ratio: sparse.zip(dense).map_or(1.0, |(sparse, dense)| sparse / dense),
            area,
            rim_cells: cells.count(CellKind::Rim),
            invalid_cells: cells.count(CellKind::Invalid),
        })
    }
}

/// The value below which a share `q` of the values lies.
fn quantile(values: &mut [f64], q: f64) -> Option<f64> {
    if values.is_empty() {
        return None;
    }
    let place = ((values.len() - 1) as f64 * q).round() as usize;
    Some(*values.select_nth_unstable_by(place, f64::total_cmp).1)
}

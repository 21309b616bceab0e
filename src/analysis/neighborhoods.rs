//! The points that are computed on, and their neighbors: repetitions merged, strays left out, noise smoothed.

use super::{AnalysisError, Parameters};
use crate::geometry::near::Repetitions;
use crate::geometry::noise::Noise;
use crate::geometry::points::POINTS_MIN;
use crate::geometry::strays::strays;
use crate::geometry::survey::Rules;
use crate::geometry::{NearestNeighbors, Points, SearchTree};
use crate::operator::OperatorKind;
use crate::progress::Progress;

/// Nearest neighbors looked up for every point: planes from all of them, most cells from the first ten.
const NEIGHBORS: usize = 20;

/// Times that repetitions are looked for: frames of which more than 20 overlap take more than one.
const ROUNDS: usize = 3;

/// Noise over spacing from which on lengths are measured on a smoothed surface; below it costs less than 0.5 %.
const NOISE_MIN: f64 = 0.06;

/// Points with what is near them.
pub(super) struct Neighborhoods {
    pub(super) points: Points,
    pub(super) tree: SearchTree,
    pub(super) nearest: NearestNeighbors,
    /// Points that were merged with others.
    pub(super) merged: usize,
    /// Rows of points that lie off the surface, ascending.
    pub(super) strays: Vec<usize>,
    /// Noise along the normals over the spacing.
    pub(super) noise: f64,
}

impl Neighborhoods {
    fn of(points: Points, progress: &Progress) -> Result<Self, AnalysisError> {
        let tree = SearchTree::new_by(&points, progress)?;
        let nearest = NearestNeighbors::find(&tree, &points, NEIGHBORS, progress)?;
        Ok(Self { points, tree, nearest, merged: 0, strays: Vec::new(), noise: 0.0 })
    }

    /// Looks up the neighbors of all points; of those that repeat one another one is left, those off the surface are
    /// left out, and noisy ones are moved onto the surface through their middle, where the parameters leave room for additions.
    pub(super) fn find(
        points: Points,
        parameters: &Parameters,
        rules: Rules,
        progress: &Progress,
    ) -> Result<Self, AnalysisError> {
        let mut found = Self::of(points, progress)?;
        if !parameters.additions().isometric_cells {
            return Ok(found);
        }
        for _ in 0..if rules.merge_repetitions { ROUNDS } else { 0 } {
            let Some(repeated) = Repetitions::find(&found.points, &found.nearest, progress)? else { break };
            let left = repeated.sizes.len();
            if left < POINTS_MIN.max(parameters.bases) {
                break;
            }
            let merged = found.merged + found.points.len() - left;
            let points = found.points.merged(&repeated.group, &repeated.sizes);
            found = Self { merged, ..Self::of(points, progress)? };
        }
        if parameters.dimension == 2 && rules.leave_strays {
            let strays = strays(&found.points, &found.nearest, progress)?;
            let left = found.points.len() - strays.len();
            if !strays.is_empty() && left >= POINTS_MIN.max(parameters.bases) {
                let mut rows: Vec<usize> = strays.iter().map(|&i| found.points.row(i as usize)).collect();
                rows.sort_unstable();
                let (points, merged) = (found.points.without(&strays), found.merged);
                found = Self { merged, strays: rows, ..Self::of(points, progress)? };
            }
        }
        let on_surface = matches!(parameters.operator, OperatorKind::PbMhb | OperatorKind::Voronoi);
        if on_surface && parameters.dimension == 2 {
            let noise = Noise::estimate(&found.points, &found.nearest);
            if rules.smooth_noise && noise.share > NOISE_MIN {
                let points = noise.smoothed(&found.points, &found.tree, progress)?;
                found = Self { merged: found.merged, strays: found.strays, ..Self::of(points, progress)? };
            }
            found.noise = noise.share;
        }
        Ok(found)
    }
}

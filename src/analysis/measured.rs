//! The stages before there is an operator: neighborhoods, tangent frames, cells, sampling.

use super::neighborhoods::Neighborhoods;
use super::{AnalysisError, Fidelity, Parameters};
use crate::geometry::cells::CellOptions;
use crate::geometry::orientation::Orientation;
use crate::geometry::survey::{Rules, Survey, Traits};
use crate::geometry::{Cells, Frames, NearestNeighbors, Points, Sampling, SearchTree, Stars, cells, frames};
use crate::operator::OperatorKind;
use crate::progress::{Phase, Progress};

/// (k+1)-th over k-th principal variance of the neighborhoods from which on the caller is warned. On a surface noise of
/// half a spacing gives about 0.15, a volume more than 0.5.
const THICKNESS_WARNED: f64 = 0.25;

/// The cloud, measured: all that an operator is assembled of.
pub(super) struct Measured {
    pub(super) points: Points,
    pub(super) tree: SearchTree,
    pub(super) nearest: NearestNeighbors,
    pub(super) frames: Frames,
    /// The triangles around every point of a surface, where cells are made of them; which side of it is which; how it is
    /// sampled.
    pub(super) stars: Option<Stars>,
    pub(super) orientation: Option<Orientation>,
    pub(super) traits: Option<Traits>,
    pub(super) cells: Cells,
    pub(super) figures: Figures,
}

/// What a report says of the cloud before there is an operator.
pub(super) struct Figures {
    /// Rows of points that carry no result; as yet of those off the surface.
    pub(super) lonely: Vec<usize>,
    pub(super) dimension_estimate: usize,
    pub(super) sampling: Sampling,
    pub(super) fidelity: Option<Fidelity>,
    pub(super) warnings: Vec<String>,
}

impl Measured {
    /// Finds every point's neighbors, tangent frame and cell.
    pub(super) fn of(
        points: Points,
        parameters: &Parameters,
        rules: Rules,
        progress: &Progress,
    ) -> Result<Self, AnalysisError> {
        progress.enter(Phase::Neighborhoods)?;
        let Neighborhoods { points, tree, nearest, merged, strays, noise } =
            Neighborhoods::find(points, parameters, rules, progress)?;
        let frames = frames(&points, &nearest, parameters.dimension, progress)?;
        let mut warnings = warnings_of_dimension(&frames);
        let dimension_estimate = frames.dimension_estimate();

        progress.enter(Phase::Cells)?;
        let additions = parameters.additions();
        let options = CellOptions {
            isometric: additions.isometric_cells,
            clip_rims: additions.isometric_cells,
            sheet_aware: additions.sheet_aware,
        };
        let (frames, stars, orientation, traits) = if additions.isometric_cells && parameters.dimension == 2 {
            let survey = Survey { points: &points, tree: &tree, nearest: &nearest, rules };
            let surveyed = survey.triangulate(frames, additions.sheet_aware, progress)?;
            (surveyed.frames, Some(surveyed.stars), Some(surveyed.orientation), Some(surveyed.traits))
        } else {
            (frames, None, None, None)
        };
        let mut cells = match &stars {
            Some(stars) => stars.cells(&points, progress)?,
            None => cells(&points, &tree, &nearest, &frames, options, progress)?,
        };
        let disagreement = if traits.is_some() { cells.disagreement(progress)? } else { 0.0 };
        let fidelity = traits.map(|traits| Fidelity::of(traits, disagreement, noise, merged, parameters));
        warnings.extend(fidelity.iter().flat_map(|fidelity| fidelity.warnings(parameters)));
        progress.checkpoint()?;
        let extends = matches!(parameters.operator, OperatorKind::Voronoi | OperatorKind::PbMhb)
            && rules.extend_rims
            && !parameters.paper;
        if let Some(stars) = stars.as_ref().filter(|_| extends) {
            cells.extend_rims(&points, stars);
        }
        let mut sampling = Sampling::measure(&points, &nearest, parameters.dimension, &cells, progress)?;
        sampling.epsilon = parameters.epsilon.unwrap_or(sampling.epsilon);
        let figures = Figures { lonely: strays, dimension_estimate, sampling, fidelity, warnings };
        Ok(Self { points, tree, nearest, frames, stars, orientation, traits, cells, figures })
    }
}

/// Says when the neighborhoods do not look like those of a k-manifold.
fn warnings_of_dimension(frames: &Frames) -> Vec<String> {
    let (k, estimate) = (frames.intrinsic(), frames.dimension_estimate());
    let mut warnings = Vec::new();
    if estimate != k {
        warnings.push(format!(
            "most neighborhoods look {estimate}-dimensional, the analysis takes the points for samples of a \
             {k}-dimensional manifold (`dimension`)"
        ));
    } else if frames.thickness() > THICKNESS_WARNED {
        warnings.push(format!(
            "the neighborhoods are hardly flat (their principal variance number {} is {:.0} % of the one before): the \
             points do not sample a {k}-dimensional manifold, or their noise is as large as their spacing",
            k + 1,
            100.0 * frames.thickness()
        ));
    }
    warnings
}

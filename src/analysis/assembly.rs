//! The stage that turns a measured cloud into an operator.

use super::memory::memory_with_entries;
use super::{AnalysisError, Parameters};
use crate::geometry::orientation::Orientation;
use crate::geometry::survey::Rules;
use crate::geometry::{Cells, Frames, NearestNeighbors, Points, Sampling, SearchTree, Stars, Triangles};
use crate::operator::bandwidth::Bandwidth;
use crate::operator::coverage;
use crate::operator::pb_mhb::Coupling;
use crate::operator::pcd::Planes;
use crate::operator::rims::Rims;
use crate::operator::sheets::Sheets;
use crate::operator::unfolding::Atlas;
use crate::operator::{
    LaplaceBeltrami, OperatorKind, Parameterization, Sparse, cotangent, graph, mesh, pb_mhb, pcd, voronoi,
};
use crate::progress::{Canceled, Progress};
use crate::spectrum::Weyl;

/// Most neighbors within δ that an operator may couple per point, on average.
const COUPLED_MAX: usize = 2_000;

/// Fewer entries than this, 2.4 GB of them, are assembled however many there are per point.
const ENTRIES_MAX: usize = 200_000_000;

/// Points whose neighbors are counted before the operator is assembled.
const COUNTED: usize = 256;
/// Points that one time for all couples each of with, in the mean, beyond which times follow the spacing: evenly sampled
/// surfaces have about 20, random ones about 100, adaptively sampled scans up to 250, which are better off with one time.
const COUPLED_ALIKE: usize = 300;

/// No time that follows the spacing is so long that t·λ of the last eigenvalue that is asked for is more, unless one time for all
/// would be: beyond, modes of the sparsest part crowd where μ is 1/t. On a sphere of 8,000 random points, 100 : 1, the
/// worst of 100 eigenvalues is 390 % off with 2.3, 15 % with 0.8, 13 % with one time, of which it is 0.73. So times follow the
/// spacing by default where one for all leaves room below half of it.
const SMOOTHED_MAX: f64 = 0.8;

/// The measured cloud.
pub(super) struct Surface<'a> {
    pub(super) points: &'a Points,
    pub(super) tree: &'a SearchTree,
    pub(super) nearest: &'a NearestNeighbors,
    pub(super) cells: &'a Cells,
    /// The triangles around every point, where the cells were made of them.
    pub(super) stars: Option<&'a Stars>,
    /// Sides of the frames, where they are known.
    pub(super) orientation: Option<&'a Orientation>,
    pub(super) sampling: &'a Sampling,
    pub(super) triangles: &'a Triangles,
    pub(super) rules: Rules,
}

/// An operator, and for one with long rows a companion with short rows and a similar spectrum at its lower end, in the
/// same scale.
pub(super) struct Assembled {
    pub(super) laplacian: LaplaceBeltrami,
    pub(super) narrow: Option<Sparse>,
}

/// Assembles finite volumes or cotangents, of which nothing but cells or triangles is asked.
pub(super) fn narrow(
    points: &Points,
    cells: &Cells,
    triangles: &Triangles,
    operator: OperatorKind,
    progress: &Progress,
) -> Result<Assembled, AnalysisError> {
    let laplacian = if operator == OperatorKind::Cotangent {
        cotangent::build(points, triangles, progress)?
    } else {
        LaplaceBeltrami::narrow(voronoi::stiffness(cells, progress)?, cells.volume.clone())
    };
    Ok(Assembled { laplacian, narrow: None })
}

/// Assembles the operator that the parameters name.
pub(super) fn assemble(
    surface: &Surface<'_>,
    frames: Frames,
    parameters: &Parameters,
    warnings: &mut Vec<String>,
    progress: &Progress,
) -> Result<Assembled, AnalysisError> {
    let Surface { points, tree, cells, sampling, triangles, .. } = *surface;
    let walls = voronoi::stiffness(cells, progress)?;
    let kernel = || {
        let (kernel, reach) = if parameters.parameterization == Some(Parameterization::NearestTen) {
            let kernel = pcd::nearest_ten(points, surface.nearest, parameters.dimension);
            (kernel, kernel.delta)
        } else {
            let kernel = parameters.heat_kernel(sampling.epsilon);
            // simplices count within half of what is triangulated
            (kernel, if parameters.operator.is_pcd() { 0.5 * kernel.delta } else { kernel.delta })
        };
        check_coupling(points, tree, kernel.delta, |_| reach, parameters, progress).map(|()| kernel)
    };
    let volumes = || cells.volume.clone();
    let (laplacian, narrow) = match parameters.operator {
        kind @ (OperatorKind::Voronoi | OperatorKind::Cotangent) => {
            return narrow(points, cells, triangles, kind, progress);
        }
        OperatorKind::PbMhb => {
            (pb_mhb(surface, frames, &walls, parameters, warnings, progress)?, Some(walls))
        }
        OperatorKind::Mesh => {
            let narrow = cotangent::stiffness(points, triangles, progress)?;
            (mesh::build(points, tree, triangles, kernel()?, progress)?, Some(narrow))
        }
        OperatorKind::Pcd => {
            let options = parameters.pcd_options(kernel()?);
            let planes = planes(surface, frames, &walls, parameters, warnings, progress)?;
            (pcd::build(points, tree, &planes, volumes(), &options, progress)?, Some(walls))
        }
        OperatorKind::PcdSymmetrized => {
            let options = parameters.pcd_options(kernel()?);
            let planes = planes(surface, frames, &walls, parameters, warnings, progress)?;
            let laplacian = pcd::build_symmetrized(points, tree, &planes, &options, progress)?;
            (laplacian, Some(scaled(walls, |i| 1.0 / cells.volume[i].sqrt())))
        }
        OperatorKind::WeightedGraph => {
            let laplacian = graph::weighted(points, tree, kernel()?, progress)?;
            // its masses are proportional to areas, in a unit of their own
            let unit = laplacian.mass.iter().sum::<f64>() / sampling.area;
            (laplacian, Some(scaled(walls, |_| unit.sqrt())))
        }
        kind @ (OperatorKind::Graph | OperatorKind::Kirchhoff | OperatorKind::Tutte) => {
            let delta = parameters.edge_length(sampling.epsilon);
            check_coupling(points, tree, delta, |_| delta, parameters, progress)?;
            let graph = graph::build(kind, points, tree, &walls, delta, progress)?;
            (graph.laplacian, Some(graph.narrow))
        }
    };
    Ok(Assembled { laplacian, narrow })
}

/// Tangent planes of one handedness.
fn oriented(
    surface: &Surface<'_>,
    frames: Frames,
    walls: &Sparse,
    warnings: &mut Vec<String>,
    progress: &Progress,
) -> Result<Sheets, Canceled> {
    let sheets = match surface.orientation {
        Some(orientation) => Sheets::oriented(frames, orientation.clone()),
        None => Sheets::orient(frames, walls, progress)?,
    };
    if !sheets.is_orientable() {
        warnings.push(
            "the surface could not be oriented; sheets are told apart by the angle of their planes only"
                .into(),
        );
    }
    Ok(sheets)
}

/// Where `pcd` looks for neighbors. Its authors' program finds planes of its own, which are not oriented.
fn planes(
    surface: &Surface<'_>,
    frames: Frames,
    walls: &Sparse,
    parameters: &Parameters,
    warnings: &mut Vec<String>,
    progress: &Progress,
) -> Result<Planes, Canceled> {
    let own = parameters.parameterization == Some(Parameterization::NearestTen);
    if parameters.additions().sheet_aware && !own {
        Ok(Planes::Sheet(oriented(surface, frames, walls, warnings, progress)?))
    } else {
        Ok(Planes::Ball(frames))
    }
}

fn pb_mhb(
    surface: &Surface<'_>,
    frames: Frames,
    walls: &Sparse,
    parameters: &Parameters,
    warnings: &mut Vec<String>,
    progress: &Progress,
) -> Result<LaplaceBeltrami, AnalysisError> {
    let Surface { points, tree, cells, stars, sampling, .. } = *surface;
    let additions = parameters.additions();
    let mut bandwidth = Bandwidth::even(points.len(), sampling.epsilon);
    let mut kernel = parameters.heat_kernel(sampling.epsilon);
    let dimension = parameters.dimension;
    let weyl = Weyl { first: Weyl::first_of(sampling.area, dimension), dimension, t: None };
    let last = weyl.eigenvalue(parameters.bases as f64);
    let is_local = parameters.local_bandwidth.unwrap_or_else(|| {
        let is_free = !parameters.paper && parameters.delta.or(parameters.delta_factor).is_none();
        let has_room = last * kernel.t < 0.5 * SMOOTHED_MAX;
        is_free && has_room && coupled(points, tree, |_| kernel.delta) > COUPLED_ALIKE
    });
    if is_local && additions.moment_calibration {
        let stretch = (SMOOTHED_MAX / (last * kernel.t)).max(1.0).sqrt();
        bandwidth = Bandwidth::of_cells(points, cells, walls, dimension, stretch * sampling.epsilon);
        kernel = parameters.heat_kernel(parameters.epsilon.unwrap_or(bandwidth.epsilon()));
    }
    let widens = surface.rules.widen_kernels && parameters.local_bandwidth.is_none() && !parameters.paper;
    if let Some(stars) = stars.filter(|_| widens && !is_local && additions.moment_calibration) {
        let longest = (SMOOTHED_MAX / (last * kernel.t)).max(1.0).sqrt();
        let t_factor = kernel.t / (sampling.epsilon * sampling.epsilon);
        let by_stretch = surface.rules.resolve_stretch;
        let lengths = coverage::lengths(points, &frames, stars, cells, walls, t_factor, by_stretch);
        bandwidth = Bandwidth::wide_enough(points, cells, walls, &lengths, sampling.epsilon, longest);
        kernel = parameters.heat_kernel(bandwidth.epsilon());
    }
    let local = bandwidth.of_kernel(kernel);
    check_coupling(points, tree, kernel.delta, |i| local.reach(i), parameters, progress)?;
    let stars = stars.filter(|_| additions.surface_distances);
    let sheets = (additions.sheet_aware || stars.is_some())
        .then(|| oriented(surface, frames, walls, warnings, progress))
        .transpose()?;
    progress.checkpoint()?;
    let atlas = sheets.as_ref().zip(stars).map(|(sheets, stars)| Atlas::new(points, stars, sheets));
    progress.checkpoint()?;
    let coupling = match (&atlas, &sheets) {
        (Some(atlas), _) => Coupling::Surface(atlas),
        (None, Some(sheets)) => Coupling::Sheet(sheets),
        (None, None) => Coupling::Ball,
    };
    let rims = || match stars.filter(|_| surface.rules.calibrate_rims) {
        Some(stars) => Rims::of(points, stars),
        None => Rims::default(),
    };
    let calibrated = additions.moment_calibration.then(rims);
    progress.checkpoint()?;
    let built = pb_mhb::build(points, tree, cells, &coupling, local, calibrated.as_ref(), progress)?;
    Ok(LaplaceBeltrami { follows_density: is_local && local.varies(), ..built })
}

/// `D A D` with the diagonal `scale`.
fn scaled(mut matrix: Sparse, scale: impl Fn(usize) -> f64) -> Sparse {
    let diagonal: Vec<f64> = (0..matrix.rows()).map(scale).collect();
    matrix.scale_both_sides(&diagonal);
    matrix
}

/// Points within `reach` of one, in the mean.
fn coupled(points: &Points, tree: &SearchTree, reach: impl Fn(usize) -> f64) -> usize {
    let stride = points.len().div_ceil(COUNTED);
    let mut neighbors = Vec::new();
    let (mut counted, mut found) = (0, 0);
    for i in (0..points.len()).step_by(stride) {
        tree.within(points, i, reach(i), &mut neighbors);
        counted += 1;
        found += neighbors.len();
    }
    found / counted
}

/// Refuses a δ that would couple everything with everything, within `reach` of each, and one whose matrix has no room.
fn check_coupling(
    points: &Points,
    tree: &SearchTree,
    delta: f64,
    reach: impl Fn(usize) -> f64,
    parameters: &Parameters,
    progress: &Progress,
) -> Result<(), AnalysisError> {
    let mean = coupled(points, tree, reach);
    if mean > COUPLED_MAX && mean * points.len() > ENTRIES_MAX {
        return Err(AnalysisError::Parameter {
            name: "delta",
            reason: format!(
                "the cut-off radius {:.4e} couples {mean} neighbors per point; at most {COUPLED_MAX} are coupled in a \
                 cloud of this size: choose a smaller `delta` or `t`",
                delta * points.unit()
            ),
        });
    }
    // half of a neighbor more, for what was rounded off
    let entries = points.len() as u64 * (mean as u64 + 1);
    progress.afford(memory_with_entries(points.len() as u64, points.dimension(), entries, parameters))?;
    Ok(())
}

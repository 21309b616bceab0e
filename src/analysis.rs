//! Cloud → operator → spectrum: all stages on one screen.

mod error;
mod parameters;
mod report;
mod result;

pub use error::AnalysisError;
pub use parameters::{Additions, JobKind, Parameters};
pub use report::Report;
pub use result::{Analysis, SparseMatrix};

use result::NO_PLACE;

use crate::cloud::PointCloud;
use crate::geometry::cells::CellOptions;
use crate::geometry::points::POINTS_MIN;
use crate::geometry::{Cells, NearestNeighbors, Points, Sampling, SearchTree, cells, components, frames};
use crate::operator::sheets::Sheets;
use crate::operator::{HeatKernel, LaplaceBeltrami, OperatorKind, SymmetricSparse, pb_mhb, voronoi};
use crate::progress::{Phase, Progress};
use crate::spectrum::solver::{DENSE_POINTS_MAX, Request};
use crate::spectrum::{Eigenbasis, Problem, Spectrum, certificates, solve};

/// Cheap checks before a cloud is accepted: enough distinct points, not all on a line, enough for the bases.
/// Costs a sort of the points. Returns the number of rows that repeat an earlier position.
///
/// # Errors
/// [`AnalysisError`] that says what is missing.
pub fn admit(cloud: &PointCloud, parameters: &Parameters) -> Result<usize, AnalysisError> {
    parameters.check()?;
    let points = Points::prepare(cloud)?;
    check_bases(parameters.bases, points.len())?;
    Ok(points.duplicates())
}

fn check_bases(bases: usize, points: usize) -> Result<(), AnalysisError> {
    let refuse = |reason| Err(AnalysisError::Parameter { name: "bases", reason });
    if bases > points {
        return refuse(format!("{bases} bases asked of {points} distinct points; at most {points} exist"));
    }
    if points > DENSE_POINTS_MAX && bases > points / 5 {
        return refuse(format!(
            "{bases} bases asked of {points} points; above {DENSE_POINTS_MAX} points at most a fifth of them, {}, are \
             computed",
            points / 5
        ));
    }
    Ok(())
}

/// Nearest neighbours looked up for every point: planes from all of them, most cells from the first ten.
const NEIGHBORS: usize = 20;

/// Components of fewer points carry no result.
const COMPONENT_MIN: usize = POINTS_MIN;

/// Most neighbours within δ that a kernel may couple per point, on average.
const COUPLED_MAX: usize = 2_000;

/// Third over second principal variance of the neighbourhoods from which on the caller is warned. Noise of half a
/// spacing gives about 0.15, a volume more than 0.5.
const THICKNESS_WARNED: f64 = 0.25;

/// Points whose neighbours are counted before the kernel is assembled.
const COUNTED: usize = 256;

/// Runs all stages on the calling thread and the current rayon pool.
///
/// # Errors
/// [`AnalysisError`].
pub fn analyze(
    cloud: &PointCloud,
    kind: JobKind,
    parameters: &Parameters,
    progress: &Progress,
) -> Result<Analysis, AnalysisError> {
    parameters.check()?;
    progress.enter(Phase::Preparation)?;
    let points = Points::prepare(cloud)?;

    progress.enter(Phase::Neighborhoods)?;
    let tree = SearchTree::new(&points);
    let nearest = NearestNeighbors::find(&tree, &points, NEIGHBORS, progress)?;
    let frames = frames(&points, &nearest, progress)?;

    progress.enter(Phase::Cells)?;
    let additions = parameters.additions();
    let options = CellOptions {
        isometric: additions.isometric_cells,
        clip_rims: additions.isometric_cells,
        sheet_aware: additions.sheet_aware,
    };
    let cells = cells(&points, &tree, &nearest, &frames, options, progress)?;
    let mut sampling = Sampling::measure(&points, &nearest, &cells);
    sampling.epsilon = parameters.epsilon.unwrap_or(sampling.epsilon);
    drop(nearest);

    progress.enter(Phase::Assembly)?;
    let walls = voronoi::stiffness(&cells, progress)?;
    let mut warnings = Vec::new();
    if frames.thickness() > THICKNESS_WARNED {
        warnings.push(format!(
            "the neighbourhoods are hardly flat (their third principal variance is {:.0} % of the second): the points \
             do not sample a surface, or their noise is as large as their spacing",
            100.0 * frames.thickness()
        ));
    }
    let (laplacian, narrow) = match parameters.operator {
        OperatorKind::Voronoi => {
            (LaplaceBeltrami { stiffness: walls, mass: cells.area.clone(), heat_kernel: None }, None)
        }
        OperatorKind::PbMhb => {
            let kernel = parameters.heat_kernel(sampling.epsilon);
            check_coupling(&points, &tree, kernel)?;
            let sheets = additions.sheet_aware.then(|| Sheets::orient(frames, &cells, &walls));
            if sheets.as_ref().is_some_and(|sheets| !sheets.is_orientable()) {
                warnings.push(
                    "the surface could not be oriented; sheets are told apart by the angle of their planes only".into(),
                );
            }
            (pb_mhb::build(&points, &tree, &cells, sheets.as_ref(), kernel, progress)?, Some(walls))
        }
    };
    drop(tree);
    let (laplacian, narrow, place) = without_small_components(laplacian, narrow, &cells)?;
    let used = laplacian.mass.len();
    let mut report = Report {
        operator: parameters.operator,
        rows: cloud.len(),
        dimension: cloud.dimension(),
        points_used: used,
        duplicates: points.duplicates(),
        nonfinite: cloud.nonfinite(),
        isolated: points.len() - used,
        components: components(used, |i| laplacian.stiffness.neighbors(i)).size.len(),
        sampling,
        heat_kernel: laplacian.heat_kernel,
        additions,
        nonzeros: laplacian.stiffness.nonzeros(),
        neighbors: laplacian.stiffness.nonzeros() as f64 / used as f64 - 1.0,
        warnings,
        spectrum: None,
    };
    report.warn_of_sampling();
    drop(cells);

    let mass = laplacian.mass.clone();
    let (stiffness, eigenbasis) = match kind {
        JobKind::Operator => (Some(laplacian.stiffness), None),
        JobKind::Eigen => {
            let active: Vec<u32> =
                (0..points.len() as u32).filter(|&i| place[i as usize] != NO_PLACE).collect();
            let eigenbasis =
                eigenpairs(&points, &active, laplacian, narrow, parameters, &mut report, progress)?;
            (None, Some(eigenbasis))
        }
    };
    Ok(Analysis { report, points, place, mass, stiffness, eigenbasis })
}

/// Solves the eigenproblem and writes what was found into the report.
fn eigenpairs(
    points: &Points,
    active: &[u32],
    laplacian: LaplaceBeltrami,
    narrow: Option<SymmetricSparse>,
    parameters: &Parameters,
    report: &mut Report,
    progress: &Progress,
) -> Result<Eigenbasis, AnalysisError> {
    check_bases(parameters.bases, active.len())?;
    let heat_kernel = laplacian.heat_kernel;
    let problem = Problem::new(laplacian);
    let narrow = narrow.map(|mut matrix| {
        let inverse: Vec<f64> = problem.root_mass.iter().map(|m| 1.0 / m).collect();
        matrix.scale_both_sides(&inverse);
        matrix
    });
    let request = Request {
        count: parameters.bases,
        tolerance: parameters.tolerance,
        position: |i: u32| points.point(active[i as usize] as usize),
        narrow: narrow.as_ref(),
        heat_kernel,
    };
    let solution = solve(&problem, &request, progress)?;
    let raw = solution.pairs.values.clone();
    let corrected = heat_kernel.filter(|_| report.additions.heat_correction);
    let eigenvalues: Vec<Option<f64>> = raw
        .iter()
        .map(|&mu| Some(corrected.map_or(mu, |kernel| kernel.corrected(mu))).filter(|x| x.is_finite()))
        .collect();
    report.spectrum = Some(Spectrum {
        eigenvalues,
        clusters: certificates::clusters(&raw, problem.shift),
        raw_eigenvalues: raw,
        residuals: solution.residuals,
        components: problem.zero_modes(),
        certificates: solution.certificates,
        method: solution.method,
    });
    report.warn_of_spectrum(parameters.tolerance);
    Ok(Eigenbasis::new(&problem, solution.pairs))
}

/// Refuses a δ that would couple everything with everything.
fn check_coupling(points: &Points, tree: &SearchTree, kernel: HeatKernel) -> Result<(), AnalysisError> {
    let stride = points.len().div_ceil(COUNTED);
    let mut neighbors = Vec::new();
    let (mut counted, mut found) = (0, 0);
    for i in (0..points.len()).step_by(stride) {
        tree.within(points, i, kernel.delta, &mut neighbors);
        counted += 1;
        found += neighbors.len();
    }
    if found / counted > COUPLED_MAX && points.len() > COUPLED_MAX {
        return Err(AnalysisError::Parameter {
            name: "delta",
            reason: format!(
                "the cut-off radius {:.4e} reaches {} neighbours per point; at most {COUPLED_MAX} are coupled: choose \
                 a smaller `delta` or `t`",
                kernel.delta,
                found / counted
            ),
        });
    }
    Ok(())
}

/// Leaves out components of fewer than [`COMPONENT_MIN`] points, in the operator and its narrow companion; also
/// returns every point's place.
fn without_small_components(
    laplacian: LaplaceBeltrami,
    narrow: Option<SymmetricSparse>,
    cells: &Cells,
) -> Result<(LaplaceBeltrami, Option<SymmetricSparse>, Vec<u32>), AnalysisError> {
    let n = cells.area.len();
    let found = components(n, |i| laplacian.stiffness.neighbors(i));
    if found.size.iter().all(|&size| size >= COMPONENT_MIN) {
        return Ok((laplacian, narrow, (0..n as u32).collect()));
    }
    let keep: Vec<u32> =
        (0..n as u32).filter(|&i| found.size[found.label[i as usize] as usize] >= COMPONENT_MIN).collect();
    if keep.is_empty() {
        return Err(AnalysisError::Cloud(format!(
            "no {COMPONENT_MIN} of the {n} points are connected: the cut-off radius is smaller than the spacing"
        )));
    }
    let mut place = vec![NO_PLACE; n];
    for (new, &old) in keep.iter().enumerate() {
        place[old as usize] = new as u32;
    }
    // the companion's walls may lead out of a kept component: such a row sums to more than zero, which leaves it
    // positive definite, and it only preconditions
    let narrow = narrow.map(|matrix| matrix.restricted_to(&keep));
    Ok((laplacian.restricted_to(&keep), narrow, place))
}

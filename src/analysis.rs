//! Cloud → operator → spectrum: all stages on one screen, [`analyze_by`].

mod admission;
mod assembly;
mod durations;
mod error;
mod expected;
mod fidelity;
mod laplacian;
mod measured;
mod memory;
mod neighborhoods;
mod parameters;
mod report;
mod resolution;
mod result;
mod unit;

pub use admission::{Examined, admit};
pub use durations::seconds_left;
pub use error::AnalysisError;
pub use fidelity::Fidelity;
pub use laplacian::Laplacian;
use memory::memory_beside_factor;
pub use memory::{memory_estimate, memory_within};
pub use parameters::{Additions, JobKind, Parameters, Task};
pub use report::Report;
pub use result::{Analysis, SparseMatrix};

use admission::{Bases, check_cells, triangles};
use assembly::{Assembled, Surface, assemble, narrow};
use expected::Doubts;
use measured::{Figures, Measured};
use resolution::Resolution;
use result::NO_PLACE;

use crate::cloud::PointCloud;
use crate::geometry::points::POINTS_MIN;
use crate::geometry::survey::Rules;
use crate::geometry::{Components, Points, components};
use crate::operator::bandwidth;
use crate::operator::{LaplaceBeltrami, OperatorKind, Sparse, Structure};
use crate::progress::{Phase, Progress};
use crate::spectrum::{Eigenbasis, Method, Problem, Request, Solution, Spectrum, Weyl, certificates, solve};

/// Components of fewer points carry no result.
const COMPONENT_MIN: usize = POINTS_MIN;

/// Largest residual, in the dual norm, of bases that come of a thinned sample: eigenvalues are at most about 5 % off.
const PROLONGED_MAX: f64 = 0.05;

/// Modes whose eigenvalues are nearer than so many tolerances may be mixtures of each other.
const MIXED: f64 = 10.0;

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
    analyze_by(Rules::default(), cloud, kind, parameters, progress)
}

/// The same, by some of the rules only: to measure what each is worth.
///
/// # Errors
/// [`AnalysisError`].
pub fn analyze_by(
    rules: Rules,
    cloud: &PointCloud,
    kind: JobKind,
    parameters: &Parameters,
    progress: &Progress,
) -> Result<Analysis, AnalysisError> {
    parameters.check()?;
    progress.enter(Phase::Preparation)?;
    let points = Points::prepare_by(cloud, parameters.dimension, progress)?;
    parameters.check_extent(points.extent())?;
    let points = points.normalized();
    let parameters = &parameters.in_units(points.unit());
    let triangles = triangles(cloud, &points, parameters)?;

    progress.expect(durations::expected(kind, parameters, points.len()));
    let Measured { points, tree, nearest, frames, stars, orientation, traits, cells, figures } =
        Measured::of(points, parameters, rules, progress)?;
    let Figures { mut lonely, dimension_estimate, mut sampling, fidelity, mut warnings } = figures;
    let stretch = traits.filter(|_| rules.resolve_stretch).map_or(1.0, |traits| traits.stretch);
    let parameters = &parameters.for_kind(kind, &sampling, points.len()).for_stretch(stretch);

    progress.enter(Phase::Assembly)?;
    warnings.splice(0..0, cloud.notes().iter().cloned());
    // bases of a thinned cloud are farther off than what so many points lose of them
    let is_corrected = rules.correct_resolution
        && kind == JobKind::Eigen
        && parameters.operator == OperatorKind::Voronoi
        && !parameters.is_thinned(points.len());
    let resolution = stars
        .as_ref()
        .filter(|_| is_corrected)
        .map(|stars| Resolution::of(&points, stars, progress))
        .transpose()?;
    let assembled = if parameters.operator.is_narrow() {
        // of large clouds there is no room for these beside the matrix, which needs none of them
        drop((tree, nearest, frames, stars, orientation));
        narrow(&points, &cells, &triangles, parameters.operator, progress)?
    } else {
        let surface = Surface {
            points: &points,
            tree: &tree,
            nearest: &nearest,
            cells: &cells,
            stars: stars.as_ref(),
            orientation: orientation.as_ref(),
            sampling: &sampling,
            triangles: &triangles,
            rules,
        };
        let assembled = assemble(&surface, frames, parameters, &mut warnings, progress)?;
        drop((tree, nearest, stars, orientation));
        assembled
    };
    drop(triangles);
    progress.checkpoint()?;
    let looks_thinner = dimension_estimate < parameters.dimension;
    let (operator, place) = without_small_components(assembled, looks_thinner, &warnings, progress)?;
    let known = |i: usize| Some(place[i]).filter(|&place| place != NO_PLACE);
    let doubts = match traits {
        Some(traits) if kind == JobKind::Eigen => {
            Doubts::of(traits, &cells, parameters.operator, known, progress)?
        }
        _ => None,
    };
    let resolution = resolution.map(|resolution| resolution.placed(known));
    sampling.keep(&cells, parameters.dimension, |i| place[i] != NO_PLACE);
    drop(cells);
    check_cells(parameters, &sampling, operator.laplacian.mass.len())?;
    lonely.extend((0..points.len()).filter(|&i| place[i] == NO_PLACE).map(|i| points.row(i)));
    let figures = Figures { lonely, dimension_estimate, sampling, fidelity, warnings };
    let components = operator.components.size.len();
    let mut report =
        Report::of(cloud, parameters, points.duplicates(), &operator.laplacian, components, figures);

    let mass = operator.laplacian.mass.clone();
    let (stiffness, eigenbasis) = match kind {
        JobKind::Operator => (Some(operator.laplacian.stiffness), None),
        JobKind::Eigen => {
            progress.checkpoint()?;
            let active: Vec<u32> =
                (0..points.len() as u32).filter(|&i| place[i as usize] != NO_PLACE).collect();
            let eigenbasis = eigenpairs(
                &points,
                &active,
                operator,
                (doubts, resolution),
                parameters,
                &mut report,
                progress,
            )?;
            (None, Some(eigenbasis))
        }
    };
    Ok(Analysis { report, points, place, mass, stiffness, eigenbasis }.in_unit_of_cloud())
}

/// Solves the eigenproblem and writes what was found into the report.
fn eigenpairs(
    points: &Points,
    active: &[u32],
    operator: Connected,
    (doubts, resolution): (Option<Doubts>, Option<Resolution>),
    parameters: &Parameters,
    report: &mut Report,
    progress: &Progress,
) -> Result<Eigenbasis, AnalysisError> {
    let count = Bases::of(parameters, report.points_used + report.isolated, active.len());
    report.warnings.extend(count.warning());
    let Connected { laplacian, narrow, components } = operator;
    let (heat_kernel, plateau, structure) = (laplacian.heat_kernel, laplacian.plateau, laplacian.structure);
    let times = laplacian.times.clone();
    let problem = Problem::with_components(laplacian, components, first_eigenvalue(report, plateau));
    let narrow = narrow.map(|mut matrix| {
        let inverse: Vec<f64> = problem.root_mass.iter().map(|m| 1.0 / m).collect();
        matrix.scale_both_sides(&inverse);
        matrix
    });
    let request = Request {
        count: count.computed,
        tolerance: parameters.tolerance,
        position: |i: u32| points.point(active[i as usize] as usize),
        narrow: narrow.as_ref(),
        weyl: (!report.operator.is_combinatorial()).then(|| Weyl {
            first: first_eigenvalue(report, plateau),
            dimension: report.dimension,
            t: heat_kernel.map(|kernel| kernel.t),
        }),
        plateau,
        solved_max: parameters.solved_points.unwrap_or(usize::MAX),
        saturates: heat_kernel.is_some(),
    };
    let stored = problem.matrix.nonzeros() + narrow.as_ref().map_or(0, Sparse::nonzeros);
    let (n, dimension) = (problem.size() as u64, points.dimension());
    progress.hold(memory_beside_factor(n, dimension, stored as u64, parameters));
    let solution = solve(&problem, &request, progress)?;
    progress.checkpoint()?;
    check_solution(&solution, request.solved_max, parameters.tolerance, report)?;
    let raw = solution.values;
    let mut imaginary = solution.imaginary.clone();
    imaginary.resize(raw.len(), 0.0);
    let corrected = heat_kernel.filter(|_| report.additions.heat_correction);
    let row = |i: usize, y: &mut [f64]| solution.vectors.write_row(i, problem.root_mass[i], y);
    let of_kernel = |(&mu, b): (&f64, &mut f64)| {
        let (lambda, part) = corrected.map_or((mu, *b), |kernel| kernel.corrected_complex(mu, *b));
        *b = part;
        lambda
    };
    let lambdas: Vec<f64> = match (resolution, times, corrected) {
        (Some(resolution), ..) => {
            let gap = MIXED * parameters.tolerance;
            let mixed = certificates::clusters_within(&raw, problem.shift, gap);
            resolution.corrected(&raw, &mixed, &problem.root_mass, row, progress)?
        }
        (None, Some(times), Some(_)) => {
            let mut lambdas = bandwidth::corrected(&times, &raw, row, progress)?;
            // where times differ the order of μ need not be that of λ
            lambdas.sort_unstable_by(f64::total_cmp);
            lambdas
        }
        _ => raw.iter().zip(&mut imaginary).map(of_kernel).collect(),
    };
    let expected = |doubts: Doubts| doubts.expected(&lambdas, &problem.root_mass, row, progress);
    let expected_errors = doubts.map(expected).transpose()?;
    if let (Some(fidelity), Some(errors)) = (&mut report.fidelity, &expected_errors) {
        fidelity.expect(errors);
    }
    let eigenvalues = lambdas.into_iter().map(|lambda| Some(lambda).filter(|x| x.is_finite())).collect();
    report.spectrum = Some(Spectrum {
        eigenvalues,
        clusters: certificates::clusters(&raw, problem.shift),
        expected_errors,
        raw_eigenvalues: raw,
        imaginary_parts: (structure == Structure::General).then_some(imaginary),
        residuals: solution.residuals,
        dual_residuals: solution.dual_residuals,
        solved_points: Some(solution.solved_points),
        components: problem.zero_modes(),
        certificates: solution.certificates,
        method: solution.method,
    });
    report.warn_of_spectrum();
    Ok(Eigenbasis::new(&problem, solution.vectors, &solution.imaginary, progress)?)
}

/// Warns of a cloud that could not be thinned, and refuses pairs that are not what was asked for.
fn check_solution(
    solution: &Solution,
    solved_max: usize,
    tolerance: f64,
    report: &mut Report,
) -> Result<(), AnalysisError> {
    if solution.solved_points > solved_max {
        report.warnings.push(format!(
            "the cloud could not be thinned out to {solved_max} points, and all of them were solved: it is not a surface in \
             space, is disconnected, or has too few points for this number of bases"
        ));
    }
    if solution.method == Method::Prolonged {
        check_prolonged(solution)?;
    } else if solution.certificates.residual > tolerance {
        return Err(AnalysisError::Cloud(format!(
            "the eigenpairs have residuals up to {:.1e}, above the tolerance {:.1e}: the operator's entries differ too much in \
             size for double precision; look for points that nearly coincide, or take a larger `tolerance`",
            solution.certificates.residual, tolerance
        )));
    }
    Ok(())
}

/// Refuses bases of a sample that is another surface than the points.
fn check_prolonged(solution: &Solution) -> Result<(), AnalysisError> {
    match solution.certificates.dual_residual {
        Some(dual) if dual <= PROLONGED_MAX => Ok(()),
        dual => Err(AnalysisError::Cloud(format!(
            "the surface is not preserved when thinned to {} points: the bases extended to all points leave residuals of \
             {:.1e} in the dual norm, more than {PROLONGED_MAX}; take a larger `solved_points`, fewer `bases`, or `exact`",
            solution.solved_points,
            dual.unwrap_or(f64::INFINITY)
        ))),
    }
}

/// The size of the first non-zero eigenvalues, by Weyl's law. A ball graph of n points with mean degree d, whose spectrum
/// ends at `1/plateau`, begins at about `d/n` of that.
fn first_eigenvalue(report: &Report, plateau: Option<f64>) -> f64 {
    if report.operator.is_combinatorial() {
        return report.neighbors / (plateau.unwrap_or(1.0) * report.points_used as f64);
    }
    Weyl::first_of(report.sampling.area, report.dimension)
}

/// An operator on the points that carry results.
struct Connected {
    laplacian: LaplaceBeltrami,
    narrow: Option<Sparse>,
    components: Components,
}

/// Leaves out components of fewer than [`COMPONENT_MIN`] points, in the operator and its narrow companion; also
/// returns every point's place. A refusal tells the warnings too, which no report will.
fn without_small_components(
    assembled: Assembled,
    looks_thinner: bool,
    warnings: &[String],
    progress: &Progress,
) -> Result<(Connected, Vec<u32>), AnalysisError> {
    let Assembled { laplacian, narrow } = assembled;
    let n = laplacian.mass.len();
    let found = components(n, |i| laplacian.stiffness.neighbors(i), progress)?;
    if found.size.iter().all(|&size| size >= COMPONENT_MIN) {
        return Ok((Connected { laplacian, narrow, components: found }, (0..n as u32).collect()));
    }
    let keep: Vec<u32> =
        (0..n as u32).filter(|&i| found.size[found.label[i as usize] as usize] >= COMPONENT_MIN).collect();
    // A curve that is taken for a surface falls apart, and what is left of it by chance is not a result.
    if keep.is_empty() || (looks_thinner && 2 * keep.len() < n) {
        let connected = if keep.is_empty() {
            format!("no {COMPONENT_MIN} of the {n} points are connected")
        } else {
            format!("only {} of the {n} points are connected to {COMPONENT_MIN} or more", keep.len())
        };
        let mut reasons = vec![format!("{connected}: the cut-off radius is smaller than the spacing")];
        reasons.extend_from_slice(warnings);
        return Err(AnalysisError::Cloud(reasons.join("; ")));
    }
    let mut place = vec![NO_PLACE; n];
    for (new, &old) in keep.iter().enumerate() {
        place[old as usize] = new as u32;
    }
    // the companion's walls may lead out of a kept component: such a row sums to more than zero, which leaves it
    // positive definite, and it only preconditions
    let narrow = narrow.map(|matrix| matrix.restricted_to(&keep));
    progress.checkpoint()?;
    let laplacian = laplacian.restricted_to(&keep);
    let components = components(keep.len(), |i| laplacian.stiffness.neighbors(i), progress)?;
    Ok((Connected { laplacian, narrow, components }, place))
}

//! Cloud → operator → spectrum: all stages on one screen.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use crate::cloud::PointCloud;
use crate::geometry::cells::CellOptions;
use crate::geometry::points::{GeometryError, POINTS_MIN};
use crate::geometry::{Cells, NearestNeighbors, Points, Sampling, SearchTree, cells, components, frames};
use crate::operator::sheets::Sheets;
use crate::operator::{HeatKernel, LaplaceBeltrami, OperatorKind, SymmetricSparse, pb_mhb, voronoi};
use crate::progress::{Canceled, Phase, Progress};
use crate::spectrum::solver::{DENSE_POINTS_MAX, Request};
use crate::spectrum::{Eigenbasis, Problem, Spectrum, SpectrumError, certificates, solve};

/// Whether only the operator is built, or its eigenpairs too.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "lowercase")]
pub enum JobKind {
    /// Builds and diagnoses the operator; its matrices Q and B can be fetched.
    Operator,
    /// Builds the operator, then computes bases and spectrum.
    #[default]
    Eigen,
}

/// What a caller may choose. Absent numbers are derived from the cloud; absent switches follow `paper`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(default, deny_unknown_fields)]
pub struct Parameters {
    /// The discrete Laplace–Beltrami operator.
    pub operator: OperatorKind,
    /// Number of eigenpairs, the zero modes included.
    pub bases: usize,
    /// Largest relative residual of an eigenpair.
    pub tolerance: f64,
    /// Time of the heat kernel, in squared units of the cloud.
    pub t: Option<f64>,
    /// The same as a multiple of ε².
    pub t_factor: Option<f64>,
    /// Cut-off radius of the heat kernel, in units of the cloud.
    pub delta: Option<f64>,
    /// The same as a multiple of √(2t).
    pub delta_factor: Option<f64>,
    /// Covering radius ε, in units of the cloud, instead of the estimate.
    pub epsilon: Option<f64>,
    /// Exactly the paper's operator: switches all additions off that are not set themselves.
    pub paper: bool,
    /// Scale projected neighbours back to their true distance before cells are clipped.
    pub isometric_cells: Option<bool>,
    /// Make up for the Gaussian's share beyond the cut-off.
    pub truncation_compensation: Option<bool>,
    /// Couple only neighbours on the same sheet of the surface.
    pub sheet_aware: Option<bool>,
    /// Report λ = −ln(1−tμ)/t beside the raw μ.
    pub heat_correction: Option<bool>,
}

impl Default for Parameters {
    fn default() -> Self {
        Self {
            operator: OperatorKind::default(),
            bases: 100,
            tolerance: 1e-4,
            t: None,
            t_factor: None,
            delta: None,
            delta_factor: None,
            epsilon: None,
            paper: false,
            isometric_cells: None,
            truncation_compensation: None,
            sheet_aware: None,
            heat_correction: None,
        }
    }
}

impl Parameters {
    /// Refuses what can be refused without a cloud: ranges, and pairs that exclude each other.
    ///
    /// # Errors
    /// [`AnalysisError::Parameter`] with the field's name.
    pub fn check(&self) -> Result<(), AnalysisError> {
        let refuse = |name, reason: &str| Err(AnalysisError::Parameter { name, reason: reason.into() });
        if self.bases == 0 {
            return refuse("bases", "must be at least 1");
        }
        if !(1e-12..=1e-1).contains(&self.tolerance) {
            return refuse("tolerance", "must lie between 1e-12 and 0.1");
        }
        let lengths = [
            ("t", self.t),
            ("t_factor", self.t_factor),
            ("delta", self.delta),
            ("delta_factor", self.delta_factor),
            ("epsilon", self.epsilon),
        ];
        for (name, value) in lengths {
            if value.is_some_and(|x| !(x > 0.0 && x.is_finite())) {
                return refuse(name, "must be a positive number");
            }
        }
        if self.t.is_some() && self.t_factor.is_some() {
            return refuse("t_factor", "cannot be combined with `t`");
        }
        if self.delta.is_some() && self.delta_factor.is_some() {
            return refuse("delta_factor", "cannot be combined with `delta`");
        }
        Ok(())
    }

    /// The switches as they are in force.
    #[must_use]
    pub fn additions(&self) -> Additions {
        let on = |switch: Option<bool>| switch.unwrap_or(!self.paper);
        Additions {
            isometric_cells: on(self.isometric_cells),
            truncation_compensation: on(self.truncation_compensation),
            sheet_aware: on(self.sheet_aware),
            heat_correction: on(self.heat_correction),
        }
    }

    /// t and δ for a cloud with covering radius `epsilon`: `t = c·ε²`, `δ = c'·√(2t)`.
    fn heat_kernel(&self, epsilon: f64) -> HeatKernel {
        let t = self.t.unwrap_or_else(|| self.t_factor.unwrap_or(pb_mhb::T_FACTOR) * epsilon * epsilon);
        let compensated = self.additions().truncation_compensation;
        let factor = if compensated { pb_mhb::DELTA_FACTOR } else { pb_mhb::DELTA_FACTOR_PAPER };
        let delta = self.delta.unwrap_or_else(|| self.delta_factor.unwrap_or(factor) * (2.0 * t).sqrt());
        HeatKernel { t, delta, truncation_compensation: compensated }
    }
}

/// What we add to the paper's operator, as in force.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct Additions {
    /// Scale projected neighbours back to their true distance before cells are clipped; measure rim cells.
    pub isometric_cells: bool,
    /// Make up for the Gaussian's share beyond the cut-off.
    pub truncation_compensation: bool,
    /// Couple only neighbours on the same sheet of the surface.
    pub sheet_aware: bool,
    /// Report λ = −ln(1−tμ)/t beside the raw μ.
    pub heat_correction: bool,
}

/// What an analysis found out, without its arrays. Serialised as it is shown.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Report {
    /// The operator.
    pub operator: OperatorKind,
    /// Rows of the upload.
    pub rows: usize,
    /// Ambient dimension d.
    pub dimension: usize,
    /// Points that the operator is built on.
    pub points_used: usize,
    /// Rows that repeat an earlier row's position.
    pub duplicates: usize,
    /// Rows with a non-finite coordinate.
    pub nonfinite: usize,
    /// Points in components too small to analyse; they carry no result.
    pub isolated: usize,
    /// Connected components of the operator's graph.
    pub components: usize,
    /// Density and evenness of the sampling.
    pub sampling: Sampling,
    /// t and δ; absent for operators without a heat kernel.
    pub heat_kernel: Option<HeatKernel>,
    /// Additions to the paper's operator, as in force.
    pub additions: Additions,
    /// Stored entries of the stiffness matrix.
    pub nonzeros: usize,
    /// Mean number of coupled neighbours per point.
    pub neighbors: f64,
    /// What the caller should know before trusting the result.
    pub warnings: Vec<String>,
    /// Present for eigen jobs.
    pub spectrum: Option<Spectrum>,
}

/// An operator and, for [`JobKind::Eigen`], its eigenbasis; arrays are handed out in rows of the upload.
#[derive(Debug)]
pub struct Analysis {
    /// Everything but the arrays.
    pub report: Report,
    points: Points,
    /// For every point its place among those analysed, or [`NO_PLACE`].
    place: Vec<u32>,
    mass: Vec<f64>,
    stiffness: Option<SymmetricSparse>,
    eigenbasis: Option<Eigenbasis>,
}

/// Marks a point in a component too small to analyse.
const NO_PLACE: u32 = u32::MAX;

/// A symmetric sparse matrix in rows of the upload, compressed by rows, columns ascending.
#[derive(Debug, Clone, PartialEq)]
pub struct SparseMatrix {
    /// n+1 offsets.
    pub offsets: Vec<u64>,
    /// Column of every entry.
    pub columns: Vec<u32>,
    /// Value of every entry.
    pub values: Vec<f64>,
}

impl Analysis {
    /// Place of a row's point among those analysed.
    fn place_of_row(&self, row: usize) -> Option<usize> {
        let place = self.place[self.points.of_row(row)?];
        (place != NO_PLACE).then_some(place as usize)
    }

    /// Mass B of every row, in `length^k`: 0 for a duplicate (its first occurrence carries the mass), NaN for a
    /// row without a result.
    #[must_use]
    pub fn mass(&self) -> Vec<f64> {
        (0..self.points.rows())
            .map(|row| match self.place_of_row(row) {
                None => f64::NAN,
                Some(_) if self.points.of_row(row).is_some_and(|point| self.points.row(point) != row) => 0.0,
                Some(place) => self.mass[place],
            })
            .collect()
    }

    /// Number of bases; 0 for operator jobs.
    #[must_use]
    pub fn bases(&self) -> usize {
        self.eigenbasis.as_ref().map_or(0, Eigenbasis::len)
    }

    /// Basis `j`, one value per row: duplicates repeat their first occurrence, NaN without a result.
    ///
    /// # Panics
    /// When `j` is not below [`Self::bases`].
    #[must_use]
    pub fn basis(&self, j: usize) -> Vec<f64> {
        assert!(j < self.bases(), "basis {j} of {}", self.bases());
        let value = |place| self.eigenbasis.as_ref().map_or(f64::NAN, |basis| basis.at(place, j));
        (0..self.points.rows()).map(|row| self.place_of_row(row).map_or(f64::NAN, value)).collect()
    }

    /// Q = −S: symmetric, zero row sums, negative semi-definite. Empty rows for duplicates and rows without a
    /// result. Present for [`JobKind::Operator`].
    #[must_use]
    pub fn operator_matrix(&self) -> Option<SparseMatrix> {
        let stiffness = self.stiffness.as_ref()?;
        let mut row_of_place = vec![0_u32; stiffness.rows()];
        for (point, &place) in self.place.iter().enumerate().filter(|(_, place)| **place != NO_PLACE) {
            row_of_place[place as usize] = self.points.row(point) as u32;
        }
        let mut matrix = SparseMatrix {
            offsets: vec![0],
            columns: Vec::with_capacity(stiffness.nonzeros()),
            values: Vec::with_capacity(stiffness.nonzeros()),
        };
        let mut entries: Vec<(u32, f64)> = Vec::new();
        for row in 0..self.points.rows() {
            let place = self.place_of_row(row).filter(|&place| row_of_place[place] as usize == row);
            if let Some(place) = place {
                let (columns, values) = stiffness.row(place);
                entries.clear();
                // 0 − x, because −x would give −0
                entries.extend(columns.iter().zip(values).map(|(&j, &s)| (row_of_place[j as usize], 0.0 - s)));
                entries.sort_unstable_by_key(|&(column, _)| column);
                matrix.columns.extend(entries.iter().map(|&(column, _)| column));
                matrix.values.extend(entries.iter().map(|&(_, value)| value));
            }
            matrix.offsets.push(matrix.columns.len() as u64);
        }
        Some(matrix)
    }
}

/// Why an analysis did not happen.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum AnalysisError {
    /// A parameter out of range.
    #[error("parameter `{name}`: {reason}")]
    Parameter {
        /// As in the interface.
        name: &'static str,
        /// What is wrong, and what would be accepted.
        reason: String,
    },
    /// The cloud cannot carry the analysis.
    #[error("{0}")]
    Cloud(String),
    /// The operator needs something that the cloud does not have.
    #[error("{0}")]
    Unsupported(String),
    /// A numerical failure: a bug, or a cloud beyond double precision.
    #[error("{0}")]
    Numerical(String),
    /// Canceled by the caller.
    #[error(transparent)]
    Canceled(#[from] Canceled),
}

impl From<GeometryError> for AnalysisError {
    fn from(error: GeometryError) -> Self {
        match error {
            GeometryError::Canceled(canceled) => Self::Canceled(canceled),
            other => Self::Cloud(other.to_string()),
        }
    }
}

impl From<SpectrumError> for AnalysisError {
    fn from(error: SpectrumError) -> Self {
        match error {
            SpectrumError::Canceled(canceled) => Self::Canceled(canceled),
            other => Self::Numerical(other.to_string()),
        }
    }
}

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
    warn_of_sampling(&mut report);
    drop(cells);

    let mass = laplacian.mass.clone();
    let (stiffness, eigenbasis) = match kind {
        JobKind::Operator => (Some(laplacian.stiffness), None),
        JobKind::Eigen => {
            let active: Vec<u32> = (0..points.len() as u32).filter(|&i| place[i as usize] != NO_PLACE).collect();
            let eigenbasis = eigenpairs(&points, &active, laplacian, narrow, parameters, &mut report, progress)?;
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
    let eigenvalues: Vec<Option<f64>> =
        raw.iter().map(|&mu| Some(corrected.map_or(mu, |kernel| kernel.corrected(mu))).filter(|x| x.is_finite())).collect();
    report.spectrum = Some(Spectrum {
        eigenvalues,
        clusters: certificates::clusters(&raw, problem.shift),
        raw_eigenvalues: raw,
        residuals: solution.residuals,
        components: problem.zero_modes(),
        certificates: solution.certificates,
        method: solution.method,
    });
    warn_of_spectrum(report, parameters);
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

/// Share of invalid cells, largest tμ, and ratio of densities from which on the caller is warned.
const INVALID_SHARE_WARNED: f64 = 0.05;
const SATURATION_WARNED: f64 = 0.5;
const DENSITY_RATIO_WARNED: f64 = 50.0;

fn warn_of_sampling(report: &mut Report) {
    let sampling = &report.sampling;
    if sampling.invalid_cells as f64 > INVALID_SHARE_WARNED * report.points_used as f64 {
        report.warnings.push(format!(
            "{} of {} Voronoi cells could not be measured and were given the mean area",
            sampling.invalid_cells, report.points_used
        ));
    }
    if sampling.density_ratio > DENSITY_RATIO_WARNED {
        report.warnings.push(format!(
            "the densest parts are {:.0} times as dense as the sparsest: one t for the whole cloud is a compromise",
            sampling.density_ratio
        ));
    }
    if report.isolated > 0 {
        report.warnings.push(format!(
            "{} points lie in components of fewer than {COMPONENT_MIN} points and carry no result",
            report.isolated
        ));
    }
}

fn warn_of_spectrum(report: &mut Report, parameters: &Parameters) {
    let Some(spectrum) = &report.spectrum else { return };
    let certificates = &spectrum.certificates;
    if let Some(saturation) = certificates.saturation.filter(|&s| s > SATURATION_WARNED) {
        report.warnings.push(format!(
            "t·μ reaches {saturation:.2}: the last eigenvalues are near the heat kernel's limit 1/t and carry little \
             information; ask for fewer bases or a smaller t"
        ));
    }
    if certificates.missed.is_some_and(|missed| missed > 0) {
        report.warnings.push("the check found eigenvalues below the last one that were not returned".into());
    }
    if certificates.missed.is_none() {
        report.warnings.push("whether an eigenvalue was missed could not be checked".into());
    }
    if certificates.residual > parameters.tolerance {
        report.warnings.push(format!(
            "the largest residual is {:.1e}, above the tolerance {:.1e}",
            certificates.residual, parameters.tolerance
        ));
    }
}

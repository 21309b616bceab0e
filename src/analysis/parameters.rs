//! What a caller may choose.

use serde::{Deserialize, Serialize};

use super::AnalysisError;
use crate::arguments::{Ranges, arguments, words};
use crate::geometry::Sampling;
use crate::geometry::frames::INTRINSIC_MAX;
use crate::operator::{Distance, HeatKernel, OperatorKind, Parameterization, graph, pb_mhb, pcd};

words! {
    /// Whether only the operator is built, or its eigenpairs too.
    #[derive(Default)]
    #[non_exhaustive]
    pub enum JobKind {
        /// Builds the operator, then computes bases and spectrum.
        #[default]
        Eigen,
        /// Builds and diagnoses the operator; its matrices Q and B can be fetched.
        Operator,
    }
}

/// Fewest points that a thinned sample may be asked to have.
pub(super) const SOLVED_LEAST: usize = 1_000;

/// Most bases that any configuration may allow.
const BASES_CEILING: usize = 10_000;

arguments! {
    /// What a job computes.
    #[derive(Debug, Clone, Copy, PartialEq, Eq)]
    pub struct Task {
        /// What the job computes: `eigen` builds the operator, then bases and spectrum; `operator` builds and describes
        /// the operator, whose matrices can then be fetched.
        kind: JobKind = word(JobKind), default JobKind::Eigen;
    }
}

/// Where a Gaussian is cut at the latest: `exp(−600)` is near the smallest number there is.
const EXPONENT_MAX: f64 = 600.0;

/// t over `ε^{4/3} area^{1/3}` of an operator that is applied: on random spheres 2ε² at 8,000 points.
const APPLIED_T: f64 = 0.15;

/// Its `δ/√(2t)`: its rows are long, and the compensation makes up for the cut.
const APPLIED_DELTA_FACTOR: f64 = 3.0;

/// Most neighbors of its rows, and most entries of its matrix.
const APPLIED_NEIGHBORS: f64 = 800.0;
const APPLIED_ENTRIES: f64 = 4e7;

/// Largest factor of a length: beyond it a kernel is flat over any cloud that can be analyzed.
const FACTOR_MAX: f64 = 1e6;

arguments! {
    /// What a caller may choose. Absent numbers are derived from the cloud; absent switches follow `paper`.
    #[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
    #[cfg_attr(feature = "server", derive(utoipa::ToSchema))]
    #[serde(default, deny_unknown_fields)]
    pub struct Parameters {
        /// The discrete Laplace–Beltrami operator. `mesh` and `cotangent` need a cloud with faces.
        operator: OperatorKind = word(OperatorKind), default OperatorKind::PbMhb;
        /// Intrinsic dimension k of what the points sample: 1 for curves, 2 for surfaces, 3 for volumes.
        dimension: usize = integer(1, INTRINSIC_MAX), default 2;
        /// Number of eigenpairs, the zero modes included. At most the number of points, and the service's own limit.
        #[short = 'k']
        bases: usize = integer(1, BASES_CEILING), default 100;
        /// Largest relative residual of an eigenpair.
        #[alias = "tol"]
        tolerance: f64 = range(1e-12, 1e-1), default 1e-4;
        /// Solve the eigenproblem on every point, whatever memory that takes; otherwise more points than the memory budget
        /// allows are thinned out, solved, and the bases brought back to all points.
        exact: bool = switch, default false;
        /// Most points that the eigenproblem is solved on: of a surface in space that has more, an evenly spread part is solved,
        /// and the bases are brought from there to all points.
        solved_points: Option<usize> = integer(SOLVED_LEAST, u32::MAX as usize), absent "as many as memory allows";
        /// Time of the heat kernel, in squared units of the cloud.
        t: Option<f64> = positive, absent "from t_factor";
        /// The same as a multiple of ε².
        t_factor: Option<f64> = positive, absent "by operator";
        /// Cut-off radius of the heat kernel, or length of a graph's edges, in units of the cloud.
        delta: Option<f64> = positive, absent "from delta_factor";
        /// The same as a multiple of √(2t); of ε for graph operators, which have no t.
        delta_factor: Option<f64> = positive, absent "by operator";
        /// Covering radius ε of the sampling, in units of the cloud, instead of the estimate.
        epsilon: Option<f64> = positive, absent "estimated";
        /// Distance in the Gaussian of `pcd`: in space, or in the tangent plane of the row's point.
        distance: Option<Distance> = word(Distance), absent "by parameterization";
        /// How `pcd` chooses t, δ and its simplices: from the covering radius as in the paper, or from the mean distance
        /// to the ten nearest as the authors' own program does.
        parameterization: Option<Parameterization> = word(Parameterization), absent "covering-radius";
        /// Exactly the operator of the PB-MHB paper: switches all additions off that are not set themselves.
        paper: bool = switch, default false;
        /// Measure cells by true distances; on surfaces in the triangles around every point, without gaps and holes.
        isometric_cells: Option<bool> = switch, absent "not paper";
        /// Make up for the Gaussian's share beyond the cut-off.
        truncation_compensation: Option<bool> = switch, absent "not paper";
        /// Couple only neighbors on the same sheet of the surface.
        sheet_aware: Option<bool> = switch, absent "not paper";
        /// Measure distances in the kernel of `pb-mhb` along the surface; needs `isometric_cells`.
        surface_distances: Option<bool> = switch, absent "not paper";
        /// Scale the kernel of `pb-mhb` so that its second moment is right around every point.
        moment_calibration: Option<bool> = switch, absent "not paper";
        /// Let t and δ of `pb-mhb` follow the local spacing, with t their mean; needs `moment_calibration`.
        local_bandwidth: Option<bool> = switch, absent "on surfaces where one t would couple each point with more than 300 others and is short enough for the bases";
        /// Report λ = −ln(1−tμ)/t as eigenvalues, beside the raw μ of the matrices.
        heat_correction: Option<bool> = switch, absent "not paper";
    }
}

impl Parameters {
    /// Refuses what can be refused without a cloud: ranges, and pairs that exclude each other.
    ///
    /// # Errors
    /// [`AnalysisError::Parameter`] with the field's name.
    pub fn check(&self) -> Result<(), AnalysisError> {
        let refuse = |name, reason: &str| Err(AnalysisError::Parameter { name, reason: reason.into() });
        self.check_ranges()?;
        if self.operator.needs_faces() && self.dimension != 2 {
            return refuse("dimension", "must be 2 for an operator on the triangles of a mesh");
        }
        self.check_pcd()?;
        if self.exact && self.solved_points.is_some() {
            return refuse("solved_points", "cannot be combined with `exact`");
        }
        for (name, value) in [("t_factor", self.t_factor), ("delta_factor", self.delta_factor)] {
            if value.is_some_and(|x| x > FACTOR_MAX) {
                return refuse(name, "must be at most 1,000,000");
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

    /// Refuses numbers that the declaration does not accept.
    fn check_ranges(&self) -> Result<(), AnalysisError> {
        let Some(argument) = self.out_of_range() else { return Ok(()) };
        let reason = format!("must be {}", argument.accepts.in_words());
        Err(AnalysisError::Parameter { name: argument.name, reason })
    }

    /// Refuses what only `pcd` can follow.
    fn check_pcd(&self) -> Result<(), AnalysisError> {
        let refuse = |name, reason: &str| Err(AnalysisError::Parameter { name, reason: reason.into() });
        let only = "applies to the operators `pcd` and `pcd-symmetrized` only";
        if self.distance.is_some() && !self.operator.is_pcd() {
            return refuse("distance", only);
        }
        if self.parameterization.is_some() && !self.operator.is_pcd() {
            return refuse("parameterization", only);
        }
        let given = self.t.or(self.t_factor).or(self.delta).or(self.delta_factor).is_some();
        if self.parameterization == Some(Parameterization::NearestTen) && given {
            return refuse("parameterization", "`nearest-ten` chooses t and delta by itself; leave them out");
        }
        Ok(())
    }

    /// The switches as they are in force; those that the operator has no use for are off.
    #[must_use]
    pub fn additions(&self) -> Additions {
        use OperatorKind::{Mesh, PbMhb};
        let on = |switch: Option<bool>, applies: bool| applies && switch.unwrap_or(!self.paper);
        let measures_cells = !self.operator.needs_faces();
        let isometric_cells = on(self.isometric_cells, measures_cells);
        let unfolds = isometric_cells && self.operator == PbMhb && self.dimension == 2;
        Additions {
            isometric_cells,
            truncation_compensation: on(self.truncation_compensation, matches!(self.operator, PbMhb | Mesh)),
            sheet_aware: on(self.sheet_aware, measures_cells),
            surface_distances: on(self.surface_distances, unfolds),
            moment_calibration: on(self.moment_calibration, self.operator == PbMhb),
            local_bandwidth: false,
            wide_kernels: false,
            heat_correction: on(self.heat_correction, self.operator.is_heat_kernel()),
        }
    }

    /// The parameters with the t by which an operator that is applied, not solved for, converges.
    ///
    /// With `t ~ ε²` the noise of the sampling stays as large as what Δ makes of a function, or grows; `t` must shrink more
    /// slowly. The bias is O(t), the noise of random samples O(√(h²/t)/t^½): `t ~ ε^{4/3}` lets both vanish (Singer
    /// 2006; [PCD] takes `ε^{1/(2+ξ)}`). Rows are kept to [`APPLIED_NEIGHBORS`].
    pub(super) fn for_kind(&self, kind: JobKind, sampling: &Sampling, points: usize) -> Self {
        let chosen = self.t.or(self.t_factor).or(self.epsilon).or(self.delta).is_some();
        if kind == JobKind::Eigen
            || self.operator != OperatorKind::PbMhb
            || self.dimension != 2
            || !self.additions().moment_calibration
            || chosen
        {
            return self.clone();
        }
        let factor = self.delta_factor.unwrap_or(APPLIED_DELTA_FACTOR);
        let neighbors = APPLIED_NEIGHBORS.min(APPLIED_ENTRIES / points as f64);
        // π δ²/h² neighbors with δ² = 2t·factor²
        let most = neighbors * sampling.spacing.powi(2) / (2.0 * std::f64::consts::PI * factor * factor);
        let smooth = APPLIED_T * sampling.epsilon.powf(4.0 / 3.0) * sampling.area.cbrt();
        let least = pb_mhb::t_factor(2, true) * sampling.epsilon.powi(2);
        Self { t: Some(smooth.min(most).max(least)), delta_factor: Some(factor), ..self.clone() }
    }

    /// The parameters with the t that resolves points which are `stretch` times as far apart in one direction as in the other.
    pub(super) fn for_stretch(self, stretch: f64) -> Self {
        if !self.resolves_stretch() {
            // a t that was chosen is that of all points
            return Self { local_bandwidth: self.local_bandwidth.or(Some(false)), ..self };
        }
        Self { t_factor: Some(pb_mhb::t_factor_of_stretched(stretch)), ..self }
    }

    /// Whether t is chosen by the stretch of the sampling.
    pub(super) fn resolves_stretch(&self) -> bool {
        let chosen = self.t.or(self.t_factor).or(self.epsilon).is_some();
        self.operator == OperatorKind::PbMhb
            && self.dimension == 2
            && self.additions().moment_calibration
            && !chosen
    }

    /// t and δ for a cloud with covering radius `epsilon`: `t = c·ε²`, `δ = c'·√(2t)`.
    pub(super) fn heat_kernel(&self, epsilon: f64) -> HeatKernel {
        let t = self.t.unwrap_or_else(|| {
            self.t_factor.unwrap_or(pb_mhb::t_factor(self.dimension, self.additions().moment_calibration))
                * epsilon
                * epsilon
        });
        let truncation_compensation = self.additions().truncation_compensation;
        let factor = match self.operator {
            kind if kind.is_pcd() => pcd::DELTA_FACTOR,
            _ if self.paper && !truncation_compensation => pb_mhb::DELTA_FACTOR_PAPER,
            _ => pb_mhb::DELTA_FACTOR,
        };
        let delta = self.delta.unwrap_or_else(|| self.delta_factor.unwrap_or(factor) * (2.0 * t).sqrt());
        let delta = delta.min((4.0 * EXPONENT_MAX * t).sqrt());
        HeatKernel { t, delta, truncation_compensation, dimension: self.dimension }
    }

    /// Length up to which a graph operator joins points.
    pub(super) fn edge_length(&self, epsilon: f64) -> f64 {
        self.delta.unwrap_or_else(|| self.delta_factor.unwrap_or(graph::DELTA_FACTOR) * epsilon)
    }

    /// The options of `pcd` around its kernel.
    pub(super) fn pcd_options(&self, kernel: HeatKernel) -> pcd::Options {
        let parameterization = self.parameterization.unwrap_or_default();
        let usual = match parameterization {
            Parameterization::CoveringRadius => Distance::Ambient,
            Parameterization::NearestTen => Distance::Projected,
        };
        pcd::Options { kernel, distance: self.distance.unwrap_or(usual), parameterization }
    }
}

/// What we add to the paper's operator, as in force.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "server", derive(utoipa::ToSchema))]
#[allow(clippy::struct_excessive_bools)] // independent switches
#[non_exhaustive]
pub struct Additions {
    /// Measure cells by true distances; on surfaces in the triangles around every point, without gaps and holes.
    pub isometric_cells: bool,
    /// Make up for the Gaussian's share beyond the cut-off.
    pub truncation_compensation: bool,
    /// Couple only neighbors on the same sheet of the surface.
    pub sheet_aware: bool,
    /// Measure distances in the kernel along the surface.
    #[serde(default)]
    pub surface_distances: bool,
    /// Scale the kernel so that its second moment is right around every point.
    #[serde(default)]
    pub moment_calibration: bool,
    /// t and δ follow the local spacing: known when the operator has been assembled.
    #[serde(default)]
    pub local_bandwidth: bool,
    /// t and δ are longer around cells that are larger than the covering radius: known then, too.
    #[serde(default)]
    pub wide_kernels: bool,
    /// Report λ = −ln(1−tμ)/t beside the raw μ.
    pub heat_correction: bool,
}

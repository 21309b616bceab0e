//! What an analysis says about itself.

use serde::{Deserialize, Serialize};

use super::measured::Figures;
use super::{Additions, COMPONENT_MIN, Fidelity, Parameters};
use crate::cloud::PointCloud;
use crate::geometry::Sampling;
use crate::operator::{HeatKernel, LaplaceBeltrami, OperatorKind};
use crate::spectrum::{Method, Spectrum};

/// What an analysis found out, without its arrays. Serialized as it is shown.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "server", derive(utoipa::ToSchema))]
#[non_exhaustive]
pub struct Report {
    /// The operator.
    pub operator: OperatorKind,
    /// Rows of the upload.
    pub rows: usize,
    /// Dimension d of the space that the points lie in; 0 in reports of versions that did not tell it.
    #[serde(default)]
    pub ambient_dimension: usize,
    /// Intrinsic dimension k that the operator was built for.
    pub dimension: usize,
    /// Intrinsic dimension that most neighborhoods look like: the number of principal variances before the first that
    /// is less than a fifth of the one before.
    #[serde(default)]
    pub dimension_estimate: usize,
    /// Points that the operator is built on.
    pub points_used: usize,
    /// Rows that repeat an earlier row's position.
    pub duplicates: usize,
    /// Rows with a non-finite coordinate.
    pub nonfinite: usize,
    /// Points off the surface or in components too small to analyze; they carry no result.
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
    /// Mean number of coupled neighbors per point.
    pub neighbors: f64,
    /// What the caller should know before trusting the result.
    pub warnings: Vec<String>,
    /// How far the numbers can be trusted, by what the surface looks like; absent for operators that triangulate none.
    #[serde(default)]
    pub fidelity: Option<Fidelity>,
    /// Present for eigen jobs.
    pub spectrum: Option<Spectrum>,
}

/// Share of invalid cells, largest tμ, and ratio of densities from which on the caller is warned.
const INVALID_SHARE_WARNED: f64 = 0.05;
const SATURATION_WARNED: f64 = 0.5;
const DENSITY_RATIO_WARNED: f64 = 50.0;

/// Residual of prolonged bases, in the dual norm, from which on the caller is warned.
const PROLONGED_WARNED: f64 = 0.01;

/// Rows that a warning names at most.
const ROWS_NAMED: usize = 10;

impl Report {
    /// All but the spectrum.
    pub(super) fn of(
        cloud: &PointCloud,
        parameters: &Parameters,
        duplicates: usize,
        laplacian: &LaplaceBeltrami,
        components: usize,
        figures: Figures,
    ) -> Self {
        let Figures { lonely, dimension_estimate, sampling, fidelity, warnings } = figures;
        let (used, nonzeros) = (laplacian.mass.len(), laplacian.stiffness.nonzeros());
        let mut report = Self {
            operator: parameters.operator,
            rows: cloud.len(),
            ambient_dimension: cloud.dimension(),
            dimension: parameters.dimension,
            dimension_estimate,
            points_used: used,
            duplicates,
            nonfinite: cloud.nonfinite(),
            isolated: lonely.len(),
            components,
            sampling,
            heat_kernel: laplacian.heat_kernel,
            additions: Additions { local_bandwidth: laplacian.follows_density, ..parameters.additions() },
            nonzeros,
            neighbors: nonzeros as f64 / used as f64 - 1.0,
            warnings,
            fidelity,
            spectrum: None,
        };
        report.warn_of_sampling(lonely);
        report
    }

    /// Whether its eigenvalues are those of a surface: not of a curve, a volume or a graph.
    #[must_use]
    pub fn is_of_surface(&self) -> bool {
        self.dimension == 2 && !self.operator.is_combinatorial()
    }

    /// Says what the sampling leaves doubtful; `lonely` are the rows of isolated points.
    pub(super) fn warn_of_sampling(&mut self, mut lonely: Vec<usize>) {
        let sampling = &self.sampling;
        if sampling.invalid_cells as f64 > INVALID_SHARE_WARNED * self.points_used as f64 {
            self.warnings.push(format!(
                "{} of {} Voronoi cells could not be measured and were given the mean volume",
                sampling.invalid_cells, self.points_used
            ));
        }
        if sampling.density_ratio > DENSITY_RATIO_WARNED {
            self.warnings.push(format!(
            "the densest parts are {:.0} times as dense as the sparsest: one t for the whole cloud is a compromise",
            sampling.density_ratio
        ));
        }
        if self.isolated > 0 {
            lonely.sort_unstable();
            let named: Vec<String> = lonely.iter().take(ROWS_NAMED).map(ToString::to_string).collect();
            let more = if lonely.len() > named.len() { " and others" } else { "" };
            self.warnings.push(format!(
                "{} points (rows {}{more}) lie off the surface or in components of fewer than {COMPONENT_MIN} points and \
                 carry no result",
                self.isolated,
                named.join(", ")
            ));
        }
    }

    /// Says what the certificates leave doubtful.
    pub(super) fn warn_of_spectrum(&mut self) {
        let Some(spectrum) = &self.spectrum else { return };
        let certificates = &spectrum.certificates;
        if let Some(saturation) = certificates.saturation.filter(|&s| s > SATURATION_WARNED) {
            self.warnings.push(format!(
            "t·μ reaches {saturation:.2}: the last eigenvalues are near the heat kernel's limit 1/t and carry little \
             information; ask for fewer bases or a smaller t"
        ));
        }
        if spectrum.imaginary_parts.is_some() {
            self.warnings.push(format!(
                "the operator is not symmetrizable: eigenvalues need not be real ({} of these are not) and bases are not \
                 orthogonal (defect {:.1e}), so that coefficients and filters do not invert exactly",
                spectrum.imaginary_parts.iter().flatten().filter(|b| **b != 0.0).count(),
                certificates.orthogonality
            ));
        }
        let prolonged = certificates.dual_residual.filter(|_| spectrum.method == Method::Prolonged);
        if let Some(dual) = prolonged.filter(|&dual| dual > PROLONGED_WARNED) {
            self.warnings.push(format!(
                "the bases of a sample of {} points leave residuals of {dual:.1e} in the dual norm on all points: \
                 eigenvalues may be that share off; a larger `solved_points`, or `exact`, makes them better",
                spectrum.solved_points.unwrap_or(0)
            ));
        }
        if certificates.missed.is_some_and(|missed| missed > 0) {
            self.warnings
                .push("the check found eigenvalues below the last one that were not returned".into());
        }
        if certificates.missed.is_none() {
            self.warnings.push("whether an eigenvalue was missed could not be checked".into());
        }
    }
}

impl Parameters {
    /// The parameters as used: these, and those that the analysis derived from the cloud.
    #[must_use]
    pub fn as_used(&self, report: &Report) -> Self {
        let (kernel, additions) = (report.heat_kernel, &report.additions);
        Self {
            epsilon: Some(report.sampling.epsilon),
            t: kernel.map(|kernel| kernel.t),
            delta: kernel.map(|kernel| kernel.delta).or(self.delta),
            isometric_cells: Some(additions.isometric_cells),
            truncation_compensation: Some(additions.truncation_compensation),
            sheet_aware: Some(additions.sheet_aware),
            surface_distances: Some(additions.surface_distances),
            moment_calibration: Some(additions.moment_calibration),
            local_bandwidth: Some(additions.local_bandwidth),
            heat_correction: Some(additions.heat_correction),
            ..self.clone()
        }
    }
}

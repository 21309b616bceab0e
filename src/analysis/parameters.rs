//! What a caller may choose.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::AnalysisError;
use crate::operator::{HeatKernel, OperatorKind, pb_mhb};

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
    pub(super) fn heat_kernel(&self, epsilon: f64) -> HeatKernel {
        let t = self.t.unwrap_or_else(|| self.t_factor.unwrap_or(pb_mhb::T_FACTOR) * epsilon * epsilon);
        let compensated = self.additions().truncation_compensation;
        let factor = if compensated { pb_mhb::DELTA_FACTOR } else { pb_mhb::DELTA_FACTOR_PAPER };
        let delta = self.delta.unwrap_or_else(|| self.delta_factor.unwrap_or(factor) * (2.0 * t).sqrt());
        HeatKernel { t, delta, truncation_compensation: compensated }
    }
}

/// What we add to the paper's operator, as in force.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[allow(clippy::struct_excessive_bools)] // four independent switches
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

//! Lengths between the upload's unit and that of the points, in which everything is computed.
//!
//! `Points::normalized` gives every cloud an extent between 1 and 2, so that no threshold and no solver sees the unit;
//! the unit is a power of two, so that the way there and back changes no digit.

use super::{Analysis, AnalysisError, Parameters};
use crate::operator::OperatorKind;

/// Largest lengths that mean something, in extents of the cloud: a Gaussian this wide is flat all over it.
const EPSILON_MAX: f64 = 100.0;
const DELTA_MAX: f64 = 1_000.0;
const T_MAX: f64 = 10_000.0;

/// Smallest t that means something, in squared extents: double precision tells no points that near from each other.
const T_MIN: f64 = 1e-30;

impl Parameters {
    /// The parameters with all lengths in `unit`s.
    pub(super) fn in_units(&self, unit: f64) -> Self {
        Self {
            t: self.t.map(|t| t / unit / unit),
            delta: self.delta.map(|delta| delta / unit),
            epsilon: self.epsilon.map(|epsilon| epsilon / unit),
            ..self.clone()
        }
    }

    /// Refuses lengths that no cloud of this `extent` has.
    pub(super) fn check_extent(&self, extent: f64) -> Result<(), AnalysisError> {
        let most = |name, value: Option<f64>, max: f64, limit: &str| match value {
            Some(value) if value > max => Err(AnalysisError::Parameter {
                name,
                reason: format!(
                    "{value:e} is more than {limit} of this cloud, whose extent is {extent:.4e}; choose a smaller \
                     `{name}`, or leave it out"
                ),
            }),
            _ => Ok(()),
        };
        most("t", self.t, T_MAX * extent * extent, "10,000 squared extents")?;
        most("delta", self.delta, DELTA_MAX * extent, "1,000 extents")?;
        most("epsilon", self.epsilon, EPSILON_MAX * extent, "100 extents")?;
        match self.t {
            Some(t) if t < T_MIN * extent * extent => Err(AnalysisError::Parameter {
                name: "t",
                reason: format!(
                    "{t:e} is less than 1e-30 squared extents of this cloud, whose extent is {extent:.4e}; choose a \
                     larger `t`, or leave it out"
                ),
            }),
            _ => Ok(()),
        }
    }
}

impl Analysis {
    /// The analysis with all numbers in the upload's unit, of which `unit` is that of the points.
    pub(super) fn in_unit_of_cloud(mut self) -> Self {
        let unit = self.points.unit();
        let volume = unit.powi(i32::try_from(self.report.dimension).unwrap_or(i32::MAX));
        let sampling = &mut self.report.sampling;
        sampling.epsilon *= unit;
        sampling.zeta *= unit;
        sampling.spacing *= unit;
        sampling.area *= volume;
        if let Some(kernel) = &mut self.report.heat_kernel {
            kernel.t *= unit * unit;
            kernel.delta *= unit;
        }
        let kind = self.report.operator;
        if kind.is_combinatorial() {
            return self;
        }
        let eigenvalue = 1.0 / (unit * unit);
        // these two have masses without a unit
        let has_unit = !matches!(kind, OperatorKind::PcdSymmetrized | OperatorKind::WeightedGraph);
        let mass = if has_unit { volume } else { 1.0 };
        self.mass.iter_mut().for_each(|b| *b *= mass);
        if let Some(stiffness) = &mut self.stiffness {
            stiffness.scale(mass * eigenvalue);
        }
        if let Some(eigenbasis) = &mut self.eigenbasis {
            eigenbasis.scale(1.0 / mass.sqrt());
        }
        if let Some(spectrum) = &mut self.report.spectrum {
            let imaginary = spectrum.imaginary_parts.iter_mut().flatten();
            let known = spectrum.eigenvalues.iter_mut().flatten();
            spectrum.raw_eigenvalues.iter_mut().chain(known).chain(imaginary).for_each(|x| *x *= eigenvalue);
        }
        self
    }
}

//! How far the numbers can be trusted, by what the surface looks like.

use serde::{Deserialize, Serialize};

use super::Parameters;
use crate::geometry::survey::Traits;
use crate::operator::OperatorKind;

/// What the triangulated surface says of itself. Absent for operators that triangulate none.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "server", derive(utoipa::ToSchema))]
#[non_exhaustive]
pub struct Fidelity {
    /// 1 where none of the figures below speaks against the numbers, towards 0 where they do; no bound on the error. From 0.9
    /// on nearly all results that were compared with a truth are within 2 %.
    pub trust: f64,
    /// Largest relative error to expect among the eigenvalues; absent while there are none.
    #[serde(default)]
    pub expected_error: Option<f64>,
    /// Share of the walls between cells that their two sides see differently: sheets that touch, edges sharper than the
    /// sampling.
    pub disputed: f64,
    /// Share of the triangles' area that was taken out as holes.
    pub opened: f64,
    /// Standard deviation of the points along the normals over their spacing.
    pub noise: f64,
    /// Median ratio of the distances between points along and across: 1 for even sampling, 2 for scan lines twice as far
    /// apart as the points on them.
    pub stretch: f64,
    /// Rows that repeat others but for rounding or jitter; they share the result of those.
    pub merged: usize,
}

/// Shares and ratios at which trust is halved. Of the scans of `docs/accuracy.md` those within 2 % dispute less than 0.8 % of
/// their walls, most of those beyond 5 % more than 1.4 %.
const DISPUTED_HALF: f64 = 0.02;
const OPENED_HALF: f64 = 0.02;
const NOISE_HALF: f64 = 0.4;
const STRETCH_HALF: f64 = 1.5;
/// Expected error at which trust is halved; at 0.9 it is 0.39 of that. Of 148 clouds of 25 scans (their points, halves of them,
/// random and even samples of their meshes) and of spheres, cylinders and planes, 27 have a trust of 0.9 or more with `voronoi`,
/// and all of these are within 2 %. Chosen without one scan and tried on its clouds, scan by scan: 29 of 30.
const EXPECTED_HALF: f64 = 0.035;

/// Values from which on the caller is warned.
const DISPUTED_WARNED: f64 = 0.02;
const OPENED_WARNED: f64 = 0.02;
const NOISE_WARNED: f64 = 0.15;
const STRETCH_WARNED: f64 = 2.2;
/// The same where t is chosen by the stretch: scan lines 10 : 1 cost 2.9 %.
const RESOLVED_STRETCH_WARNED: f64 = 6.0;

impl Fidelity {
    pub(super) fn of(
        Traits { opened, stretch }: Traits,
        disputed: f64,
        noise: f64,
        merged: usize,
        parameters: &Parameters,
    ) -> Self {
        // only a kernel that is alike in all directions minds
        let stretched = if parameters.operator == OperatorKind::Voronoi { 1.0 } else { stretch };
        let trust = halved(disputed, DISPUTED_HALF)
            * halved(opened, OPENED_HALF)
            * halved(noise, NOISE_HALF)
            * halved((stretched - stretch_warned(parameters)).max(0.0), STRETCH_HALF);
        Self { trust, expected_error: None, disputed, opened, noise, stretch, merged }
    }

    /// Takes the errors to expect of the eigenvalues into account.
    pub(super) fn expect(&mut self, errors: &[f64]) {
        let worst = errors.iter().copied().fold(0.0, f64::max);
        self.expected_error = Some(worst);
        self.trust *= halved(worst, EXPECTED_HALF);
    }

    /// What a caller should know, and can do.
    pub(super) fn warnings(&self, parameters: &Parameters) -> Vec<String> {
        let mut warnings = Vec::new();
        if self.merged > 0 {
            warnings.push(format!(
                "{} rows repeat others up to rounding or a small jitter; each group is computed as one point, and its \
                 rows share the result",
                self.merged
            ));
        }
        if self.noise > NOISE_WARNED {
            warnings.push(format!(
                "the points scatter by {:.2} of their spacing about a smooth surface; lengths are measured on the \
                 smoothed surface, and details of a few spacings are lost",
                self.noise
            ));
        }
        if self.disputed > DISPUTED_WARNED {
            warnings.push(format!(
                "{:.1} % of the surface is seen differently from neighboring points: sheets touch or are as thin as the \
                 spacing, or edges are sharper than the sampling; sample these parts more densely",
                100.0 * self.disputed
            ));
        }
        if self.opened > OPENED_WARNED {
            warnings.push(format!(
                "{:.1} % of the surface was left open as holes wider than the spacing around them; scan them, or check \
                 that they are holes",
                100.0 * self.opened
            ));
        }
        if self.stretch > stretch_warned(parameters) && parameters.operator != OperatorKind::Voronoi {
            warnings.push(format!(
                "the points are {:.1} times as far apart in one direction as in the other: choose operator `voronoi`, whose \
                 eigenvalues do not depend on that, or thin the cloud to even distances",
                self.stretch
            ));
        }
        warnings
    }
}

/// Trust that is left at this value, of which `half` halves it.
fn halved(value: f64, half: f64) -> f64 {
    (-(value / half).powi(2) * std::f64::consts::LN_2).exp()
}

/// Stretch from which on a kernel is too narrow for the points' lattice.
fn stretch_warned(parameters: &Parameters) -> f64 {
    if parameters.resolves_stretch() { RESOLVED_STRETCH_WARNED } else { STRETCH_WARNED }
}

//! k = 1: the stretch of a curve that is nearest to a point.

use super::{BOX, Corner, Polytope, Site};

/// The nearest neighbor on either side.
#[derive(Debug, Clone)]
pub struct Interval {
    below: Site<1>,
    above: Site<1>,
}

impl Default for Interval {
    fn default() -> Self {
        let side = |at| Site { at: [at], neighbor: BOX };
        Self { below: side(f64::NEG_INFINITY), above: side(f64::INFINITY) }
    }
}

impl Polytope<1> for Interval {
    fn reset(&mut self, half: f64) {
        self.below = Site { at: [-2.0 * half], neighbor: BOX };
        self.above = Site { at: [2.0 * half], neighbor: BOX };
    }

    fn clip(&mut self, site: Site<1>) {
        let x = site.at[0];
        if x > 0.0 && x < self.above.at[0] {
            self.above = site;
        } else if x < 0.0 && x > self.below.at[0] {
            self.below = site;
        }
    }

    fn squared_radius(&self) -> f64 {
        self.corners().map(|corner| corner.at[0] * corner.at[0]).fold(0.0, f64::max)
    }

    fn corners(&self) -> impl Iterator<Item = Corner<1>> {
        [self.below, self.above].into_iter().map(|site| Corner { at: [0.5 * site.at[0]], sites: [site] })
    }
}

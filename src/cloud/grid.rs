//! Coordinates of scans are whole steps on a grid: kept, so that they can be written as the very same steps.

use super::ScalarType;

/// The grid of an axis: a coordinate is a whole number of 32 bits times `scale`, plus `offset`, each rounded to a double
/// as LAS wants it. Both are in the units of the upload.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Grid {
    /// Length of a step, not 0; the sign is the file's.
    pub scale: f64,
    /// Coordinate of step 0.
    pub offset: f64,
}

impl Grid {
    /// The coordinate of a step.
    #[must_use]
    pub fn coordinate(self, step: f64) -> f64 {
        step * self.scale + self.offset
    }

    /// The step nearest to a coordinate, within 32 bits or not.
    #[must_use]
    pub fn nearest(self, coordinate: f64) -> f64 {
        ((coordinate - self.offset) / self.scale).round()
    }

    /// Whether the nearest step is this very coordinate, to the last bit.
    #[must_use]
    pub fn holds(self, coordinate: f64) -> bool {
        let step = self.nearest(coordinate);
        ScalarType::Int32.holds(step) && self.coordinate(step).to_bits() == coordinate.to_bits()
    }
}

#[cfg(test)]
#[allow(clippy::float_cmp)] // steps are whole
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn every_step_of_a_scan_is_held(
            step: i32,
            digits in 2..6_i32,
            thousands in -9_000_000..9_000_000_i32,
        ) {
            let grid = Grid { scale: 10_f64.powi(-digits), offset: f64::from(thousands) + 0.25 };
            let coordinate = grid.coordinate(step.into());
            prop_assert_eq!(grid.nearest(coordinate), f64::from(step));
            prop_assert!(grid.holds(coordinate));
        }
    }

    #[test]
    fn what_lies_between_steps_or_beyond_them_is_not_held() {
        let grid = Grid { scale: 0.001, offset: 1e6 };
        assert!(grid.holds(1e6) && grid.holds(grid.coordinate(-2_147_483_648.0)));
        assert!(!grid.holds(1e6 + 0.0005) && !grid.holds(1e6 + 3e6) && !grid.holds(f64::NAN));
    }
}

//! The grids on which coordinates are written.

use crate::cloud::{Grid, PointCloud};

/// Rounding errors that a coordinate on a grid may have gathered, in units of its last place.
const GRID_ROUNDING: f64 = 4.0;

/// The grid on which an axis' coordinates are written.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Axis {
    index: usize,
    pub(super) grid: Grid,
}

impl Axis {
    pub(super) fn of(cloud: &PointCloud, axis: usize) -> Self {
        if axis >= cloud.dimension() {
            return Self { index: axis, grid: Grid { scale: 1.0, offset: 0.0 } };
        }
        let values = || cloud.coordinates().iter().skip(axis).step_by(cloud.dimension()).copied();
        let kept = cloud.grids().map(|grids| grids[axis]).filter(|grid| values().all(|x| grid.holds(x)));
        Self { index: axis, grid: kept.unwrap_or_else(|| fitted(values)) }
    }

    /// The step of a row's coordinate.
    pub(super) fn encode(self, cloud: &PointCloud, row: usize) -> f64 {
        cloud.point(row).get(self.index).map_or(0.0, |&x| self.grid.nearest(x))
    }
}

/// A grid for coordinates of which nothing is known.
fn fitted<Values: Iterator<Item = f64>>(values: impl Fn() -> Values) -> Grid {
    let (low, high) = values().fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), x| (a.min(x), b.max(x)));
    if low >= high {
        // All at one place: the offset is that place.
        return Grid { scale: 0.001, offset: low };
    }
    let half = 0.5 * (high - low);
    let middle = low + half;
    // All coordinates lie within 1.5 of this power of ten around a multiple of it, hence on 3·10⁹ < 2³² steps.
    let exponent = half.log10().ceil().clamp(-280.0, 290.0) as i32;
    let unit = power_of_ten(exponent);
    let offset = (middle / unit).round() * unit;
    let tolerance = GRID_ROUNDING * f64::EPSILON * low.abs().max(high.abs());
    let grid = |exponent| Grid { scale: power_of_ten(exponent), offset };
    let is_near = |grid: Grid| values().all(|x| (grid.coordinate(grid.nearest(x)) - x).abs() <= tolerance);
    let scales = (exponent - 9..=exponent).rev().map(grid);
    scales.into_iter().find(|&grid| is_near(grid)).unwrap_or_else(|| grid(exponent - 9))
}

/// `10^exponent`, correctly rounded, as a product of tens is not.
fn power_of_ten(exponent: i32) -> f64 {
    format!("1e{exponent}").parse().unwrap_or(1.0)
}

#[cfg(test)]
#[allow(clippy::float_cmp)] // grids are exact
mod tests {
    use super::*;
    use crate::cloud::{NonFinite, ScalarType};

    fn axis(values: &[f64]) -> Grid {
        Axis::of(&PointCloud::new(1, values.to_vec(), NonFinite::Reject).unwrap(), 0).grid
    }

    #[test]
    fn coordinates_on_a_grid_of_millimeters_are_written_on_it() {
        let axis = axis(&[500_000.123, 500_017.5, 500_100.001]);
        assert_eq!(axis.scale.to_bits(), 0.001_f64.to_bits());
        assert_eq!(axis.offset, 500_100.0);
    }

    #[test]
    fn the_grid_that_a_cloud_came_on_is_kept_while_all_its_coordinates_lie_on_it() {
        let grid = Grid { scale: 0.000_25, offset: 1_000_000.125 };
        let on = [-7.0, 0.0, 1_999_999_999.0].map(|step| grid.coordinate(step));
        let written = |values: &[f64]| {
            let cloud = PointCloud::new(1, values.to_vec(), NonFinite::Reject).unwrap();
            Axis::of(&cloud.with_grids(Some([grid; 3])), 0).grid
        };
        assert_eq!(written(&on), grid);
        assert_ne!(written(&[on[0], on[1], on[2] + 0.0001]), grid);
    }

    #[test]
    fn other_coordinates_are_written_as_finely_as_their_extent_allows() {
        let axis = axis(&[0.0, std::f64::consts::PI, 90.0]);
        assert_eq!((axis.scale, axis.offset), (1e-7, 0.0));
    }

    #[test]
    fn one_place_and_extremes_have_a_grid_too() {
        for constant in [0.0, 7.25, 411.123_456_789_012_3, 1e300] {
            assert!(axis(&[constant, constant]).holds(constant), "{constant}");
        }
        for values in [[1e-200, 3e-200], [-1e200, 1e200], [0.3, 0.3 + 1e-9]] {
            let axis = axis(&values);
            let steps = values.map(|x| ((x - axis.offset) / axis.scale).round());
            assert!(steps.iter().all(|&step| ScalarType::Int32.holds(step)), "{axis:?} {steps:?}");
            assert!(steps[0] != steps[1]);
        }
    }
}

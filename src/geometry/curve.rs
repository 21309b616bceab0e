//! The rows of a cloud in the order of a space-filling curve: rows that follow each other are near each other, and rows at one
//! position follow each other.

use std::cmp::Ordering;
use std::ops::RangeInclusive;

use rayon::prelude::*;

use super::morton;
use crate::cloud::{DIMENSION_MAX, PointCloud};
use crate::progress::{Canceled, Progress};

/// Marks a row of the upload that carries no result; there are fewer rows.
pub(super) const NO_POINT: u32 = u32::MAX;

/// Extents whose squares double precision holds with room to spare.
pub(super) const EXTENTS: RangeInclusive<f64> = 1e-100..=1e100;

/// Least distance from a flat, squared and over that of the points from each other, that rounding does not explain:
/// single-precision files carry relative coordinate errors of 6e-8.
const FLAT: f64 = 1e-12;

/// A place in space, of which the leading numbers count; the others are 0.
type Place = [f64; DIMENSION_MAX];

/// The rows of a cloud that have a position, in their order along the curve.
pub struct Curve<'a> {
    pub(super) cloud: &'a PointCloud,
    /// Rows of the cloud; none where these are more than have numbers.
    pub(super) rows: usize,
    /// Longest side of the bounding box.
    pub(super) extent: f64,
    /// Middle of the bounding box.
    center: Place,
    /// Places on the curve, and rows.
    order: Vec<(u64, u32)>,
}

impl<'a> Curve<'a> {
    /// Orders the rows of a cloud.
    #[must_use]
    pub fn of(cloud: &'a PointCloud) -> Self {
        #[allow(clippy::expect_used)]
        Self::by(cloud, &Progress::new()).expect("nobody cancels")
    }

    /// The same, as long as nobody cancels it.
    pub(super) fn by(cloud: &'a PointCloud, progress: &Progress) -> Result<Self, Canceled> {
        let d = cloud.dimension();
        let (low, high) = cloud.bounding_box().unwrap_or_else(|| (vec![0.0; d], vec![0.0; d]));
        let extent = low.iter().zip(&high).map(|(l, h)| h - l).fold(0.0, f64::max);
        // where the middle overflows, the places themselves tell rows apart
        let is_sound = EXTENTS.contains(&extent);
        let middle = |axis: usize| if is_sound { low[axis] + 0.5 * (high[axis] - low[axis]) } else { 0.0 };
        let center = std::array::from_fn(|axis| if axis < d { middle(axis) } else { 0.0 });
        let rows = if cloud.len() < NO_POINT as usize { cloud.len() } else { 0 };
        let mut curve = Self { cloud, rows, extent, center, order: Vec::new() };
        progress.checkpoint()?;
        // as many as there are rows, so that they are gathered in place
        let mut order: Vec<(u64, u32)> =
            (0..rows as u32).into_par_iter().map(|row| (curve.key(row), row)).collect();
        progress.checkpoint()?;
        order.retain(|&(_, row)| curve.has_position(row));
        progress.leaving(|leave| {
            order.par_sort_unstable_by(|&a, &b| {
                leave.if_canceled();
                curve.compared(a, b)
            });
        })?;
        curve.order = order;
        Ok(curve)
    }

    /// Where a row is, recentered.
    pub(super) fn position(&self, row: u32) -> Place {
        let mut place = [0.0; DIMENSION_MAX];
        for ((place, x), center) in place.iter_mut().zip(self.cloud.point(row as usize)).zip(self.center) {
            // + 0.0 turns -0 into 0, so that equal positions are equal in the total order too
            *place = x - center + 0.0;
        }
        place
    }

    fn has_position(&self, row: u32) -> bool {
        self.cloud.nonfinite() == 0 || self.cloud.point(row as usize).iter().all(|x| x.is_finite())
    }

    /// The place of a row on the curve.
    fn key(&self, row: u32) -> u64 {
        let scale = if EXTENTS.contains(&self.extent) { self.extent } else { 0.0 };
        let d = self.cloud.dimension();
        morton::key(self.position(row).into_iter().take(d), scale, d)
    }

    /// Which of two rows, with their places on the curve, comes first.
    fn compared(&self, (key_a, a): (u64, u32), (key_b, b): (u64, u32)) -> Ordering {
        let axes = || self.position(a).into_iter().zip(self.position(b));
        let by_axes = || axes().fold(Ordering::Equal, |order, (x, y)| order.then(x.total_cmp(&y)));
        key_a.cmp(&key_b).then_with(by_axes).then(a.cmp(&b))
    }

    /// The rows that have a position, and whether each is the first there.
    pub(super) fn order(&self) -> impl Iterator<Item = (u32, bool)> {
        // most rows differ in their places on the curve already, and where they are need not be looked up
        let repeats = |a: (u64, u32), b: (u64, u32)| {
            a.0 == b.0 && self.position(a.1).into_iter().eq(self.position(b.1))
        };
        let is_first = move |k: usize| k == 0 || !repeats(self.order[k - 1], self.order[k]);
        (0..self.order.len()).map(move |k| (self.order[k].1, is_first(k)))
    }

    /// Number of rows that have a position.
    #[must_use]
    #[allow(clippy::len_without_is_empty)] // a cloud has rows
    pub fn len(&self) -> usize {
        self.order.len()
    }

    /// Number of dimensions, at most `enough`, that the rows span: farthest ones first, until none is farther from the flat
    /// through them than rounding explains.
    pub(super) fn dimensions_spanned(&self, enough: usize, progress: &Progress) -> Result<usize, Canceled> {
        let Some(&(_, first)) = self.order.first() else { return Ok(0) };
        let (origin, d) = (self.position(first), self.cloud.dimension());
        let mut axes: Vec<Place> = Vec::new();
        let mut size = 0.0;
        while axes.len() < enough {
            let dot = |a: &Place, b: &Place| a[..d].iter().zip(b).map(|(x, y)| x * y).sum::<f64>();
            let residual = |row: u32| {
                let mut offset = self.position(row);
                offset.iter_mut().zip(&origin).for_each(|(x, o)| *x -= o);
                for axis in &axes {
                    let along = dot(&offset, axis);
                    offset.iter_mut().zip(axis).for_each(|(x, a)| *x -= along * a);
                }
                offset
            };
            // row by row as they lie in memory, and of rows as far the last along the curve, whatever the threads
            let key = |row: u32| (self.key(row), row);
            let later = |a: (f64, u32), b: (f64, u32)| {
                let order = a.0.total_cmp(&b.0).then_with(|| self.compared(key(a.1), key(b.1)));
                if order.is_lt() { b } else { a }
            };
            let farther = |row: u32| {
                if progress.is_canceled() || !self.has_position(row) {
                    return (0.0, first);
                }
                let offset = residual(row);
                (dot(&offset, &offset), row)
            };
            let (far, row) =
                (0..self.rows as u32).into_par_iter().map(farther).reduce(|| (0.0, first), later);
            progress.checkpoint()?;
            if axes.is_empty() {
                size = far;
            }
            if far <= FLAT * size {
                break;
            }
            axes.push(residual(row).map(|x| x / far.sqrt()));
        }
        Ok(axes.len())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cloud::NonFinite;
    use crate::geometry::stars::tests::jitter;

    fn cloud(rows: u64) -> PointCloud {
        PointCloud::new(3, (0..3 * rows).map(jitter).collect(), NonFinite::Drop).unwrap()
    }

    #[test]
    fn rows_are_ordered_until_it_is_canceled() {
        let cloud = cloud(5_000);
        assert_eq!(Curve::by(&cloud, &Progress::canceled_after(1_000)).err(), Some(Canceled));
        let curve = Curve::by(&cloud, &Progress::new()).unwrap();
        assert_eq!(curve.dimensions_spanned(3, &Progress::canceled_after(2)), Err(Canceled));
        assert_eq!(curve.dimensions_spanned(3, &Progress::new()), Ok(3));
    }

    #[test]
    fn rows_at_one_place_follow_each_other_and_those_without_a_place_are_left_out() {
        let mut coordinates: Vec<f64> = (0..300).map(jitter).collect();
        coordinates.extend_from_within(..30);
        coordinates[150] = f64::NAN;
        let cloud = PointCloud::new(3, coordinates, NonFinite::Drop).unwrap();
        let curve = Curve::of(&cloud);
        assert_eq!(curve.len(), 109);
        let repeated: Vec<u32> =
            curve.order().filter(|(_, is_first)| !is_first).map(|(row, _)| row).collect();
        assert_eq!(repeated.len(), 10);
        assert!(repeated.iter().all(|row| (100..110).contains(row)), "the first of them is the first row");
    }
}

//! The points that an analysis computes on, and their way back to the rows of the upload.

use super::curve::{Curve, NO_POINT};
use crate::cloud::PointCloud;
use crate::progress::{Canceled, Progress};

/// Why points cannot carry a surface operator.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum GeometryError {
    /// Fewer distinct finite points than any operator needs.
    #[error("{distinct} distinct finite points among {rows} rows; an analysis needs at least {needed}")]
    TooFewPoints {
        /// Distinct finite points.
        distinct: usize,
        /// Rows of the upload.
        rows: usize,
        /// The least number.
        needed: usize,
    },
    /// The points span less than the manifold they are said to sample.
    #[error(
        "all points lie on {} (to within rounding): an operator of intrinsic dimension {needed} needs points that span \
         at least {needed} dimensions", flat(*.spanned)
    )]
    Flat {
        /// Dimensions spanned.
        spanned: usize,
        /// Intrinsic dimension k.
        needed: usize,
    },
    /// A manifold cannot have more dimensions than the space that it lies in.
    #[error(
        "requested intrinsic dimension {intrinsic} of points in {ambient} dimensions, which allow at most {ambient}"
    )]
    Intrinsic {
        /// Intrinsic dimension k.
        intrinsic: usize,
        /// Ambient dimension d.
        ambient: usize,
    },
    /// More points than indices.
    #[error("{rows} rows; at most {limit} are supported")]
    TooManyPoints {
        /// Rows of the upload.
        rows: usize,
        /// The limit.
        limit: usize,
    },
    /// The coordinates' extent overflows or underflows double precision when squared.
    #[error("the cloud's extent is {extent:e}; extents from 1e-100 to 1e100 are supported")]
    Extent {
        /// Longest side of the bounding box.
        extent: f64,
    },
    /// Canceled by the caller.
    #[error(transparent)]
    Canceled(#[from] Canceled),
}

fn flat(spanned: usize) -> &'static str {
    match spanned {
        1 => "a line",
        2 => "a plane",
        _ => "a flat of fewer dimensions",
    }
}

/// Least number of distinct points: a tangent plane and one more.
pub const POINTS_MIN: usize = 5;

/// Rows handled between two looks at whether to go on.
const BATCH: usize = 1 << 18;

/// Finite, distinct points of `R^d`, recentered to the middle of their bounding box, in Morton order, so that
/// neighbors in space are neighbors in memory.
#[derive(Debug, Clone)]
pub struct Points {
    dimension: usize,
    /// Row-major, `len × dimension`, in `unit`s of the upload's unit of length.
    coordinates: Vec<f64>,
    unit: f64,
    /// For every row of the upload the point that stands for it, or [`NO_POINT`].
    point_of_row: Vec<u32>,
    /// The row that is a point's first occurrence.
    row_of_point: Vec<u32>,
    duplicates: usize,
}

impl Points {
    /// Selects, merges, recenters and orders the rows of a cloud, whether an analysis can begin with them or not. Exact
    /// repetitions of a position are merged.
    #[must_use]
    pub fn distinct(cloud: &PointCloud) -> Self {
        Self::along(&Curve::of(cloud))
    }

    /// The same of rows that are ordered already.
    #[must_use]
    pub fn along(curve: &Curve<'_>) -> Self {
        #[allow(clippy::expect_used)]
        Self::along_by(curve, &Progress::new()).expect("nobody cancels")
    }

    /// The same, as long as nobody cancels it.
    pub(super) fn along_by(curve: &Curve<'_>, progress: &Progress) -> Result<Self, Canceled> {
        let d = curve.cloud.dimension();
        let mut coordinates = Vec::with_capacity(curve.len() * d);
        let mut point_of_row = vec![NO_POINT; curve.rows];
        let mut row_of_point: Vec<u32> = Vec::with_capacity(curve.len());
        for (k, (row, is_first)) in curve.order().enumerate() {
            if k.is_multiple_of(BATCH) {
                progress.checkpoint()?;
            }
            if is_first {
                row_of_point.push(row);
                coordinates.extend_from_slice(&curve.position(row)[..d]);
            }
            point_of_row[row as usize] = row_of_point.len() as u32 - 1;
        }
        let duplicates = curve.len() - row_of_point.len();
        Ok(Self { dimension: d, coordinates, unit: 1.0, point_of_row, row_of_point, duplicates })
    }

    /// For every row of a cloud the first row at its position: those that [`Self::distinct`] merges are one position, and no
    /// others. A row that is not finite stands for itself.
    #[must_use]
    pub fn first_rows(cloud: &PointCloud) -> Vec<u32> {
        let points = Self::distinct(cloud);
        (0..cloud.len()).map(|row| points.of_row(row).map_or(row, |point| points.row(point)) as u32).collect()
    }

    /// The same points in another unit of length, the power of two for which their extent is at least 1 and less than 2:
    /// thresholds and dense eigensolvers then see the same numbers whatever the cloud's unit is.
    #[must_use]
    pub fn normalized(mut self) -> Self {
        let extent = self.extent();
        if extent > 0.0 {
            let unit = 2.0_f64.powi(extent.log2().floor() as i32);
            self.coordinates.iter_mut().for_each(|x| *x /= unit);
            self.unit *= unit;
        }
        self
    }

    /// One point in the place of every group of points, at their mean; rows follow. Groups are numbered by their first
    /// points, `sizes` their points.
    #[must_use]
    pub fn merged(&self, group: &[u32], sizes: &[usize]) -> Self {
        let d = self.dimension;
        let mut coordinates = vec![0.0; sizes.len() * d];
        let mut row_of_point = vec![NO_POINT; sizes.len()];
        for (i, &group) in group.iter().enumerate() {
            let group = group as usize;
            for (sum, x) in coordinates[group * d..(group + 1) * d].iter_mut().zip(self.point(i)) {
                *sum += x / sizes[group] as f64;
            }
            row_of_point[group] = row_of_point[group].min(self.row_of_point[i]);
        }
        let of_row = |&point: &u32| if point == NO_POINT { NO_POINT } else { group[point as usize] };
        Self {
            coordinates,
            point_of_row: self.point_of_row.iter().map(of_row).collect(),
            row_of_point,
            ..*self
        }
    }

    /// The points without those `left_out`, which must ascend; their rows have no point any more.
    #[must_use]
    pub fn without(&self, left_out: &[u32]) -> Self {
        let mut place = vec![NO_POINT; self.len()];
        let (mut coordinates, mut row_of_point) = (Vec::new(), Vec::new());
        for i in (0..self.len()).filter(|&i| left_out.binary_search(&(i as u32)).is_err()) {
            place[i] = row_of_point.len() as u32;
            row_of_point.push(self.row_of_point[i]);
            coordinates.extend_from_slice(self.point(i));
        }
        let of_row = |&point: &u32| if point == NO_POINT { NO_POINT } else { place[point as usize] };
        let point_of_row = self.point_of_row.iter().map(of_row).collect();
        Self { coordinates, point_of_row, row_of_point, ..*self }
    }

    /// The same points at other places.
    ///
    /// # Panics
    /// Unless there are as many coordinates as before.
    #[must_use]
    pub fn moved(&self, coordinates: Vec<f64>) -> Self {
        assert_eq!(coordinates.len(), self.coordinates.len());
        Self { coordinates, ..self.clone() }
    }

    /// What a length of 1 between these points is in the upload's unit of length.
    #[must_use]
    pub fn unit(&self) -> f64 {
        self.unit
    }

    /// Longest side of the bounding box.
    #[must_use]
    pub fn extent(&self) -> f64 {
        (0..self.dimension)
            .map(|axis| {
                let along = (0..self.len()).map(|i| self.point(i)[axis]);
                let (low, high) = along
                    .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), x| (low.min(x), high.max(x)));
                high - low
            })
            .fold(0.0, f64::max)
    }

    /// Number of points n.
    #[must_use]
    #[allow(clippy::len_without_is_empty)] // never empty once prepared
    pub fn len(&self) -> usize {
        self.row_of_point.len()
    }

    /// Ambient dimension d.
    #[must_use]
    pub fn dimension(&self) -> usize {
        self.dimension
    }

    /// Coordinates of point `i`, recentered.
    #[must_use]
    pub fn point(&self, i: usize) -> &[f64] {
        &self.coordinates[i * self.dimension..(i + 1) * self.dimension]
    }

    /// Row-major coordinates, `n × d`.
    #[must_use]
    pub fn coordinates(&self) -> &[f64] {
        &self.coordinates
    }

    /// Squared Euclidean distance; the same bits for `(i, j)` and `(j, i)`.
    #[must_use]
    pub fn squared_distance(&self, i: usize, j: usize) -> f64 {
        squared_distance(self.point(i), self.point(j))
    }

    /// Rows of the upload that repeat an earlier position.
    #[must_use]
    pub fn duplicates(&self) -> usize {
        self.duplicates
    }

    /// The point that stands for a row, if it has one.
    #[must_use]
    pub fn of_row(&self, row: usize) -> Option<usize> {
        let point = self.point_of_row[row];
        (point != NO_POINT).then_some(point as usize)
    }

    /// The row of the upload where point `i` occurs first.
    #[must_use]
    pub fn row(&self, i: usize) -> usize {
        self.row_of_point[i] as usize
    }

    /// Number of rows of the upload.
    #[must_use]
    pub fn rows(&self) -> usize {
        self.point_of_row.len()
    }
}

/// Squared Euclidean distance.
fn squared_distance(p: &[f64], q: &[f64]) -> f64 {
    difference(p, q).map(|x| x * x).sum()
}

fn difference<'a>(p: &'a [f64], q: &'a [f64]) -> impl Iterator<Item = f64> + 'a {
    p.iter().zip(q).map(|(a, b)| a - b)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cloud::NonFinite;

    fn cloud(coordinates: Vec<f64>) -> PointCloud {
        PointCloud::new(3, coordinates, NonFinite::Drop).unwrap()
    }

    #[test]
    fn duplicates_share_the_first_occurrence_and_nonfinite_rows_have_no_point() {
        let points = Points::prepare(
            &cloud(vec![
                0.0,
                0.0,
                0.0,
                1.0,
                0.0,
                0.0,
                0.0,
                1.0,
                0.0,
                -0.0,
                0.0,
                0.0,
                f64::NAN,
                0.0,
                0.0,
                0.0,
                0.0,
                1.0,
                1.0,
                1.0,
                0.0,
            ]),
            2,
        )
        .unwrap();
        assert_eq!(points.len(), 5);
        assert_eq!(points.duplicates(), 1);
        assert_eq!(points.of_row(3), points.of_row(0));
        assert_eq!(points.row(points.of_row(3).unwrap()), 0);
        assert_eq!(points.of_row(4), None);
    }

    #[test]
    fn positions_that_the_recentered_cloud_cannot_tell_apart_are_one() {
        // 1e-20 − 1 and 0 − 1 are the same double.
        let rows = PointCloud::new(1, vec![0.0, 2.0, 1e-20, f64::NAN, 2.0], NonFinite::Drop).unwrap();
        assert_eq!(Points::distinct(&rows).duplicates(), 2);
        assert_eq!(Points::first_rows(&rows), [0, 1, 0, 3, 1]);
    }

    #[test]
    fn points_on_a_line_are_refused_and_a_slightly_bent_line_is_not() {
        let line: Vec<f64> = (0..20).flat_map(|i| [f64::from(i), 2.0 * f64::from(i), 1e6]).collect();
        let error = Points::prepare(&cloud(line.clone()), 2).unwrap_err();
        assert_eq!(error, GeometryError::Flat { spanned: 1, needed: 2 });
        assert!(Points::prepare(&cloud(line), 1).is_ok());
        let bent: Vec<f64> = (0..20).flat_map(|i| [f64::from(i), 1e-3 * f64::from(i * i), 1e6]).collect();
        assert!(Points::prepare(&cloud(bent.clone()), 2).is_ok());
        let error = Points::prepare(&cloud(bent), 3).unwrap_err();
        assert!(error.to_string().starts_with("all points lie on a plane"), "{error}");
    }

    #[test]
    fn normalized_points_are_the_same_in_every_unit() {
        let rows: Vec<f64> = (0..60).map(|i| f64::from(i * i % 17) + 0.1 * f64::from(i)).collect();
        let one = Points::prepare(&cloud(rows.clone()), 2).unwrap().normalized();
        assert!((1.0..2.0).contains(&one.extent()));
        for exponent in [-200, -3, 90] {
            let scale = 2.0_f64.powi(exponent);
            let scaled = cloud(rows.iter().map(|x| scale * x).collect());
            let other = Points::prepare(&scaled, 2).unwrap().normalized();
            assert_eq!(other.coordinates(), one.coordinates());
            assert!((other.unit() / one.unit()).to_bits() == scale.to_bits());
        }
    }

    #[test]
    fn too_few_distinct_points_are_refused_with_their_number() {
        let error = Points::prepare(&cloud([1.0, 2.0, 3.0].repeat(100)), 2).unwrap_err();
        assert_eq!(error, GeometryError::TooFewPoints { distinct: 1, rows: 100, needed: POINTS_MIN });
    }
}

//! What decides whether an analysis can begin with a cloud's points.

use super::curve::{Curve, EXTENTS, NO_POINT};
use super::points::{GeometryError, POINTS_MIN, Points};
use crate::cloud::PointCloud;
use crate::progress::{Canceled, Progress};

/// What decides whether an analysis can begin with a cloud's points.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Span {
    /// Rows of the upload.
    pub rows: usize,
    /// Ambient dimension d.
    pub ambient: usize,
    /// Distinct finite points.
    pub distinct: usize,
    /// Longest side of the bounding box; the largest number where that overflows.
    pub extent: f64,
    /// Dimensions that the points span, counted up to the intrinsic dimension that was looked for.
    pub dimensions: usize,
}

impl Span {
    /// That of the rows of a cloud, where `enough` dimensions are as good as more.
    #[must_use]
    pub fn of(curve: &Curve<'_>, enough: usize) -> Self {
        #[allow(clippy::expect_used)]
        Self::by(curve, curve.order().filter(|&(_, is_first)| is_first).count(), enough, &Progress::new())
            .expect("nobody cancels")
    }

    /// The same where the number of `distinct` positions is known, as long as nobody cancels it.
    fn by(curve: &Curve<'_>, distinct: usize, enough: usize, progress: &Progress) -> Result<Self, Canceled> {
        let extent = curve.extent;
        let dimensions =
            if EXTENTS.contains(&extent) { curve.dimensions_spanned(enough, progress)? } else { 0 };
        progress.checkpoint()?;
        let (rows, ambient) = (curve.cloud.len(), curve.cloud.dimension());
        Ok(Self { rows, ambient, distinct, extent: extent.min(f64::MAX), dimensions })
    }

    /// Checks that the points can sample a manifold.
    ///
    /// # Errors
    /// [`GeometryError`] when there are fewer than [`POINTS_MIN`] or more than 32 bits number, when they span fewer than
    /// `intrinsic` dimensions, or when their extent cannot be squared.
    pub fn check(&self, intrinsic: usize) -> Result<(), GeometryError> {
        let &Self { rows, ambient, distinct, extent, dimensions } = self;
        if intrinsic > ambient {
            return Err(GeometryError::Intrinsic { intrinsic, ambient });
        }
        if rows >= NO_POINT as usize {
            return Err(GeometryError::TooManyPoints { rows, limit: NO_POINT as usize - 1 });
        }
        if distinct > 0 && extent != 0.0 && !EXTENTS.contains(&extent) {
            return Err(GeometryError::Extent { extent });
        }
        if distinct < POINTS_MIN {
            return Err(GeometryError::TooFewPoints { distinct, rows, needed: POINTS_MIN });
        }
        if dimensions < intrinsic {
            return Err(GeometryError::Flat { spanned: dimensions, needed: intrinsic });
        }
        Ok(())
    }
}

impl Points {
    /// [`Self::distinct`] points that an analysis can begin with.
    ///
    /// # Errors
    /// As [`Span::check`].
    pub fn prepare(cloud: &PointCloud, intrinsic: usize) -> Result<Self, GeometryError> {
        Self::prepare_by(cloud, intrinsic, &Progress::new())
    }

    /// The same, as long as nobody cancels it.
    ///
    /// # Errors
    /// As [`Span::check`], and [`GeometryError::Canceled`].
    pub fn prepare_by(
        cloud: &PointCloud,
        intrinsic: usize,
        progress: &Progress,
    ) -> Result<Self, GeometryError> {
        let curve = Curve::by(cloud, progress)?;
        let points = Self::along_by(&curve, progress)?;
        Span::by(&curve, points.len(), intrinsic, progress)?.check(intrinsic)?;
        progress.checkpoint()?;
        Ok(points)
    }
}

//! Why a cloud was refused.

/// What makes numbers unfit to be a [`super::PointCloud`]. Rows and indices count from 0.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum CloudError {
    /// No point at all.
    #[error("the cloud has no points")]
    Empty,
    /// Ambient dimension out of range.
    #[error("points have {dimension} coordinates; 1 to 8 are supported")]
    Dimension {
        /// Coordinates per point.
        dimension: usize,
    },
    /// The number of values is not a multiple of the dimension.
    #[error("{values} values do not divide into points of {dimension} coordinates")]
    Ragged {
        /// Number of values.
        values: usize,
        /// Coordinates per point.
        dimension: usize,
    },
    /// A coordinate is NaN or infinite.
    #[error(
        "point {row} (counting from 0) has a non-finite coordinate; send nonfinite=drop to keep such rows without a result"
    )]
    NonFinite {
        /// The first such row.
        row: usize,
    },
    /// A field has the wrong number of values.
    #[error("field `{name}` has {values} values for {points} points")]
    FieldLength {
        /// Name of the field.
        name: String,
        /// Its number of values.
        values: usize,
        /// Number of points.
        points: usize,
    },
    /// A face names a point that does not exist.
    #[error("face {face} names point {index}, but there are only {points} points (indices count from 0)")]
    FaceIndex {
        /// The face.
        face: usize,
        /// The index it names.
        index: u32,
        /// Number of points.
        points: usize,
    },
    /// A triangle continues a polygon that it does not share a side from the first corner with.
    #[error("triangle {triangle} does not continue the polygon of the triangle before it")]
    Polygon {
        /// The triangle.
        triangle: usize,
    },
}

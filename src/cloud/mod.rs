//! Point clouds as they were uploaded: parsed, bounded, row for row.

mod error;
mod grid;
mod las;
mod numbers;
mod origin;
pub mod reader;
mod scalar;
pub mod shapes;
mod survey;
pub mod writer;

use rayon::prelude::*;

pub use error::CloudError;
pub use grid::Grid;
pub use numbers::{Numbers, take_most_mapped};
pub use origin::Origin;
pub use survey::{Bytes, Survey};

use crate::arguments::words;

/// Largest ambient dimension d of a cloud.
pub const DIMENSION_MAX: usize = 8;

words! {
    /// The scalar types of PLY, in the order of Turk's specification; remembered so that a field leaves as it came.
    pub enum ScalarType {
        /// Signed 8-bit integer.
        Int8,
        /// Unsigned 8-bit integer.
        Uint8,
        /// Signed 16-bit integer.
        Int16,
        /// Unsigned 16-bit integer.
        Uint16,
        /// Signed 32-bit integer.
        Int32,
        /// Unsigned 32-bit integer.
        Uint32,
        /// IEEE 754 single precision.
        Float32,
        /// IEEE 754 double precision.
        Float64,
    }
}

/// A named per-point scalar of the upload, for example `intensity`, `red` or `nx`.
///
/// Values are kept as `f64`, in which every [`ScalarType`] is exact.
#[derive(Debug, Clone, PartialEq)]
pub struct ScalarField {
    /// Name as in the file.
    pub name: String,
    /// Type as in the file.
    pub kind: ScalarType,
    /// One value per point.
    pub values: Numbers,
}

words! {
    /// What to do with a point that has a non-finite coordinate.
    #[derive(Default)]
    pub enum NonFinite {
        /// Refuse the cloud and name the first such row.
        #[default]
        Reject,
        /// Keep the row, without a result.
        Drop,
    }
}

/// A cloud of n points in `R^d`, row for row as uploaded.
///
/// Invariants: `1 ≤ d ≤ 8`, n ≥ 1, every field has n values, every face index is below n, a polygon is a fan of
/// consecutive triangles around its first corner.
/// Rows with a non-finite coordinate exist only when the caller chose [`NonFinite::Drop`].
#[derive(Debug, Clone, PartialEq)]
pub struct PointCloud {
    dimension: usize,
    coordinates: Numbers,
    coordinate_type: ScalarType,
    grids: Option<[Grid; 3]>,
    origin: Origin,
    fields: Vec<ScalarField>,
    faces: Vec<[u32; 3]>,
    /// Triangles that continue the polygon of the one before, ascending.
    continued: Vec<u32>,
    nonfinite: usize,
}

/// Bytes of memory that a cloud of so many points with so many numbers each, and so many triangles, takes.
#[must_use]
pub fn bytes_in_memory(points: u64, numbers: usize, triangles: u64) -> u64 {
    // a triangle, and its place in a polygon
    points.saturating_mul(8 * numbers as u64).saturating_add(triangles.saturating_mul(12 + 4))
}

/// Whether all numbers are finite; without a branch per number, so that the compiler looks at several at once.
fn all_finite(block: &[f64]) -> bool {
    block.iter().fold(true, |all, x| all & x.is_finite())
}

impl PointCloud {
    /// A cloud from row-major coordinates, `n × dimension`, in the units of the upload.
    ///
    /// # Errors
    /// [`CloudError`] when there is no point, the dimension is out of range, or a coordinate is not finite
    /// and `policy` is [`NonFinite::Reject`].
    pub fn new(dimension: usize, coordinates: Vec<f64>, policy: NonFinite) -> Result<Self, CloudError> {
        Self::looked_through(dimension, coordinates.into(), policy, false)
    }

    /// [`Self::new`] for coordinates that may be known to be finite: readers look at them while they are in the cache.
    fn looked_through(
        dimension: usize,
        coordinates: Numbers,
        policy: NonFinite,
        are_finite: bool,
    ) -> Result<Self, CloudError> {
        if !(1..=DIMENSION_MAX).contains(&dimension) {
            return Err(CloudError::Dimension { dimension });
        }
        if coordinates.is_empty() {
            return Err(CloudError::Empty);
        }
        if !coordinates.len().is_multiple_of(dimension) {
            return Err(CloudError::Ragged { values: coordinates.len(), dimension });
        }
        let mut nonfinite = 0;
        if !are_finite && !coordinates.par_chunks(1 << 16).all(|part| part.chunks(1024).all(all_finite)) {
            for (row, point) in coordinates.chunks_exact(dimension).enumerate() {
                if !all_finite(point) {
                    if policy == NonFinite::Reject {
                        return Err(CloudError::NonFinite { row });
                    }
                    nonfinite += 1;
                }
            }
        }
        Ok(Self {
            dimension,
            coordinates,
            coordinate_type: ScalarType::Float64,
            grids: None,
            origin: Origin::default(),
            fields: Vec::new(),
            faces: Vec::new(),
            continued: Vec::new(),
            nonfinite,
        })
    }

    /// A cloud of points in space.
    ///
    /// # Errors
    /// [`CloudError`] when there is no point, or a coordinate is not finite.
    pub fn from_points(points: &[[f64; 3]]) -> Result<Self, CloudError> {
        Self::new(3, points.as_flattened().to_vec(), NonFinite::Reject)
    }

    /// Remembers the type that the coordinates had in the file.
    #[must_use]
    pub fn with_coordinate_type(mut self, kind: ScalarType) -> Self {
        self.coordinate_type = kind;
        self
    }

    /// Remembers the grids of x, y and z that the file had its coordinates on.
    #[must_use]
    pub fn with_grids(mut self, grids: Option<[Grid; 3]>) -> Self {
        self.grids = grids;
        self
    }

    /// Remembers what the file said beside its points.
    #[must_use]
    pub fn with_origin(mut self, origin: Origin) -> Self {
        self.origin = origin;
        self
    }

    /// Adds notes about the file.
    #[must_use]
    pub fn with_notes(mut self, notes: impl IntoIterator<Item = String>) -> Self {
        self.origin.notes.extend(notes);
        self
    }

    /// Adds per-point scalars.
    ///
    /// # Errors
    /// [`CloudError::FieldLength`] unless every field has one value per point.
    pub fn with_fields(mut self, fields: Vec<ScalarField>) -> Result<Self, CloudError> {
        for field in &fields {
            if field.values.len() != self.len() {
                return Err(CloudError::FieldLength {
                    name: field.name.clone(),
                    values: field.values.len(),
                    points: self.len(),
                });
            }
        }
        self.fields = fields;
        Ok(self)
    }

    /// Adds triangles, as point indices from 0.
    ///
    /// # Errors
    /// [`CloudError::FaceIndex`] when an index is not below the number of points.
    pub fn with_faces(mut self, faces: Vec<[u32; 3]>) -> Result<Self, CloudError> {
        for (face, corners) in faces.iter().enumerate() {
            if let Some(&index) = corners.iter().find(|&&i| i as usize >= self.len()) {
                return Err(CloudError::FaceIndex { face, index, points: self.len() });
            }
        }
        self.faces = faces;
        self.continued = Vec::new();
        Ok(self)
    }

    /// Says which triangles are parts of polygons: those at `continued`, ascending, belong to the polygon of the
    /// triangle before, whose first and last corner they go on from.
    ///
    /// # Errors
    /// [`CloudError::Polygon`] for a triangle that does not go on from the one before.
    pub fn with_polygons(mut self, continued: Vec<u32>) -> Result<Self, CloudError> {
        let mut last = 0;
        for &triangle in &continued {
            let place = triangle as usize;
            let goes_on = triangle > last
                && self.faces.get(place).is_some_and(|corners| {
                    let before = self.faces[place - 1];
                    corners[..2] == [before[0], before[2]]
                });
            if !goes_on {
                return Err(CloudError::Polygon { triangle: place });
            }
            last = triangle;
        }
        self.continued = continued;
        Ok(self)
    }

    /// Number of rows n.
    #[must_use]
    #[allow(clippy::len_without_is_empty)] // a cloud is never empty
    pub fn len(&self) -> usize {
        self.coordinates.len() / self.dimension
    }

    /// Bytes of memory that it takes.
    #[must_use]
    pub fn bytes(&self) -> u64 {
        bytes_in_memory(self.len() as u64, self.dimension + self.fields.len(), self.faces.len() as u64)
    }

    /// Ambient dimension d.
    #[must_use]
    pub fn dimension(&self) -> usize {
        self.dimension
    }

    /// Row-major coordinates, `n × d`.
    #[must_use]
    pub fn coordinates(&self) -> &[f64] {
        &self.coordinates
    }

    /// The d coordinates of row `i`.
    #[must_use]
    pub fn point(&self, i: usize) -> &[f64] {
        &self.coordinates[i * self.dimension..(i + 1) * self.dimension]
    }

    /// Type of the coordinates in the file.
    #[must_use]
    pub fn coordinate_type(&self) -> ScalarType {
        self.coordinate_type
    }

    /// The grids of x, y and z that the file had its coordinates on, if it was one of scaled integers.
    #[must_use]
    pub fn grids(&self) -> Option<[Grid; 3]> {
        self.grids
    }

    /// What the file said beside its points.
    #[must_use]
    pub fn origin(&self) -> &Origin {
        &self.origin
    }

    /// What was left out of the file, and what was not taken word for word; a sentence each.
    #[must_use]
    pub fn notes(&self) -> &[String] {
        &self.origin.notes
    }

    /// The per-point scalars, in file order.
    #[must_use]
    pub fn fields(&self) -> &[ScalarField] {
        &self.fields
    }

    /// Triangles as point indices from 0; empty when the upload had none.
    #[must_use]
    pub fn faces(&self) -> &[[u32; 3]] {
        &self.faces
    }

    /// Triangles, by their index, that continue the polygon of the one before; empty for a mesh of triangles.
    #[must_use]
    pub fn continued(&self) -> &[u32] {
        &self.continued
    }

    /// The faces as the upload had them: a triangle, or the fan of triangles that a polygon became.
    pub fn polygons(&self) -> impl Iterator<Item = &[[u32; 3]]> {
        let mut continued = self.continued.iter().peekable();
        let mut start = 0;
        std::iter::from_fn(move || {
            let mut end = start + 1;
            while continued.next_if(|&&triangle| triangle as usize == end).is_some() {
                end += 1;
            }
            let fan = self.faces.get(start..end)?;
            start = end;
            Some(fan)
        })
    }

    /// Number of rows with a non-finite coordinate.
    #[must_use]
    pub fn nonfinite(&self) -> usize {
        self.nonfinite
    }

    /// The rows that have a position, with the faces between them.
    ///
    /// # Errors
    /// [`CloudError::Empty`] when no row has one.
    pub fn without_nonfinite(&self) -> Result<Self, CloudError> {
        let is_finite = |row: &usize| self.point(*row).iter().all(|x| x.is_finite());
        let rows: Vec<usize> = (0..self.len()).filter(is_finite).collect();
        let mut place = vec![u32::MAX; self.len()];
        rows.iter().enumerate().for_each(|(new, &old)| place[old] = new as u32);
        let coordinates = rows.iter().flat_map(|&row| self.point(row).iter().copied()).collect();
        let fields = self.fields.iter().map(|field| ScalarField {
            name: field.name.clone(),
            kind: field.kind,
            values: rows.iter().map(|&row| field.values[row]).collect(),
        });
        // A polygon that loses a corner is left out whole.
        let (mut faces, mut continued) = (Vec::new(), Vec::new());
        for fan in self.polygons() {
            let moved: Vec<[u32; 3]> = fan.iter().map(|t| t.map(|corner| place[corner as usize])).collect();
            if !moved.as_flattened().contains(&u32::MAX) {
                continued.extend((1..moved.len()).map(|i| (faces.len() + i) as u32));
                faces.extend(moved);
            }
        }
        Self::new(self.dimension, coordinates, NonFinite::Reject)?
            .with_coordinate_type(self.coordinate_type)
            .with_grids(self.grids)
            .with_origin(self.origin.clone())
            .with_fields(fields.collect())?
            .with_faces(faces)?
            .with_polygons(continued)
    }

    /// Axis-aligned bounding box of the finite points, `(minimum, maximum)`; `None` when there are none.
    #[must_use]
    pub fn bounding_box(&self) -> Option<(Vec<f64>, Vec<f64>)> {
        let mut finite =
            self.coordinates.chunks_exact(self.dimension).filter(|p| p.iter().all(|x| x.is_finite()));
        let first = finite.next()?;
        let (mut low, mut high) = (first.to_vec(), first.to_vec());
        for point in finite {
            for (axis, &x) in point.iter().enumerate() {
                low[axis] = low[axis].min(x);
                high[axis] = high[axis].max(x);
            }
        }
        Some((low, high))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_without_a_position_can_be_left_out_with_the_faces_at_them() {
        let nan = f64::NAN;
        let points = vec![0.0, 0.0, nan, 1.0, 1.0, 0.0, 1.0, 1.0, 0.0, 1.0];
        let field = ScalarField {
            name: "a".to_owned(),
            kind: ScalarType::Int8,
            values: vec![1.0, 2.0, 3.0, 4.0, 5.0].into(),
        };
        let cloud = PointCloud::new(2, points, NonFinite::Drop)
            .and_then(|cloud| cloud.with_fields(vec![field]))
            .and_then(|cloud| cloud.with_faces(vec![[0, 1, 2], [0, 2, 3], [0, 3, 4], [2, 3, 4]]))
            .and_then(|cloud| cloud.with_polygons(vec![2]))
            .unwrap();
        let whole = cloud.without_nonfinite().unwrap();
        assert_eq!(
            (whole.len(), whole.nonfinite(), &whole.fields()[0].values[..]),
            (4, 0, &[1.0, 3.0, 4.0, 5.0][..])
        );
        assert_eq!((whole.faces(), whole.continued()), (&[[0, 1, 2], [0, 2, 3], [1, 2, 3]][..], &[1][..]));
        assert_eq!(whole.without_nonfinite(), Ok(whole));
    }

    #[test]
    fn polygons_are_fans_of_consecutive_triangles() {
        let mesh = PointCloud::new(1, vec![0.0; 6], NonFinite::Reject)
            .unwrap()
            .with_faces(vec![[0, 1, 2], [0, 2, 3], [0, 3, 4], [1, 2, 5], [1, 5, 3]])
            .unwrap();
        let sizes = |continued: Vec<u32>| -> Result<Vec<usize>, CloudError> {
            Ok(mesh.clone().with_polygons(continued)?.polygons().map(<[_]>::len).collect())
        };
        assert_eq!(sizes(vec![]), Ok(vec![1; 5]));
        assert_eq!(sizes(vec![1, 2, 4]), Ok(vec![3, 2]));
        assert_eq!(sizes(vec![2]), Ok(vec![1, 2, 1, 1]));
        for (continued, triangle) in
            [(vec![0], 0), (vec![3], 3), (vec![5], 5), (vec![2, 1], 1), (vec![1, 1], 1)]
        {
            assert_eq!(sizes(continued), Err(CloudError::Polygon { triangle }));
        }
    }
}

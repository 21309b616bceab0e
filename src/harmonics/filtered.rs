//! A filter applied to a cloud: which of its numbers are filtered, and what the cloud is afterwards.

use serde::Serialize;

use super::functions::{self, Function};
use super::transform::{self, Energy, Transformed};
use super::{Block, Transfer};
use crate::arguments::arguments;
use crate::cloud::{CloudError, NonFinite, PointCloud, ScalarType};
use crate::geometry::normals;

/// Share of a cloud's extent that its filtered coordinates resolve in a file.
const EXTENT_RESOLVED: f64 = 1e-6;
/// Fields that are colors.
const COLORS: [&str; 4] = ["red", "green", "blue", "alpha"];

arguments! {
    /// What of a cloud is filtered, as a caller names it.
    #[derive(Debug, Clone, PartialEq, Eq)]
    pub struct Named {
        /// Filter this field of the upload in place of the coordinates; several are separated by commas.
        #[alias = "fields"]
        field: Vec<String> = names, absent "the coordinates";
    }
}

/// What of a cloud is filtered.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Target {
    /// The positions of its points.
    Coordinates,
    /// Some of its fields, by their places in the cloud.
    Fields(Vec<usize>),
}

/// Why a field cannot be filtered or transformed.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum TargetError {
    /// No such field.
    #[error("the cloud has no field `{name}`; it has {}", known(.fields))]
    Unknown {
        /// The name asked for.
        name: String,
        /// Those there are.
        fields: Vec<String>,
    },
    /// A value that is not finite.
    #[error("`{name}` is not finite in row {row} (counting from 0)")]
    NonFinite {
        /// Name of the field or function.
        name: String,
        /// The first such row that carries mass.
        row: usize,
    },
}

fn known(fields: &[String]) -> String {
    if fields.is_empty() { "none".to_owned() } else { fields.join(", ") }
}

impl Target {
    /// The fields with these names; the coordinates when none is named.
    ///
    /// # Errors
    /// [`TargetError::Unknown`].
    pub fn named(cloud: &PointCloud, names: &[impl AsRef<str>]) -> Result<Self, TargetError> {
        if names.is_empty() {
            return Ok(Self::Coordinates);
        }
        let find = |name: &str| {
            let find = |name: &str| cloud.fields().iter().position(|field| field.name == name);
            // The name of a scalar field in a PLY file may be given with its prefix.
            let place = find(name).or_else(|| find(name.strip_prefix("scalar_")?));
            place.ok_or_else(|| TargetError::Unknown {
                name: name.to_owned(),
                fields: cloud.fields().iter().map(|field| field.name.clone()).collect(),
            })
        };
        names.iter().map(|name| find(name.as_ref())).collect::<Result<_, _>>().map(Self::Fields)
    }

    /// The numbers to filter; every duplicate has those of its first occurrence. Rows of a field that are not finite have
    /// the mean of the others, and are remembered as missing.
    ///
    /// # Errors
    /// [`TargetError::NonFinite`].
    pub fn functions(&self, cloud: &PointCloud, mass: &[f64]) -> Result<Vec<Function>, TargetError> {
        let mut functions = match self {
            Self::Coordinates => functions::coordinates(cloud),
            Self::Fields(places) => places
                .iter()
                .map(|&place| &cloud.fields()[place])
                .map(|field| Function::new(field.name.clone(), field.values.to_vec()))
                .collect(),
        };
        if let Some(row_of) = functions::first_occurrences(cloud, mass) {
            for function in &mut functions {
                functions::copy_from_first(&mut function.values, &row_of);
            }
        }
        for function in &mut functions {
            let Some(row) = functions::first_nonfinite(&function.values, mass) else { continue };
            // A field may have gaps; a position is not made up.
            if *self == Self::Coordinates || !function.fill_missing(mass) {
                return Err(TargetError::NonFinite { name: function.name.clone(), row });
            }
        }
        Ok(functions)
    }

    /// The cloud with these numbers in place of its own, everything else as it was. Normals follow moved points. A filtered
    /// integer is not an integer and becomes a double; but colors stay whole, as viewers want them.
    ///
    /// # Errors
    /// [`CloudError`] when the numbers are not as many as the cloud's.
    pub fn replaced(&self, cloud: &PointCloud, columns: &[Vec<f64>]) -> Result<PointCloud, CloudError> {
        match self {
            Self::Fields(places) => {
                let mut fields = cloud.fields().to_vec();
                for (&place, column) in places.iter().zip(columns) {
                    let field = &mut fields[place];
                    field.values = column.clone().into();
                    match field.kind.integer_range().filter(|_| COLORS.contains(&field.name.as_str())) {
                        Some((low, high)) => {
                            field.values.iter_mut().for_each(|x| *x = x.round().clamp(low, high));
                        }
                        None => field.kind = field.kind.floating(),
                    }
                }
                cloud.clone().with_fields(fields)
            }
            Self::Coordinates => {
                let coordinates =
                    (0..cloud.len()).flat_map(|row| columns.iter().map(move |column| column[row]));
                let moved = PointCloud::new(cloud.dimension(), coordinates.collect(), NonFinite::Drop)?;
                let kind = moved_type(&moved, cloud.coordinate_type());
                let moved = moved
                    .with_coordinate_type(kind)
                    .with_grids(cloud.grids())
                    .with_origin(cloud.origin().clone())
                    .with_faces(cloud.faces().to_vec())?
                    .with_polygons(cloud.continued().to_vec())?
                    .with_fields(cloud.fields().to_vec())?;
                with_normals(moved)
            }
        }
    }
}

/// The type in which moved coordinates are written: integers become doubles, and so do floats so far from the origin
/// that they would tell positions apart to no better than a millionth of the cloud's extent.
fn moved_type(moved: &PointCloud, before: ScalarType) -> ScalarType {
    let kind = before.floating();
    let Some((low, high)) = moved.bounding_box() else { return kind };
    let extent = low.iter().zip(&high).map(|(low, high)| high - low).fold(0.0, f64::max);
    let farthest = low.iter().chain(&high).map(|x| x.abs()).fold(0.0, f64::max);
    let is_coarse = farthest * f64::from(f32::EPSILON) > EXTENT_RESOLVED * extent;
    if kind == ScalarType::Float32 && is_coarse { ScalarType::Float64 } else { kind }
}

/// Recomputes the normals of a cloud in space that has them as fields `nx`, `ny`, `nz`.
fn with_normals(cloud: PointCloud) -> Result<PointCloud, CloudError> {
    let place = |name| cloud.fields().iter().position(|field| field.name == name);
    let [Some(x), Some(y), Some(z)] = ["nx", "ny", "nz"].map(place) else { return Ok(cloud) };
    if cloud.dimension() != 3 {
        return Ok(cloud);
    }
    let mut fields = cloud.fields().to_vec();
    let before: Vec<[f64; 3]> =
        (0..cloud.len()).map(|row| [x, y, z].map(|place| fields[place].values[row])).collect();
    for (row, normal) in normals(&cloud, &before).into_iter().enumerate() {
        for (place, component) in [x, y, z].into_iter().zip(normal) {
            fields[place].values[row] = component;
        }
    }
    cloud.with_fields(fields)
}

/// A block's rows of the filtered functions. Rows without a result are as they were, rows that were missing are NaN.
#[must_use]
pub fn rows<C: AsRef<[f64]>>(
    block: &Block<C>,
    functions: &[Function],
    transformed: &[Transformed],
    transfer: &Transfer,
) -> Vec<Vec<f64>> {
    let changes: Vec<Vec<f64>> = transformed.iter().map(|f| transfer.apply(&f.coefficients)).collect();
    let changes: Vec<&[f64]> = changes.iter().map(Vec::as_slice).collect();
    let mut columns = transform::synthesize(block, &changes);
    for (column, function) in columns.iter_mut().zip(functions) {
        let before = &function.values[block.first..block.first + block.rows()];
        for (value, &before) in column.iter_mut().zip(before) {
            *value = if value.is_nan() { before } else { *value + transfer.outside * before };
        }
        let rows = block.first as u32..(block.first + block.rows()) as u32;
        let missing = function.missing.iter().filter(|row| rows.contains(*row));
        missing.for_each(|&row| column[row as usize - block.first] = f64::NAN);
    }
    columns
}

/// A function's energy before and after a filter.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[cfg_attr(feature = "server", derive(utoipa::ToSchema))]
pub struct Change {
    /// Of the function as it was.
    pub before: Energy,
    /// Of the filtered function.
    pub after: Energy,
}

impl Change {
    /// In bands as of [`Energy::of`].
    #[must_use]
    pub fn of(function: &Transformed, transfer: &Transfer, bands: usize) -> Self {
        let before = Energy::of(function, bands);
        let coefficients = transfer.filtered(&function.coefficients);
        let inside: f64 = coefficients.iter().map(|c| c * c).sum();
        // what lies outside of the span is orthogonal to it
        let energy = inside + transfer.outside.powi(2) * before.outside;
        Self { after: Energy::of(&Transformed { coefficients, energy }, bands), before }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_field_with_gaps_is_filtered_and_keeps_them() {
        let nan = f64::NAN;
        let field = crate::cloud::ScalarField {
            name: "q".to_owned(),
            kind: ScalarType::Float32,
            values: vec![1.0, nan, 3.0, f64::INFINITY].into(),
        };
        let cloud = PointCloud::new(1, vec![0.0, 1.0, 2.0, 3.0], NonFinite::Reject).unwrap();
        let cloud = cloud.with_fields(vec![field]).unwrap();
        let mass = [1.0, 1.0, 3.0, 0.0];
        for name in ["q", "scalar_q"] {
            let target = Target::named(&cloud, &[name]).unwrap();
            let function = target.functions(&cloud, &mass).unwrap().swap_remove(0);
            assert_eq!((&function.values[..3], &function.missing[..]), (&[1.0, 2.5, 3.0][..], &[1][..]));
        }
        let empty = cloud.clone().with_fields(vec![crate::cloud::ScalarField {
            name: "q".to_owned(),
            kind: ScalarType::Float32,
            values: vec![nan; 4].into(),
        }]);
        let empty = empty.unwrap();
        let target = Target::named(&empty, &["q"]).unwrap();
        assert!(matches!(target.functions(&empty, &mass), Err(TargetError::NonFinite { row: 0, .. })));
    }

    #[test]
    fn a_filtered_integer_is_a_double_and_a_filtered_color_is_a_color() {
        let field = |name: &str| crate::cloud::ScalarField {
            name: name.to_owned(),
            kind: ScalarType::Uint8,
            values: vec![1.0, 2.0, 3.0].into(),
        };
        let cloud = PointCloud::new(1, vec![0.0, 1.0, 2.0], NonFinite::Reject).unwrap();
        let cloud = cloud.with_fields(vec![field("red"), field("echo")]).unwrap();
        let filtered = vec![-3.5, 1.25, 255.75];
        let target = Target::named(&cloud, &["red", "echo"]).unwrap();
        let cloud = target.replaced(&cloud, &[filtered.clone(), filtered.clone()]).unwrap();
        let [red, echo] = cloud.fields() else { panic!("two fields") };
        assert_eq!((red.kind, &red.values[..]), (ScalarType::Uint8, &[0.0, 1.0, 255.0][..]));
        assert_eq!((echo.kind, &echo.values[..]), (ScalarType::Float64, &filtered[..]));
    }

    #[test]
    fn moved_polygons_stay_polygons() {
        let cloud = PointCloud::new(3, vec![0.0; 12], NonFinite::Reject).unwrap();
        let cloud = cloud.with_faces(vec![[0, 1, 2], [0, 2, 3]]).unwrap().with_polygons(vec![1]).unwrap();
        let moved = Target::Coordinates.replaced(&cloud, &vec![vec![1.0, 2.0, 3.0, 4.0]; 3]).unwrap();
        assert_eq!(moved.polygons().count(), 1);
    }

    fn moved(offset: f64, kind: ScalarType) -> ScalarType {
        let points = vec![offset, 0.0, 0.0, offset + 100.0, 50.0, 2.0];
        let cloud = PointCloud::new(3, points, NonFinite::Reject).unwrap().with_coordinate_type(kind);
        let columns: Vec<Vec<f64>> =
            functions::coordinates(&cloud).into_iter().map(|function| function.values).collect();
        Target::Coordinates.replaced(&cloud, &columns).unwrap().coordinate_type()
    }

    #[test]
    fn filtered_coordinates_are_written_in_a_type_that_loses_nothing() {
        assert_eq!(moved(0.0, ScalarType::Float32), ScalarType::Float32);
        assert_eq!(moved(1e6, ScalarType::Float32), ScalarType::Float64);
        assert_eq!(moved(1e6, ScalarType::Float64), ScalarType::Float64);
        assert_eq!(moved(0.0, ScalarType::Int16), ScalarType::Float64, "a filtered integer is none");
    }
}

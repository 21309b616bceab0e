//! Rows of numbers become coordinates and fields, column by column.

use super::{Format, Limits, ReadError, ReadOptions};
use crate::cloud::{PointCloud, ScalarField, ScalarType};

/// Where the values of one column of a file go.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Target {
    /// Coordinate along this axis.
    Coordinate(usize),
    /// Scalar field of this number.
    Field(usize),
    /// Nowhere.
    Skipped,
}

/// Name and type of a column.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Column {
    pub(super) name: String,
    pub(super) kind: ScalarType,
}

impl Column {
    /// A column of a text file.
    pub(super) fn text(name: impl Into<String>) -> Self {
        Self { name: name.into(), kind: ScalarType::Float64 }
    }

    /// A column without a name: `column4` is the fourth.
    pub(super) fn unnamed(index: usize) -> Self {
        Self::text(format!("column{}", index + 1))
    }
}

/// The axis that a column name means. Axes beyond z are named as the PLY writer names them.
pub(super) fn axis(name: &str) -> Option<usize> {
    match name.trim() {
        "x" | "X" => Some(0),
        "y" | "Y" => Some(1),
        "z" | "Z" => Some(2),
        name => name.strip_prefix("coordinate_")?.parse().ok().filter(|axis| *axis >= 3),
    }
}

/// A cloud while it is read.
#[derive(Debug)]
pub(super) struct Columns {
    pub(super) targets: Vec<Target>,
    pub(super) dimension: usize,
    pub(super) coordinates: Vec<f64>,
    pub(super) fields: Vec<ScalarField>,
    coordinate_type: ScalarType,
    limits: Limits,
}

impl Columns {
    /// The first `dimension` columns are coordinates, the others fields.
    pub(super) fn leading(columns: &[Column], dimension: usize, limits: &Limits) -> Result<Self, ReadError> {
        if dimension == 0 || dimension > columns.len() {
            return Err(ReadError::DimensionColumns { dimension, columns: columns.len() });
        }
        let axes = (0..columns.len()).map(|i| (i < dimension).then_some(i)).collect();
        Self::new(columns, axes, limits)
    }

    /// Columns named x, y, z, `coordinate_3`… are coordinates, wherever they stand, the others fields; `None`
    /// when no column is named x or the axes have gaps or repeat.
    pub(super) fn named(columns: &[Column], limits: &Limits) -> Result<Option<Self>, ReadError> {
        let axes: Vec<_> = columns.iter().map(|column| axis(&column.name)).collect();
        let mut present: Vec<usize> = axes.iter().flatten().copied().collect();
        present.sort_unstable();
        if present.is_empty() || present.iter().enumerate().any(|(i, &axis)| i != axis) {
            return Ok(None);
        }
        Self::new(columns, axes, limits).map(Some)
    }

    fn new(columns: &[Column], axes: Vec<Option<usize>>, limits: &Limits) -> Result<Self, ReadError> {
        let dimension = axes.iter().flatten().count();
        if dimension > limits.dimension_max {
            return Err(ReadError::Dimension { dimension, dimension_max: limits.dimension_max });
        }
        let count = columns.len() - dimension;
        if count > limits.fields_max {
            return Err(ReadError::TooManyFields { fields: count, fields_max: limits.fields_max });
        }
        let mut fields: Vec<ScalarField> = Vec::with_capacity(count);
        let mut kinds = Vec::with_capacity(dimension);
        let mut targets = Vec::with_capacity(columns.len());
        for (column, axis) in columns.iter().zip(axes) {
            targets.push(axis.map_or(Target::Field(fields.len()), Target::Coordinate));
            if axis.is_some() {
                kinds.push(column.kind);
            } else {
                let name = unique(&column.name, &fields);
                fields.push(ScalarField { name, kind: column.kind, values: Vec::new() });
            }
        }
        let same = kinds.windows(2).all(|pair| pair[0] == pair[1]);
        let coordinate_type =
            if same { kinds.first().copied().unwrap_or(ScalarType::Float64) } else { ScalarType::Float64 };
        Ok(Self { targets, dimension, coordinates: Vec::new(), fields, coordinate_type, limits: *limits })
    }

    /// Bytes of memory for so many points.
    pub(super) fn bytes_of(&self, points: usize) -> Option<usize> {
        points.checked_mul(self.dimension + self.fields.len())?.checked_mul(size_of::<f64>())
    }

    /// Refuses `points` beyond the limits, then makes room for them.
    pub(super) fn reserve(&mut self, points: usize) -> Result<(), ReadError> {
        self.limits.points(points)?;
        self.limits.memory(self.bytes_of(points))?;
        self.coordinates.reserve_exact(points * self.dimension);
        for field in &mut self.fields {
            field.values.reserve_exact(points);
        }
        Ok(())
    }

    /// Refuses `points` beyond the limits, then makes them, at 0: the pages come zeroed from the system and are
    /// touched only once, when they are filled.
    pub(super) fn zeroed(&mut self, points: usize) -> Result<(), ReadError> {
        self.limits.points(points)?;
        self.limits.memory(self.bytes_of(points))?;
        self.coordinates = vec![0.0; points * self.dimension];
        for field in &mut self.fields {
            field.values = vec![0.0; points];
        }
        Ok(())
    }

    /// Adds a point. The row has one value per target.
    pub(super) fn push(&mut self, row: &[f64]) -> Result<(), ReadError> {
        let start = self.coordinates.len();
        self.limits.points(self.len() + 1)?;
        self.coordinates.resize(start + self.dimension, 0.0);
        for (&target, &value) in self.targets.iter().zip(row) {
            match target {
                Target::Coordinate(axis) => self.coordinates[start + axis] = value,
                Target::Field(field) => self.fields[field].values.push(value),
                Target::Skipped => {}
            }
        }
        Ok(())
    }

    /// Points for which there is room already.
    pub(super) fn room(&self) -> usize {
        self.coordinates.capacity() / self.dimension
    }

    /// Points so far.
    pub(super) fn len(&self) -> usize {
        self.coordinates.len() / self.dimension
    }

    /// The finished cloud.
    pub(super) fn into_cloud(
        self,
        faces: Vec<[u32; 3]>,
        options: &ReadOptions,
    ) -> Result<PointCloud, ReadError> {
        let cloud = PointCloud::new(self.dimension, self.coordinates, options.policy)?;
        let cloud = cloud.with_coordinate_type(self.coordinate_type).with_fields(self.fields)?;
        Ok(cloud.with_faces(faces)?)
    }
}

/// Field names are keys in answers, so a repeated one gets a number.
fn unique(name: &str, taken: &[ScalarField]) -> String {
    let free = |name: &str| taken.iter().all(|field| field.name != name);
    if free(name) {
        return name.to_owned();
    }
    let mut number = 2;
    while !free(&format!("{name}_{number}")) {
        number += 1;
    }
    format!("{name}_{number}")
}

/// The rule for tables without a header: up to three columns are all coordinates; of more, the first three.
pub(super) fn leading_dimension(columns: usize, options: &ReadOptions) -> usize {
    options.dimension.unwrap_or(columns.min(3))
}

/// A row that has another number of values than the first.
pub(super) fn ragged(found: usize, expected: usize, last: bool, format: Format, line: usize) -> ReadError {
    let message = format!("the row has {found} values, the rows before it have {expected}");
    if last && found < expected {
        let location = super::Location::Line(line);
        return ReadError::Truncated { format, location, message };
    }
    ReadError::line(format, line, message)
}

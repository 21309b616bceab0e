//! Rows of numbers become coordinates and fields, column by column.

use std::ops::Range;

use rayon::prelude::*;

use super::text::{Lines, before_comment};
use super::{Format, Limits, ReadError, ReadOptions};
use crate::cloud::{Numbers, PointCloud, ScalarField, ScalarType, all_finite};

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

/// The axis that a column name means. Axes beyond z are named as the PLY writer names them. No field has such a name.
pub(super) fn axis(name: &str) -> Option<usize> {
    match name.trim() {
        "x" | "X" => Some(0),
        "y" | "Y" => Some(1),
        "z" | "Z" => Some(2),
        name => name.strip_prefix("coordinate_")?.parse().ok().filter(|axis| *axis >= 3),
    }
}

/// Rows decoded together: all their columns stay in the first cache.
const BLOCK_ROWS: usize = 512;
/// Rows that one thread decodes at a time.
const PART_ROWS: usize = 128 * BLOCK_ROWS;

/// Some rows, and where their numbers go.
pub(super) struct Block<'a, 'b> {
    pub(super) rows: Range<usize>,
    /// Of all axes, point by point.
    pub(super) coordinates: &'b mut [f64],
    fields: &'b mut [&'a mut [f64]],
    first: usize,
}

impl Block<'_, '_> {
    /// The values of a field.
    pub(super) fn field(&mut self, field: usize) -> &mut [f64] {
        &mut self.fields[field][self.first..self.first + self.rows.len()]
    }
}

/// A cloud while it is read.
#[derive(Debug)]
pub(super) struct Columns {
    pub(super) targets: Vec<Target>,
    pub(super) dimension: usize,
    pub(super) coordinates: Numbers,
    pub(super) fields: Vec<ScalarField>,
    /// Told with the cloud.
    pub(super) notes: Vec<String>,
    coordinate_type: ScalarType,
    /// Whether the coordinates are known to be finite.
    are_finite: bool,
    limits: Limits,
}

impl Columns {
    /// The first `dimension` columns are coordinates, the others fields.
    pub(super) fn leading(columns: &[Column], dimension: usize, limits: &Limits) -> Result<Self, ReadError> {
        if dimension == 0 || dimension > columns.len() {
            return Err(ReadError::DimensionColumns { dimension, columns: columns.len() });
        }
        let axes: Vec<_> = (0..columns.len()).map(|i| (i < dimension).then_some(i)).collect();
        Self::new(columns, &axes, limits)
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
        Self::new(columns, &axes, limits).map(Some)
    }

    /// Columns that have an axis are coordinates along it, the others fields.
    pub(super) fn new(
        columns: &[Column],
        axes: &[Option<usize>],
        limits: &Limits,
    ) -> Result<Self, ReadError> {
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
        for (column, &axis) in columns.iter().zip(axes) {
            targets.push(axis.map_or(Target::Field(fields.len()), Target::Coordinate));
            if axis.is_some() {
                kinds.push(column.kind);
            } else {
                let name = unique(&column.name, &fields);
                fields.push(ScalarField { name, kind: column.kind, values: Numbers::default() });
            }
        }
        let same = kinds.windows(2).all(|pair| pair[0] == pair[1]);
        let coordinate_type =
            if same { kinds.first().copied().unwrap_or(ScalarType::Float64) } else { ScalarType::Float64 };
        let (coordinates, notes) = (Numbers::default(), Vec::new());
        let (are_finite, limits) = (false, *limits);
        Ok(Self { targets, dimension, coordinates, fields, notes, coordinate_type, are_finite, limits })
    }

    /// Leaves a field out, from here on and what it had.
    pub(super) fn leave_out(&mut self, field: usize) {
        self.fields[field].values = Numbers::default();
        for target in &mut self.targets {
            if *target == Target::Field(field) {
                *target = Target::Skipped;
            }
        }
    }

    /// Bytes of memory that a number of points takes.
    pub(super) fn bytes_of(&self, points: usize) -> Option<usize> {
        points.checked_mul(self.dimension + self.fields.len())?.checked_mul(size_of::<f64>())
    }

    /// Refuses `points` beyond the limits, then makes room for them.
    pub(super) fn reserve(&mut self, points: usize) -> Result<(), ReadError> {
        self.limits.points(points)?;
        self.limits.memory(self.bytes_of(points))?;
        self.coordinates.growing().reserve_exact(points * self.dimension);
        for field in &mut self.fields {
            field.values.growing().reserve_exact(points);
        }
        Ok(())
    }

    /// Refuses `points` beyond the limits, then makes them, at 0.
    pub(super) fn zeroed(&mut self, points: usize) -> Result<(), ReadError> {
        self.limits.points(points)?;
        self.limits.memory(self.bytes_of(points))?;
        self.coordinates = Numbers::zeros(points * self.dimension);
        for field in &mut self.fields {
            field.values = Numbers::zeros(points);
        }
        Ok(())
    }

    /// Fills the numbers that are there, on all threads: each touches its own memory first.
    pub(super) fn fill_blocks(&mut self, fill: impl Fn(&mut Block<'_, '_>) + Sync) {
        let dimension = self.dimension;
        let coordinates = self.coordinates.chunks_mut(PART_ROWS * dimension).enumerate();
        let mut parts: Vec<_> =
            coordinates.map(|(part, coordinates)| (part * PART_ROWS, coordinates, Vec::new())).collect();
        for field in &mut self.fields {
            for ((_, _, fields), values) in parts.iter_mut().zip(field.values.chunks_mut(PART_ROWS)) {
                fields.push(values);
            }
        }
        let part_is_finite = |(start, coordinates, mut fields): (usize, &mut [f64], Vec<_>)| {
            let mut are_finite = true;
            for (index, coordinates) in coordinates.chunks_mut(BLOCK_ROWS * dimension).enumerate() {
                let (fields, first) = (fields.as_mut_slice(), index * BLOCK_ROWS);
                let rows = start + first..start + first + coordinates.len() / dimension;
                let mut block = Block { rows, coordinates, fields, first };
                fill(&mut block);
                are_finite &= all_finite(block.coordinates);
            }
            are_finite
        };
        self.are_finite = parts.into_par_iter().map(part_is_finite).reduce(|| true, |a, b| a & b);
    }

    /// Adds a point. The row has one value per target.
    pub(super) fn push(&mut self, row: &[f64]) -> Result<(), ReadError> {
        let start = self.coordinates.len();
        self.limits.points(self.len() + 1)?;
        self.coordinates.growing().resize(start + self.dimension, 0.0);
        for (&target, &value) in self.targets.iter().zip(row) {
            match target {
                Target::Coordinate(axis) => self.coordinates[start + axis] = value,
                Target::Field(field) => self.fields[field].values.growing().push(value),
                Target::Skipped => {}
            }
        }
        Ok(())
    }

    /// Adds a field with a value for every point.
    pub(super) fn append(&mut self, name: &str, kind: ScalarType, values: Numbers) -> Result<(), ReadError> {
        let fields = self.fields.len() + 1;
        if fields > self.limits.fields_max {
            return Err(ReadError::TooManyFields { fields, fields_max: self.limits.fields_max });
        }
        let bytes = self.len().checked_mul(8 * (self.dimension + fields));
        self.limits.memory(bytes)?;
        self.targets.push(Target::Field(self.fields.len()));
        let name = unique(name, &self.fields);
        self.fields.push(ScalarField { name, kind, values });
        Ok(())
    }

    /// Points so far.
    pub(super) fn len(&self) -> usize {
        self.coordinates.len() / self.dimension
    }

    /// Tells of lines behind the last that the header announces.
    pub(super) fn note_lines_behind(&mut self, lines: Lines<'_>, what: &str) {
        let behind = lines.filter(|line| !before_comment(line.text, b'#').is_empty()).count();
        if behind > 0 {
            self.notes.push(format!("{behind} lines behind the {what} that are announced were left out"));
        }
    }

    /// Settles the types of numbers that came as text. What the header calls `float` is rounded to it, as the same file in
    /// binary has it, unless it is written with more digits than a float holds: then it is kept as double. What it calls
    /// an integer and is none is a double too.
    pub(super) fn settle_types(&mut self) {
        settle(&mut self.coordinate_type, &mut self.coordinates);
        for field in &mut self.fields {
            settle(&mut field.kind, &mut field.values);
        }
    }

    /// The finished cloud.
    pub(super) fn into_cloud(
        self,
        faces: Vec<[u32; 3]>,
        options: &ReadOptions,
    ) -> Result<PointCloud, ReadError> {
        let (dimension, policy) = (self.dimension, options.policy);
        let cloud = PointCloud::looked_through(dimension, self.coordinates, policy, self.are_finite)?;
        let mut is_kept = vec![false; self.fields.len()];
        for target in &self.targets {
            if let Target::Field(field) = *target {
                is_kept[field] = true;
            }
        }
        let kept = self.fields.into_iter().zip(is_kept).filter_map(|(field, kept)| kept.then_some(field));
        let cloud = cloud.with_fields(kept.collect())?;
        let cloud = cloud.with_coordinate_type(self.coordinate_type).with_notes(self.notes);
        Ok(cloud.with_faces(faces)?)
    }
}

fn settle(kind: &mut ScalarType, values: &mut [f64]) {
    if *kind == ScalarType::Float32 {
        if values.iter().any(|&x| has_more_digits(x)) {
            *kind = ScalarType::Float64;
        } else {
            for x in values {
                *x = f64::from(*x as f32);
            }
        }
    } else if !values.iter().all(|&x| kind.holds(x)) {
        *kind = ScalarType::Float64;
    }
}

/// Whether a number was written with more digits than a float holds: it is neither a float written with nine digits,
/// which tell every float apart, nor the shortest text of one.
fn has_more_digits(x: f64) -> bool {
    let float = x as f32;
    let error = (f64::from(float) - x).abs();
    // Half a unit of the ninth digit is between these shares of a number.
    if !x.is_finite() || error <= 5e-10 * x.abs() {
        return false;
    }
    if error <= 5e-9 * x.abs() && error <= 0.501 * 10_f64.powi(x.abs().log10().floor() as i32 - 8) {
        return false;
    }
    let mut buffer = [0; <f32 as lexical_core::FormattedSize>::FORMATTED_SIZE_DECIMAL];
    let shortest: Result<f64, _> = lexical_core::parse(lexical_core::write(float, &mut buffer));
    !shortest.is_ok_and(|shortest| shortest.to_bits() == x.to_bits())
}

/// Field names are keys in answers and stand beside the axes in files, so a repeated one gets a number.
fn unique(name: &str, taken: &[ScalarField]) -> String {
    let free = |name: &str| axis(name).is_none() && taken.iter().all(|field| field.name != name);
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_with_more_digits_than_a_float_holds_is_told() {
        for x in [
            0.1,
            0.25,
            512_000.1,
            f64::from(1.0_f32 / 3.0),
            0.333_333_343,
            16_777_217.0 - 1.0,
            1e-42_f32.into(),
        ] {
            assert!(!has_more_digits(x), "{x}");
        }
        for x in [5_301_000.61, 512_000.123, 0.123_456_789_1, 1e39] {
            assert!(has_more_digits(x), "{x}");
        }
        assert!(!has_more_digits(f64::NAN) && !has_more_digits(f64::INFINITY));
    }
}

//! What the attributes of points are: coordinates, fields, marks of invalid points.

use std::ops::Range;

use e57::{PointCloud as Scan, Quaternion, RecordDataType, RecordName};

use super::unpack::Packing;
use crate::cloud::ScalarType;
use crate::cloud::reader::columns::{Column, Columns};

/// How the attributes of a scan are packed, in their order.
pub(super) fn packings(scan: &Scan) -> impl Iterator<Item = Packing> {
    scan.prototype.iter().map(|record| Packing::of(&record.data_type))
}

/// Where the values of an attribute go.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Place {
    /// Along this axis; of spherical coordinates range, azimuth and elevation.
    Axis(usize),
    Field(usize),
    /// A point is invalid where the value is not 0.
    Invalid,
    Skipped,
}

/// The columns of a cloud of several scans: x, y, z and the fields of all.
#[derive(Debug)]
pub(super) struct Layout {
    pub(super) columns: Vec<Column>,
    /// Names of the fields as the files have them, before repeated ones are numbered.
    fields: Vec<String>,
}

impl Layout {
    pub(super) fn of(scans: &[Scan]) -> Self {
        let mut fields: Vec<(String, ScalarType, usize)> = Vec::new();
        for (name, data) in scans.iter().flat_map(named) {
            let kind = kind(data);
            match fields.iter_mut().find(|(known, ..)| *known == name) {
                Some((_, known, scans)) => {
                    *scans += 1;
                    if *known != kind {
                        *known = ScalarType::Float64;
                    }
                }
                None => fields.push((name, kind, 1)),
            }
        }
        let kind = if scans.iter().all(is_single) { ScalarType::Float32 } else { ScalarType::Float64 };
        let mut columns: Vec<Column> =
            ["x", "y", "z"].map(|name| Column { name: name.to_owned(), kind }).to_vec();
        columns.extend(fields.iter().map(|(name, kind, count)| {
            // Scans without the field have NaN.
            let kind = if *count == scans.len() { *kind } else { ScalarType::Float64 };
            Column { name: name.clone(), kind }
        }));
        Self { columns, fields: fields.into_iter().map(|(name, ..)| name).collect() }
    }

    /// Where the attributes of a scan go.
    pub(super) fn places(&self, scan: &Scan) -> Vec<Place> {
        let is_cartesian = is_cartesian(scan);
        let axis = |axis: usize, cartesian: bool| {
            if cartesian == is_cartesian { Place::Axis(axis) } else { Place::Skipped }
        };
        let place = |name: &RecordName| match name {
            RecordName::CartesianX => axis(0, true),
            RecordName::CartesianY => axis(1, true),
            RecordName::CartesianZ => axis(2, true),
            RecordName::SphericalRange => axis(0, false),
            RecordName::SphericalAzimuth => axis(1, false),
            RecordName::SphericalElevation => axis(2, false),
            RecordName::CartesianInvalidState | RecordName::SphericalInvalidState => Place::Invalid,
            name => {
                let known = field(name).and_then(|name| self.fields.iter().position(|known| *known == name));
                known.map_or(Place::Skipped, Place::Field)
            }
        };
        scan.prototype.iter().map(|record| place(&record.name)).collect()
    }

    /// Turns what was unpacked into points: spherical coordinates into cartesian ones, invalid points into ones without a
    /// position, those in the scanner's frame into the file's. Fields that the scan has not are NaN.
    pub(super) fn settle(&self, scan: &Scan, columns: &mut Columns, rows: Range<usize>, invalid: &[bool]) {
        let points = &mut columns.coordinates[3 * rows.start..3 * rows.end];
        let points = points.as_chunks_mut::<3>().0;
        if !is_cartesian(scan) {
            for point in points.iter_mut() {
                let [range, azimuth, elevation] = *point;
                let across = range * elevation.cos();
                *point = [across * azimuth.cos(), across * azimuth.sin(), range * elevation.sin()];
            }
        }
        for (point, _) in points.iter_mut().zip(invalid).filter(|(_, invalid)| **invalid) {
            *point = [f64::NAN; 3];
        }
        let has = |name: &str| named(scan).any(|(known, _)| known == name);
        for (place, name) in self.fields.iter().enumerate().filter(|(_, name)| !has(name)) {
            debug_assert!(!name.is_empty() || !has(name));
            columns.fields[place].values[rows.clone()].fill(f64::NAN);
        }
        let Some(pose) = &scan.transform else { return };
        let (turn, t) = (unit(&pose.rotation), &pose.translation);
        let points = columns.coordinates[3 * rows.start..3 * rows.end].as_chunks_mut::<3>().0;
        for point in points {
            let [x, y, z] = rotated(&turn, *point);
            *point = [x + t.x, y + t.y, z + t.z];
        }
        let normal = ["nx", "ny", "nz"].map(|name| self.fields.iter().position(|known| known == name));
        if let [Some(x), Some(y), Some(z)] = normal {
            for row in rows {
                let before = [x, y, z].map(|place| columns.fields[place].values[row]);
                for (place, value) in [x, y, z].into_iter().zip(rotated(&turn, before)) {
                    columns.fields[place].values[row] = value;
                }
            }
        }
    }
}

/// Names and types of the fields of a scan.
fn named(scan: &Scan) -> impl Iterator<Item = (String, &RecordDataType)> {
    scan.prototype.iter().filter_map(|record| Some((field(&record.name)?, &record.data_type)))
}

fn is_cartesian(scan: &Scan) -> bool {
    let has = |name: &RecordName| scan.prototype.iter().any(|record| record.name == *name);
    [RecordName::CartesianX, RecordName::CartesianY, RecordName::CartesianZ].iter().all(has)
}

/// Whether the coordinates are of single precision and stay so.
fn is_single(scan: &Scan) -> bool {
    let is_axis = |name: &RecordName| {
        matches!(name, RecordName::CartesianX | RecordName::CartesianY | RecordName::CartesianZ)
    };
    let mut axes = scan.prototype.iter().filter(|record| is_axis(&record.name));
    let is_single = axes.all(|record| matches!(record.data_type, RecordDataType::Single { .. }));
    is_cartesian(scan) && scan.transform.is_none() && is_single
}

/// The quaternion made of length 1: what is rounded in files would scale the scan. One of no length does not turn.
fn unit(q: &Quaternion) -> Quaternion {
    let length = (q.w * q.w + q.x * q.x + q.y * q.y + q.z * q.z).sqrt();
    if length.is_normal() {
        Quaternion { w: q.w / length, x: q.x / length, y: q.y / length, z: q.z / length }
    } else {
        Quaternion { w: 1.0, x: 0.0, y: 0.0, z: 0.0 }
    }
}

/// A vector turned by a quaternion of length 1: `v + 2w(u×v) + 2u×(u×v)`.
fn rotated(q: &Quaternion, v: [f64; 3]) -> [f64; 3] {
    let cross = |a: [f64; 3], b: [f64; 3]| {
        [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
    };
    let u = [q.x, q.y, q.z];
    let once = cross(u, v);
    let twice = cross(u, once);
    [0, 1, 2].map(|axis| v[axis] + 2.0 * (q.w * once[axis] + twice[axis]))
}

/// The name of a field; `None` for what is not a field of its own.
fn field(name: &RecordName) -> Option<String> {
    let known = match name {
        RecordName::Intensity => "intensity",
        RecordName::ColorRed => "red",
        RecordName::ColorGreen => "green",
        RecordName::ColorBlue => "blue",
        RecordName::RowIndex => "row_index",
        RecordName::ColumnIndex => "column_index",
        RecordName::ReturnCount => "return_count",
        RecordName::ReturnIndex => "return_index",
        RecordName::TimeStamp => "time_stamp",
        RecordName::Unknown { name, .. } => match name.as_str() {
            "normalX" => "nx",
            "normalY" => "ny",
            "normalZ" => "nz",
            name => name,
        },
        _ => return None,
    };
    Some(known.to_owned())
}

/// The smallest type that holds all values.
fn kind(data: &RecordDataType) -> ScalarType {
    match *data {
        RecordDataType::Single { .. } => ScalarType::Float32,
        RecordDataType::Double { .. } | RecordDataType::ScaledInteger { .. } => ScalarType::Float64,
        RecordDataType::Integer { min, max } => {
            let holds = |kind: &ScalarType| kind.holds(min as f64) && kind.holds(max as f64);
            let integers = [ScalarType::Uint8, ScalarType::Uint16, ScalarType::Int16, ScalarType::Uint32];
            integers.into_iter().chain([ScalarType::Int32]).find(holds).unwrap_or(ScalarType::Float64)
        }
    }
}

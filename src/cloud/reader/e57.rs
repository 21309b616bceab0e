//! ASTM E57: one scan of a file, in the file's coordinate system.
//!
//! The crate `e57` reads pages, XML and packets; what it would keep in memory on a header's word is checked first
//! (see [`packets`]). Points that the scanner marks as invalid have no position: they are rows without one.

mod packets;

use std::io::Cursor;

use e57::{E57Reader, Quaternion, Record, RecordDataType, RecordName, Transform};

use super::columns::{Column, Columns};
use super::{Format, ReadError, ReadOptions, guarded};
use crate::cloud::{PointCloud, ScalarType};

const FORMAT: Format = Format::E57;

pub(super) fn read(bytes: &[u8], options: &ReadOptions) -> Result<PointCloud, ReadError> {
    guarded(FORMAT, || read_scan(bytes, options))
}

fn refuse(error: impl std::fmt::Display) -> ReadError {
    ReadError::byte(FORMAT, 0, error.to_string())
}

fn read_scan(bytes: &[u8], options: &ReadOptions) -> Result<PointCloud, ReadError> {
    packets::check_description(bytes)?;
    let mut file = E57Reader::new(Cursor::new(bytes)).map_err(refuse)?;
    let scans = file.pointclouds();
    let wanted = options.scan.unwrap_or(0);
    let scan = scans.get(wanted).ok_or(ReadError::NoSuchScan { scan: wanted, scans: scans.len() })?;
    let points = usize::try_from(scan.records).unwrap_or(usize::MAX);
    options.limits.points(points)?;
    if points == 0 {
        return Err(crate::cloud::CloudError::Empty.into());
    }
    let queued_bytes = packets::check_streams(bytes, scan)?;

    let roles = Roles::of(&scan.prototype);
    let mut columns = Columns::leading(&roles.columns(scan.transform.is_some()), 3, &options.limits)?;
    options.limits.memory(columns.bytes_of(points).and_then(|bytes| bytes.checked_add(queued_bytes)))?;
    columns.reserve(points)?;
    let pose = scan.transform.clone();
    let mut row = Vec::new();
    for (index, point) in file.pointcloud_raw(scan).map_err(refuse)?.enumerate() {
        let point = point.map_err(|error| refuse(format!("point {index} of {points}: {error}")))?;
        row.clear();
        for (value, record) in point.iter().zip(&scan.prototype) {
            row.push(value.to_f64(&record.data_type).map_err(refuse)?);
        }
        columns.push(&roles.row(&row, pose.as_ref()))?;
    }
    columns.into_cloud(Vec::new(), options)
}

/// What the values of a point are, by their places among them.
#[derive(Debug, Default)]
struct Roles {
    cartesian: [Option<usize>; 3],
    /// Range, azimuth, elevation.
    spherical: [Option<usize>; 3],
    invalid: Vec<usize>,
    fields: Vec<(usize, Column)>,
    is_single: bool,
}

impl Roles {
    fn of(prototype: &[Record]) -> Self {
        let mut roles = Self { is_single: true, ..Self::default() };
        for (place, record) in prototype.iter().enumerate() {
            let mut is_coordinate = true;
            match &record.name {
                RecordName::CartesianX => roles.cartesian[0] = Some(place),
                RecordName::CartesianY => roles.cartesian[1] = Some(place),
                RecordName::CartesianZ => roles.cartesian[2] = Some(place),
                RecordName::SphericalRange => roles.spherical[0] = Some(place),
                RecordName::SphericalAzimuth => roles.spherical[1] = Some(place),
                RecordName::SphericalElevation => roles.spherical[2] = Some(place),
                name => {
                    is_coordinate = false;
                    match name {
                        RecordName::CartesianInvalidState | RecordName::SphericalInvalidState => {
                            roles.invalid.push(place);
                        }
                        name => {
                            let kind = kind(&record.data_type);
                            let column = field(name).map(|name| Column { name, kind });
                            roles.fields.extend(column.map(|column| (place, column)));
                        }
                    }
                }
            }
            roles.is_single &= !is_coordinate || matches!(record.data_type, RecordDataType::Single { .. });
        }
        roles
    }

    /// x, y, z and the fields.
    fn columns(&self, is_posed: bool) -> Vec<Column> {
        let is_single = self.is_single && !is_posed && self.cartesian.iter().all(Option::is_some);
        let kind = if is_single { ScalarType::Float32 } else { ScalarType::Float64 };
        let axes = ["x", "y", "z"].map(|name| Column { name: name.to_owned(), kind });
        axes.into_iter().chain(self.fields.iter().map(|(_, column)| column.clone())).collect()
    }

    /// The values of [`Self::columns`] from those of a point.
    fn row(&self, values: &[f64], pose: Option<&Transform>) -> Vec<f64> {
        let at = |places: [Option<usize>; 3]| match places {
            [Some(a), Some(b), Some(c)] => Some([values[a], values[b], values[c]]),
            _ => None,
        };
        let spherical = |[range, azimuth, elevation]: [f64; 3]| {
            let across = range * elevation.cos();
            [across * azimuth.cos(), across * azimuth.sin(), range * elevation.sin()]
        };
        let position = at(self.cartesian).or_else(|| at(self.spherical).map(spherical));
        let is_valid = self.invalid.iter().all(|&place| values[place] == 0.0);
        let mut position = position.filter(|_| is_valid).unwrap_or([f64::NAN; 3]);
        let mut row = vec![0.0; 3];
        row.extend(self.fields.iter().map(|(place, _)| values[*place]));
        if let Some(pose) = pose {
            let t = &pose.translation;
            let [x, y, z] = rotated(&pose.rotation, position);
            position = [x + t.x, y + t.y, z + t.z];
            let normal =
                ["nx", "ny", "nz"].map(|name| self.fields.iter().position(|(_, column)| column.name == name));
            if let [Some(x), Some(y), Some(z)] = normal {
                let turned = rotated(&pose.rotation, [row[3 + x], row[3 + y], row[3 + z]]);
                [row[3 + x], row[3 + y], row[3 + z]] = turned;
            }
        }
        row[..3].copy_from_slice(&position);
        row
    }
}

/// A vector turned by a unit quaternion: `v + 2w(u×v) + 2u×(u×v)`.
fn rotated(q: &Quaternion, v: [f64; 3]) -> [f64; 3] {
    let cross = |a: [f64; 3], b: [f64; 3]| {
        [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
    };
    let u = [q.x, q.y, q.z];
    let once = cross(u, v);
    let twice = cross(u, once);
    [0, 1, 2].map(|axis| v[axis] + 2.0 * (q.w * once[axis] + twice[axis]))
}

/// The name of a field; `None` for what is no field of its own.
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

#[cfg(test)]
mod tests;

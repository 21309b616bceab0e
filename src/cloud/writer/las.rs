//! LAS 1.4 and LAZ, point formats 6 to 8.
//!
//! Coordinates are integers times a scale: on the grid of the file that the cloud came in, as long as all coordinates lie
//! on it, so that they come back bit for bit; else on the coarsest power of ten on which all lie, or the finest that the
//! extent of the cloud leaves. Fields with
//! the name and range of an attribute of LAS become that attribute, the others extra bytes of their own type.

use std::io::{self, Cursor, Write};

use las::point::Format as PointFormat;
use las::{Builder, PointDataBuilder, Transform, Vector, Vlr};

use super::{Column, encode_rows};
use crate::cloud::{Grid, PointCloud, ScalarField, ScalarType};

/// Points encoded together.
const CHUNK_POINTS: usize = 50_000;
/// Step of the scan angle in degrees [LAS 1.4 R15, §2.6.7].
const SCAN_ANGLE_STEP: f64 = 0.006;
/// Rounding errors that a coordinate on a grid may have gathered, in units of its last place.
const GRID_ROUNDING: f64 = 4.0;

/// Writes a cloud of at most three dimensions whose coordinates are all finite.
pub(super) fn write_las(cloud: &PointCloud, is_compressed: bool, out: &mut impl Write) -> io::Result<()> {
    if cloud.dimension() > 3 {
        return Err(unsupported(format!(
            "LAS has three coordinates; these points have {}",
            cloud.dimension()
        )));
    }
    if let Some(row) = (0..cloud.len()).find(|&row| !cloud.point(row).iter().all(|x| x.is_finite())) {
        return Err(unsupported(format!(
            "LAS has no place for point {row}, which has a non-finite coordinate"
        )));
    }
    let axes = [0, 1, 2].map(|axis| Axis::of(cloud, axis));
    let attributes = Attributes::of(cloud);
    let header = header(&axes, &attributes, is_compressed).map_err(io::Error::other)?;
    let (format, transforms) = (*header.point_format(), *header.transforms());
    let mut writer = las::Writer::new(Cursor::new(Vec::new()), header).map_err(io::Error::other)?;
    for first in (0..cloud.len()).step_by(CHUNK_POINTS) {
        let rows = first..(first + CHUNK_POINTS).min(cloud.len());
        let records = attributes.encode(cloud, &axes, rows);
        let points = PointDataBuilder::new().with_format(format).with_transforms(transforms);
        let points = points.build_from_bytes(records).map_err(io::Error::other)?;
        writer.write_points(&points).map_err(io::Error::other)?;
    }
    out.write_all(&writer.into_inner().map_err(io::Error::other)?.into_inner())
}

fn unsupported(message: String) -> io::Error {
    io::Error::new(io::ErrorKind::Unsupported, message)
}

fn header(axes: &[Axis; 3], attributes: &Attributes<'_>, is_compressed: bool) -> las::Result<las::Header> {
    let mut format = PointFormat::new(6)?;
    format.has_color = attributes.color.is_some();
    format.has_nir = attributes.nir.is_some();
    format.extra_bytes = attributes.extra.iter().map(|field| field.kind.size() as u16).sum();
    format.is_compressed = is_compressed;
    let mut builder = Builder::from((1, 4));
    builder.point_format = format;
    let [x, y, z] =
        axes.each_ref().map(|Axis { grid, .. }| Transform { scale: grid.scale, offset: grid.offset });
    builder.transforms = Vector { x, y, z };
    concat!("chladni ", env!("CARGO_PKG_VERSION")).clone_into(&mut builder.generating_software);
    // The same cloud gives the same file, today and tomorrow.
    builder.date = None;
    if !attributes.extra.is_empty() {
        builder.vlrs.push(Vlr {
            user_id: "LASF_Spec".to_owned(),
            record_id: 4,
            description: "extra bytes".to_owned(),
            data: attributes.extra.iter().flat_map(|field| description(field)).collect(),
        });
    }
    builder.into_header()
}

/// Describes a field [LAS 1.4 R15, table 24]: type, name and text, everything else unset.
fn description(field: &ScalarField) -> [u8; 192] {
    let mut bytes = [0; 192];
    bytes[2] = match field.kind {
        ScalarType::Uint8 => 1,
        ScalarType::Int8 => 2,
        ScalarType::Uint16 => 3,
        ScalarType::Int16 => 4,
        ScalarType::Uint32 => 5,
        ScalarType::Int32 => 6,
        ScalarType::Float32 => 9,
        ScalarType::Float64 => 10,
    };
    let mut end = field.name.len().min(32);
    while !field.name.is_char_boundary(end) {
        end -= 1;
    }
    bytes[4..4 + end].copy_from_slice(&field.name.as_bytes()[..end]);
    bytes
}

/// The grid on which an axis' coordinates are written.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Axis {
    index: usize,
    grid: Grid,
}

impl Axis {
    fn of(cloud: &PointCloud, axis: usize) -> Self {
        if axis >= cloud.dimension() {
            return Self { index: axis, grid: Grid { scale: 1.0, offset: 0.0 } };
        }
        let values = || cloud.coordinates().iter().skip(axis).step_by(cloud.dimension()).copied();
        let kept = cloud.grids().map(|grids| grids[axis]).filter(|grid| values().all(|x| grid.holds(x)));
        Self { index: axis, grid: kept.unwrap_or_else(|| fitted(values)) }
    }

    fn encode(self, cloud: &PointCloud, row: usize) -> f64 {
        cloud.point(row).get(self.index).map_or(0.0, |&x| self.grid.nearest(x))
    }
}

/// A grid for coordinates of which nothing is known.
fn fitted<Values: Iterator<Item = f64>>(values: impl Fn() -> Values) -> Grid {
    let (low, high) = values().fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), x| (a.min(x), b.max(x)));
    let half = 0.5 * (high - low);
    let middle = low + half;
    // All coordinates lie within 1.5 of this power of ten around a multiple of it, hence on 3·10⁹ < 2³² steps.
    let size = if half > 0.0 { half } else { middle.abs() };
    let exponent = if size > 0.0 { size.log10().ceil().clamp(-280.0, 290.0) as i32 } else { 0 };
    let unit = power_of_ten(exponent);
    let offset = (middle / unit).round() * unit;
    let tolerance = GRID_ROUNDING * f64::EPSILON * low.abs().max(high.abs());
    let grid = |exponent| Grid { scale: power_of_ten(exponent), offset };
    let is_near = |grid: Grid| values().all(|x| (grid.coordinate(grid.nearest(x)) - x).abs() <= tolerance);
    let scales = (exponent - 9..=exponent).rev().map(grid);
    scales.into_iter().find(|&grid| is_near(grid)).unwrap_or_else(|| grid(exponent - 9))
}

/// `10^exponent`, correctly rounded, as a product of tens is not.
fn power_of_ten(exponent: i32) -> f64 {
    format!("1e{exponent}").parse().unwrap_or(1.0)
}

/// Where the fields of a cloud go.
struct Attributes<'a> {
    intensity: Option<&'a ScalarField>,
    return_number: Option<&'a ScalarField>,
    number_of_returns: Option<&'a ScalarField>,
    classification: Option<&'a ScalarField>,
    user_data: Option<&'a ScalarField>,
    scan_angle: Option<&'a ScalarField>,
    point_source_id: Option<&'a ScalarField>,
    gps_time: Option<&'a ScalarField>,
    color: Option<[&'a ScalarField; 3]>,
    nir: Option<&'a ScalarField>,
    extra: Vec<&'a ScalarField>,
}

impl<'a> Attributes<'a> {
    fn of(cloud: &'a PointCloud) -> Self {
        let mut extra: Vec<&ScalarField> = cloud.fields().iter().collect();
        let mut take = |name: &str, holds: &dyn Fn(f64) -> bool| {
            let place = extra.iter().position(|f| f.name == name && f.values.iter().all(|&x| holds(x)))?;
            Some(extra.remove(place))
        };
        let whole = |most: u32| move |x: f64| x.fract() == 0.0 && (0.0..=f64::from(most)).contains(&x);
        let (half, byte, word) = (whole(15), whole(255), whole(65_535));
        let angle = |x: f64| {
            let steps = x / SCAN_ANGLE_STEP;
            (steps - steps.round()).abs() < 1e-6 && ScalarType::Int16.holds(steps.round())
        };
        let intensity = take("intensity", &word);
        let return_number = take("return_number", &half);
        let number_of_returns = take("number_of_returns", &half);
        let classification = take("classification", &byte);
        let user_data = take("user_data", &byte);
        let scan_angle = take("scan_angle", &angle);
        let point_source_id = take("point_source_id", &word);
        let gps_time = take("gps_time", &|_| true);
        let is_color = ["red", "green", "blue"]
            .iter()
            .all(|name| cloud.fields().iter().any(|f| f.name == *name && f.values.iter().all(|&x| word(x))));
        let color = is_color.then(|| ["red", "green", "blue"].map(|name| take(name, &word)));
        let color = color.and_then(|[red, green, blue]| Some([red?, green?, blue?]));
        // Near infrared stands behind colours only.
        let nir = if color.is_some() { take("nir", &word) } else { None };
        Self {
            intensity,
            return_number,
            number_of_returns,
            classification,
            user_data,
            scan_angle,
            point_source_id,
            gps_time,
            color,
            nir,
            extra,
        }
    }

    /// Records of some rows [LAS 1.4 R15, §2.6.7 to §2.6.9].
    fn encode(&self, cloud: &PointCloud, axes: &[Axis; 3], rows: std::ops::Range<usize>) -> Vec<u8> {
        use ScalarType::{Float64, Int16, Int32, Uint8, Uint16};
        let steps = axes.map(|axis| rows.clone().map(|row| axis.encode(cloud, row)).collect::<Vec<f64>>());
        let at = |field: Option<&ScalarField>, row: usize| field.map_or(0.0, |field| field.values[row]);
        let returns: Vec<f64> = rows
            .clone()
            .map(|row| at(self.return_number, row) + 16.0 * at(self.number_of_returns, row))
            .collect();
        let angles: Vec<f64> =
            rows.clone().map(|row| (at(self.scan_angle, row) / SCAN_ANGLE_STEP).round()).collect();
        let given = |field: Option<&'a ScalarField>, kind| {
            let values = field.map_or(&[][..], |field| &field.values[rows.clone()]);
            Column { values, stride: 1, kind }
        };
        let made = |values, kind| Column { values, stride: 1, kind };
        let mut columns: Vec<Column<'_>> = steps.iter().map(|values| made(values, Int32)).collect();
        columns.extend([
            given(self.intensity, Uint16),
            made(&returns, Uint8),
            given(None, Uint8),
            given(self.classification, Uint8),
            given(self.user_data, Uint8),
            made(&angles, Int16),
            given(self.point_source_id, Uint16),
            given(self.gps_time, Float64),
        ]);
        columns.extend(self.color.into_iter().flatten().map(|field| given(Some(field), Uint16)));
        columns.extend(self.nir.map(|field| given(Some(field), Uint16)));
        columns.extend(self.extra.iter().map(|field| given(Some(field), field.kind)));
        encode_rows(&columns, rows.len())
    }
}

#[cfg(test)]
#[allow(clippy::float_cmp)] // grids are exact
mod tests {
    use super::*;
    use crate::cloud::NonFinite;

    fn axis(values: &[f64]) -> Grid {
        Axis::of(&PointCloud::new(1, values.to_vec(), NonFinite::Reject).unwrap(), 0).grid
    }

    #[test]
    fn coordinates_on_a_grid_of_millimetres_are_written_on_it() {
        let axis = axis(&[500_000.123, 500_017.5, 500_100.001]);
        assert_eq!(axis.scale.to_bits(), 0.001_f64.to_bits());
        assert_eq!(axis.offset, 500_100.0);
    }

    #[test]
    fn the_grid_that_a_cloud_came_on_is_kept_while_all_its_coordinates_lie_on_it() {
        let grid = Grid { scale: 0.000_25, offset: 1_000_000.125 };
        let on = [-7.0, 0.0, 1_999_999_999.0].map(|step| grid.coordinate(step));
        let written = |values: &[f64]| {
            let cloud = PointCloud::new(1, values.to_vec(), NonFinite::Reject).unwrap();
            Axis::of(&cloud.with_grids(Some([grid; 3])), 0).grid
        };
        assert_eq!(written(&on), grid);
        assert_ne!(written(&[on[0], on[1], on[2] + 0.0001]), grid);
    }

    #[test]
    fn other_coordinates_are_written_as_finely_as_their_extent_allows() {
        let axis = axis(&[0.0, std::f64::consts::PI, 90.0]);
        assert_eq!((axis.scale, axis.offset), (1e-7, 0.0));
    }

    #[test]
    fn one_place_and_extremes_have_a_grid_too() {
        assert_eq!(axis(&[0.0, 0.0]).scale, 1.0);
        let alone = axis(&[7.25]);
        assert_eq!((alone.scale, alone.offset), (0.01, 10.0));
        for values in [[1e-200, 3e-200], [-1e200, 1e200], [0.3, 0.3 + 1e-9]] {
            let axis = axis(&values);
            let steps = values.map(|x| ((x - axis.offset) / axis.scale).round());
            assert!(steps.iter().all(|&step| ScalarType::Int32.holds(step)), "{axis:?} {steps:?}");
            assert!(steps[0] != steps[1]);
        }
    }

    #[test]
    fn what_las_cannot_hold_is_refused() {
        let refusal = |dimension, values: &[f64]| {
            let cloud = PointCloud::new(dimension, values.to_vec(), NonFinite::Drop).unwrap();
            write_las(&cloud, false, &mut Vec::new()).unwrap_err().to_string()
        };
        assert!(refusal(4, &[0.0; 4]).contains("these points have 4"));
        assert!(refusal(3, &[0.0, 0.0, 0.0, 1.0, f64::NAN, 0.0]).contains("point 1"));
    }
}

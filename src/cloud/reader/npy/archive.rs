//! Archives of arrays, as `numpy.savez` writes them: one of them is the points, or three vectors are their coordinates; others of
//! as many rows are fields, `faces` the triangles.

use std::io::Cursor;

use npyz::zip::ZipArchive;

use super::FORMAT;
use super::header::Header;
use crate::cloud::reader::columns::{Column, Columns, leading_dimension};
use crate::cloud::reader::container::{entries, member, open};
use crate::cloud::reader::decode::Place;
use crate::cloud::reader::number::{self, Source};
use crate::cloud::reader::polygons::{Triangles, corner};
use crate::cloud::reader::{ReadError, ReadOptions};
use crate::cloud::{Numbers, PointCloud};

/// Names of the array of points, the first that is there counts.
const POINTS: [&str; 13] = [
    "points",
    "xyz",
    "vertices",
    "coordinates",
    "coords",
    "positions",
    "pos",
    "point_cloud",
    "pointcloud",
    "pc",
    "v",
    "data",
    "arr_0",
];
/// Names of the vectors that are coordinates where there is no array of points.
const AXES: [&str; 3] = ["x", "y", "z"];
const FACES: [&str; 5] = ["faces", "triangles", "face", "tri", "f"];

pub(super) fn read(bytes: &[u8], options: &ReadOptions) -> Result<PointCloud, ReadError> {
    let mut archive = open(bytes, FORMAT)?;
    let entries = entries(&mut archive, FORMAT)?;
    let names: Vec<&str> = entries.iter().map(|(_, name)| name.trim_end_matches(".npy")).collect();
    let place = |wanted: &str| names.iter().position(|name| name.eq_ignore_ascii_case(wanted));
    let points = POINTS.iter().find_map(|name| place(name)).or_else(|| (names.len() == 1).then_some(0));
    let axes = || AXES.iter().map(|name| place(name)).collect::<Option<Vec<_>>>();
    let Some(points) = points.map(|points| vec![points]).or_else(axes) else {
        let shown: Vec<&str> = names.iter().copied().take(12).collect();
        let message = format!(
            "the archive has no array `points` and no vectors `x`, `y` and `z`; it has {}",
            if shown.is_empty() { "none".to_owned() } else { shown.join(", ") }
        );
        return Err(ReadError::byte(FORMAT, 0, message));
    };
    let load = |place: usize, archive: &mut ZipArchive<Cursor<&[u8]>>| {
        member(archive, entries[place].0, bytes.len(), FORMAT)
    };
    let arrays = points.iter().map(|&place| load(place, &mut archive)).collect::<Result<Vec<_>, _>>()?;
    let mut columns = coordinates(&arrays, options)?;
    drop(arrays);
    let mut triangles = Triangles::new(&options.limits, columns.bytes_of(columns.len()));
    let faces = FACES.iter().find_map(|name| place(name)).filter(|place| !points.contains(place));
    for place in (0..names.len()).filter(|place| !points.contains(place)) {
        let array = load(place, &mut archive)?;
        let is_faces = faces == Some(place);
        if let Some(refused) = add(&array, names[place], is_faces, &mut columns, &mut triangles, options)? {
            columns.notes.push(refused);
        }
    }
    triangles.finish(columns, options)
}

/// The columns of an array of points, or of vectors of their coordinates.
fn coordinates(arrays: &[Vec<u8>], options: &ReadOptions) -> Result<Columns, ReadError> {
    let headers = arrays.iter().map(|array| Header::parse(array)).collect::<Result<Vec<_>, _>>()?;
    let rows = headers[0].rows;
    options.limits.points(rows)?;
    let mut columns = if let [header] = &headers[..] {
        header.columns(options)?
    } else {
        if headers.iter().any(|header| header.columns.len() != 1 || header.rows != rows) {
            let sizes = headers.iter().map(|header| format!("{}×{}", header.rows, header.columns.len()));
            let sizes = sizes.collect::<Vec<_>>().join(", ");
            let message = format!(
                "`x`, `y` and `z` are to be vectors of one length, as `ravel()` makes them; they are {sizes}"
            );
            return Err(ReadError::byte(FORMAT, 0, message));
        }
        let named = headers.iter().zip(AXES).map(|(header, name)| Column {
            kind: header.columns[0].number.scalar_type(),
            ..Column::text(name)
        });
        let named: Vec<Column> = named.collect();
        Columns::leading(&named, leading_dimension(named.len(), options), &options.limits)?
    };
    columns.zeroed(rows)?;
    let mut sources: Vec<Source> = Vec::new();
    for (header, array) in headers.iter().zip(arrays) {
        let block = header.block(array)?;
        sources.extend((0..header.columns.len()).map(|index| header.source(block, index)));
    }
    number::fill(&mut columns, &sources);
    Ok(columns)
}

/// Adds an array as fields or as triangles; tells why it was left out, if it was.
fn add(
    array: &[u8],
    name: &str,
    is_faces: bool,
    columns: &mut Columns,
    triangles: &mut Triangles,
    options: &ReadOptions,
) -> Result<Option<String>, ReadError> {
    let left_out = |why: &str| Ok(Some(format!("the array `{name}` {why} and was left out")));
    let Ok(header) = Header::parse(array) else { return left_out("holds no numbers per point") };
    let block = header.block(array)?;
    let values = |index: usize| {
        let mut values = Numbers::zeros(header.rows);
        header.source(block, index).decode(Place::packed(&mut values));
        values
    };
    if is_faces {
        if header.columns.len() != 3 {
            return left_out("has not three columns");
        }
        let corners = [values(0), values(1), values(2)];
        for face in 0..header.rows {
            let mut triangle = [0; 3];
            for (index, values) in triangle.iter_mut().zip(&corners) {
                *index = corner(values[face] as i64, columns.len(), face)
                    .map_err(|message| ReadError::byte(FORMAT, 0, format!("`{name}`: {message}")))?;
            }
            triangles.push(triangle)?;
        }
        return Ok(None);
    }
    if header.rows != columns.len() {
        return left_out(&format!("has {} rows for {} points", header.rows, columns.len()));
    }
    let width = header.columns.len();
    options.limits.memory(
        columns.bytes_of(columns.len()).and_then(|bytes| bytes.checked_add(8 * width * header.rows)),
    )?;
    for index in 0..width {
        let kind = header.columns[index].number.scalar_type();
        let each = match &header.columns[index].name {
            Some(member) => format!("{name}_{member}"),
            None if width == 1 => name.to_owned(),
            None => format!("{name}_{index}"),
        };
        columns.append(&each, kind, values(index))?;
    }
    Ok(None)
}

//! `points3D.txt` of COLMAP: an id, the position, the color, the error, and a track of any length.

use super::columns::{Column, Columns};
use super::text::{Lines, number_at, rows_at_most};
use super::{Format, ReadError, ReadOptions};
use crate::cloud::{PointCloud, ScalarType};

const FORMAT: Format = Format::Xyz;

/// Whether the comments at the head name the columns as COLMAP does.
pub(super) fn is_points(bytes: &[u8]) -> bool {
    let comments = Lines::new(bytes).take_while(|line| line.text.starts_with(b"#")).take(8);
    comments.into_iter().any(|line| line.text.windows(20).any(|part| part == b"POINT3D_ID, X, Y, Z,"))
}

pub(super) fn read(bytes: &[u8], options: &ReadOptions) -> Result<PointCloud, ReadError> {
    use ScalarType::{Float64, Uint8};
    let named = [
        ("point3d_id", Float64),
        ("x", Float64),
        ("y", Float64),
        ("z", Float64),
        ("red", Uint8),
        ("green", Uint8),
        ("blue", Uint8),
        ("error", Float64),
    ];
    let named = named.map(|(name, kind)| Column { name: name.to_owned(), kind });
    let axes = [None, Some(0), Some(1), Some(2), None, None, None, None];
    let mut columns = Columns::new(&named, &axes, &options.limits)?;
    columns.reserve(rows_at_most(bytes).min(options.limits.points_max))?;
    let mut row = Vec::with_capacity(named.len());
    for line in Lines::new(bytes).filter(|line| !line.text.is_empty() && !line.text.starts_with(b"#")) {
        row.clear();
        for word in line.words().take(named.len()) {
            row.push(number_at(word, FORMAT, line.number)?);
        }
        if row.len() < named.len() {
            let message =
                format!("a point of COLMAP has {} numbers or more, this one has {}", named.len(), row.len());
            return Err(ReadError::line(FORMAT, line.number, message));
        }
        columns.push(&row)?;
    }
    if columns.len() == 0 {
        return Err(ReadError::NoRows { format: FORMAT });
    }
    columns.settle_types();
    columns.notes.push("the tracks of the points were left out".to_owned());
    columns.into_cloud(Vec::new(), options)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_position_stands_behind_the_id() {
        let text = "# 3D point list with one line of data per point:\n#   POINT3D_ID, X, Y, Z, R, G, B, ERROR, TRACK[] as \
            (IMAGE_ID, POINT2D_IDX)\n# Number of points: 2, mean track length: 1\n63390 1.5 2.5 3.5 115 121 122 1.3 16 6542 \
            15 7345\n63376 4 5 6 1 2 3 0.5 1 2\n";
        let cloud =
            crate::cloud::reader::read(text.as_bytes(), Format::Xyz, &ReadOptions::default()).unwrap();
        assert_eq!(cloud.coordinates(), [1.5, 2.5, 3.5, 4.0, 5.0, 6.0]);
        let names: Vec<_> = cloud.fields().iter().map(|field| field.name.as_str()).collect();
        assert_eq!(names, ["point3d_id", "red", "green", "blue", "error"]);
    }
}

//! PCD of the Point Cloud Library, version 0.7, binary.
//!
//! Coordinates are floats where all of them are, since most readers of PCL want them so; doubles otherwise. Red, green and
//! blue of bytes are packed into `rgb`, normals called as PCL calls them; the reader undoes both.

use std::io::{self, Write};

use super::{Column, axis_name, encode_rows};
use crate::cloud::{PointCloud, ScalarField, ScalarType};

/// Writes a cloud with all its fields.
pub(super) fn write_pcd(cloud: &PointCloud, out: &mut impl Write) -> io::Result<()> {
    let is_float =
        cloud.coordinates().iter().all(|&x| !x.is_finite() || f64::from(x as f32).to_bits() == x.to_bits());
    let axis_kind = if is_float { ScalarType::Float32 } else { ScalarType::Float64 };
    let colors = colors(cloud);
    let fields: Vec<&ScalarField> =
        cloud.fields().iter().filter(|field| colors.is_none() || !is_color(&field.name)).collect();
    let mut described: Vec<(String, ScalarType)> =
        (0..cloud.dimension().max(3)).map(|axis| (axis_name(axis), axis_kind)).collect();
    if colors.is_some() {
        described.push(("rgb".to_owned(), ScalarType::Uint32));
    }
    for field in &fields {
        let name = name(&field.name, &described);
        described.push((name, field.kind));
    }
    out.write_all(header(&described, cloud.len()).as_bytes())?;
    for first in (0..cloud.len()).step_by(super::CHUNK_ROWS) {
        let rows = super::CHUNK_ROWS.min(cloud.len() - first);
        let dimension = cloud.dimension();
        let from = &cloud.coordinates()[first * dimension..];
        let axis = |axis| Column {
            values: from.get(axis..).unwrap_or_default(),
            stride: dimension,
            kind: axis_kind,
        };
        let missing = (dimension..3).map(|_| Column { values: &[], stride: 1, kind: axis_kind });
        let mut columns: Vec<Column<'_>> = (0..dimension).map(axis).chain(missing).collect();
        if let Some(colors) = &colors {
            columns.push(Column { values: &colors[first..], stride: 1, kind: ScalarType::Uint32 });
        }
        columns.extend(fields.iter().map(|field| Column {
            values: &field.values[first..],
            stride: 1,
            kind: field.kind,
        }));
        out.write_all(&encode_rows(&columns, rows))?;
    }
    Ok(())
}

fn header(described: &[(String, ScalarType)], points: usize) -> String {
    let words = |word: &dyn Fn(&(String, ScalarType)) -> String| {
        described.iter().map(word).collect::<Vec<_>>().join(" ")
    };
    let letter = |(name, kind): &(String, ScalarType)| {
        let letter = match kind {
            // The bits of a color are called a float, since PCL does.
            ScalarType::Uint32 if name == "rgb" => "F",
            ScalarType::Float32 | ScalarType::Float64 => "F",
            ScalarType::Int8 | ScalarType::Int16 | ScalarType::Int32 => "I",
            ScalarType::Uint8 | ScalarType::Uint16 | ScalarType::Uint32 => "U",
        };
        letter.to_owned()
    };
    format!(
        "# .PCD v0.7 - Point Cloud Data file format\nVERSION 0.7\nFIELDS {}\nSIZE {}\nTYPE {}\nCOUNT {}\nWIDTH {points}\n\
         HEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS {points}\nDATA binary\n",
        words(&|(name, _)| name.clone()),
        words(&|(_, kind)| kind.size().to_string()),
        words(&letter),
        words(&|_| "1".to_owned()),
    )
}

fn is_color(name: &str) -> bool {
    matches!(name, "red" | "green" | "blue")
}

/// The colors as 0xRRGGBB, where the cloud has them in bytes.
fn colors(cloud: &PointCloud) -> Option<Vec<f64>> {
    let field = |name: &str| {
        cloud.fields().iter().find(|field| field.name == name && field.kind == ScalarType::Uint8)
    };
    let [red, green, blue] = [field("red")?, field("green")?, field("blue")?];
    let packed = |row: usize| 65_536.0 * red.values[row] + 256.0 * green.values[row] + blue.values[row];
    Some((0..cloud.len()).map(packed).collect())
}

/// One word, that no field before has.
fn name(field: &str, taken: &[(String, ScalarType)]) -> String {
    let word: String =
        field.chars().map(|c| if c.is_whitespace() || c.is_control() { '_' } else { c }).collect();
    let word = match word.as_str() {
        "nx" => "normal_x".to_owned(),
        "ny" => "normal_y".to_owned(),
        "nz" => "normal_z".to_owned(),
        // These are padding and packed colors.
        "" | "_" | "rgb" | "rgba" => format!("{word}_value"),
        _ => word,
    };
    let numbered = (2..).map(|number| format!("{word}_{number}"));
    let is_free = |name: &String| taken.iter().all(|(taken, _)| taken != name);
    std::iter::once(word.clone()).chain(numbered).find(is_free).unwrap_or(word)
}

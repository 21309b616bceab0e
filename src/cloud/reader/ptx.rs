//! PTX of Leica: grids of a scanner, each with its pose; world coordinates come out.
//!
//! A scan is: columns, rows, the scanner's position, its three axes, a 4 × 4 matrix by whose rows points are multiplied
//! (`p' = p M`), then a point per cell: `x y z intensity`, or with `red green blue`. A cell without a return is `0 0 0`
//! and becomes a row without position.
//!
//! Written here: no crate at hand reads it.

use super::columns::{Column, Columns};
use super::text::{Line, Lines, count_at, number_at, rows_at_most};
use super::{Format, Location, ReadError, ReadOptions};
use crate::cloud::{CloudError, NonFinite, PointCloud, ScalarType};

const FORMAT: Format = Format::Xyz;
/// Lines of a scan before its points.
const HEADER_LINES: usize = 10;

/// Whether a text begins as PTX does: two lines of a count, four of three numbers, four of four.
pub(super) fn is_ptx(bytes: &[u8]) -> bool {
    let words = |line: Line<'_>| line.words().take(5).map(<[u8]>::to_vec).collect::<Vec<_>>();
    let lines: Vec<Vec<Vec<u8>>> = Lines::new(bytes).take(HEADER_LINES).map(words).collect();
    let widths: Vec<usize> = lines.iter().map(Vec::len).collect();
    let is_count = |line: &[Vec<u8>]| line.iter().all(|word| lexical_core::parse::<u32>(word).is_ok());
    widths == [1, 1, 3, 3, 3, 3, 4, 4, 4, 4] && lines[..2].iter().all(|line| is_count(line))
}

/// One scan's frame.
struct Scan {
    points: usize,
    /// `p' = p M`, rows of M.
    matrix: [[f64; 4]; 4],
}

impl Scan {
    /// The next scan; `None` at the end of the file.
    fn read(lines: &mut Lines<'_>) -> Result<Option<Self>, ReadError> {
        let Some(first) = lines.find(|line| !line.text.is_empty()) else { return Ok(None) };
        let columns = count_at(first.text, "number of columns", FORMAT, first.number)?;
        let mut next = |what: &str| {
            lines.next().ok_or_else(|| {
                let message = format!("the {what} of a scan is missing");
                ReadError::Truncated { format: FORMAT, location: Location::Line(first.number), message }
            })
        };
        let line = next("number of rows")?;
        let rows = count_at(line.text, "number of rows", FORMAT, line.number)?;
        for _ in 0..4 {
            next("position or an axis")?;
        }
        let mut matrix = [[0.0; 4]; 4];
        for row in &mut matrix {
            let line = next("matrix")?;
            let mut words = line.words();
            for value in row {
                let word = words.next().unwrap_or_default();
                *value = number_at(word, FORMAT, line.number)?;
            }
        }
        let points = columns.saturating_mul(rows);
        Ok(Some(Self { points, matrix }))
    }

    fn place(&self, p: [f64; 3]) -> [f64; 3] {
        let m = &self.matrix;
        [0, 1, 2].map(|axis| p[0] * m[0][axis] + p[1] * m[1][axis] + p[2] * m[2][axis] + m[3][axis])
    }
}

pub(super) fn read(bytes: &[u8], options: &ReadOptions) -> Result<PointCloud, ReadError> {
    let mut lines = Lines::new(bytes);
    let mut columns: Option<Columns> = None;
    let (mut scans, mut empty) = (Vec::new(), 0_usize);
    let mut number = 0;
    while let Some(scan) = Scan::read(&mut lines)? {
        let is_wanted = options.scan.is_none_or(|wanted| wanted == number);
        // A point has seven bytes at least, and the end of its line.
        let possible = lines.rest().len().div_ceil(8);
        if scan.points > possible {
            let message = format!("{} points are announced, {possible} at most can follow", scan.points);
            let location = Location::Line(lines.number());
            return Err(ReadError::Truncated { format: FORMAT, location, message });
        }
        for point in 0..scan.points {
            let Some(line) = lines.next() else {
                let message = format!("scan {number} announces {} points, {point} follow", scan.points);
                let location = Location::Line(lines.number());
                return Err(ReadError::Truncated { format: FORMAT, location, message });
            };
            if !is_wanted {
                continue;
            }
            let row = row(&line)?;
            let columns = match &mut columns {
                Some(columns) => columns,
                none => none.insert(named(row.len(), rows_at_most(bytes), options)?),
            };
            empty += usize::from(push(columns, row, &scan, &line)?);
            scans.push(number as f64);
        }
        number += 1;
    }
    finish(columns, scans, (number, empty), options)
}

fn row(line: &Line<'_>) -> Result<Vec<f64>, ReadError> {
    line.words().take(16).map(|word| number_at(word, FORMAT, line.number)).collect()
}

fn named(width: usize, at_most: usize, options: &ReadOptions) -> Result<Columns, ReadError> {
    let names: &[&str] = match width {
        4 => &["x", "y", "z", "intensity"],
        7 => &["x", "y", "z", "intensity", "red", "green", "blue"],
        _ => &["x", "y", "z"],
    };
    let known = names.iter().map(|&name| Column::text(name));
    let named: Vec<Column> = known.chain((names.len()..width).map(Column::unnamed)).collect();
    let mut columns = Columns::leading(&named, 3, &options.limits)?;
    columns.reserve(at_most.min(options.limits.points_max))?;
    Ok(columns)
}

/// Adds a point in world coordinates; whether its cell has no return.
fn push(columns: &mut Columns, mut row: Vec<f64>, scan: &Scan, line: &Line<'_>) -> Result<bool, ReadError> {
    let expected = columns.targets.len();
    if row.len() < expected.min(3) {
        let message = format!("the point has {} numbers, those before it have {expected}", row.len());
        return Err(ReadError::line(FORMAT, line.number, message));
    }
    // Scans with and without color may stand in one file.
    row.resize(expected, f64::NAN);
    let is_empty = row[..3] == [0.0; 3];
    let place = if is_empty { [f64::NAN; 3] } else { scan.place([row[0], row[1], row[2]]) };
    row[..3].copy_from_slice(&place);
    columns.push(&row)?;
    Ok(is_empty)
}

fn finish(
    columns: Option<Columns>,
    scans: Vec<f64>,
    (count, empty): (usize, usize),
    options: &ReadOptions,
) -> Result<PointCloud, ReadError> {
    let Some(mut columns) = columns else {
        return Err(match options.scan {
            Some(scan) if scan >= count => ReadError::NoSuchScan { scan, scans: count },
            _ => CloudError::Empty.into(),
        });
    };
    let points = columns.len();
    if empty == points {
        return Err(CloudError::Empty.into());
    }
    if empty > 0 {
        columns
            .notes
            .push(format!("{empty} of {points} cells have no return: they are rows without a position"));
    }
    if count > 1 && options.scan.is_none() {
        columns.append("scan", ScalarType::Uint32, scans.into())?;
    }
    // What the scanner marks as no return is not a broken number.
    let policy = if empty > 0 { NonFinite::Drop } else { options.policy };
    columns.into_cloud(Vec::new(), &ReadOptions { policy, ..*options })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cloud::reader::read as read_file;

    const SCAN: &str = "2\n2\n100 200 300\n0 1 0\n-1 0 0\n0 0 1\n0 1 0 0\n-1 0 0 0\n0 0 1 0\n100 200 300 1\n0 0 0 0.5\n\
        1 0 0 0.25\n0 1 0 0.4\n1 1 0.5 0.3\n";

    fn ptx(text: &str, options: &ReadOptions) -> Result<PointCloud, ReadError> {
        read_file(text.as_bytes(), Format::Xyz, options)
    }

    #[test]
    fn points_are_placed_in_the_world_and_cells_without_a_return_have_no_position() {
        let cloud = ptx(SCAN, &ReadOptions::default()).unwrap();
        assert_eq!((cloud.len(), cloud.nonfinite(), cloud.fields()[0].name.as_str()), (4, 1, "intensity"));
        assert!(cloud.point(0)[0].is_nan());
        assert_eq!(cloud.coordinates()[3..], [100.0, 201.0, 300.0, 99.0, 200.0, 300.0, 99.0, 201.0, 300.5]);
        assert_eq!(cloud.fields()[0].values, [0.5, 0.25, 0.4, 0.3]);
        assert!(cloud.notes()[0].contains("1 of 4 cells"));
    }

    #[test]
    fn several_scans_are_one_cloud_or_the_one_that_is_asked_for() {
        let colored = SCAN.replace("0.25\n", "0.25 1 2 3\n").replace("0.5\n1", "0.5 0 0 0\n1");
        let two =
            format!("{SCAN}{}", colored.replace("0.4\n", "0.4 4 5 6\n").replace("0.3\n", "0.3 7 8 9\n"));
        let cloud = ptx(&two, &ReadOptions::default()).unwrap();
        assert_eq!(cloud.len(), 8);
        let scan = cloud.fields().iter().find(|field| field.name == "scan").unwrap();
        assert_eq!(scan.values, [0.0, 0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 1.0]);
        let options = ReadOptions { scan: Some(1), ..ReadOptions::default() };
        let second = ptx(&two, &options).unwrap();
        assert_eq!((second.len(), second.fields().len()), (4, 4));
        let options = ReadOptions { scan: Some(2), ..ReadOptions::default() };
        assert_eq!(ptx(&two, &options).unwrap_err(), ReadError::NoSuchScan { scan: 2, scans: 2 });
    }

    #[test]
    fn a_scan_that_is_cut_is_refused() {
        for lines in [11, 13] {
            let cut: Vec<&str> = SCAN.lines().take(lines).collect();
            let error = ptx(&cut.join("\n"), &ReadOptions::default()).unwrap_err();
            assert!(matches!(error, ReadError::Truncated { .. }), "{error}");
        }
        let many = SCAN.replacen("2\n2\n", "4000000\n4000000\n", 1);
        assert!(ptx(&many, &ReadOptions::default()).is_err());
    }
}

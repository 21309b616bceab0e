//! Tables of numbers in text: what XYZ and CSV have in common.

use super::columns::{Column, Columns, leading_dimension, ragged};
use super::text::{Line, Lines, number, number_at, rows_at_most};
use super::{Format, Limits, ReadError, ReadOptions};
use crate::cloud::PointCloud;

/// Cells of a line that are looked at before its columns are known. A line without end is no table, and is not to be
/// taken apart as one.
const CELLS_MAX: usize = 4096;

/// How a table is written.
#[derive(Debug, Clone, Copy)]
pub(super) struct Dialect {
    pub(super) format: Format,
    /// `None`: any run of blanks.
    pub(super) separator: Option<u8>,
}

impl Dialect {
    /// The line's text without comments; empty when nothing else is there.
    pub(super) fn content<'a>(self, line: &Line<'a>) -> &'a [u8] {
        if line.text.starts_with(b"//") || line.text.starts_with(b"#") {
            return b"";
        }
        if self.separator.is_some() {
            return line.text;
        }
        let end = line.text.iter().position(|&b| b == b'#').unwrap_or(line.text.len());
        line.text[..end].trim_ascii_end()
    }

    /// Calls `each` with every cell of a line, unquoted.
    fn cells<'a, E>(self, text: &'a [u8], mut each: impl FnMut(&'a [u8]) -> Result<(), E>) -> Result<(), E> {
        match self.separator {
            Some(separator) => {
                text.split(|&b| b == separator).try_for_each(|cell| each(unquoted(cell.trim_ascii())))
            }
            None => text.split(u8::is_ascii_whitespace).filter(|word| !word.is_empty()).try_for_each(each),
        }
    }

    /// The cells of a line, the first [`CELLS_MAX`] of them at most.
    pub(super) fn split(self, text: &[u8]) -> Vec<&[u8]> {
        let mut cells = Vec::new();
        // Ends early by its only error.
        let _ = self.cells(text, |cell| {
            cells.push(cell);
            if cells.len() < CELLS_MAX { Ok(()) } else { Err(()) }
        });
        cells
    }

    /// The numbers of a row, no more of them than a point may have.
    fn row(self, text: &[u8], line: usize, row: &mut Vec<f64>, limits: &Limits) -> Result<(), ReadError> {
        row.clear();
        self.cells(text, |cell| {
            if row.len() >= limits.dimension_max.saturating_add(limits.fields_max) {
                let fields = limits.fields_max.saturating_add(1);
                return Err(ReadError::TooManyFields { fields, fields_max: limits.fields_max });
            }
            if cell.is_empty() {
                let message = format!("column {} is empty; write nan for a missing value", row.len() + 1);
                return Err(ReadError::line(self.format, line, message));
            }
            row.push(number_at(cell, self.format, line)?);
            Ok(())
        })
    }

    /// Column names in a line, if none of its cells is a number.
    pub(super) fn names(self, text: &[u8]) -> Option<Vec<String>> {
        let cells = self.split(text);
        let named = (1..CELLS_MAX).contains(&cells.len()) && cells.iter().all(|cell| number(cell).is_none());
        named.then(|| cells.iter().map(|cell| String::from_utf8_lossy(cell).into_owned()).collect())
    }
}

fn unquoted(cell: &[u8]) -> &[u8] {
    match cell {
        [b'"', inner @ .., b'"'] => inner.trim_ascii(),
        _ => cell,
    }
}

/// Reads the rows that `lines` still has. `names` come from a header line, `suggested` names from a comment
/// before the first row: those count only if there is one per column and one is x.
pub(super) fn read(
    dialect: Dialect,
    names: Option<&[String]>,
    suggested: Option<&[String]>,
    mut lines: Lines<'_>,
    options: &ReadOptions,
) -> Result<PointCloud, ReadError> {
    let rows = rows_at_most(lines.rest()).min(options.limits.points_max);
    let mut row = Vec::new();
    let mut table: Option<Columns> = None;
    while let Some(line) = lines.next() {
        let text = dialect.content(&line);
        if text.is_empty() {
            continue;
        }
        dialect.row(text, line.number, &mut row, &options.limits)?;
        if table.is_none() {
            if let Some(names) = names
                && names.len() != row.len()
            {
                return Err(ragged_header(dialect.format, line.number, row.len(), names.len()));
            }
            let suggested = suggested.filter(|names| names.len() == row.len());
            let mut columns = columns(row.len(), names.or(suggested), options)?;
            columns.reserve(rows)?;
            table = Some(columns);
        }
        if let Some(columns) = &mut table {
            let expected = columns.targets.len();
            if row.len() != expected {
                let last = lines.rest().trim_ascii().is_empty();
                return Err(ragged(row.len(), expected, last, dialect.format, line.number));
            }
            columns.push(&row)?;
        }
    }
    table.ok_or(ReadError::Empty)?.into_cloud(Vec::new(), options)
}

fn columns(width: usize, names: Option<&[String]>, options: &ReadOptions) -> Result<Columns, ReadError> {
    let limits = &options.limits;
    let columns: Vec<Column> = match names {
        Some(names) => names.iter().map(Column::text).collect(),
        None => (0..width).map(Column::unnamed).collect(),
    };
    if names.is_some()
        && options.dimension.is_none()
        && let Some(named) = Columns::named(&columns, limits)?
    {
        return Ok(named);
    }
    Columns::leading(&columns, leading_dimension(width, options), limits)
}

fn ragged_header(format: Format, line: usize, found: usize, names: usize) -> ReadError {
    ReadError::line(format, line, format!("the row has {found} values, but the header names {names} columns"))
}

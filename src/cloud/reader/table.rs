//! Tables of numbers in text: rows of cells become points. What XYZ and CSV have in common.
//!
//! Empty cells and the usual words for a missing value are NaN. Beside a header, columns of text are left out and told
//! of; without one, text may only stand around the numbers of a row, where it cannot shift coordinates.

use super::columns::{Column, Columns, Target, leading_dimension, ragged};
use super::heading::Heading;
use super::text::{Line, Lines, before_comment, not_a_number, number, rows_at_most, shown};
use super::{Format, Limits, ReadError, ReadOptions, names};
use crate::cloud::{PointCloud, ScalarType};

/// Cells of a line that are looked at before its columns are known. A line without end is not a table, and is not to be
/// taken apart as one.
pub(super) const CELLS_MAX: usize = 4096;

/// How a table is written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Dialect {
    pub(super) format: Format,
    /// `None`: any run of blanks.
    pub(super) separator: Option<u8>,
}

impl Dialect {
    /// The dialect that a line looks like. A semicolon separates before a comma does: where commas are decimal marks,
    /// semicolons or blanks separate. Tabs are blanks in XYZ.
    pub(super) fn of(format: Format, line: &[u8]) -> Self {
        let marks: &[u8] = if format == Format::Xyz { b";,|" } else { b";\t,|" };
        let separator = marks.iter().copied().find(|mark| line.contains(mark));
        let blank = Self { format, separator: None };
        if separator == Some(b',') && blank.has_decimal_commas(line) {
            return blank;
        }
        Self { format, separator }
    }

    /// Whether a line is made of two words or more that all are numbers, some with a decimal comma.
    fn has_decimal_commas(self, line: &[u8]) -> bool {
        let words = self.split(line);
        let is_number = |word: &&[u8]| number(word).is_some() || with_decimal_comma(word).is_some();
        words.len() > 1 && words.iter().all(is_number) && words.iter().any(|word| word.contains(&b','))
    }

    /// The line's text without comments; empty when nothing else is there.
    pub(super) fn content<'a>(self, line: &Line<'a>) -> &'a [u8] {
        if is_comment(line.text) {
            return b"";
        }
        if self.separator.is_some() { line.text } else { before_comment(line.text, b'#') }
    }

    /// Calls `each` with every cell of a line, unquoted.
    fn cells<'a, E>(self, text: &'a [u8], mut each: impl FnMut(&'a [u8]) -> Result<(), E>) -> Result<(), E> {
        match self.separator {
            Some(separator) if text.contains(&b'"') => quoted_cells(text, separator, each),
            Some(separator) => text.split(|&b| b == separator).try_for_each(|cell| each(cell.trim_ascii())),
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
}

pub(super) fn is_comment(text: &[u8]) -> bool {
    text.starts_with(b"#") || text.starts_with(b"//") || text.starts_with(b"%")
}

/// Cells of a line with quotes, in which separators do not separate [RFC 4180 §2.6].
fn quoted_cells<'a, E>(
    text: &'a [u8],
    separator: u8,
    mut each: impl FnMut(&'a [u8]) -> Result<(), E>,
) -> Result<(), E> {
    let (mut start, mut is_quoted) = (0, false);
    for (at, &byte) in text.iter().enumerate() {
        if byte == b'"' {
            is_quoted = !is_quoted;
        } else if byte == separator && !is_quoted {
            each(unquoted(&text[start..at]))?;
            start = at + 1;
        }
    }
    each(unquoted(&text[start..]))
}

fn unquoted(cell: &[u8]) -> &[u8] {
    match cell.trim_ascii() {
        [b'"', inner @ .., b'"'] => inner.trim_ascii(),
        cell => cell,
    }
}

/// A number such as `-0,25` or `1,5e-3`.
fn with_decimal_comma(word: &[u8]) -> Option<f64> {
    let at = word.iter().position(|&byte| byte == b',')?;
    if !word.get(at + 1).is_some_and(u8::is_ascii_digit) || word.contains(&b'.') || word.len() > 64 {
        return None;
    }
    let mut dotted = word.to_vec();
    dotted[at] = b'.';
    number(&dotted)
}

/// Whether a cell says that its value is missing, as spreadsheets and statistics programs do.
fn is_missing(cell: &[u8]) -> bool {
    const WORDS: [&[u8]; 8] = [b"", b"na", b"n/a", b"#n/a", b"null", b"none", b"nil", b"-"];
    cell.len() <= 4 && WORDS.contains(&cell.to_ascii_lowercase().as_slice())
}

/// A cell as a row has it.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Cell {
    Number(f64),
    DecimalComma(f64),
    Missing,
    Text,
}

impl Dialect {
    fn cell(self, cell: &[u8]) -> Cell {
        if let Some(value) = number(cell) {
            return Cell::Number(value);
        }
        if is_missing(cell) {
            return Cell::Missing;
        }
        match with_decimal_comma(cell) {
            Some(value) if self.separator != Some(b',') => Cell::DecimalComma(value),
            _ => Cell::Text,
        }
    }

    /// Whether a cell would be a number in a row.
    pub(super) fn is_number(self, cell: &[u8]) -> bool {
        matches!(self.cell(cell), Cell::Number(_) | Cell::DecimalComma(_))
    }
}

/// A row while it is read.
#[derive(Debug, Default)]
struct Row<'a> {
    values: Vec<f64>,
    /// Places and words of cells that are text.
    texts: Vec<(usize, &'a [u8])>,
    has_decimal_commas: bool,
    ends_empty: bool,
}

impl<'a> Row<'a> {
    /// Takes the cells of a line, no more of them than a point may have.
    fn take(&mut self, dialect: Dialect, text: &'a [u8], limits: &Limits) -> Result<(), ReadError> {
        self.values.clear();
        self.texts.clear();
        self.ends_empty = false;
        dialect.cells(text, |cell| {
            // A separator may stand behind the last cell.
            if self.values.len() > limits.dimension_max.saturating_add(limits.fields_max) {
                let fields = limits.fields_max.saturating_add(1);
                return Err(ReadError::TooManyFields { fields, fields_max: limits.fields_max });
            }
            let value = match dialect.cell(cell) {
                Cell::Number(value) => value,
                Cell::DecimalComma(value) => {
                    self.has_decimal_commas = true;
                    value
                }
                Cell::Missing => f64::NAN,
                Cell::Text => {
                    self.texts.push((self.values.len(), cell));
                    f64::NAN
                }
            };
            self.ends_empty = cell.is_empty();
            self.values.push(value);
            Ok(())
        })
    }

    /// Drops an empty last cell when the row has one more than its table.
    fn fit(&mut self, width: usize) {
        if self.ends_empty && self.values.len() == width + 1 {
            self.values.pop();
        }
    }
}

/// A table while it is read.
struct Table<'a> {
    heading: Heading<'a>,
    columns: Columns,
    /// The first row of every scan.
    scans: Vec<usize>,
}

/// Reads a table: its heading, then its rows.
pub(super) fn read(bytes: &[u8], format: Format, options: &ReadOptions) -> Result<PointCloud, ReadError> {
    let heading = Heading::read(bytes, format)?;
    let (dialect, mut lines) = (heading.dialect, heading.rows.clone());
    if let Some(points) = heading.announced {
        options.limits.points(points)?;
    }
    let at_most = rows_at_most(lines.rest()).min(options.limits.points_max);
    let mut row = Row::default();
    let mut table: Option<Table<'_>> = None;
    while let Some(line) = lines.next() {
        let text = dialect.content(&line);
        if text.is_empty() {
            continue;
        }
        row.take(dialect, text, &options.limits)?;
        let table = match &mut table {
            Some(table) => table,
            none => none.insert(Table::new(heading.clone(), &mut row, &line, at_most, options)?),
        };
        table.push(&mut row, &line, &lines)?;
    }
    let mut table = table.ok_or(ReadError::NoRows { format })?;
    if row.has_decimal_commas {
        table.columns.notes.push("decimal commas were read as decimal points".to_owned());
    }
    table.into_cloud(options)
}

impl<'a> Table<'a> {
    /// A table whose first row this is.
    fn new(
        heading: Heading<'a>,
        row: &mut Row<'_>,
        line: &Line<'_>,
        at_most: usize,
        options: &ReadOptions,
    ) -> Result<Self, ReadError> {
        let width = heading.width.unwrap_or(row.values.len());
        row.fit(width);
        if row.values.len() != width {
            let found = row.values.len();
            let message = format!("the row has {found} values, but the header names {width} columns");
            return Err(ReadError::line(heading.dialect.format, line.number, message));
        }
        let mut columns = match &heading.names {
            Some(names) => named(names, options, &heading)?,
            None => unnamed(width, row, line, options, heading.dialect.format)?,
        };
        columns.notes.extend(heading.notes.iter().cloned());
        columns.reserve(at_most)?;
        Ok(Self { heading, columns, scans: vec![0] })
    }

    fn push(&mut self, row: &mut Row<'_>, line: &Line<'_>, lines: &Lines<'_>) -> Result<(), ReadError> {
        let format = self.heading.dialect.format;
        let expected = self.columns.targets.len();
        row.fit(expected);
        if row.values.len() != expected {
            if self.begins_scan(row) {
                self.scans.push(self.columns.len());
                return Ok(());
            }
            let is_last = lines.rest().trim_ascii().is_empty();
            return Err(ragged(row.values.len(), expected, is_last, format, line.number));
        }
        for &(place, word) in &row.texts {
            match self.columns.targets[place] {
                Target::Skipped => {}
                Target::Field(field) if self.heading.names.is_some() => {
                    self.columns.notes.push(format!(
                        "the column `{}` holds text ({}, line {}) and was left out",
                        self.columns.fields[field].name,
                        shown(word),
                        line.number
                    ));
                    self.columns.leave_out(field);
                }
                _ => return Err(ReadError::line(format, line.number, not_a_number(word))),
            }
        }
        self.columns.push(&row.values)
    }

    /// Whether a line is the number of points of a further scan, as PTS files have it.
    fn begins_scan(&self, row: &Row<'_>) -> bool {
        let is_count = |x: f64| x >= 0.0 && x.fract() == 0.0;
        self.heading.announced.is_some()
            && row.texts.is_empty()
            && matches!(row.values[..], [x] if is_count(x))
    }

    fn into_cloud(mut self, options: &ReadOptions) -> Result<PointCloud, ReadError> {
        let points = self.columns.len();
        if let Some(announced) = self.heading.announced
            && self.scans.len() == 1
            && announced != points
        {
            self.columns
                .notes
                .push(format!("the first line announces {announced} points; {points} follow and were read"));
        }
        if self.heading.names.is_none() {
            name_colors(&mut self.columns);
        }
        if self.scans.len() > 1 {
            let ends = self.scans.iter().copied().skip(1).chain([points]);
            let scan = self.scans.iter().zip(ends).enumerate();
            let values = scan.flat_map(|(scan, (&start, end))| std::iter::repeat_n(scan as f64, end - start));
            let values = values.collect();
            self.columns.append("scan", ScalarType::Uint32, values)?;
        }
        self.columns.into_cloud(Vec::new(), options)
    }
}

/// Columns of a table with names.
fn named(names: &[String], options: &ReadOptions, heading: &Heading<'_>) -> Result<Columns, ReadError> {
    let columns: Vec<Column> = names.iter().map(Column::text).collect();
    if let Some(dimension) = options.dimension {
        return Columns::leading(&columns, dimension, &options.limits);
    }
    let Some(axes) = names::axes(names) else {
        let shown: Vec<String> = names.iter().take(12).map(|name| shown(name.as_bytes())).collect();
        return Err(ReadError::NoAxes { format: heading.dialect.format, names: shown.join(", ") });
    };
    let mut columns = Columns::new(&columns, &axes.of_column, &options.limits)?;
    columns.notes.extend(axes.note);
    Ok(columns)
}

/// Columns of a table without names: text before the numbers, or behind three of them, is left out.
fn unnamed(
    width: usize,
    row: &Row<'_>,
    line: &Line<'_>,
    options: &ReadOptions,
    format: Format,
) -> Result<Columns, ReadError> {
    let columns: Vec<Column> = (0..width).map(Column::unnamed).collect();
    let is_text = |place: usize| row.texts.iter().any(|&(text, _)| text == place);
    let numbers: Vec<usize> = (0..width).filter(|&place| !is_text(place)).collect();
    let Some(&(_, word)) = row.texts.first() else {
        return Columns::leading(&columns, leading_dimension(width, options), &options.limits);
    };
    let dimension = options.dimension.unwrap_or(3);
    let is_together =
        numbers.get(..dimension).is_some_and(|n| n.windows(2).all(|pair| pair[1] == pair[0] + 1));
    if !is_together || dimension == 0 {
        return Err(ReadError::line(format, line.number, not_a_number(word)));
    }
    let axes: Vec<Option<usize>> =
        (0..width).map(|place| numbers[..dimension].iter().position(|&number| number == place)).collect();
    let mut columns = Columns::new(&columns, &axes, &options.limits)?;
    for &(place, word) in &row.texts {
        if let Target::Field(field) = columns.targets[place] {
            columns.leave_out(field);
        }
        columns.notes.push(format!(
            "column {} holds text ({}, line {}) and was left out",
            place + 1,
            shown(word),
            line.number
        ));
    }
    Ok(columns)
}

/// Names three unnamed columns behind the coordinates, or behind an intensity, that hold bytes as colors do.
fn name_colors(columns: &mut Columns) {
    let names: &[&str] = match columns.fields.len() {
        3 => &["red", "green", "blue"],
        4 => &["intensity", "red", "green", "blue"],
        _ => return,
    };
    let is_byte = |&x: &f64| x.fract() == 0.0 && (0.0..=255.0).contains(&x);
    let colors = &columns.fields[columns.fields.len() - 3..];
    let has_color = colors.iter().any(|field| field.values.iter().any(|&x| x > 1.0));
    if columns.dimension == 3 && has_color && colors.iter().all(|field| field.values.iter().all(is_byte)) {
        for (field, name) in columns.fields.iter_mut().zip(names) {
            (*name).clone_into(&mut field.name);
        }
    }
}

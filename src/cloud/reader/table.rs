//! Tables of numbers in text: rows of cells become points. What XYZ and CSV have in common.
//!
//! Empty cells and the usual words for a missing value are NaN. Beside a header, columns of text are left out and told
//! of; without one, text may only stand around the numbers of a row, where it cannot shift coordinates.

use super::columns::{Column, Columns, Target, leading_dimension, ragged};
use super::dialect::{Cell, Dialect};
use super::heading::Heading;
use super::text::{Line, Lines, not_a_number, rows_at_most, shown};
use super::{Format, Limits, ReadError, ReadOptions, names};
use crate::cloud::{PointCloud, ScalarType};

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

//! The lines before the first row of a table: comments, a number of points, names of the columns.

use super::dialect::{CELLS_MAX, Dialect, is_comment};
use super::text::{Lines, decoded, shown};
use super::{Format, ReadError, names};

/// Lines that name nothing and may stand before the rows.
const PROSE_MAX: usize = 50;
/// Comments that are looked at for names.
const COMMENTS_MAX: usize = 50;

/// What stands before the rows.
#[derive(Debug, Clone)]
pub(super) struct Heading<'a> {
    /// How the rows are written.
    pub(super) dialect: Dialect,
    /// Names of the columns, one for each.
    pub(super) names: Option<Vec<String>>,
    /// Columns, where names tell.
    pub(super) width: Option<usize>,
    /// The number of points in the first line.
    pub(super) announced: Option<usize>,
    /// The rows.
    pub(super) rows: Lines<'a>,
    pub(super) notes: Vec<String>,
}

impl<'a> Heading<'a> {
    pub(super) fn read(bytes: &'a [u8], format: Format) -> Result<Self, ReadError> {
        let mut scan = Scan { lines: Lines::new(bytes), comments: Vec::new(), format, told: None };
        let mut notes = Vec::new();
        let (mut header, mut announced): (Option<&[u8]>, _) = (None, None);
        loop {
            let before = scan.lines.clone();
            let Some(line) = scan.next() else { return Err(ReadError::NoRows { format }) };
            if let Some(mark) = told_separator(line) {
                scan.told = Some(mark);
                continue;
            }
            let dialect = scan.dialect(line);
            if announced.is_none() && scan.counts_points(line) {
                announced = lexical_core::parse(line).ok();
                continue;
            }
            let is_row = match header {
                Some(header) => scan.is_named(header) || scan.has_number(line),
                None => scan.has_number(line) && !scan.is_named(line),
            };
            if is_row || dialect.split(line).len() == CELLS_MAX {
                return Ok(scan.finish(line, before, (header, announced), notes));
            }
            // A second line of words: the first was prose.
            if let Some(prose) = header.replace(line) {
                if notes.len() == PROSE_MAX {
                    return Err(ReadError::NoRows { format });
                }
                notes.push(passed_over(prose));
            }
        }
    }
}

/// Lines are passed until the first row is found.
struct Scan<'a> {
    lines: Lines<'a>,
    comments: Vec<&'a [u8]>,
    format: Format,
    /// The separator that the first line tells.
    told: Option<u8>,
}

impl<'a> Scan<'a> {
    fn dialect(&self, line: &[u8]) -> Dialect {
        match self.told {
            Some(_) => Dialect { format: self.format, separator: self.told },
            None => Dialect::of(self.format, line),
        }
    }

    /// The next line that is not a comment.
    fn next(&mut self) -> Option<&'a [u8]> {
        loop {
            let line = self.lines.next()?;
            if is_comment(line.text) {
                if self.comments.len() == COMMENTS_MAX {
                    self.comments.remove(0);
                }
                self.comments.push(line.text);
                continue;
            }
            let text = self.dialect(line.text).content(&line);
            if !text.is_empty() {
                return Some(text);
            }
        }
    }

    fn has_number(&self, line: &[u8]) -> bool {
        let dialect = self.dialect(line);
        dialect.split(line).iter().any(|cell| dialect.is_number(cell))
    }

    fn is_named(&self, line: &[u8]) -> bool {
        names::axes(&owned(&self.dialect(line).split(line))).is_some()
    }

    /// Whether a line is the number of points: it stands alone in its line, and the next has more, or is a title.
    fn counts_points(&self, line: &[u8]) -> bool {
        let mut ahead = Self { lines: self.lines.clone(), comments: Vec::new(), ..*self };
        let is_alone =
            self.dialect(line).split(line).len() == 1 && lexical_core::parse::<usize>(line).is_ok();
        let is_more = |next| self.dialect(next).split(next).len() > 1 || !self.has_number(next);
        is_alone && ahead.next().is_some_and(is_more)
    }

    /// The heading before the row `line`.
    fn finish(
        self,
        line: &[u8],
        rows: Lines<'a>,
        (header, announced): (Option<&[u8]>, Option<usize>),
        notes: Vec<String>,
    ) -> Heading<'a> {
        let mut heading =
            Heading { dialect: self.dialect(line), names: None, width: None, announced, rows, notes };
        if let Some(header) = header {
            let own = self.dialect(header);
            if own.separator.is_some() && own.split(line).len() > 1 {
                heading.dialect = own;
            }
            let named = names_of(header, line, heading.dialect);
            let named = named.or_else(|| self.is_named(header).then(|| owned(&own.split(header))));
            if named.is_none() {
                heading.notes.push(passed_over(header));
            }
            heading.names = named;
        }
        let dialect = heading.dialect;
        if heading.names.is_none() {
            heading.names = self.comments.iter().rev().find_map(|comment| {
                let text =
                    comment.strip_prefix(b"//").unwrap_or_else(|| comment.get(1..).unwrap_or_default());
                names_of(text.trim_ascii(), line, dialect).filter(|names| names::axes(names).is_some())
            });
        }
        let cells = dialect.split(line);
        if heading.names.is_none() && announced.is_some() && cells.iter().all(|cell| dialect.is_number(cell))
        {
            heading.names = scanned(cells.len());
        }
        heading.width = match &heading.names {
            Some(names) => Some(names.len()),
            None if cells.len() > 1 && Self::all_end_empty(dialect, cells.len(), &heading.rows) => {
                Some(cells.len() - 1)
            }
            None => None,
        };
        heading
    }

    /// Whether the first rows all end in a separator.
    fn all_end_empty(dialect: Dialect, width: usize, rows: &Lines<'a>) -> bool {
        dialect.separator.is_some()
            && rows
                .clone()
                .take(PROSE_MAX)
                .map(|line| dialect.content(&line))
                .filter(|text| !text.is_empty())
                .all(|text| {
                    let cells = dialect.split(text);
                    cells.len() == width && cells.last().is_some_and(|cell| cell.is_empty())
                })
    }
}

fn passed_over(line: &[u8]) -> String {
    format!("the line {} names no columns and was passed over", shown(line))
}

/// `sep=;`, as Excel wants it in the first line.
fn told_separator(line: &[u8]) -> Option<u8> {
    let line = line.strip_prefix(b"\"").and_then(|line| line.strip_suffix(b"\"")).unwrap_or(line);
    match line {
        [b's' | b'S', b'e' | b'E', b'p' | b'P', b'=', mark @ (b';' | b',' | b'|' | b':')] => Some(*mark),
        [b's' | b'S', b'e' | b'E', b'p' | b'P', b'='] => Some(b'\t'),
        _ => None,
    }
}

fn owned(cells: &[&[u8]]) -> Vec<String> {
    cells
        .iter()
        .map(|cell| {
            let name = decoded(cell);
            // What a spreadsheet would take for a formula is written behind an apostrophe.
            match name.strip_prefix('\'') {
                Some(rest) if rest.starts_with(['=', '+', '-', '@']) => rest.to_owned(),
                _ => name,
            }
        })
        .collect()
}

/// The names in a line, as many as the first row has cells, however they are separated. The header, the row or both may
/// end in a separator.
fn names_of(header: &[u8], row: &[u8], rows: Dialect) -> Option<Vec<String>> {
    let cells = rows.split(row);
    let (width, row_ends_empty) = (cells.len(), cells.last().is_some_and(|cell| cell.is_empty()));
    let others = [Some(b';'), Some(b'\t'), Some(b','), None].map(|separator| Dialect { separator, ..rows });
    [rows].into_iter().chain(others).find_map(|dialect| {
        let mut names = owned(&dialect.split(header));
        if dialect.separator.is_none() && names.len() > width {
            names = with_units(names);
        }
        let ends_empty = names.len() > 1 && names.last().is_some_and(String::is_empty);
        if ends_empty && (names.len() == width + 1 || (names.len() == width && row_ends_empty)) {
            names.pop();
        }
        // R writes a name before every row, and none above them.
        let is_row_named = names.len() + 1 == width && !row_ends_empty && !rows.is_number(cells[0]);
        if is_row_named && names::axes(&names).is_some() {
            names.insert(0, "row".to_owned());
        }
        let fits = names.len() == width || (names.len() + 1 == width && row_ends_empty);
        let named = |(place, name): (usize, String)| {
            if name.is_empty() { format!("column{}", place + 1) } else { name }
        };
        fits.then(|| names.into_iter().enumerate().map(named).collect())
    })
}

/// `X [m] Y [m]`: units belong to the names before them.
fn with_units(names: Vec<String>) -> Vec<String> {
    let mut joined: Vec<String> = Vec::with_capacity(names.len());
    for name in names {
        match joined.last_mut() {
            Some(last) if name.starts_with(['[', '(']) => {
                last.push(' ');
                last.push_str(&name);
            }
            _ => joined.push(name),
        }
    }
    joined
}

/// Names of the columns that PTS files of scanners have behind their number of points: intensity, color, or both.
fn scanned(width: usize) -> Option<Vec<String>> {
    let names: &[&str] = match width {
        4 => &["x", "y", "z", "intensity"],
        6 => &["x", "y", "z", "red", "green", "blue"],
        7 => &["x", "y", "z", "intensity", "red", "green", "blue"],
        _ => return None,
    };
    Some(names.iter().map(|&name| name.to_owned()).collect())
}

//! How the lines of a table are written: what separates cells, what is a comment, and what a cell says.

use super::Format;
use super::text::{Line, before_comment, number};

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
    pub(super) fn cells<'a, E>(
        self,
        text: &'a [u8],
        mut each: impl FnMut(&'a [u8]) -> Result<(), E>,
    ) -> Result<(), E> {
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

/// Whether a cell says that its value is missing, as spreadsheets and statistics programs do, or that it could not be
/// printed, as Fortran does by asterisks.
fn is_missing(cell: &[u8]) -> bool {
    const WORDS: [&[u8]; 20] = [
        b"", b"na", b"n/a", b"#n/a", b"#nv", b"n.a.", b"<na>", b"null", b"none", b"nil", b"-", b"--",
        b"#div/0!", b"#value!", b"#wert!", b"#ref!", b"#bezug!", b"#num!", b"#zahl!", b"#name?",
    ];
    (cell.len() <= 8 && WORDS.contains(&cell.to_ascii_lowercase().as_slice()))
        || cell.iter().all(|&b| b == b'*')
}

/// A cell as a row has it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Cell {
    Number(f64),
    DecimalComma(f64),
    Missing,
    Text,
}

impl Dialect {
    /// What stands in a cell.
    pub(super) fn cell(self, cell: &[u8]) -> Cell {
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

//! Lines and numbers of the text formats.

use super::{Format, ReadError};

/// A line without its end.
#[derive(Debug, Clone, Copy)]
pub(super) struct Line<'a> {
    /// Counting from 1.
    pub(super) number: usize,
    /// Without blanks around it.
    pub(super) text: &'a [u8],
}

impl<'a> Line<'a> {
    /// The words between blanks.
    pub(super) fn words(&self) -> impl Iterator<Item = &'a [u8]> + use<'a> {
        self.text.split(u8::is_ascii_whitespace).filter(|word| !word.is_empty())
    }
}

/// Iterates over lines that end in LF or CRLF.
#[derive(Debug, Clone)]
pub(super) struct Lines<'a> {
    rest: &'a [u8],
    number: usize,
}

impl<'a> Lines<'a> {
    pub(super) fn new(bytes: &'a [u8]) -> Self {
        Self::starting_at(bytes, 1)
    }

    /// Lines of a part of a file whose first line has this number.
    pub(super) fn starting_at(bytes: &'a [u8], number: usize) -> Self {
        Self { rest: bytes, number: number - 1 }
    }

    /// Number of the last line handed out.
    pub(super) fn number(&self) -> usize {
        self.number
    }

    /// Bytes not handed out yet.
    pub(super) fn rest(&self) -> &'a [u8] {
        self.rest
    }

    /// The next line that has text before the `mark` of a comment, cut there.
    pub(super) fn next_without_comment(&mut self, mark: u8) -> Option<Line<'a>> {
        self.find_map(|line| {
            let end = line.text.iter().position(|&b| b == mark).unwrap_or(line.text.len());
            let text = line.text[..end].trim_ascii_end();
            (!text.is_empty()).then_some(Line { text, ..line })
        })
    }
}

impl<'a> Iterator for Lines<'a> {
    type Item = Line<'a>;

    fn next(&mut self) -> Option<Line<'a>> {
        if self.rest.is_empty() {
            return None;
        }
        let end = self.rest.iter().position(|&b| b == b'\n').unwrap_or(self.rest.len());
        let text = self.rest[..end].trim_ascii();
        self.rest = self.rest.get(end + 1..).unwrap_or_default();
        self.number += 1;
        Some(Line { number: self.number, text })
    }
}

/// Upper bound of the rows of a table, to allocate once and no more than the bytes warrant.
pub(super) fn rows_at_most(bytes: &[u8]) -> usize {
    bytes.iter().map(|&b| usize::from(b == b'\n')).sum::<usize>() + 1
}

/// Parses a number, including the spellings of NaN and infinity that C, Python and Windows print: the caller's
/// policy decides about those.
pub(super) fn number(word: &[u8]) -> Option<f64> {
    lexical_core::parse(word).ok().or_else(|| spelled(word))
}

fn spelled(word: &[u8]) -> Option<f64> {
    let unsigned = word.strip_prefix(b"-").or_else(|| word.strip_prefix(b"+")).unwrap_or(word);
    let lowercase = unsigned.to_ascii_lowercase();
    let magnitude = match lowercase.as_slice() {
        b"nan" | b"nan(ind)" | b"nan(snan)" | b"1.#qnan" | b"1.#ind" => f64::NAN,
        b"inf" | b"infinity" | b"1.#inf" => f64::INFINITY,
        _ => return None,
    };
    Some(if word.starts_with(b"-") { -magnitude } else { magnitude })
}

/// [`number`], or an error that shows the word.
pub(super) fn number_at(word: &[u8], format: Format, line: usize) -> Result<f64, ReadError> {
    number(word).ok_or_else(|| ReadError::line(format, line, not_a_number(word)))
}

/// Parses a non-negative count, or an error that shows the word and says what it counts.
pub(super) fn count_at(word: &[u8], what: &str, format: Format, line: usize) -> Result<usize, ReadError> {
    lexical_core::parse(word).map_err(|_| {
        ReadError::line(format, line, format!("{} is no {what}: write a whole number from 0", shown(word)))
    })
}

fn not_a_number(word: &[u8]) -> String {
    let dotted: Vec<u8> = word.iter().map(|&b| if b == b',' { b'.' } else { b }).collect();
    let shown = shown(word);
    if word.contains(&b',') && number(&dotted).is_some() {
        return format!("{shown} has a decimal comma; write {}", String::from_utf8_lossy(&dotted));
    }
    let exponent: Vec<u8> =
        word.iter().map(|&b| if b.eq_ignore_ascii_case(&b'd') { b'e' } else { b }).collect();
    if number(&exponent).is_some() {
        return format!("{shown} has a Fortran exponent; write {}", String::from_utf8_lossy(&exponent));
    }
    format!("{shown} is no number; decimal numbers such as -1.5e-3 are accepted")
}

/// A word as it is shown in errors: quoted, printable, and no longer than 40 characters.
pub(super) fn shown(word: &[u8]) -> String {
    let text = String::from_utf8_lossy(word);
    let printable = |c: char| if c.is_control() { char::REPLACEMENT_CHARACTER } else { c };
    let mut shown: String = text.chars().take(40).map(printable).collect();
    if text.chars().nth(40).is_some() {
        shown.push('…');
    }
    format!("`{shown}`")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_usual_spelling_of_a_number_is_read() {
        for (word, value) in
            [("1", 1.0), ("+2.5", 2.5), ("-.5", -0.5), ("3.", 3.0), ("1E-3", 1e-3), ("0", 0.0)]
        {
            assert_eq!(number(word.as_bytes()), Some(value), "{word}");
        }
        for word in ["nan", "NaN", "-nan", "-nan(ind)", "1.#QNAN"] {
            assert!(number(word.as_bytes()).is_some_and(f64::is_nan), "{word}");
        }
        assert_eq!(number(b"inf"), Some(f64::INFINITY));
        assert_eq!(number(b"-Infinity"), Some(f64::NEG_INFINITY));
        assert_eq!(number(b"1e999"), Some(f64::INFINITY));
    }

    #[test]
    fn what_is_no_number_is_refused_with_advice() {
        let message = |word: &str| number_at(word.as_bytes(), Format::Xyz, 7).unwrap_err().to_string();
        assert_eq!(message("0,5"), "XYZ, line 7: `0,5` has a decimal comma; write 0.5");
        assert_eq!(message("1D+02"), "XYZ, line 7: `1D+02` has a Fortran exponent; write 1e+02");
        assert!(message("abc").contains("`abc` is no number"));
        assert!(message(&"x".repeat(500)).len() < 200);
        for word in ["", "1.2.3", "0x10", "--1", "1e"] {
            assert_eq!(number(word.as_bytes()), None, "{word}");
        }
    }

    #[test]
    fn lines_end_in_lf_or_crlf_and_are_counted_from_one() {
        let lines: Vec<_> = Lines::new(b"a\r\n\n b \nc").map(|l| (l.number, l.text)).collect();
        assert_eq!(lines, [(1, &b"a"[..]), (2, b""), (3, b"b"), (4, b"c")]);
    }
}

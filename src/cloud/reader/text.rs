//! Lines and numbers of the text formats.

use memchr::memchr2;

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

/// What ends a line.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum LineEnd {
    /// LF, CRLF or CR, as they come.
    Any,
    /// LF, or CRLF.
    Feed,
    /// CR alone, as old Macintosh programs and Rhinoceros write.
    Return,
}

/// Iterates over the lines of a text.
#[derive(Debug, Clone)]
pub(super) struct Lines<'a> {
    rest: &'a [u8],
    number: usize,
    end: LineEnd,
}

impl<'a> Lines<'a> {
    pub(super) fn new(bytes: &'a [u8]) -> Self {
        Self::starting_at(bytes, 1)
    }

    /// Lines of a part of a file whose first line has this number.
    pub(super) fn starting_at(bytes: &'a [u8], number: usize) -> Self {
        Self { rest: bytes, number: number - 1, end: LineEnd::Any }
    }

    /// Lines of a header that binary data may follow: all end as the first does, so that no byte behind the last end
    /// is taken for a part of it.
    pub(super) fn of_header(bytes: &'a [u8]) -> Self {
        let end = match memchr2(b'\n', b'\r', bytes) {
            Some(at) if bytes[at] == b'\r' && bytes.get(at + 1) != Some(&b'\n') => LineEnd::Return,
            _ => LineEnd::Feed,
        };
        Self { rest: bytes, number: 0, end }
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
            let text = before_comment(line.text, mark);
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
        let end = match self.end {
            LineEnd::Any => memchr2(b'\n', b'\r', self.rest),
            LineEnd::Feed => memchr::memchr(b'\n', self.rest),
            LineEnd::Return => memchr::memchr(b'\r', self.rest),
        };
        let end = end.unwrap_or(self.rest.len());
        let text = self.rest[..end].trim_ascii();
        let is_pair = self.end == LineEnd::Any && self.rest[end..].starts_with(b"\r\n");
        self.rest = self.rest.get(end + 1 + usize::from(is_pair)..).unwrap_or_default();
        self.number += 1;
        Some(Line { number: self.number, text })
    }
}

/// The text before a comment, which may stand directly behind a word; `1.#QNAN` is a number.
pub(super) fn before_comment(text: &[u8], mark: u8) -> &[u8] {
    let is_letter = |at: usize| text.get(at + 1).is_some_and(u8::is_ascii_alphabetic);
    let begins = |&at: &usize| !(text[..at].ends_with(b"1.") && is_letter(at));
    let end = memchr::memchr_iter(mark, text).find(begins).unwrap_or(text.len());
    text[..end].trim_ascii_end()
}

/// Upper bound of the rows of a table, to allocate once and no more than the bytes warrant.
pub(super) fn rows_at_most(bytes: &[u8]) -> usize {
    let feeds = memchr::memchr_iter(b'\n', bytes).count();
    let lone = memchr::memchr_iter(b'\r', bytes).filter(|&at| bytes.get(at + 1) != Some(&b'\n')).count();
    feeds + lone + 1
}

/// Parses a number, including the spellings of NaN and infinity that C, Python and Windows print: the caller's
/// policy decides about those.
pub(super) fn number(word: &[u8]) -> Option<f64> {
    lexical_core::parse(word).ok().or_else(|| spelled(word)).or_else(|| fortran(word))
}

/// A number in double precision as Fortran writes it, `0.25D+01`: always with a sign, so that no code in hexadecimal is
/// taken for one.
fn fortran(word: &[u8]) -> Option<f64> {
    let at = word.iter().position(|byte| matches!(byte, b'd' | b'D'))?;
    if !matches!(word.get(at + 1), Some(b'+' | b'-')) || word.len() > 64 {
        return None;
    }
    let mut exponent = word.to_vec();
    exponent[at] = b'e';
    lexical_core::parse(&exponent).ok()
}

fn spelled(word: &[u8]) -> Option<f64> {
    let unsigned = word.strip_prefix(b"-").or_else(|| word.strip_prefix(b"+")).unwrap_or(word);
    let lowercase = unsigned.to_ascii_lowercase();
    let magnitude = match lowercase.as_slice() {
        b"nan" => f64::NAN,
        b"inf" | b"infinity" => f64::INFINITY,
        // With what C allows in brackets: `nan(ind)`, `nan(0x8000000000000)`.
        [b'n', b'a', b'n', b'(', inner @ .., b')'] if inner.iter().all(u8::is_ascii_alphanumeric) => f64::NAN,
        word => microsoft(word)?,
    };
    Some(if word.starts_with(b"-") { -magnitude } else { magnitude })
}

/// What the C runtime of Windows printed before 2015: `1.#QNAN`, `1.#IND`, `1.#INF`, padded with zeros to the precision
/// or rounded to it as if the letters were digits (`1.#R`, `1.#J`, `1.#QO`, `1.#IO`), by `%e` with an exponent of 0. Rounded,
/// infinity may look like the indefinite NaN: both are taken for NaN.
fn microsoft(word: &[u8]) -> Option<f64> {
    let word = word.strip_prefix(b"1.#")?;
    let word = ["e+000", "e+00"].iter().find_map(|e| word.strip_suffix(e.as_bytes())).unwrap_or(word);
    let letters = &word[..word.iter().take_while(|byte| byte.is_ascii_alphabetic()).count()];
    let padding = &word[letters.len()..];
    if letters.is_empty() || padding.iter().any(|&byte| byte != b'0') {
        return None;
    }
    match letters {
        b"inf" => Some(f64::INFINITY),
        b"qnan" | b"snan" | b"ind" | b"qna" | b"qnb" | b"sna" | b"snb" | b"in" | b"io" | b"qn" | b"qo"
        | b"sn" | b"so" | b"r" | b"j" | b"t" | b"q" | b"s" | b"i" => Some(f64::NAN),
        _ => None,
    }
}

/// [`number`], or an error that shows the word.
pub(super) fn number_at(word: &[u8], format: Format, line: usize) -> Result<f64, ReadError> {
    number(word).ok_or_else(|| ReadError::line(format, line, not_a_number(word)))
}

/// Parses a non-negative count, or an error that shows the word and says what it counts.
pub(super) fn count_at(word: &[u8], what: &str, format: Format, line: usize) -> Result<usize, ReadError> {
    lexical_core::parse(word).map_err(|_| {
        ReadError::line(format, line, format!("{} is not a {what}; write a whole number from 0", shown(word)))
    })
}

/// Why a word is not a number, and what to write instead.
pub(super) fn not_a_number(word: &[u8]) -> String {
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
    format!("{shown} is not a number; decimal numbers such as -1.5e-3 are accepted")
}

/// Text of a file: UTF-8, or else what Windows wrote in Western Europe, of which Latin-1 is all that names need.
pub(super) fn decoded(bytes: &[u8]) -> String {
    std::str::from_utf8(bytes)
        .map_or_else(|_| bytes.iter().map(|&byte| char::from(byte)).collect(), str::to_owned)
}

/// A word as it is shown in errors: quoted, printable, and no longer than 40 characters.
pub(super) fn shown(word: &[u8]) -> String {
    let text = String::from_utf8_lossy(&word[..word.len().min(200)]);
    let printable = |c: char| if c.is_control() { char::REPLACEMENT_CHARACTER } else { c };
    let mut shown: String = text.chars().take(40).map(printable).collect();
    if text.chars().nth(40).is_some() {
        shown.push('…');
    }
    format!("`{shown}`")
}

/// The text of a file in UTF-16, recognized by its byte order mark or by zeros in every other byte; `None` for other files.
pub(super) fn from_utf16(bytes: &[u8]) -> Option<Vec<u8>> {
    type Unit = fn([u8; 2]) -> u16;
    let is_zero_at = |offset: usize| {
        let head = &bytes[..bytes.len().min(64) & !1];
        let zeros = |from: usize| head.iter().skip(from).step_by(2).filter(|&&byte| byte == 0).count();
        head.len() >= 8 && zeros(offset) == head.len() / 2 && zeros(1 - offset) == 0
    };
    let (body, unit): (&[u8], Unit) = match bytes {
        [0xFF, 0xFE, body @ ..] => (body, u16::from_le_bytes),
        [0xFE, 0xFF, body @ ..] => (body, u16::from_be_bytes),
        _ if is_zero_at(1) => (bytes, u16::from_le_bytes),
        _ if is_zero_at(0) => (bytes, u16::from_be_bytes),
        _ => return None,
    };
    let units = body.as_chunks::<2>().0.iter().map(|pair| unit(*pair));
    let mut text = Vec::with_capacity(body.len() / 2);
    for character in char::decode_utf16(units) {
        let character = character.unwrap_or(char::REPLACEMENT_CHARACTER);
        text.extend_from_slice(character.encode_utf8(&mut [0; 4]).as_bytes());
    }
    Some(text)
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
        for word in [
            "nan",
            "NaN",
            "-nan",
            "-nan(ind)",
            "1.#QNAN",
            "-1.#IND",
            "1.#QNAN0",
            "-1.#IND00",
            "1.#R",
            "-1.#J",
            "1.#QNAN0e+000",
            "-1.#IND00e+00",
            "nan(0x8000000000000)",
        ] {
            assert!(number(word.as_bytes()).is_some_and(f64::is_nan), "{word}");
        }
        assert_eq!(number(b"inf"), Some(f64::INFINITY));
        assert_eq!(number(b"-Infinity"), Some(f64::NEG_INFINITY));
        assert_eq!(number(b"-1.#INF00"), Some(f64::NEG_INFINITY));
        assert_eq!(number(b"1.#INF00e+000"), Some(f64::INFINITY));
        assert_eq!(number(b"1e999"), Some(f64::INFINITY));
        assert_eq!(number(b"-0.25D+01"), Some(-2.5));
        assert_eq!(number(b"25d-01"), Some(2.5));
    }

    #[test]
    fn what_is_no_number_is_refused_with_advice() {
        let message = |word: &str| number_at(word.as_bytes(), Format::Xyz, 7).unwrap_err().to_string();
        assert_eq!(message("0,5"), "XYZ, line 7: `0,5` has a decimal comma; write 0.5");
        assert_eq!(message("1D2"), "XYZ, line 7: `1D2` has a Fortran exponent; write 1e2");
        assert!(message("abc").contains("`abc` is not a number"));
        assert!(message(&"x".repeat(500)).len() < 200);
        for word in ["", "1.2.3", "0x10", "--1", "1e", "1.#", "1.#QNAN7", "1.#x", "2.#INF", "nan(a b)", "1D+"]
        {
            assert_eq!(number(word.as_bytes()), None, "{word}");
        }
    }

    #[test]
    fn lines_end_in_lf_crlf_or_cr_and_are_counted_from_one() {
        for text in ["a\r\n\n b \nc", "a\r\r b \rc", "a\n\n b \r\nc\r\n"] {
            let lines: Vec<_> = Lines::new(text.as_bytes()).map(|l| (l.number, l.text)).collect();
            assert_eq!(lines, [(1, &b"a"[..]), (2, b""), (3, b"b"), (4, b"c")], "{text:?}");
            assert!(rows_at_most(text.as_bytes()) >= 4);
        }
    }

    #[test]
    fn a_header_in_cr_ends_before_the_first_byte_of_its_data() {
        let mut lines = Lines::of_header(b"ply\rend_header\r\n\x01");
        assert_eq!(lines.by_ref().take(2).count(), 2);
        assert_eq!(lines.rest(), b"\n\x01");
        let mut lines = Lines::of_header(b"ply\r\nend_header\r\n\r\x01");
        assert_eq!(lines.by_ref().take(2).map(|line| line.text).last(), Some(&b"end_header"[..]));
        assert_eq!(lines.rest(), b"\r\x01");
    }

    #[test]
    fn comments_begin_behind_anything_but_the_start_of_a_number_that_is_none() {
        assert_eq!(before_comment(b"1 1.#QNAN # note", b'#'), b"1 1.#QNAN");
        assert_eq!(before_comment(b"v 0 0 0# note", b'#'), b"v 0 0 0");
        assert_eq!(before_comment(b"v 0 0 1.# 1", b'#'), b"v 0 0 1.");
        assert_eq!(before_comment(b"# note", b'#'), b"");
    }

    #[test]
    fn text_in_utf16_is_told_by_its_mark_or_its_zeros() {
        let units: Vec<u16> = "v 1 2 3\né".encode_utf16().collect();
        let little: Vec<u8> = units.iter().flat_map(|unit| unit.to_le_bytes()).collect();
        let big: Vec<u8> = units.iter().flat_map(|unit| unit.to_be_bytes()).collect();
        let text = "v 1 2 3\né".as_bytes();
        assert_eq!(from_utf16(&[&[0xFF, 0xFE], little.as_slice()].concat()).unwrap(), text);
        assert_eq!(from_utf16(&[&[0xFE, 0xFF], big.as_slice()].concat()).unwrap(), text);
        assert_eq!(from_utf16(&little[..16]).unwrap(), b"v 1 2 3\n");
        assert_eq!(from_utf16(&big[..16]).unwrap(), b"v 1 2 3\n");
        assert_eq!(from_utf16(b"v 1 2 3\n"), None);
        assert_eq!(from_utf16(&[0; 64]), None);
    }
}

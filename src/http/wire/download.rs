//! Serving a large result: validators, conditional requests and byte ranges (RFC 9110 §13, §14).

use std::io;
use std::ops::Range;

use axum::body::{Body, Bytes};
use axum::http::{HeaderMap, HeaderValue, Method, StatusCode, header};
use axum::response::{IntoResponse, Response};
use futures_util::stream;
use serde::Serialize;

use super::accept::{CSV, JSON, Offer, PNG, SVG};
use super::memory::Reservation;
use super::problem::{Kind, Problem};
use crate::jobs::Wanted;

/// What browsers show; everything else they save.
const SHOWN: [Offer; 4] = [PNG, SVG, JSON, CSV];
/// An answer that is opened by itself runs nothing and loads nothing.
const POLICY: &str = "default-src 'none'; style-src 'unsafe-inline'; frame-ancestors 'self'";

/// A representation of a result, before its bytes are made.
#[derive(Debug)]
pub(crate) struct Download {
    /// Decides the media type and the file name's ending.
    pub offer: Offer,
    /// Names these very bytes: the result never changes, so its identity and the arguments do.
    pub tag: String,
    /// File name without its ending.
    pub stem: String,
    /// Length in bytes; `None` for text whose length is known only once it is written.
    pub length: Option<u64>,
}

impl Download {
    /// The answer: 304, 206, 416, or the whole. `body` makes the bytes of a range; it is not called for HEAD. The memory
    /// for what they are made of is kept until the last one is taken.
    ///
    /// # Errors
    /// A problem when the range lies outside of the result.
    pub(crate) fn answer(
        self,
        method: &Method,
        headers: &HeaderMap,
        reservation: Reservation,
        body: impl FnOnce(Range<u64>) -> Body,
    ) -> Result<Response, Problem> {
        let etag = format!("\"{}-{}\"", self.tag, self.offer.name);
        let mut response = if is_known(headers, &etag) {
            StatusCode::NOT_MODIFIED.into_response()
        } else {
            self.bytes(method, headers, &etag, body)?
        };
        let answered = response.headers_mut();
        if let Ok(etag) = HeaderValue::from_str(&etag) {
            answered.insert(header::ETAG, etag);
        }
        answered.insert(header::VARY, HeaderValue::from_static("accept"));
        answered.insert(header::CACHE_CONTROL, HeaderValue::from_static("private, no-cache"));
        Ok(reservation.until_sent(response))
    }

    fn bytes(
        &self,
        method: &Method,
        headers: &HeaderMap,
        etag: &str,
        body: impl FnOnce(Range<u64>) -> Body,
    ) -> Result<Response, Problem> {
        let span = match self.length {
            Some(length) if method == Method::GET => span(headers, etag, length)?,
            _ => None,
        };
        let whole = 0..self.length.unwrap_or(u64::MAX);
        let wanted = span.clone().unwrap_or(whole);
        let body = match self.length {
            _ if method != Method::HEAD => body(wanted.clone()),
            Some(_) => Body::empty(),
            // Of a length that is not known either: an empty body would be announced as one of no bytes.
            None => Body::from_stream(stream::empty::<io::Result<Bytes>>()),
        };
        let mut response = Response::new(body);
        let answered = response.headers_mut();
        answered.insert(header::CONTENT_TYPE, HeaderValue::from_static(self.offer.media_type()));
        let kind = if SHOWN.contains(&self.offer) { "inline" } else { "attachment" };
        let disposition = format!("{kind}; filename=\"{}.{}\"", self.stem, self.offer.name);
        if let Ok(disposition) = HeaderValue::from_str(&disposition) {
            answered.insert(header::CONTENT_DISPOSITION, disposition);
        }
        answered.insert(header::X_CONTENT_TYPE_OPTIONS, HeaderValue::from_static("nosniff"));
        answered.insert(header::CONTENT_SECURITY_POLICY, HeaderValue::from_static(POLICY));
        let Some(length) = self.length else { return Ok(response) };
        answered.insert(header::ACCEPT_RANGES, HeaderValue::from_static("bytes"));
        answered.insert(header::CONTENT_LENGTH, HeaderValue::from(wanted.end - wanted.start));
        if span.is_some() {
            let range = format!("bytes {}-{}/{length}", wanted.start, wanted.end - 1);
            if let Ok(range) = HeaderValue::from_str(&range) {
                answered.insert(header::CONTENT_RANGE, range);
            }
            *response.status_mut() = StatusCode::PARTIAL_CONTENT;
        }
        Ok(response)
    }
}

/// The bytes `span` of a file in memory.
pub(crate) fn part(bytes: Vec<u8>, span: Range<u64>) -> Body {
    let end = bytes.len() as u64;
    Body::from(Bytes::from(bytes).slice(span.start.min(end) as usize..span.end.min(end) as usize))
}

/// Why an answer could not be written: its client has left, which is nobody's fault, or ours.
pub(crate) fn unwritten(error: &io::Error) -> Problem {
    if error.kind() == io::ErrorKind::ConnectionAborted {
        return Problem::new(Kind::Unavailable, "nobody waits for the answer any more");
    }
    Problem::internal(error)
}

/// The JSON of an answer, as long as somebody waits for it.
///
/// # Errors
/// A problem: its client has left.
pub(crate) fn json(answer: &impl Serialize, wanted: &Wanted) -> Result<Vec<u8>, Problem> {
    let mut text = Vec::new();
    serde_json::to_writer(wanted.writer(&mut text), answer).map_err(|error| unwritten(&error.into()))?;
    Ok(text)
}

/// Whether `If-None-Match` names `etag`: the client has these bytes already.
#[must_use]
pub(crate) fn is_known(headers: &HeaderMap, etag: &str) -> bool {
    headers
        .get_all(header::IF_NONE_MATCH)
        .iter()
        .filter_map(|value| value.to_str().ok())
        .flat_map(|value| value.split(','))
        .map(str::trim)
        .any(|known| known == "*" || known.strip_prefix("W/").unwrap_or(known) == etag)
}

/// The single byte range asked for, clipped to `length`. Several ranges, other units and ranges that depend on
/// another version are answered with the whole, as RFC 9110 §14.2 permits.
fn span(headers: &HeaderMap, etag: &str, length: u64) -> Result<Option<Range<u64>>, Problem> {
    let Some(range) = headers.get(header::RANGE).and_then(|value| value.to_str().ok()) else {
        return Ok(None);
    };
    if headers.get(header::IF_RANGE).is_some_and(|condition| condition.as_bytes() != etag.as_bytes()) {
        return Ok(None);
    }
    let Some((first, last)) = range.strip_prefix("bytes=").and_then(|range| range.trim().split_once('-'))
    else {
        return Ok(None);
    };
    let number = |text: &str| text.trim().parse::<u64>().ok();
    let wanted = match (first.trim(), last.trim()) {
        ("", suffix) => match number(suffix) {
            Some(suffix) => length.saturating_sub(suffix)..length,
            None => return Ok(None),
        },
        (first, "") => match number(first) {
            Some(first) => first..length,
            None => return Ok(None),
        },
        (first, last) => match (number(first), number(last)) {
            (Some(first), Some(last)) if first <= last => first..last.saturating_add(1).min(length),
            _ => return Ok(None),
        },
    };
    if wanted.start < wanted.end {
        return Ok(Some(wanted));
    }
    Err(Problem::new(
        Kind::RangeNotSatisfiable,
        format!("the result has {length} bytes; `{range}` selects none"),
    )
    .with_header(header::CONTENT_RANGE, format!("bytes */{length}"))
    .with("length", length))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn headers(pairs: &[(header::HeaderName, &str)]) -> HeaderMap {
        pairs.iter().map(|(name, value)| (name.clone(), HeaderValue::from_str(value).unwrap())).collect()
    }

    fn wanted(range: &str) -> Option<Range<u64>> {
        span(&headers(&[(header::RANGE, range)]), "\"e\"", 100).unwrap()
    }

    #[test]
    fn ranges_from_the_front_the_back_and_the_middle_are_clipped_to_the_length() {
        assert_eq!(wanted("bytes=0-9"), Some(0..10));
        assert_eq!(wanted("bytes=90-"), Some(90..100));
        assert_eq!(wanted("bytes=90-1000"), Some(90..100));
        assert_eq!(wanted("bytes=-30"), Some(70..100));
        assert_eq!(wanted("bytes=-300"), Some(0..100));
    }

    #[test]
    fn what_is_not_a_single_byte_range_gets_the_whole() {
        for range in ["bytes=1-2,4-5", "rows=0-3", "bytes=x-y", "bytes=9-3", "bytes=", "bytes=-"] {
            assert_eq!(wanted(range), None, "{range}");
        }
    }

    #[test]
    fn a_range_that_selects_nothing_is_not_satisfiable() {
        for range in ["bytes=100-", "bytes=200-300", "bytes=-0"] {
            let problem = span(&headers(&[(header::RANGE, range)]), "\"e\"", 100).unwrap_err();
            assert_eq!(problem.kind(), Kind::RangeNotSatisfiable, "{range}");
        }
    }

    #[test]
    fn a_range_on_another_version_gets_the_whole() {
        let ask = |etag| {
            span(&headers(&[(header::RANGE, "bytes=0-9"), (header::IF_RANGE, etag)]), "\"e\"", 100).unwrap()
        };
        assert_eq!(ask("\"e\""), Some(0..10));
        assert_eq!(ask("\"f\""), None);
        assert_eq!(ask("W/\"e\""), None);
    }

    #[test]
    fn browsers_show_pictures_and_text_and_save_arrays() {
        for (offer, expected) in [
            (PNG, "inline; filename=\"x.png\""),
            (crate::http::wire::accept::NPY, "attachment; filename=\"x.npy\""),
        ] {
            let download = Download { offer, tag: "t".to_owned(), stem: "x".to_owned(), length: Some(1) };
            let answer = download
                .answer(&Method::GET, &HeaderMap::new(), Reservation::small(), |_| Body::from("1"))
                .unwrap();
            assert_eq!(answer.headers()[header::CONTENT_DISPOSITION], expected);
            assert_eq!(answer.headers()[header::X_CONTENT_TYPE_OPTIONS], "nosniff");
        }
    }

    #[test]
    fn known_bytes_are_recognized_in_a_list() {
        let known = |value| is_known(&headers(&[(header::IF_NONE_MATCH, value)]), "\"e\"");
        assert!(known("\"a\", \"e\""));
        assert!(known("W/\"e\""));
        assert!(known("*"));
        assert!(!known("\"a\""));
    }
}

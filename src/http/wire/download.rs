//! Serving a large result: validators, conditional requests and byte ranges (RFC 9110 §13, §14).
//!
//! Ours, since crates for ranges serve files: here the bytes of a range are made while they are sent.

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

/// The answer that a request for a result will get, known before the result is read.
#[derive(Debug, Clone)]
pub(crate) struct Plan<'a> {
    /// GET, HEAD or POST.
    pub method: &'a Method,
    /// The request's headers.
    pub headers: &'a HeaderMap,
    /// Decides the media type and the file name's ending.
    pub offer: Offer,
    /// Names these very bytes: the result never changes, so its identity and the arguments do.
    pub tag: String,
    /// File name without its ending.
    pub stem: String,
}

impl Plan<'_> {
    /// The answer to a client that has these bytes already (304).
    pub(crate) fn unchanged(&self) -> Option<Response> {
        is_known(self.headers, &self.etag()).then(|| {
            let mut response = StatusCode::NOT_MODIFIED.into_response();
            self.validate(&mut response);
            response
        })
    }

    /// The answer to a client that has these bytes already, or wants none (HEAD) of a length that is known only once
    /// they are made.
    pub(crate) fn without_work(&self) -> Option<Response> {
        self.without_bytes(None)
    }

    /// The same where the length may be known.
    pub(crate) fn without_bytes(&self, length: Option<u64>) -> Option<Response> {
        self.unchanged().or_else(|| {
            (self.method == Method::HEAD).then(|| {
                let body = match length {
                    Some(_) => Body::empty(),
                    // An empty body would be announced as one of no bytes.
                    None => Body::from_stream(stream::empty::<io::Result<Bytes>>()),
                };
                let mut response = Response::new(body);
                self.describe(&mut response);
                if let Some(length) = length {
                    Self::announce(&mut response, &(0..length));
                }
                response
            })
        })
    }

    /// The whole of `bytes`, or the range asked for.
    ///
    /// # Errors
    /// A problem when the range lies outside of the result.
    pub(crate) fn send(&self, reservation: Reservation, bytes: Vec<u8>) -> Result<Response, Problem> {
        let length = bytes.len() as u64;
        self.answer(Some(length), reservation, |span| part(bytes, span))
    }

    /// The answer: 304, 206, 416, or the whole. `body` makes the bytes of a range; it is not called for HEAD. The
    /// `length` of text may be unknown. The memory for what the bytes are made of is kept until the last one is taken.
    ///
    /// # Errors
    /// A problem when the range lies outside of the result.
    pub(crate) fn answer(
        &self,
        length: Option<u64>,
        reservation: Reservation,
        body: impl FnOnce(Range<u64>) -> Body,
    ) -> Result<Response, Problem> {
        self.content(length, body).map(|response| reservation.until_sent(response))
    }

    fn content(
        &self,
        length: Option<u64>,
        body: impl FnOnce(Range<u64>) -> Body,
    ) -> Result<Response, Problem> {
        if let Some(answer) = self.without_bytes(length) {
            return Ok(answer);
        }
        let Some(length) = length else {
            let mut response = Response::new(body(0..u64::MAX));
            self.describe(&mut response);
            return Ok(response);
        };
        let span = match *self.method {
            Method::GET => span(self.headers, &self.etag(), length)?,
            _ => None,
        };
        let wanted = span.clone().unwrap_or(0..length);
        let mut response = Response::new(body(wanted.clone()));
        self.describe(&mut response);
        Self::announce(&mut response, &wanted);
        if span.is_some() {
            let range = format!("bytes {}-{}/{length}", wanted.start, wanted.end - 1);
            if let Ok(range) = HeaderValue::from_str(&range) {
                response.headers_mut().insert(header::CONTENT_RANGE, range);
            }
            *response.status_mut() = StatusCode::PARTIAL_CONTENT;
        }
        Ok(response)
    }

    fn etag(&self) -> String {
        format!("\"{}-{}\"", self.tag, self.offer.name)
    }

    /// The headers of a representation, whatever part of it is sent.
    fn describe(&self, response: &mut Response) {
        let media_type = HeaderValue::from_static(self.offer.media_type());
        response.headers_mut().insert(header::CONTENT_TYPE, media_type);
        let kind = if SHOWN.contains(&self.offer) { "inline" } else { "attachment" };
        response.headers_mut().insert(header::X_CONTENT_TYPE_OPTIONS, HeaderValue::from_static("nosniff"));
        response.headers_mut().insert(header::CONTENT_SECURITY_POLICY, HeaderValue::from_static(POLICY));
        let disposition = format!("{kind}; filename=\"{}.{}\"", self.stem, self.offer.name);
        if let Ok(disposition) = HeaderValue::from_str(&disposition) {
            response.headers_mut().insert(header::CONTENT_DISPOSITION, disposition);
        }
        self.validate(response);
    }

    fn announce(response: &mut Response, sent: &Range<u64>) {
        response.headers_mut().insert(header::ACCEPT_RANGES, HeaderValue::from_static("bytes"));
        response.headers_mut().insert(header::CONTENT_LENGTH, HeaderValue::from(sent.end - sent.start));
    }

    fn validate(&self, response: &mut Response) {
        validate(response, &self.etag());
        response.headers_mut().insert(header::VARY, HeaderValue::from_static("accept"));
    }
}

/// The headers by which a client may keep an answer and ask whether it still holds.
fn validate(response: &mut Response, etag: &str) {
    if let Ok(etag) = HeaderValue::from_str(etag) {
        response.headers_mut().insert(header::ETAG, etag);
    }
    response.headers_mut().insert(header::CACHE_CONTROL, HeaderValue::from_static("private, no-cache"));
}

/// The bytes `span` of a file in memory.
fn part(bytes: Vec<u8>, span: Range<u64>) -> Body {
    let end = bytes.len() as u64;
    Body::from(Bytes::from(bytes).slice(span.start.min(end) as usize..span.end.min(end) as usize))
}

/// Why an answer could not be written: its client has left, which is nobody's fault, or ours.
pub(crate) fn unwritten(error: &io::Error) -> Problem {
    if error.kind() == io::ErrorKind::ConnectionAborted {
        return abandoned();
    }
    Problem::internal(error)
}

/// Why an answer was not made to its end.
pub(crate) fn abandoned() -> Problem {
    Problem::new(Kind::Unavailable, "the client has disconnected")
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
fn is_known(headers: &HeaderMap, etag: &str) -> bool {
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
            let headers = HeaderMap::new();
            let plan = Plan {
                method: &Method::GET,
                headers: &headers,
                offer,
                tag: "t".to_owned(),
                stem: "x".to_owned(),
            };
            let answer = plan.send(Reservation::small(), b"1".to_vec()).unwrap();
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

//! Text is sent compressed to who accepts it; arrays and pictures are not: their bytes can be asked for in parts.

use std::io;

use axum::body::{Body, Bytes, HttpBody};
use axum::extract::{Request, State};
use axum::http::{HeaderMap, HeaderValue, Method, StatusCode, header};
use axum::middleware::Next;
use axum::response::Response;
use futures_util::stream;

use super::compressed::{CompressedBody, Encoder};
use super::compression::Compression;
use super::memory::Reservation;
use crate::http::service::Shared;
use crate::store::Owner;

/// Bytes below which compression is not worth its head.
const BYTES_MIN: u64 = 1024;
/// Bytes of memory that an encoder of a body that is not small takes.
const ENCODER_BYTES: u64 = 2 << 20;
/// What is compressed.
const TEXT: [&str; 10] = [
    "application/json",
    "application/problem+json",
    "application/yaml",
    "image/svg+xml",
    "text/css",
    "text/csv",
    "text/html",
    "text/javascript",
    "text/x-matrix-market",
    "text/x-xyz",
];

/// Compresses answers of text by zstd or gzip, as long as there is memory for it.
pub(crate) async fn compress(State(service): State<Shared>, request: Request, next: Next) -> Response {
    let accepted = Compression::accepted(request.headers());
    let is_head = request.method() == Method::HEAD;
    let response = next.run(request).await;
    if !is_text(response.status(), response.headers()) {
        return response;
    }
    let mut response = vary(response);
    let Some(compression) = accepted else { return response };
    let length = response.body().size_hint().exact();
    let reservation = match length {
        _ if is_head => Some(Reservation::small()),
        Some(length) if length < BYTES_MIN => None,
        Some(length) if length <= CompressedBody::PROMPT_BYTES as u64 => Some(Reservation::small()),
        _ => service.memory.try_reserve(Owner::nobody(), ENCODER_BYTES),
    };
    let Some(reservation) = reservation else { return response };
    if is_head {
        describe(&mut response, compression);
        // Of no known length, as the compressed body: an empty one would be announced as one of no bytes.
        return response.map(|_| Body::from_stream(stream::empty::<io::Result<Bytes>>()));
    }
    let Ok(encoder) = Encoder::new(compression) else { return response };
    describe(&mut response, compression);
    response
        .map(|body| Body::new(CompressedBody::new(body, encoder, service.compressing.clone(), reservation)))
}

fn is_text(status: StatusCode, headers: &HeaderMap) -> bool {
    let value = |name| headers.get(name).and_then(|value: &HeaderValue| value.to_str().ok());
    let media_type = value(header::CONTENT_TYPE).and_then(|media_type| media_type.split(';').next());
    let is_small = value(header::CONTENT_LENGTH)
        .and_then(|length| length.parse::<u64>().ok())
        .is_some_and(|n| n < BYTES_MIN);
    status != StatusCode::PARTIAL_CONTENT
        && !is_small
        && media_type.is_some_and(|media_type| TEXT.contains(&media_type.trim()))
}

fn vary(mut response: Response) -> Response {
    response.headers_mut().append(header::VARY, HeaderValue::from_static("accept-encoding"));
    response
}

/// What the headers say of the bytes as they are does not hold of the compressed ones. Their tag is weak: a strong one
/// names the bytes without compression, of which parts can be had.
fn describe(response: &mut Response, compression: Compression) {
    let headers = response.headers_mut();
    headers.insert(header::CONTENT_ENCODING, HeaderValue::from_static(compression.name()));
    headers.remove(header::CONTENT_LENGTH);
    headers.remove(header::ACCEPT_RANGES);
    if let Some(tag) = headers.get(header::ETAG).and_then(|tag| tag.to_str().ok())
        && !tag.starts_with("W/")
        && let Ok(weak) = HeaderValue::from_str(&format!("W/{tag}"))
    {
        headers.insert(header::ETAG, weak);
    }
}

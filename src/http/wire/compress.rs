//! Compresses text if the client accepts it; arrays and images stay uncompressed so that byte ranges work.

use std::io;

use axum::body::{Body, Bytes, HttpBody};
use axum::extract::{Request, State};
use axum::http::{HeaderName, HeaderValue, Method, StatusCode, header};
use axum::middleware::Next;
use axum::response::Response;
use futures_util::stream;

use super::compressed::{CompressedBody, Compression, Encoder};
use super::memory::Reservation;
use super::service::Shared;
use crate::store::Owner;

/// Smaller bodies are not compressed.
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
    let length = value(&response, &header::CONTENT_LENGTH).and_then(|length| length.parse().ok());
    let length = length.or_else(|| response.body().size_hint().exact());
    if !is_text(&response) || length.is_some_and(|length| length < BYTES_MIN) {
        return response;
    }
    let mut response = vary(response);
    let Some(compression) = accepted else { return response };
    let is_prompt = length.is_some_and(|length| length <= CompressedBody::PROMPT_BYTES as u64);
    let reservation = if is_head || is_prompt {
        Some(Reservation::small())
    } else {
        service.memory.try_reserve(Owner::nobody(), ENCODER_BYTES)
    };
    let Some(reservation) = reservation else { return response };
    if is_head {
        describe(&mut response, compression);
        // Of no known length, as the compressed body: an empty one would be announced as one of no bytes.
        return response.map(|_| Body::from_stream(stream::empty::<io::Result<Bytes>>()));
    }
    let Ok(encoder) = Encoder::new(compression) else { return response };
    describe(&mut response, compression);
    response.map(|body| {
        Body::new(CompressedBody::new(body, encoder, service.pools.compressing.clone(), reservation))
    })
}

fn value<'a>(response: &'a Response, name: &HeaderName) -> Option<&'a str> {
    response.headers().get(name).and_then(|value| value.to_str().ok())
}

fn is_text(response: &Response) -> bool {
    let media_type = value(response, &header::CONTENT_TYPE).and_then(|value| value.split(';').next());
    response.status() != StatusCode::PARTIAL_CONTENT
        && media_type.is_some_and(|media_type| TEXT.contains(&media_type.trim()))
}

fn vary(mut response: Response) -> Response {
    response.headers_mut().append(header::VARY, HeaderValue::from_static("accept-encoding"));
    response
}

/// Length and ranges describe the uncompressed bytes, so they are removed. The `ETag` becomes weak: the strong one names the
/// uncompressed bytes, which support ranges.
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

//! Text is sent compressed to who accepts it; arrays and pictures are not: their bytes can be asked for in parts.

use axum::extract::Request;
use axum::http::{Extensions, HeaderMap, HeaderValue, StatusCode, Version, header};
use axum::middleware::Next;
use axum::response::Response;
use tower_http::compression::CompressionLayer;
use tower_http::compression::predicate::Predicate;

/// Bytes below which compression is not worth its head.
const BYTES_MIN: u64 = 1024;
/// What is compressed.
const TEXT: [&str; 8] = [
    "application/json",
    "application/problem+json",
    "application/yaml",
    "image/svg+xml",
    "text/csv",
    "text/html",
    "text/x-matrix-market",
    "text/x-xyz",
];

/// Compresses answers of text by gzip or zstd.
pub(crate) fn layer() -> CompressionLayer<impl Predicate> {
    CompressionLayer::new().compress_when(is_text)
}

fn is_text(status: StatusCode, _: Version, headers: &HeaderMap, _: &Extensions) -> bool {
    let value = |name| headers.get(name).and_then(|value: &HeaderValue| value.to_str().ok());
    let media_type = value(header::CONTENT_TYPE).and_then(|media_type| media_type.split(';').next());
    let is_small = value(header::CONTENT_LENGTH)
        .and_then(|length| length.parse::<u64>().ok())
        .is_some_and(|n| n < BYTES_MIN);
    status != StatusCode::PARTIAL_CONTENT
        && !is_small
        && media_type.is_some_and(|media_type| TEXT.contains(&media_type.trim()))
}

/// The tag of compressed bytes is weak: a strong one names the bytes without compression, of which parts can be had.
pub(crate) async fn weaken_tags(request: Request, next: Next) -> Response {
    let mut response = next.run(request).await;
    let headers = response.headers_mut();
    if headers.contains_key(header::CONTENT_ENCODING)
        && let Some(tag) = headers.get(header::ETAG).and_then(|tag| tag.to_str().ok())
        && !tag.starts_with("W/")
        && let Ok(weak) = HeaderValue::from_str(&format!("W/{tag}"))
    {
        headers.insert(header::ETAG, weak);
    }
    response
}

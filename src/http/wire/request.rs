//! Around every request: its id, its line in the log, and the completion of problems.

use std::time::Instant;

use axum::body::HttpBody;
use axum::extract::{MatchedPath, Request};
use axum::http::{HeaderMap, HeaderName, HeaderValue, header};
use axum::middleware::Next;
use axum::response::Response;
use uuid::Uuid;

use super::problem::{Kind, Problem};
use crate::store::Owner;

/// Carries the request's id, both ways.
pub(crate) const REQUEST_ID: HeaderName = HeaderName::from_static("x-request-id");

/// Marks an answer that was given before.
pub(crate) const REPLAYED: HeaderName = HeaderName::from_static("idempotency-replayed");

/// Longest id that a client may choose.
const REQUEST_ID_LENGTH_MAX: usize = 128;

/// Gives the request an id, logs it, and completes a [`Problem`] into its document.
pub(crate) async fn identify(request: Request, next: Next) -> Response {
    let started = Instant::now();
    let id = chosen_by_client(request.headers()).unwrap_or_else(|| Uuid::now_v7().to_string());
    let method = request.method().clone();
    let received = request.body().size_hint().exact();
    let path = request.uri().path().to_owned();
    let route = request
        .extensions()
        .get::<MatchedPath>()
        .map_or_else(|| "(none)".to_owned(), |matched| matched.as_str().to_owned());

    let span = tracing::info_span!("request", id);
    let mut response = tracing::Instrument::instrument(next.run(request), span).await;

    let problem = response.extensions_mut().remove::<Problem>();
    if let Some(problem) = &problem {
        problem.render(&path, &id, &mut response);
    }
    response.headers_mut().insert(header::X_CONTENT_TYPE_OPTIONS, HeaderValue::from_static("nosniff"));
    if let Ok(value) = HeaderValue::from_str(&id) {
        response.headers_mut().insert(REQUEST_ID, value);
    }
    let milliseconds = started.elapsed().as_secs_f64() * 1e3;
    let milliseconds = (milliseconds * 1e3).round() / 1e3;
    if problem.is_some_and(|problem| problem.kind() == Kind::Interrupted) {
        tracing::info!(%method, route, milliseconds, id, "the client left before its request was whole");
    } else {
        let status = response.status().as_u16();
        let owner = response.extensions().get::<Owner>().map(Owner::name).unwrap_or_default();
        let bytes = response.body().size_hint().exact();
        tracing::info!(%method, route, status, owner, received, bytes, milliseconds, id, "answered");
    }
    response
}

/// The client's own id, if it is short and printable enough to be put into logs and headers.
fn chosen_by_client(headers: &HeaderMap) -> Option<String> {
    let id = headers.get(REQUEST_ID)?.to_str().ok()?;
    let sane = (1..=REQUEST_ID_LENGTH_MAX).contains(&id.len())
        && id.bytes().all(|b| b.is_ascii_alphanumeric() || b"-_.:/+=".contains(&b));
    sane.then(|| id.to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn chosen(id: &'static str) -> Option<String> {
        chosen_by_client(&HeaderMap::from_iter([(REQUEST_ID, HeaderValue::from_static(id))]))
    }

    #[test]
    fn a_sane_id_is_honored_and_a_strange_one_is_not() {
        assert_eq!(chosen("abc-123").as_deref(), Some("abc-123"));
        assert_eq!(chosen("two words"), None);
        assert_eq!(chosen("quote\"d"), None);
        assert_eq!(chosen(""), None);
    }

    #[test]
    fn an_id_over_the_limit_is_not_honored() {
        let header = |length: usize| {
            HeaderMap::from_iter([(REQUEST_ID, HeaderValue::from_str(&"a".repeat(length)).unwrap())])
        };
        assert!(chosen_by_client(&header(REQUEST_ID_LENGTH_MAX)).is_some());
        assert!(chosen_by_client(&header(REQUEST_ID_LENGTH_MAX + 1)).is_none());
    }
}

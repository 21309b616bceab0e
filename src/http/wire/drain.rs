//! Reads on for a little after an early error, so that the answer reaches a client that is still sending.
//!
//! A connection closed with unread bytes is reset, and the client loses the answer that was on its way.

use std::pin::Pin;
use std::sync::{Arc, Mutex, PoisonError};
use std::task::{Context, Poll};
use std::time::Duration;

use axum::body::{Body, Bytes, HttpBody};
use axum::extract::Request;
use axum::http::header;
use axum::middleware::Next;
use axum::response::Response;

/// Bytes read and thrown away at most.
const DRAIN_BYTES: usize = 32 << 20;
/// Time spent on it at most.
const DRAIN_TIME: Duration = Duration::from_secs(5);

/// Drains the rest of the body after an error, within limits.
pub(crate) async fn after_errors(request: Request, next: Next) -> Response {
    let asks_first = request.headers().contains_key(header::EXPECT);
    let (parts, body) = request.into_parts();
    let shared = Arc::new(Mutex::new(Rest { body, begun: false }));
    let request = Request::from_parts(parts, Body::new(Shared(Arc::clone(&shared))));
    let response = next.run(request).await;
    let failed = response.status().is_client_error() || response.status().is_server_error();
    // A client that waits for "100 Continue" has sent nothing yet and will not.
    let unsent = asks_first && !shared.lock().unwrap_or_else(PoisonError::into_inner).begun;
    if failed && !unsent {
        let _ = tokio::time::timeout(DRAIN_TIME, drain(Shared(shared))).await;
    }
    response
}

async fn drain(mut body: Shared) {
    let mut left = DRAIN_BYTES;
    while let Some(Ok(frame)) = std::future::poll_fn(|cx| Pin::new(&mut body).poll_frame(cx)).await {
        let Some(rest) = left.checked_sub(frame.data_ref().map_or(0, Bytes::len)) else { return };
        left = rest;
    }
}

struct Rest {
    body: Body,
    begun: bool,
}

/// The request's body, of which the middleware keeps a handle.
struct Shared(Arc<Mutex<Rest>>);

impl HttpBody for Shared {
    type Data = Bytes;
    type Error = axum::Error;

    fn poll_frame(
        self: Pin<&mut Self>,
        cx: &mut Context<'_>,
    ) -> Poll<Option<Result<hyper::body::Frame<Bytes>, axum::Error>>> {
        let mut rest = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        rest.begun = true;
        Pin::new(&mut rest.body).poll_frame(cx)
    }

    fn is_end_stream(&self) -> bool {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).body.is_end_stream()
    }

    fn size_hint(&self) -> hyper::body::SizeHint {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).body.size_hint()
    }
}

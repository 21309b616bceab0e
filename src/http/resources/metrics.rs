//! `GET /metrics`, and what is measured around every request.

use std::pin::Pin;
use std::sync::Arc;
use std::task::{Context, Poll};
use std::time::Instant;

use axum::body::{Body, Bytes, HttpBody};
use axum::extract::{MatchedPath, Request, State};
use axum::http::{Method, header};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};
use hyper::body::{Frame, SizeHint};

use crate::http::wire::problem::{Problem, ProblemDocument};
use crate::http::wire::service::Shared;
use crate::metrics::{self, Gauges, Metrics};
use crate::store::JobState;

/// All states, so that one without jobs is reported as 0.
const STATES: [JobState; 5] =
    [JobState::Queued, JobState::Running, JobState::Succeeded, JobState::Failed, JobState::Canceled];

/// Counts the request, its time and its answer's bytes.
pub(crate) async fn measure(State(metrics): State<Arc<Metrics>>, request: Request, next: Next) -> Response {
    let started = Instant::now();
    let method = known(request.method());
    let route = request.extensions().get::<MatchedPath>();
    let route = route.map_or("none", MatchedPath::as_str).to_owned();
    let response = next.run(request).await;
    let status = response.status().as_u16();
    metrics.answered(&metrics::Request { method, route, status }, started.elapsed().as_secs_f64());
    response.map(|body| Body::new(Counted { body, metrics }))
}

/// A client may make methods up; labels are not for it to choose.
fn known(method: &Method) -> &'static str {
    match *method {
        Method::GET => "GET",
        Method::HEAD => "HEAD",
        Method::POST => "POST",
        Method::PUT => "PUT",
        Method::DELETE => "DELETE",
        Method::OPTIONS => "OPTIONS",
        _ => "other",
    }
}

/// An answer's body, counted as it goes out.
struct Counted {
    body: Body,
    metrics: Arc<Metrics>,
}

impl HttpBody for Counted {
    type Data = Bytes;
    type Error = axum::Error;

    fn poll_frame(
        mut self: Pin<&mut Self>,
        cx: &mut Context<'_>,
    ) -> Poll<Option<Result<Frame<Bytes>, axum::Error>>> {
        let frame = Pin::new(&mut self.body).poll_frame(cx);
        if let Poll::Ready(Some(Ok(frame))) = &frame {
            self.metrics.sent(frame.data_ref().map_or(0, Bytes::len) as u64);
        }
        frame
    }

    fn is_end_stream(&self) -> bool {
        self.body.is_end_stream()
    }

    fn size_hint(&self) -> SizeHint {
        self.body.size_hint()
    }
}

/// Counters and histograms for Prometheus.
///
/// Jobs by state, time in the queue and in every phase, requests by route and status, bytes, memory and disk.
#[utoipa::path(
    get,
    path = "/metrics",
    tag = "service",
    responses(
        (status = 200, description = "OpenMetrics text.", body = String, content_type = "application/openmetrics-text"),
        (status = 500, description = "The database cannot be read.", body = ProblemDocument, content_type = "application/problem+json"),
    )
)]
pub(crate) async fn metrics(State(service): State<Shared>) -> Result<Response, Problem> {
    let counted = service.store.jobs_by_state().await?;
    let jobs = STATES.map(|state| (state.name(), counted.get(&state).copied().unwrap_or(0)));
    let space = service.store.space().await?;
    let gauges = Gauges {
        jobs: jobs.to_vec(),
        job_memory: service.jobs.memory_taken(),
        body_memory: service.memory.taken(),
        oldest_queued_seconds: service.store.oldest_queued_seconds().await?,
        disk_free: space.disk_free,
        node: service.store.node().to_string(),
        database_file: space.file,
        database_free: space.free_pages,
    };
    let text = service.metrics.text(&gauges).map_err(|error| Problem::internal(&error))?;
    Ok(([(header::CONTENT_TYPE, metrics::MEDIA_TYPE)], text).into_response())
}

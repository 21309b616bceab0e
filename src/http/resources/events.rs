//! `GET /jobs/{id}/events`: a job's state and progress as they change.

use std::convert::Infallible;
use std::sync::Arc;
use std::time::Duration;

use axum::extract::{Path, State};
use axum::http::{HeaderMap, StatusCode};
use axum::response::sse::{Event, KeepAlive, Sse};
use axum::response::{IntoResponse, Response};
use futures_util::stream;
use tokio::sync::watch;
use utoipa::ToSchema;

use super::jobs::JobView;
use crate::http::wire::notation::{parse_id, short_digest};
use crate::http::wire::problem::Problem;
use crate::http::wire::problem_sets::JobProblems;
use crate::http::wire::query::FromQuery;
use crate::http::wire::retry;
use crate::http::wire::service::Shared;
use crate::http::wire::waiting_places::WaitingPlace;
use crate::store::JobRecord;

/// Pause after which a comment shows that the connection lives.
const KEEP_ALIVE: Duration = Duration::from_secs(15);

/// One server-sent event.
#[derive(Debug, ToSchema)]
#[allow(dead_code)] // names the answer in the OpenAPI document
pub(crate) struct JobEvent {
    /// Names this state of the job: what `Last-Event-ID` repeats.
    id: String,
    /// `progress`, or the state that the job ended in.
    event: String,
    /// Milliseconds after which to connect again.
    retry: u64,
    /// The job as of `GET /jobs/{id}`, in JSON.
    data: String,
}

/// A job's state and progress as server-sent events.
///
/// Events are named `progress` until the job ends, then by its final state (`succeeded`, `failed`, `canceled`), and the
/// stream closes. The data equals `GET /jobs/{id}`. Half of the connections are for the streams and waits of any one key: beyond, a
/// stream closes after its first event, and `?wait=` answers at once. A client that reconnects with `Last-Event-ID` gets only news; 204 if it
/// already has the final event.
#[utoipa::path(
    get,
    path = "/jobs/{id}/events",
    operation_id = "job_events",
    tag = "jobs",
    params(
        ("id" = Uuid, Path, description = "The job."),
        ("Last-Event-ID" = Option<String>, Header, description = "The id of the last event that the client has."),
    ),
    responses(
        (status = 200, description = "The events.", body = JobEvent, content_type = "text/event-stream"),
        (status = 204, description = "The client knows how the job ended."),
        JobProblems,
    )
)]
pub(crate) async fn events(
    State(service): State<Shared>,
    Path(id): Path<String>,
    FromQuery(()): FromQuery<()>,
    headers: HeaderMap,
) -> Result<Response, Problem> {
    let id = parse_id(&id)?;
    let known = headers.get("last-event-id").and_then(|value| value.to_str().ok()).map(str::to_owned);
    let jobs = service.store.follow(id).await?;
    let job = Arc::clone(&jobs.borrow());
    if job.state.is_terminal() && known.as_deref() == Some(name(&job).as_str()) {
        return Ok(StatusCode::NO_CONTENT.into_response());
    }
    let place = service.waiting.take(&job.owner);
    let follow = Follow { service, jobs, known, has_ended: false, place };
    let stream = stream::unfold(follow, |mut follow| async {
        let event = follow.next().await?;
        Some((Ok::<Event, Infallible>(event), follow))
    });
    Ok(Sse::new(stream).keep_alive(KeepAlive::new().interval(KEEP_ALIVE)).into_response())
}

/// Names a state of a job: the same for the same state and progress, also after a restart.
fn name(job: &JobRecord) -> String {
    let state = (job.state, job.attempt, job.phase, job.progress.to_bits(), job.queue_position);
    short_digest(&serde_json::to_vec(&state).unwrap_or_default())
}

struct Follow {
    service: Shared,
    jobs: watch::Receiver<Arc<JobRecord>>,
    known: Option<String>,
    has_ended: bool,
    /// Without one the stream ends after its first event, and its client connects again after a while.
    place: Option<WaitingPlace>,
}

impl Follow {
    /// The next event; `None` after the job's end, when the job is deleted, and when the service stops.
    async fn next(&mut self) -> Option<Event> {
        while !self.has_ended {
            let job = Arc::clone(&self.jobs.borrow_and_update());
            let name = name(&job);
            if self.known.as_ref() != Some(&name) {
                let is_terminal = job.state.is_terminal();
                self.has_ended = is_terminal || self.place.is_none();
                let called = if is_terminal { job.state.name() } else { "progress" };
                let event = Event::default()
                    .id(&name)
                    .event(called)
                    .retry(Duration::from_secs(retry::EVENTS_SECONDS));
                self.known = Some(name);
                return event.json_data(JobView::new(&job)).ok();
            }
            if job.state.is_terminal() || self.place.is_none() {
                return None;
            }
            tokio::select! {
                changed = self.jobs.changed() => changed.ok()?,
                () = self.service.stopping.cancelled() => return None,
            }
        }
        None
    }
}

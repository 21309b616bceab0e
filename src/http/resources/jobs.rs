//! Jobs: listing, showing, waiting, canceling, deleting.

use std::collections::BTreeMap;

use axum::Json;
use axum::extract::{Path, State};
use axum::http::{Extensions, HeaderMap, HeaderValue, Method, StatusCode, header};
use axum::response::{IntoResponse, Response};
use serde::{Serialize, Serializer};
use utoipa::ToSchema;
use uuid::Uuid;

use super::files;
use crate::analysis::{JobKind, Parameters, seconds_left};
use crate::arguments::{arguments, groups};
use crate::http::paging::Paging;
use crate::http::wait::{Wait, wait_until_ended};
use crate::http::wire::accept::JSON;
use crate::http::wire::download::Plan;
use crate::http::wire::memory::Reservation;
use crate::http::wire::notation::{parse_id, short_digest, timestamp};
use crate::http::wire::owners;
use crate::http::wire::problem::{Problem, ProblemDocument};
use crate::http::wire::problem_sets::{JobProblems, QueryProblem};
use crate::http::wire::query::FromQuery;
use crate::http::wire::retry;
use crate::http::wire::service::Shared;
use crate::progress::Phase;
use crate::store::{JobRecord, JobState, Owner, Page, StoreError};

/// No ETA is given below this fraction of the work.
const FORESEEABLE_FROM: f64 = 0.02;

arguments! {
    /// Which jobs are listed.
    #[derive(Debug)]
    pub(crate) struct Selection {
        /// Only jobs in this state.
        state: Option<JobState> = word(JobState), absent "all";
        /// Only jobs on this cloud.
        #[alias = "cloud_id"]
        cloud: Option<Uuid> = id(Uuid), absent "all";
    }
}

groups! {
    /// Query of `GET /jobs`.
    #[derive(Debug)]
    pub(crate) struct ListJobs {
        /// Which.
        selection: Selection,
        /// By pages.
        paging: Paging,
    }
}

/// A job as the interface shows it.
#[derive(Debug, Serialize, ToSchema)]
#[schema(as = Job)]
pub(crate) struct JobView {
    /// Its id.
    id: Uuid,
    /// The cloud it analyzes.
    cloud_id: Uuid,
    /// What the cloud's file was called; null when the upload did not say.
    cloud_name: Option<String>,
    /// What it computes.
    kind: JobKind,
    /// Where it is in its life.
    state: JobState,
    /// The phase it is in or ended in; null before its first attempt.
    phase: Option<Phase>,
    /// Share of the work that is done, 0 to 1; it never decreases within an attempt. Where the computation reports nothing
    /// for a second it is extrapolated, never beyond its phase.
    progress: f64,
    /// Estimated seconds to the end, the storing of the result included; null when it cannot be estimated.
    eta_seconds: Option<f64>,
    /// Jobs that are queued before it; null unless queued.
    queue_position: Option<u64>,
    /// Attempts so far.
    attempt: u32,
    /// Parameters as used: those submitted, and once the job has succeeded also those derived from the cloud.
    #[schema(value_type = Object)]
    parameters: Parameters,
    /// What to know before trusting the result.
    warnings: Vec<String>,
    /// Why it failed; null unless failed.
    error: Option<ProblemDocument>,
    /// When it was submitted, RFC 3339.
    #[schema(format = DateTime)]
    created: String,
    /// When its last attempt began, RFC 3339.
    #[schema(format = DateTime)]
    started: Option<String>,
    /// When it ended, RFC 3339.
    #[schema(format = DateTime)]
    finished: Option<String>,
    /// Seconds spent in each phase of the last attempt, in order.
    #[schema(value_type = BTreeMap<String, f64>)]
    #[serde(serialize_with = "by_name")]
    phase_seconds: Vec<(Phase, f64)>,
    /// Where its results and its cloud are.
    links: BTreeMap<&'static str, String>,
}

impl JobView {
    /// Of a record.
    #[must_use]
    pub(crate) fn new(job: &JobRecord) -> Self {
        Self {
            id: job.id,
            cloud_id: job.cloud_id,
            cloud_name: job.cloud_name.clone(),
            kind: job.kind,
            state: job.state,
            phase: job.phase,
            progress: job.progress,
            eta_seconds: eta_seconds(job),
            queue_position: job.queue_position,
            attempt: job.attempt,
            parameters: parameters_as_used(job),
            warnings: job.report.as_ref().map(|report| report.warnings.clone()).unwrap_or_default(),
            error: job.failure.as_ref().map(|failure| Problem::from(failure).document(None, None)),
            created: timestamp(job.created),
            started: job.started.map(timestamp),
            finished: job.finished.map(timestamp),
            phase_seconds: job.phase_seconds.clone(),
            links: links(job),
        }
    }
}

/// Seconds to the end, as of the last beat; only while running.
fn eta_seconds(job: &JobRecord) -> Option<f64> {
    let phase = job.phase.filter(|_| job.state == JobState::Running && job.progress >= FORESEEABLE_FROM)?;
    let of = (job.kind, &job.parameters, job.points as usize);
    let seconds = seconds_left(of, phase, job.progress, &job.phase_seconds)?;
    Some((seconds * 10.0).round() / 10.0)
}

/// The parameters as used, as far as they are known.
fn parameters_as_used(job: &JobRecord) -> Parameters {
    job.report.as_ref().map_or_else(|| job.parameters.clone(), |report| job.parameters.as_used(report))
}

fn by_name<S: Serializer>(phases: &[(Phase, f64)], serializer: S) -> Result<S::Ok, S::Error> {
    serializer.collect_map(phases.iter().map(|(phase, seconds)| (phase.name(), seconds)))
}

/// Where a job's results are, by their names.
pub(super) fn result_links(job: &JobRecord) -> BTreeMap<&'static str, String> {
    let results =
        files::NAMED.iter().filter(|result| job.kind == JobKind::Eigen || result.name == "operator");
    results.map(|result| (result.name, format!("/jobs/{}/{}", job.id, result.name))).collect()
}

fn links(job: &JobRecord) -> BTreeMap<&'static str, String> {
    let path = format!("/jobs/{}", job.id);
    let mut links = result_links(job);
    links.extend([("cloud", format!("/clouds/{}", job.cloud_id)), ("events", format!("{path}/events"))]);
    if !job.state.is_terminal() {
        links.insert("cancel", format!("{path}/cancel"));
    }
    links.insert("self", path);
    links
}

/// A page of jobs, newest first.
#[derive(Debug, Serialize, ToSchema)]
pub(crate) struct JobPage {
    /// The jobs.
    jobs: Vec<JobView>,
    /// Pass it as `cursor` for the next page; null on the last.
    next: Option<Uuid>,
}

/// Jobs, newest first.
#[utoipa::path(
    get,
    path = "/jobs",
    operation_id = "list_jobs",
    tag = "jobs",
    params(FromQuery<ListJobs>),
    responses(
        (status = 200, description = "A page.", body = JobPage),
        QueryProblem,
    )
)]
pub(crate) async fn list(
    State(service): State<Shared>,
    FromQuery(ListJobs { selection, paging }): FromQuery<ListJobs>,
    extensions: Extensions,
) -> Result<Json<JobPage>, Problem> {
    let owner = owners::owner(&extensions);
    let Selection { state, cloud } = selection;
    let (cursor, limit) = (paging.cursor, paging.limit as u32);
    let Page { items, next } = service.store.jobs(&owner, state, cloud, cursor, limit).await?;
    if let Some(id) = cloud.filter(|_| items.is_empty()) {
        refuse_job(&service, &owner, id).await?;
    }
    Ok(Json(JobPage { jobs: items.iter().map(JobView::new).collect(), next }))
}

/// The id of a job lists nothing, as a cloud without jobs does: whoever took one for the other is told.
async fn refuse_job(service: &Shared, owner: &Owner, id: Uuid) -> Result<(), Problem> {
    if !service.store.owns(owner, id).await? {
        return Ok(());
    }
    match service.store.job(id).await {
        Ok(job) => {
            let told = format!("parameter `cloud`: {id} is a job, on the cloud {}", job.cloud_id);
            Err(Problem::invalid("cloud", told).with("near", vec![format!("/jobs?cloud={}", job.cloud_id)]))
        }
        Err(StoreError::NotFound) => Ok(()),
        Err(error) => Err(error.into()),
    }
}

/// A job: state, progress, parameters as used.
///
/// `?wait=N` answers when the job has ended, or after N seconds.
#[utoipa::path(
    get,
    path = "/jobs/{id}",
    operation_id = "show_job",
    tag = "jobs",
    params(("id" = Uuid, Path, description = "The job."), FromQuery<Wait>),
    responses(
        (status = 200, description = "The job.", body = JobView, headers(("Retry-After" = u64, description = "Seconds, while the job has not ended."), ("ETag" = String, description = "Identifies this state."))),
        (status = 304, description = "The client's copy is current."),
        JobProblems,
    )
)]
pub(crate) async fn show(
    State(service): State<Shared>,
    Path(id): Path<String>,
    FromQuery(wait): FromQuery<Wait>,
    method: Method,
    headers: HeaderMap,
) -> Result<Response, Problem> {
    let job = wait_until_ended(&service, parse_id(&id)?, wait.time()).await?;
    let body = serde_json::to_vec(&JobView::new(&job)).map_err(|error| Problem::internal(&error))?;
    let (tag, stem) = (short_digest(&body), format!("job-{}", job.id));
    let plan = Plan { method: &method, headers: &headers, offer: JSON, tag, stem };
    let mut response = plan.send(Reservation::small(), body)?;
    if !job.state.is_terminal() {
        response.headers_mut().insert(header::RETRY_AFTER, HeaderValue::from(retry::JOB_SECONDS));
    }
    Ok(response)
}

/// Asks a job to end without a result.
///
/// A queued job ends at once, a running one within a second or so.
#[utoipa::path(
    post,
    path = "/jobs/{id}/cancel",
    operation_id = "cancel_job",
    tag = "jobs",
    params(("id" = Uuid, Path, description = "The job.")),
    responses(
        (status = 200, description = "It has ended, canceled or otherwise.", body = JobView),
        (status = 202, description = "It will end soon.", body = JobView),
        JobProblems,
    )
)]
pub(crate) async fn cancel(
    State(service): State<Shared>,
    Path(id): Path<String>,
    FromQuery(()): FromQuery<()>,
) -> Result<Response, Problem> {
    let job = service.store.request_cancel(parse_id(&id)?).await?;
    let status = if job.state.is_terminal() { StatusCode::OK } else { StatusCode::ACCEPTED };
    Ok((status, Json(JobView::new(&job))).into_response())
}

/// Deletes a job with its results.
///
/// A queued job is deleted at once. A running job is canceled and deleted when its attempt ends, within a second or so (202).
#[utoipa::path(
    delete,
    path = "/jobs/{id}",
    operation_id = "delete_job",
    tag = "jobs",
    params(("id" = Uuid, Path, description = "The job.")),
    responses(
        (status = 204, description = "Deleted."),
        (status = 202, description = "Cancellation requested; it is deleted when it ends.", body = JobView),
        JobProblems,
    )
)]
pub(crate) async fn delete(
    State(service): State<Shared>,
    Path(id): Path<String>,
    FromQuery(()): FromQuery<()>,
) -> Result<Response, Problem> {
    let id = parse_id(&id)?;
    if service.store.delete_job(id).await? {
        return Ok(StatusCode::NO_CONTENT.into_response());
    }
    let job = service.store.job(id).await?;
    Ok((StatusCode::ACCEPTED, Json(JobView::new(&job))).into_response())
}

//! Submitting: a cloud with a job on it, or a further job on a stored cloud.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Duration;

use axum::Json;
use axum::extract::{Path, State};
use axum::http::{HeaderName, HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Response};
use serde::Serialize;
use utoipa::ToSchema;

use super::cloud_name;
use super::clouds::CloudView;
use super::idempotency::{self, Idempotency, IdempotencyKey};
use super::jobs;
use super::jobs::JobView;
use crate::analysis::{Examined, JobKind, Parameters, Task};
use crate::arguments::{self, Argument, Arguments, arguments, groups};
use crate::cloud::PointCloud;
use crate::cloud::reader::{self, Format, ReadOptions, ReadRequest};
use crate::http::wait::{preferred_wait, wait_until_ended};
use crate::http::wire::body::IncomingBody;
use crate::http::wire::problem::Problem;
use crate::http::wire::problem_sets::UploadProblems;
use crate::http::wire::query::FromQuery;
use crate::http::wire::retry;
use crate::http::wire::service::{Service, Shared};
use crate::http::wire::upload::Upload;
use crate::store::{Owner, Submitted};

arguments! {
    /// What follows an upload.
    #[derive(Debug, Clone, Copy)]
    pub(crate) struct Analyze {
        /// Queue a job on the cloud. `false` only stores it.
        #[alias = "analyze"]
        analyze: bool = switch, default true;
    }
}

groups! {
    /// How an upload is read, and what follows.
    #[derive(Debug)]
    pub(crate) struct ReadUpload {
        /// Read how.
        reading: ReadRequest,
        /// What follows.
        analyze: Analyze,
    }
}

/// Parameters, and whether the number of bases is the client's own choice.
#[derive(Debug, Default)]
pub(crate) struct Chosen {
    parameters: Parameters,
    pub(super) is_bases_given: bool,
}

impl Arguments for Chosen {
    fn table() -> Vec<Argument> {
        Parameters::table()
    }

    fn set(&mut self, name: &str, value: &arguments::Value) -> bool {
        self.is_bases_given |= name == "bases";
        self.parameters.set(name, value)
    }
}

groups! {
    /// What a job computes, and how.
    #[derive(Debug)]
    pub(crate) struct JobArguments {
        /// What.
        task: Task,
        /// How.
        parameters: Chosen,
    }
}

groups! {
    /// Query of `POST /clouds`.
    #[derive(Debug)]
    pub(crate) struct SubmitCloud {
        /// Its name.
        naming: cloud_name::Naming,
        /// The upload.
        upload: ReadUpload,
        /// The job.
        job: JobArguments,
    }
}

impl JobArguments {
    /// Kind and parameters, checked as far as that goes without a cloud; a number of bases that nobody named is within what
    /// the service computes.
    ///
    /// # Errors
    /// A problem that names the parameter and what would be accepted.
    pub(super) fn checked(self, bases_max: usize) -> Result<(JobKind, Parameters), Problem> {
        let Chosen { mut parameters, is_bases_given } = self.parameters;
        if !is_bases_given {
            parameters.bases = parameters.bases.min(bases_max);
        }
        parameters.check()?;
        Ok((self.task.kind, parameters))
    }
}

/// Bytes of memory that storing a cloud takes beside it: a few chunks, cut and written.
const STORED_AT_ONCE: u64 = 8 << 20;

/// What is queued on a cloud.
type Job = (JobKind, Parameters);

/// The result of a submission.
#[derive(Debug, Serialize, ToSchema)]
pub(crate) struct Submission {
    /// The cloud.
    cloud: CloudView,
    /// The job; null with `analyze=false`.
    job: Option<JobView>,
    /// Where both are, and the results will be.
    links: BTreeMap<&'static str, String>,
}

/// The answers to an upload, declared once for the OpenAPI document.
#[derive(utoipa::IntoResponses)]
#[allow(dead_code)] // handlers answer with `Submission` itself
pub(crate) enum Uploaded {
    /// Stored and queued.
    #[response(status = 202, headers(("Location" = String, description = "The job."), ("Retry-After" = u64, description = "Seconds.")))]
    Queued(Submission),
    /// The same analysis of the same cloud is there already.
    #[response(status = 200)]
    Known(Submission),
    /// Stored only (`analyze=false`).
    #[response(status = 201, headers(("Location" = String, description = "The cloud.")))]
    Stored(Submission),
}

/// A form whose first file is the cloud.
#[derive(Debug, ToSchema)]
#[allow(dead_code)] // names the request body in the OpenAPI document
pub(crate) struct CloudForm {
    /// The file of points.
    #[schema(value_type = String, format = Binary)]
    file: Vec<u8>,
}

/// Uploads a cloud and queues a job on it.
///
/// The body is the file itself, or multipart/form-data with the file as its first file part. The same content is stored
/// once; the same analysis of it is answered with the job that is already there.
#[utoipa::path(
    post,
    path = "/clouds",
    tag = "clouds",
    params(FromQuery<SubmitCloud>, IdempotencyKey),
    request_body(content((String = "application/octet-stream"), (CloudForm = "multipart/form-data")), description = "The file."),
    responses(
        Uploaded,
        UploadProblems,
    )
)]
pub(crate) async fn post_cloud(
    State(service): State<Shared>,
    FromQuery(asked): FromQuery<SubmitCloud>,
    body: IncomingBody,
) -> Result<Response, Problem> {
    receive(&service, asked, body, None).await
}

/// Uploads a cloud: the same as POST, for `curl -T`.
#[utoipa::path(
    put,
    path = "/clouds",
    tag = "clouds",
    params(FromQuery<SubmitCloud>, IdempotencyKey),
    request_body(content((String = "application/octet-stream"), (CloudForm = "multipart/form-data")), description = "The file."),
    responses(
        Uploaded,
        UploadProblems,
    )
)]
pub(crate) async fn put_cloud(
    State(service): State<Shared>,
    FromQuery(asked): FromQuery<SubmitCloud>,
    body: IncomingBody,
) -> Result<Response, Problem> {
    receive(&service, asked, body, None).await
}

/// Uploads a cloud with its file name, as `curl -T scan.ply http://HOST/clouds/` does.
///
/// The name only helps to tell the format; the cloud gets an id of its own.
#[utoipa::path(
    put,
    path = "/clouds/{id}",
    tag = "clouds",
    params(("id" = String, Path, description = "The file's name."), FromQuery<SubmitCloud>, IdempotencyKey),
    request_body(content((String = "application/octet-stream")), description = "The file."),
    responses(
        Uploaded,
        UploadProblems,
    )
)]
pub(crate) async fn put_cloud_named(
    State(service): State<Shared>,
    Path(file_name): Path<String>,
    FromQuery(asked): FromQuery<SubmitCloud>,
    body: IncomingBody,
) -> Result<Response, Problem> {
    receive(&service, asked, body, Some(file_name)).await
}

/// The replayed answer to a request with a known idempotency key.
pub(super) async fn replayed(
    service: &Service,
    owner: &Owner,
    key: &Idempotency,
    wait: Option<Duration>,
) -> Result<Option<Response>, Problem> {
    let Some(submitted) = key.replayed(&service.store, owner).await? else { return Ok(None) };
    let mut response = answer(service, submitted, wait).await?;
    idempotency::mark(&mut response);
    Ok(Some(response))
}

async fn receive(
    service: &Service,
    asked: SubmitCloud,
    body: IncomingBody,
    file_name: Option<String>,
) -> Result<Response, Problem> {
    let SubmitCloud { naming, upload: ReadUpload { reading, analyze }, job } = asked;
    let lowers = !job.parameters.is_bases_given;
    let (kind, parameters) = job.checked(service.limits.bases_max)?;
    let (parts, owner) = (body.parts().clone(), body.owner());
    let wait = preferred_wait(&parts.headers);
    let (mut upload, mut reservation) = Upload::receive(service, body).await?;
    upload.file_name = upload.file_name.or(file_name);
    let named = upload.bytes.clone();
    let key = move || Idempotency::of(&parts.headers, &parts.uri, &named);
    let key = service.pools.reading.run(key).await??;
    if let Some(answered) = replayed(service, &owner, &key, wait).await? {
        return Ok(answered);
    }
    let name = cloud_name::of(naming.name.as_deref(), upload.file_name.as_deref())?;
    let job = analyze.analyze.then_some((kind, parameters));
    let options = reading.options(service.limits.reader());
    let (cloud, examined, job) =
        service.pools.reading.run(move || read(upload, reading.format, &options, job, lowers)).await??;
    reservation.keep(cloud.bytes() + STORED_AT_ONCE);
    let mut submitted = service.store.submit_shared(&owner, Arc::new(cloud), &examined, job).await?;
    if let (Some(name), None) = (name, &submitted.cloud.name) {
        submitted.cloud = service.store.name_cloud(submitted.cloud.id, name).await?;
        if let Some(job) = &mut submitted.job {
            job.cloud_name.clone_from(&submitted.cloud.name);
        }
    }
    drop(reservation);
    key.remember(&service.store, &owner, &submitted).await?;
    answer(service, submitted, wait).await
}

/// Parses and admits, on a compute thread; `lowers` the default number of bases if the cloud allows fewer.
fn read(
    upload: Upload,
    named: Option<Format>,
    options: &ReadOptions,
    mut job: Option<Job>,
    lowers: bool,
) -> Result<(PointCloud, Examined, Option<Job>), Problem> {
    let cloud = reader::read(&upload.bytes, upload.format(named)?, options)?;
    drop(upload);
    let examined = Examined::of(&cloud);
    if let Some((_, parameters)) = &mut job {
        if lowers { examined.admit_lowered(parameters)? } else { examined.admit(parameters)? }
    }
    Ok((cloud, examined, job))
}

pub(super) async fn answer(
    service: &Service,
    submitted: Submitted,
    wait: Option<Duration>,
) -> Result<Response, Problem> {
    let Submitted { cloud, mut job, cloud_created, job_created } = submitted;
    if job_created {
        // In the request's span: the log joins request and job.
        if let Some(job) = &job {
            tracing::info!(
                job = %job.id,
                cloud = %cloud.id,
                owner = cloud.owner.name(),
                operator = job.parameters.operator.name(),
                kind = if job.kind == JobKind::Eigen { "eigen" } else { "operator" },
                bases = job.parameters.bases,
                points = cloud.points,
                "job queued"
            );
        }
        service.jobs.wake();
    }
    if let (Some(wait), Some(queued)) = (wait, &job) {
        job = Some(wait_until_ended(service, queued.id, wait).await?);
    }
    let cloud_path = format!("/clouds/{}", cloud.id);
    let mut links = job.as_ref().map_or_else(BTreeMap::new, jobs::result_links);
    links.extend([("cloud", cloud_path.clone()), ("points", format!("{cloud_path}/points"))]);
    let (status, location) = match &job {
        None if cloud_created => (StatusCode::CREATED, cloud_path),
        None => (StatusCode::OK, cloud_path),
        Some(job) => {
            let path = format!("/jobs/{}", job.id);
            links.insert("job", path.clone());
            (if job_created { StatusCode::ACCEPTED } else { StatusCode::OK }, path)
        }
    };
    let body = Submission {
        cloud: CloudView::load(&service.store, &cloud).await?,
        job: job.as_ref().map(JobView::new),
        links,
    };
    let mut response = (status, Json(body)).into_response();
    if let Ok(location) = HeaderValue::from_str(&location) {
        response.headers_mut().insert(header::LOCATION, location);
    }
    if job.is_some_and(|job| !job.state.is_terminal()) {
        response.headers_mut().insert(header::RETRY_AFTER, HeaderValue::from(retry::JOB_SECONDS));
    }
    if wait.is_some() {
        let applied = HeaderName::from_static("preference-applied");
        response.headers_mut().insert(applied, HeaderValue::from_static("wait"));
    }
    Ok(response)
}

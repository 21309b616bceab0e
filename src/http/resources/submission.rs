//! Submitting: a cloud with a job on it, or a further job on a stored cloud.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Duration;

use axum::Json;
use axum::extract::{Path, State};
use axum::http::{HeaderName, HeaderValue, StatusCode, Uri, header};
use axum::response::{IntoResponse, Response};
use serde::Serialize;
use serde_json::Value;
use utoipa::ToSchema;

use super::cloud_name;
use super::clouds::CloudView;
use super::idempotency::{self, IdempotencyKey, Key};
use super::jobs;
use super::jobs::JobView;
use super::parameters::{self, KIND, PARAMETERS};
use crate::analysis::{JobKind, Parameters, admit, admit_lowered};
use crate::cloud::reader::{self, Format, ReadOptions};
use crate::cloud::{NonFinite, PointCloud};
use crate::http::notation::{now, parse_id};
use crate::http::service::{Service, Shared};
use crate::http::wait::{preferred_wait, settled};
use crate::http::wire::body::{IncomingBody, Received};
use crate::http::wire::problem::{Kind, Problem, ProblemDocument};
use crate::http::wire::query::{Accepts, Argument, Arguments, Nothing, arguments};
use crate::http::wire::retry;
use crate::http::wire::upload::Upload;
use crate::store::{Owner, Submitted};

/// How the upload is read.
pub(crate) const UPLOAD: &[Argument] = &[
    Argument {
        name: "format",
        alias: None,
        accepts: Accepts::Word(&[
            "ply", "obj", "off", "stl", "xyz", "csv", "npy", "pcd", "las", "laz", "e57",
        ]),
        default: "from Content-Type, then the file's name, then the bytes",
        meaning: "Format of the file.",
    },
    Argument {
        name: "nonfinite",
        alias: None,
        accepts: Accepts::Word(&["reject", "drop"]),
        default: "reject",
        meaning: "What to do with rows that have a NaN or infinite coordinate: refuse the cloud, or keep the rows without a result.",
    },
    Argument {
        name: "coordinates",
        alias: None,
        accepts: Accepts::Integer(1, crate::cloud::DIMENSION_MAX as u64),
        default: "3 or all columns, by format",
        meaning: "For tables (XYZ, CSV, NPY): the first so many columns are coordinates, the others fields.",
    },
    Argument {
        name: "scan",
        alias: None,
        accepts: Accepts::Integer(0, u64::MAX),
        default: "all of them",
        meaning: "For files of several scans (E57, PTX): which one, counting from 0.",
    },
    Argument {
        name: "analyze",
        alias: Some("analyse"),
        accepts: Accepts::Switch,
        default: "true",
        meaning: "Queue a job on the cloud. `false` only stores it.",
    },
];

/// Memory of a cloud and of what is looked at of it before an analysis, over the cloud's.
const ADMISSION_FACTOR: u64 = 4;
/// JSON of `POST /clouds/{id}/jobs` is small.
const JOB_BYTES_MAX: u64 = 64 << 10;

arguments!(
    /// Query of `POST /clouds`.
    SubmitCloud = UPLOAD, cloud_name::NAME, KIND, PARAMETERS
);

/// What a submission came to.
#[derive(Debug, Serialize, ToSchema)]
pub(crate) struct Submission {
    /// The cloud.
    cloud: CloudView,
    /// The job; null with `analyze=false`.
    job: Option<JobView>,
    /// Where both are, and the results will be.
    links: BTreeMap<&'static str, String>,
}

/// A file of points.
#[derive(Debug, ToSchema)]
#[schema(value_type = String, format = Binary)]
#[allow(dead_code)] // names the request body in the OpenAPI document
pub(crate) struct CloudFile(Vec<u8>);

/// Parameters of a job: the fields of the query of `POST /clouds`.
#[derive(Debug, ToSchema)]
#[allow(dead_code)] // names the request body in the OpenAPI document
pub(crate) struct JobRequest {
    /// What the job computes.
    #[schema(default = "eigen")]
    kind: Option<JobKind>,
    /// Its parameters, beside `kind`.
    #[serde(flatten)]
    parameters: Parameters,
}

/// Uploads a cloud and queues a job on it.
///
/// The body is the file itself, or multipart/form-data whose first file part it is. The same content is stored
/// once; the same analysis of it is answered with the job that is already there.
#[utoipa::path(
    post,
    path = "/clouds",
    tag = "clouds",
    params(SubmitCloud, IdempotencyKey),
    request_body(content((CloudFile = "application/octet-stream"), (CloudFile = "multipart/form-data")), description = "The file."),
    responses(
        (status = 202, description = "Stored and queued.", body = Submission, headers(("Location" = String, description = "The job."), ("Retry-After" = u64, description = "Seconds."))),
        (status = 200, description = "The same analysis of the same cloud is there already.", body = Submission),
        (status = 201, description = "Stored only (`analyze=false`).", body = Submission, headers(("Location" = String, description = "The cloud."))),
        (status = 400, description = "Body or file malformed.", body = ProblemDocument, content_type = "application/problem+json"),
        (status = 408, description = "The body stopped arriving.", body = ProblemDocument, content_type = "application/problem+json"),
        (status = 413, description = "Over a limit.", body = ProblemDocument, content_type = "application/problem+json"),
        (status = 415, description = "Format unknown.", body = ProblemDocument, content_type = "application/problem+json"),
        (status = 422, description = "A parameter is not accepted, or the cloud cannot carry the analysis.", body = ProblemDocument, content_type = "application/problem+json"),
        (status = 429, description = "The queue is full.", body = ProblemDocument, content_type = "application/problem+json"),
    )
)]
pub(crate) async fn post_cloud(
    State(service): State<Shared>,
    uri: Uri,
    body: IncomingBody,
) -> Result<Response, Problem> {
    receive(&service, &uri, body, None).await
}

/// Uploads a cloud: the same as POST, for `curl -T`.
#[utoipa::path(
    put,
    path = "/clouds",
    tag = "clouds",
    params(SubmitCloud, IdempotencyKey),
    request_body(content((CloudFile = "application/octet-stream"), (CloudFile = "multipart/form-data")), description = "The file."),
    responses(
        (status = 202, description = "Stored and queued.", body = Submission, headers(("Location" = String, description = "The job."), ("Retry-After" = u64, description = "Seconds."))),
        (status = 200, description = "The same analysis of the same cloud is there already.", body = Submission),
        (status = 201, description = "Stored only (`analyze=false`).", body = Submission, headers(("Location" = String, description = "The cloud."))),
        (status = "4XX", description = "As for POST.", body = ProblemDocument, content_type = "application/problem+json"),
    )
)]
pub(crate) async fn put_cloud(
    State(service): State<Shared>,
    uri: Uri,
    body: IncomingBody,
) -> Result<Response, Problem> {
    receive(&service, &uri, body, None).await
}

/// Uploads a cloud with its file name, as `curl -T scan.ply http://HOST/clouds/` does.
///
/// The name only helps to tell the format; the cloud gets an id of its own.
#[utoipa::path(
    put,
    path = "/clouds/{id}",
    tag = "clouds",
    params(("id" = String, Path, description = "The file's name."), SubmitCloud, IdempotencyKey),
    request_body(content((CloudFile = "application/octet-stream")), description = "The file."),
    responses(
        (status = 202, description = "Stored and queued.", body = Submission, headers(("Location" = String, description = "The job."), ("Retry-After" = u64, description = "Seconds."))),
        (status = 200, description = "The same analysis of the same cloud is there already.", body = Submission),
        (status = 201, description = "Stored only (`analyze=false`).", body = Submission, headers(("Location" = String, description = "The cloud."))),
        (status = "4XX", description = "As for POST.", body = ProblemDocument, content_type = "application/problem+json"),
    )
)]
pub(crate) async fn put_cloud_named(
    State(service): State<Shared>,
    Path(file_name): Path<String>,
    uri: Uri,
    body: IncomingBody,
) -> Result<Response, Problem> {
    receive(&service, &uri, body, Some(file_name)).await
}

/// Queues a job on a stored cloud.
///
/// The body is a JSON object of parameters; an empty body takes all defaults.
#[utoipa::path(
    post,
    path = "/clouds/{id}/jobs",
    tag = "jobs",
    params(("id" = Uuid, Path, description = "The cloud."), IdempotencyKey),
    request_body(content = Option<JobRequest>, description = "Parameters."),
    responses(
        (status = 202, description = "Queued.", body = Submission, headers(("Location" = String, description = "The job."), ("Retry-After" = u64, description = "Seconds."))),
        (status = 200, description = "The same analysis is there already.", body = Submission),
        (status = 400, description = "The body is no JSON.", body = ProblemDocument, content_type = "application/problem+json"),
        (status = 404, description = "No such cloud.", body = ProblemDocument, content_type = "application/problem+json"),
        (status = 413, description = "The body is too large.", body = ProblemDocument, content_type = "application/problem+json"),
        (status = 422, description = "A parameter is not accepted.", body = ProblemDocument, content_type = "application/problem+json"),
        (status = 429, description = "The queue is full.", body = ProblemDocument, content_type = "application/problem+json"),
    )
)]
pub(crate) async fn post_job(
    State(service): State<Shared>,
    Path(id): Path<String>,
    uri: Uri,
    body: IncomingBody,
) -> Result<Response, Problem> {
    Nothing::read(&uri).map_err(|_| {
        let told = "the query has no parameters here; those of a job are sent as JSON: curl -d '{\"bases\": 50}' URL";
        Problem::new(Kind::UnknownParameter, told)
    })?;
    let id = parse_id(&id)?;
    let (wait, owner) = (preferred_wait(body.headers()), body.owner().clone());
    let headers = body.headers().clone();
    let Received { bytes: body, mut reservation } = body.receive(JOB_BYTES_MAX).await?;
    let key = Key::of(&headers, &uri, &body)?;
    if let Some(answered) = replayed(&service, &owner, key.as_ref(), wait).await? {
        return Ok(answered);
    }
    let arguments = job_arguments(&body)?;
    let (kind, mut parameters) = parameters::read(&arguments, service.limits.bases_max)?;
    let lowers = arguments.integer("bases").is_none();
    // The cloud, and its points without those at the same place.
    reservation.add(ADMISSION_FACTOR * service.store.cloud(id).await?.bytes()).await?;
    let cloud = service.store.load_cloud(id).await?;
    let admitted = move || {
        if lowers { admit_lowered(&cloud, &mut parameters) } else { admit(&cloud, &parameters) }
            .map(|_| parameters)
    };
    let parameters = service.reading.run(admitted).await??;
    drop(reservation);
    let submitted = service.store.submit_job(id, kind, parameters).await?;
    remember(&service, &owner, key.as_ref(), &submitted).await?;
    answer(&service, submitted, wait).await
}

/// The answer to a request that was answered before under the same name.
async fn replayed(
    service: &Service,
    owner: &Owner,
    key: Option<&Key>,
    wait: Option<Duration>,
) -> Result<Option<Response>, Problem> {
    let Some(key) = key else { return Ok(None) };
    let Some(submitted) = key.replayed(&service.store, owner).await? else { return Ok(None) };
    let mut response = answer(service, submitted, wait).await?;
    idempotency::mark(&mut response);
    Ok(Some(response))
}

async fn remember(
    service: &Service,
    owner: &Owner,
    key: Option<&Key>,
    submitted: &Submitted,
) -> Result<(), Problem> {
    match key {
        Some(key) => key.remember(&service.store, owner, submitted).await,
        None => Ok(()),
    }
}

fn job_arguments(bytes: &[u8]) -> Result<Arguments, Problem> {
    let malformed = |detail: String| Problem::new(Kind::MalformedRequest, detail);
    if bytes.trim_ascii().is_empty() {
        return Ok(Arguments::default());
    }
    let json: Value = serde_json::from_slice(bytes).map_err(|error| {
        malformed(format!("the body is not JSON ({error}); send parameters as in {{\"bases\": 50}}"))
    })?;
    let Value::Object(object) = json else {
        return Err(malformed(
            "the body is not a JSON object; send parameters as in {\"bases\": 50}".to_owned(),
        ));
    };
    Arguments::from_json(object, &[KIND, PARAMETERS])
}

async fn receive(
    service: &Service,
    uri: &Uri,
    body: IncomingBody,
    file_name: Option<String>,
) -> Result<Response, Problem> {
    let arguments = SubmitCloud::read(uri)?;
    let (kind, parameters) = parameters::read(&arguments, service.limits.bases_max)?;
    let (wait, owner) = (preferred_wait(body.headers()), body.owner().clone());
    let (headers, target, format) = (body.headers().clone(), uri.clone(), arguments.word("format"));
    let (mut upload, reservation) = Upload::receive(service, body).await?;
    upload.file_name = upload.file_name.or(file_name);
    let named = upload.bytes.clone();
    let key = service.reading.run(move || Key::of(&headers, &target, &named)).await??;
    if let Some(answered) = replayed(service, &owner, key.as_ref(), wait).await? {
        return Ok(answered);
    }
    let name = cloud_name::of(arguments.word("name"), upload.file_name.as_deref())?;
    let format = upload.format(format.and_then(Format::from_name))?;
    let job = arguments.switch("analyze").unwrap_or(true).then_some((kind, parameters));
    let options = ReadOptions {
        policy: if arguments.word("nonfinite") == Some("drop") { NonFinite::Drop } else { NonFinite::Reject },
        dimension: arguments.integer("coordinates").map(|columns| columns as usize),
        scan: arguments.integer("scan").map(|scan| scan as usize),
        limits: service.limits.reader,
    };
    let lowers = arguments.integer("bases").is_none();
    let (cloud, job) = service.reading.run(move || read(upload, format, &options, job, lowers)).await??;
    let mut submitted = service.store.submit_shared(&owner, Arc::new(cloud), job).await?;
    if let (Some(name), None) = (name, &submitted.cloud.name) {
        submitted.cloud = service.store.name_cloud(submitted.cloud.id, name).await?;
        if let Some(job) = &mut submitted.job {
            job.cloud_name.clone_from(&submitted.cloud.name);
        }
    }
    drop(reservation);
    remember(service, &owner, key.as_ref(), &submitted).await?;
    answer(service, submitted, wait).await
}

/// Parses and admits, on a compute thread; `lowers` a number of bases that nobody named.
fn read(
    upload: Upload,
    format: Format,
    options: &ReadOptions,
    mut job: Option<(JobKind, Parameters)>,
    lowers: bool,
) -> Result<(PointCloud, Option<(JobKind, Parameters)>), Problem> {
    let cloud = reader::read(&upload.bytes, format, options)?;
    drop(upload);
    if let Some((_, parameters)) = &mut job {
        if lowers {
            admit_lowered(&cloud, parameters)?
        } else {
            admit(&cloud, parameters)?
        };
    }
    Ok((cloud, job))
}

async fn answer(
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
        job = Some(settled(service, queued.id, wait).await?);
    }
    let cloud_path = format!("/clouds/{}", cloud.id);
    let mut links =
        BTreeMap::from([("cloud", cloud_path.clone()), ("points", format!("{cloud_path}/points"))]);
    let (status, location) = match &job {
        None if cloud_created => (StatusCode::CREATED, cloud_path),
        None => (StatusCode::OK, cloud_path),
        Some(job) => {
            let path = format!("/jobs/{}", job.id);
            if job.kind == JobKind::Eigen {
                for result in jobs::EIGEN_RESULTS {
                    links.insert(result, format!("{path}/{result}"));
                }
            }
            links.insert("operator", format!("{path}/operator"));
            links.insert("job", path.clone());
            (if job_created { StatusCode::ACCEPTED } else { StatusCode::OK }, path)
        }
    };
    let body = Submission {
        cloud: CloudView::load(&service.store, &cloud).await?,
        job: job.as_ref().map(|job| JobView::new(job, now())),
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_formats_offered_are_the_formats_read() {
        let Accepts::Word(words) = UPLOAD[0].accepts else { panic!("format is a word") };
        let names: Vec<_> = Format::ALL.iter().map(|format| format.name()).collect();
        assert_eq!(words, names);
    }
}

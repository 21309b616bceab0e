//! Queuing a further job on a stored cloud.

use axum::extract::{Path, State};
use axum::response::Response;
use serde_json::Value;
use utoipa::ToSchema;

use super::idempotency::{Idempotency, IdempotencyKey};
use super::submission::{JobArguments, Submission, answer, replayed};
use crate::analysis::{Examined, JobKind, Parameters};
use crate::http::wait::preferred_wait;
use crate::http::wire::body::{IncomingBody, Received};
use crate::http::wire::notation::parse_id;
use crate::http::wire::problem::{Kind, Problem};
use crate::http::wire::problem_sets::{CloudProblems, SubmissionProblems};
use crate::http::wire::query::{BasesMax, FromQuery, from_json};
use crate::http::wire::service::Shared;

/// Memory for examining a cloud, as a multiple of the cloud's.
const ADMISSION_FACTOR: u64 = 4;
/// JSON of parameters is small.
const JOB_BYTES_MAX: u64 = 64 << 10;

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
        SubmissionProblems,
        CloudProblems,
    )
)]
pub(crate) async fn post_job(
    State(service): State<Shared>,
    Path(id): Path<String>,
    query: Result<FromQuery<()>, Problem>,
    body: IncomingBody,
) -> Result<Response, Problem> {
    query.map_err(|_| {
        let told = "this request takes no query parameters; send job parameters as JSON: curl -d '{\"bases\": 50}' URL";
        Problem::new(Kind::UnknownParameter, told)
    })?;
    let id = parse_id(&id)?;
    let (parts, owner) = (body.parts().clone(), body.owner());
    let wait = preferred_wait(&parts.headers);
    let Received { bytes: body, mut reservation } = body.receive(JOB_BYTES_MAX).await?;
    let key = Idempotency::of(&parts.headers, &parts.uri, &body)?;
    if let Some(answered) = replayed(&service, &owner, &key, wait).await? {
        return Ok(answered);
    }
    let asked = job_arguments(&body, BasesMax(service.limits.bases_max))?;
    let lowers = !asked.parameters.is_bases_given;
    let (kind, mut parameters) = asked.checked(service.limits.bases_max)?;
    let cloud = service.store.cloud(id).await?;
    let examined = if let Some(examined) = cloud.examined {
        examined
    } else {
        // Stored by an older version: the cloud, and its points without those at the same place.
        reservation.add(ADMISSION_FACTOR * cloud.bytes()).await?;
        let cloud = service.store.load_cloud(id).await?;
        service.pools.reading.run(move || Examined::of(&cloud)).await?
    };
    drop(reservation);
    if lowers {
        examined.admit_lowered(&mut parameters)?;
    } else {
        examined.admit(&parameters)?;
    }
    let submitted = service.store.submit_job(id, kind, parameters).await?;
    key.remember(&service.store, &owner, &submitted).await?;
    answer(&service, submitted, wait).await
}

fn job_arguments(bytes: &[u8], bases_max: BasesMax) -> Result<JobArguments, Problem> {
    let malformed = |detail: String| Problem::new(Kind::MalformedRequest, detail);
    if bytes.trim_ascii().is_empty() {
        return Ok(JobArguments::default());
    }
    let json: Value = serde_json::from_slice(bytes).map_err(|error| {
        malformed(format!("the body is not JSON ({error}); send parameters as in {{\"bases\": 50}}"))
    })?;
    let Value::Object(object) = json else {
        return Err(malformed(
            "the body is not a JSON object; send parameters as in {\"bases\": 50}".to_owned(),
        ));
    };
    from_json(&object, bases_max)
}

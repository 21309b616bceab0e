//! Clouds: listing, showing, deleting.

use axum::Json;
use axum::extract::{Path, State};
use axum::http::{Extensions, StatusCode};
use serde::Serialize;
use std::collections::BTreeMap;
use utoipa::ToSchema;
use uuid::Uuid;

use crate::geometry::Sampling;
use crate::http::paging::Paging;
use crate::http::wire::notation::{parse_id, timestamp};
use crate::http::wire::owners;
use crate::http::wire::problem::{Problem, ProblemDocument};
use crate::http::wire::problem_sets::{CloudProblems, QueryProblem};
use crate::http::wire::query::FromQuery;
use crate::http::wire::service::Shared;
use crate::store::{CloudRecord, FieldRecord, JobState, Page, Store};

/// What is known of a cloud from its upload alone.
#[derive(Debug, Serialize, ToSchema)]
pub(crate) struct CloudSummary {
    /// Its id.
    id: Uuid,
    /// What its file was called; null when the upload did not say.
    name: Option<String>,
    /// When it was stored, RFC 3339.
    #[schema(format = DateTime)]
    created: String,
    /// SHA-256, in hex, of everything kept from the upload; uploads with equal digests are one cloud.
    digest: String,
    /// Rows of the upload.
    points: u64,
    /// Coordinates per point.
    dimension: usize,
    /// Rows with a non-finite coordinate.
    nonfinite: u64,
    /// Rows that repeat an earlier row's position.
    duplicates: u64,
    /// Over the finite points, in units of the upload.
    bounding_box: BoundingBox,
    /// Type of the coordinates in the upload.
    #[schema(value_type = String)]
    coordinate_type: crate::cloud::ScalarType,
    /// Per-point scalars of the upload.
    fields: Vec<FieldRecord>,
    /// Triangles of the upload.
    faces: u64,
    /// Parts of the file that were dropped or altered on reading.
    warnings: Vec<String>,
    /// Where its points and jobs are.
    links: BTreeMap<&'static str, String>,
}

/// An axis-aligned box.
#[derive(Debug, Serialize, ToSchema)]
pub(crate) struct BoundingBox {
    /// Least coordinate on every axis.
    minimum: Vec<f64>,
    /// Greatest coordinate on every axis.
    maximum: Vec<f64>,
}

/// A cloud, with what its latest successful job learned of its sampling.
#[derive(Debug, Serialize, ToSchema)]
#[schema(as = Cloud)]
pub(crate) struct CloudView {
    /// From the upload.
    #[serde(flatten)]
    summary: CloudSummary,
    /// Rows that carry a result of their own; before the first successful job, those finite and not repeated.
    points_used: u64,
    /// Covering radius ε, spacing and density, as the latest successful job found them; null before.
    sampling: Option<Sampling>,
}

impl From<&CloudRecord> for CloudSummary {
    fn from(cloud: &CloudRecord) -> Self {
        let (minimum, maximum) = cloud.bounding_box.clone();
        let path = format!("/clouds/{}", cloud.id);
        Self {
            id: cloud.id,
            name: cloud.name.clone(),
            created: timestamp(cloud.created),
            digest: cloud.digest.clone(),
            points: cloud.points,
            dimension: cloud.dimension,
            nonfinite: cloud.nonfinite,
            duplicates: cloud.duplicates,
            bounding_box: BoundingBox { minimum, maximum },
            coordinate_type: cloud.coordinate_type,
            fields: cloud.fields.clone(),
            faces: cloud.faces,
            warnings: cloud.origin.notes.clone(),
            links: BTreeMap::from([
                ("jobs", format!("/jobs?cloud={}", cloud.id)),
                ("points", format!("{path}/points")),
                ("self", path),
            ]),
        }
    }
}

impl CloudView {
    /// With what the store knows of the cloud's jobs.
    ///
    /// # Errors
    /// As [`Store::jobs`].
    pub(crate) async fn load(store: &Store, cloud: &CloudRecord) -> Result<Self, Problem> {
        let latest = store.jobs(&cloud.owner, Some(JobState::Succeeded), Some(cloud.id), None, 1).await?;
        let report = latest.items.into_iter().next().and_then(|job| job.report);
        let points_used = match &report {
            Some(report) => report.points_used as u64,
            None => cloud.points - cloud.nonfinite - cloud.duplicates,
        };
        Ok(Self { summary: cloud.into(), points_used, sampling: report.map(|report| report.sampling) })
    }
}

/// A page of clouds, newest first.
#[derive(Debug, Serialize, ToSchema)]
pub(crate) struct CloudPage {
    /// The clouds.
    clouds: Vec<CloudSummary>,
    /// Pass it as `cursor` for the next page; null on the last.
    next: Option<Uuid>,
}

/// Clouds, newest first.
#[utoipa::path(
    get,
    path = "/clouds",
    operation_id = "list_clouds",
    tag = "clouds",
    params(FromQuery<Paging>),
    responses(
        (status = 200, description = "A page.", body = CloudPage),
        QueryProblem,
    )
)]
pub(crate) async fn list(
    State(service): State<Shared>,
    FromQuery(paging): FromQuery<Paging>,
    extensions: Extensions,
) -> Result<Json<CloudPage>, Problem> {
    let owner = owners::owner(&extensions);
    let Page { items, next } = service.store.clouds(&owner, paging.cursor, paging.limit as u32).await?;
    Ok(Json(CloudPage { clouds: items.iter().map(CloudSummary::from).collect(), next }))
}

/// A cloud: counts, bounding box, digest, fields, sampling.
#[utoipa::path(
    get,
    path = "/clouds/{id}",
    operation_id = "show_cloud",
    tag = "clouds",
    params(("id" = Uuid, Path, description = "The cloud.")),
    responses(
        (status = 200, description = "The cloud.", body = CloudView),
        CloudProblems,
    )
)]
pub(crate) async fn show(
    State(service): State<Shared>,
    Path(id): Path<String>,
    FromQuery(()): FromQuery<()>,
) -> Result<Json<CloudView>, Problem> {
    let cloud = service.store.cloud(parse_id(&id)?).await?;
    Ok(Json(CloudView::load(&service.store, &cloud).await?))
}

/// Deletes a cloud with its jobs and their results.
#[utoipa::path(
    delete,
    path = "/clouds/{id}",
    operation_id = "delete_cloud",
    tag = "clouds",
    params(("id" = Uuid, Path, description = "The cloud.")),
    responses(
        (status = 204, description = "Deleted."),
        (status = 409, description = "It has queued or running jobs.", body = ProblemDocument, content_type = "application/problem+json"),
        CloudProblems,
    )
)]
pub(crate) async fn delete(
    State(service): State<Shared>,
    Path(id): Path<String>,
    FromQuery(()): FromQuery<()>,
) -> Result<StatusCode, Problem> {
    service.store.delete_cloud(parse_id(&id)?).await?;
    Ok(StatusCode::NO_CONTENT)
}

//! `/livez` and `/readyz`: for orchestrators, without a key.

use axum::Json;
use axum::extract::State;
use serde::Serialize;
use utoipa::ToSchema;

use super::Shared;
use super::problem::{Kind, Problem, ProblemDocument};

/// A probe's answer.
#[derive(Debug, Serialize, ToSchema)]
pub(crate) struct Health {
    /// Always `ok`: anything else is a problem.
    status: &'static str,
}

/// Whether the process answers.
///
/// Says nothing about the database.
#[utoipa::path(get, path = "/livez", tag = "service", responses((status = 200, description = "It does.", body = Health)))]
pub(crate) async fn livez() -> Json<Health> {
    Json(Health { status: "ok" })
}

/// Whether requests will succeed.
///
/// Makes a small write to the database.
#[utoipa::path(
    get,
    path = "/readyz",
    tag = "service",
    responses(
        (status = 200, description = "They will.", body = Health),
        (status = 503, description = "Stopping, or the database takes no writes.", body = ProblemDocument, content_type = "application/problem+json"),
    )
)]
pub(crate) async fn readyz(State(service): State<Shared>) -> Result<Json<Health>, Problem> {
    if service.stopping.is_cancelled() {
        return Err(Problem::new(Kind::Unavailable, "the service is stopping"));
    }
    service.store.probe().await.map_err(|error| {
        tracing::error!(%error, "the database does not take writes");
        Problem::new(Kind::Unavailable, "the database does not take writes")
    })?;
    Ok(Json(Health { status: "ok" }))
}

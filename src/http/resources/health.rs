//! `/livez` and `/readyz`: for orchestrators, without a key.

use std::time::Duration;

use axum::Json;
use axum::extract::State;
use serde::Serialize;
use utoipa::ToSchema;

use crate::http::wire::problem::{Kind, Problem, ProblemDocument};
use crate::http::wire::service::Shared;
use crate::store::StoreError;

/// Time for a write: orchestrators do not wait as long as other writers do.
const WRITE_TIME: Duration = Duration::from_secs(3);

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
/// Makes a small write to the database, and looks at the free space on its disk and at the workers.
#[utoipa::path(
    get,
    path = "/readyz",
    tag = "service",
    responses(
        (status = 200, description = "They will.", body = Health),
        (status = 503, description = "Stopping, the database takes no writes, its disk is too full, or a worker died.", body = ProblemDocument, content_type = "application/problem+json"),
    )
)]
pub(crate) async fn readyz(State(service): State<Shared>) -> Result<Json<Health>, Problem> {
    if service.stopping.is_cancelled() {
        return Err(not_ready("stopping", "the service is stopping"));
    }
    if !service.jobs.are_alive() {
        tracing::error!("a worker died");
        return Err(not_ready("workers", "a worker died; restart the service"));
    }
    match service.store.refuse_when_disk_full().await {
        Ok(()) => {}
        Err(StoreError::StorageFull) => {
            return Err(not_ready("disk", "free disk space is below the configured floor"));
        }
        Err(error) => {
            tracing::error!(%error, "the free disk space cannot be read");
            return Err(not_ready("disk", "the free disk space cannot be read"));
        }
    }
    match tokio::time::timeout(WRITE_TIME, service.store.probe()).await {
        Ok(Ok(())) => return Ok(Json(Health { status: "ok" })),
        Ok(Err(error)) => tracing::error!(%error, "the database does not take writes"),
        Err(_) => tracing::error!("a test write did not finish within {} seconds", WRITE_TIME.as_secs()),
    }
    Err(not_ready("database", "the database does not take writes"))
}

/// A problem that names the check that failed.
fn not_ready(check: &str, detail: &str) -> Problem {
    Problem::new(Kind::Unavailable, detail).with("check", check)
}

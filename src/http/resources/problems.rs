//! `/problems/{name}`: what the `type` of a problem leads to.

use axum::Json;
use axum::extract::Path;
use serde::Serialize;
use utoipa::ToSchema;

use crate::http::wire::problem::{Kind, Problem, ProblemDocument};

/// A kind of problem.
#[derive(Debug, Serialize, ToSchema)]
pub(crate) struct ProblemKind {
    /// As in a problem's `type`.
    #[serde(rename = "type")]
    kind: String,
    /// As in a problem's `title`.
    title: &'static str,
    /// The HTTP status of its answers.
    status: u16,
}

/// A kind of problem: the page that a problem's `type` names.
#[utoipa::path(
    get,
    path = "/problems/{name}",
    tag = "service",
    params(("name" = String, Path, description = "The last part of the `type`.")),
    responses(
        (status = 200, description = "The kind.", body = ProblemKind),
        (status = 404, description = "No such kind.", body = ProblemDocument, content_type = "application/problem+json"),
    )
)]
pub(crate) async fn problem_kind(Path(name): Path<String>) -> Result<Json<ProblemKind>, Problem> {
    let kind = Kind::ALL.into_iter().find(|kind| kind.name() == name);
    let kind = kind.ok_or_else(|| Problem::new(Kind::NotFound, "unknown problem type"))?;
    let status = kind.status().as_u16();
    Ok(Json(ProblemKind { kind: format!("/problems/{name}"), title: kind.title(), status }))
}

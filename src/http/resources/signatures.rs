//! Heat and wave kernel signatures of every point.

use std::sync::Arc;

use axum::response::Response;
use serde::Serialize;
use serde_json::Map;
use utoipa::ToSchema;
use uuid::Uuid;

use crate::harmonics::{Signature, SignatureKind, SignatureRequest};
use crate::http::results::offered::offered;
use crate::http::results::per_row::PerRow;
use crate::http::results::request::{self, Harmonics, ResultRequest};
use crate::http::wire::accept::{JSON, NPY, PLY};
use crate::http::wire::problem::{Kind, Problem};
use crate::http::wire::problem_sets::{RangeProblem, ResultProblems};

offered!(SignatureRequest: [JSON, NPY, PLY], "Format of the answer: `npy` is an array of points × scales; `ply` has the points and one property per scale, `hks_0` and so on.");

/// Signatures as JSON.
#[derive(Debug, Serialize, ToSchema)]
#[allow(dead_code)] // describes what is written column by column
pub(crate) struct Signatures {
    /// The job.
    job_id: Uuid,
    /// Rows of the upload.
    points: usize,
    /// Which signature.
    kind: SignatureKind,
    /// Time of every scale in length² (hks), or energy ln λ (wks).
    scales: Vec<f64>,
    /// One array per scale, one number per row in 1/length²; null without a result.
    values: Vec<Vec<Option<f64>>>,
}

/// Heat or wave kernel signatures: what every point sees of the surface, at several scales.
///
/// The same for every choice of bases inside an eigenvalue cluster, unless the last cluster is cut off.
#[utoipa::path(
    get,
    path = "/jobs/{id}/signatures",
    tag = "harmonics",
    params(("id" = Uuid, Path, description = "The job."), ResultRequest<SignatureRequest>),
    responses(
        (status = 200, description = "The signatures.", content((Signatures = "application/json"), (Vec<u8> = "application/x-npy"), (Vec<u8> = "application/ply")), headers(("ETag" = String, description = "Of these bytes."))),
        (status = 206, description = "The range request for.", content((Vec<u8> = "application/x-npy"), (Vec<u8> = "application/ply"))),
        (status = 304, description = "The client's copy is current."),
        RangeProblem,
        ResultProblems,
    )
)]
pub(crate) async fn signatures(request: ResultRequest<SignatureRequest>) -> Result<Response, Problem> {
    let Harmonics { job, modes, bases, reservation } =
        request.harmonics_per_row(request.arguments.count).await?;
    let SignatureRequest { kind, count, scaled } = request.arguments;
    let signature = Signature::of(request.arguments, &modes).ok_or_else(|| no_scale(modes.len()))?;
    let per_row = PerRow {
        names: (0..count).map(|scale| format!("{}_{scale}", kind.name())).collect(),
        head: Map::from_iter([
            ("job_id".to_owned(), job.id.to_string().into()),
            ("points".to_owned(), bases.rows().into()),
            ("kind".to_owned(), kind.name().into()),
            ("scales".to_owned(), signature.scales.clone().into()),
        ]),
        work: Arc::new(move |block| signature.values(block)),
        bases,
        is_single: false,
        tag: request::tag(job.id, &(kind, count, scaled)),
        stem: kind.name(),
        reservation,
    };
    per_row.answer(&request, &job).await
}

/// The refusal when all modes are zero modes.
pub(crate) fn no_scale(bases: usize) -> Problem {
    Problem::new(
        Kind::NoSuchResult,
        format!(
            "the job has {bases} bases, none of them with an eigenvalue above 0; analyze with more bases"
        ),
    )
}

//! Heat and wave kernel signatures of every point.

use axum::response::Response;
use serde::Serialize;
use utoipa::ToSchema;
use uuid::Uuid;

use crate::harmonics::{Modes, Signature, SignatureKind, SignatureRequest};
use crate::http::results::offered::offered;
use crate::http::results::per_row::PerRow;
use crate::http::results::request::{self, ResultRequest};
use crate::http::wire::accept::{JSON, NPY, PLY};
use crate::http::wire::download;
use crate::http::wire::problem::{Kind, Problem};
use crate::http::wire::problem_sets::{RangeProblem, ResultProblems};
use crate::jobs::Wanted;

offered!(SignatureRequest: [JSON, NPY, PLY], "Format of the answer: `npy` is an array of points × scales; `ply` has the points and one property per scale, `hks_0` and so on.");

/// Signatures as JSON.
#[derive(Debug, Serialize, ToSchema)]
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
    #[schema(value_type = Vec<Vec<Option<f64>>>)]
    values: Vec<Vec<f64>>,
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
        (status = 200, description = "The signatures.", body = Signatures, headers(("ETag" = String, description = "Of these bytes."))),
        (status = 206, description = "The requested range.", content((Vec<u8> = "application/x-npy"), (Vec<u8> = "application/ply"))),
        (status = 304, description = "The client's copy is current."),
        RangeProblem,
        ResultProblems,
    )
)]
pub(crate) async fn signatures(request: ResultRequest<SignatureRequest>) -> Result<Response, Problem> {
    let eigen = request.eigen().await?;
    let (job_id, points) = (eigen.0.id, eigen.0.points as usize);
    let SignatureRequest { kind, count, scaled } = request.arguments;
    let modes = Modes::of(&eigen.1);
    let signature = Signature::of(request.arguments, &modes).ok_or_else(|| no_scale(modes.len()))?;
    let names = (0..count).map(|scale| format!("{}_{scale}", kind.name())).collect();
    let plan =
        request.plan(request::tag(job_id, &(kind, count, scaled)), format!("{}-{job_id}", kind.name()));
    let per_row = PerRow::new(&request, plan, names, false);
    if let Some(answer) = per_row.without_work(&eigen.0).await? {
        return Ok(answer);
    }
    let harmonics = request.harmonics(eigen, count).await?;
    let scales = signature.scales.clone();
    let json = move |values, wanted: &Wanted| {
        download::json(&Signatures { job_id, points, kind, scales, values }, wanted)
    };
    per_row.answer(harmonics, move |block| signature.values(block), json).await
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

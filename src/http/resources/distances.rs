//! Distances from one point to all, by the spectrum.

use axum::response::Response;
use serde::Serialize;
use utoipa::ToSchema;
use uuid::Uuid;

use super::signatures::no_scale;
use crate::harmonics::{Distance, DistanceKind, DistanceRequest};
use crate::http::results::offered::offered;
use crate::http::results::per_row::PerRow;
use crate::http::results::request::{self, ResultRequest};
use crate::http::wire::accept::{JSON, NPY, PLY};
use crate::http::wire::download;
use crate::http::wire::problem::Problem;
use crate::http::wire::problem_sets::{RangeProblem, ResultProblems};
use crate::jobs::Wanted;

offered!(DistanceRequest: [JSON, NPY, PLY], "Format of the answer: `npy` is an array of points; `ply` has the points and the property `distance`.");

/// Distances as JSON.
#[derive(Debug, Serialize, ToSchema)]
pub(crate) struct Distances {
    /// The job.
    job_id: Uuid,
    /// Rows of the upload.
    points: usize,
    /// Row that is measured from.
    from: usize,
    /// Which distance.
    kind: DistanceKind,
    /// Time of the diffusion in length², as used; null for the biharmonic distance.
    time: Option<f64>,
    /// One number per row; null without a result, and for the biharmonic distance in another component.
    #[schema(value_type = Vec<Option<f64>>)]
    values: Vec<f64>,
}

/// Biharmonic or diffusion distances from a point to all others.
///
/// Both are smooth, need no mesh, and hardly notice noise or small holes. Other components of the surface are infinitely
/// far by the biharmonic distance.
#[utoipa::path(
    get,
    path = "/jobs/{id}/distances",
    tag = "harmonics",
    params(("id" = Uuid, Path, description = "The job."), ResultRequest<DistanceRequest>),
    responses(
        (status = 200, description = "The distances.", body = Distances, headers(("ETag" = String, description = "Of these bytes."))),
        (status = 206, description = "The requested range.", content((Vec<u8> = "application/x-npy"), (Vec<u8> = "application/ply"))),
        (status = 304, description = "The client's copy is current."),
        RangeProblem,
        ResultProblems,
    )
)]
pub(crate) async fn distances(request: ResultRequest<DistanceRequest>) -> Result<Response, Problem> {
    let DistanceRequest { from, kind, time } = request.arguments;
    request.arguments.check().map_err(|error| Problem::invalid("time", error.to_string()))?;
    let eigen = request.eigen().await?;
    let (job_id, points) = (eigen.0.id, eigen.0.points as usize);
    if from >= points {
        let told = format!("parameter `from` must be a row from 0 to {}, not {from}", points - 1);
        return Err(Problem::invalid("from", told));
    }
    let tag = request::tag(job_id, &(kind, from, time.map(f64::to_bits)));
    let plan = request.plan(tag, format!("{}-{job_id}", kind.name()));
    let per_row = PerRow::new(&request, plan, vec!["distance".to_owned()], true);
    if let Some(answer) = per_row.without_work(&eigen.0).await? {
        return Ok(answer);
    }
    let harmonics = request.harmonics(eigen, 1).await?;
    let (bases, modes) = (&harmonics.bases, &harmonics.modes);
    let row = from % bases.block_rows();
    let origin = bases
        .of_block(from / bases.block_rows(), move |block| {
            (0..block.bases()).map(|j| block.column(j)[row]).collect::<Vec<f64>>()
        })
        .await?;
    if origin.iter().any(|h| h.is_nan()) {
        let told = "carries no result: it is not finite, or in a component too small to analyze";
        return Err(Problem::invalid("from", format!("row {from} {told}")));
    }
    let distance = Distance::from(kind, origin, time, modes).ok_or_else(|| no_scale(modes.len()))?;
    let time = distance.time;
    let json = move |mut values: Vec<Vec<f64>>, wanted: &Wanted| {
        let values = values.swap_remove(0);
        download::json(&Distances { job_id, points, from, kind, time, values }, wanted)
    };
    per_row.answer(harmonics, move |block| vec![distance.values(block)], json).await
}

//! Distances from one point to all, by the spectrum.

use std::sync::Arc;

use axum::response::Response;
use serde::Serialize;
use serde_json::Map;
use utoipa::ToSchema;
use uuid::Uuid;

use super::signatures::no_scale;
use crate::harmonics::{Distance, DistanceKind, DistanceRequest};
use crate::http::results::offered::offered;
use crate::http::results::per_row::PerRow;
use crate::http::results::request::{self, Harmonics, ResultRequest};
use crate::http::wire::accept::{JSON, NPY, PLY};
use crate::http::wire::problem::{Kind, Problem};
use crate::http::wire::problem_sets::{RangeProblem, ResultProblems};

offered!(DistanceRequest: [JSON, NPY, PLY], "Format of the answer: `npy` is an array of points; `ply` has the points and the property `distance`.");

/// Distances as JSON.
#[derive(Debug, Serialize, ToSchema)]
#[allow(dead_code)] // describes what is written number by number
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
    values: Vec<Option<f64>>,
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
        (status = 200, description = "The distances.", content((Distances = "application/json"), (Vec<u8> = "application/x-npy"), (Vec<u8> = "application/ply")), headers(("ETag" = String, description = "Of these bytes."))),
        (status = 206, description = "The range request for.", content((Vec<u8> = "application/x-npy"), (Vec<u8> = "application/ply"))),
        (status = 304, description = "The client's copy is current."),
        RangeProblem,
        ResultProblems,
    )
)]
pub(crate) async fn distances(request: ResultRequest<DistanceRequest>) -> Result<Response, Problem> {
    let Harmonics { job, modes, bases, reservation } = request.harmonics_per_row(1).await?;
    let DistanceRequest { from, kind, time } = request.arguments;
    if time.is_some() && kind == DistanceKind::Biharmonic {
        return Err(Problem::new(Kind::InvalidParameter, "parameter `time` belongs to kind=diffusion")
            .with("parameter", "time"));
    }
    if from >= bases.rows() {
        return Err(Problem::new(
            Kind::InvalidParameter,
            format!("parameter `from` is a row of the upload, 0 to {}, not {from}", bases.rows() - 1),
        )
        .with("parameter", "from"));
    }
    let row = from % bases.block_rows();
    let origin = bases
        .of_block(from / bases.block_rows(), move |block| {
            (0..block.bases()).map(|j| block.column(j)[row]).collect::<Vec<f64>>()
        })
        .await?;
    if origin.iter().any(|h| h.is_nan()) {
        return Err(Problem::new(
            Kind::InvalidParameter,
            format!("row {from} carries no result: it is not finite, or in a component too small to analyze"),
        )
        .with("parameter", "from"));
    }
    let distance = Distance::from(kind, origin, time, &modes).ok_or_else(|| no_scale(modes.len()))?;
    let per_row = PerRow {
        names: vec!["distance".to_owned()],
        head: Map::from_iter([
            ("job_id".to_owned(), job.id.to_string().into()),
            ("points".to_owned(), bases.rows().into()),
            ("from".to_owned(), from.into()),
            ("kind".to_owned(), kind.name().into()),
            ("time".to_owned(), distance.time.into()),
        ]),
        work: Arc::new(move |block| vec![distance.values(block)]),
        bases,
        is_single: true,
        tag: request::tag(job.id, &(kind, from, time.map(f64::to_bits))),
        stem: kind.name(),
        reservation,
    };
    per_row.answer(&request, &job).await
}

//! Distances from one point to all, by the spectrum.

use std::sync::Arc;

use axum::response::Response;
use serde::Serialize;
use serde_json::Map;
use utoipa::ToSchema;
use uuid::Uuid;

use super::signatures::no_scale;
use crate::harmonics::{Distance, DistanceKind};
use crate::http::results::asked::resource;
use crate::http::results::asked::{self, Asked, Harmonics, ResultProblems};
use crate::http::results::per_row::PerRow;
use crate::http::wire::accept::{JSON, NPY, Offer, PLY};
use crate::http::wire::problem::{Kind, Problem, ProblemDocument};
use crate::http::wire::query::{Accepts, Argument};

/// What they can be had as.
pub(crate) const OFFERS: [Offer; 3] = [JSON, NPY, PLY];

pub(crate) const ARGUMENTS: &[Argument] = &[
    asked::format(
        &["json", "npy", "ply"],
        "by Accept, else json",
        "Format of the answer: `npy` is an array of points; `ply` has the points and the property `distance`.",
    ),
    Argument {
        name: "from",
        alias: None,
        accepts: Accepts::Integer(0, u64::MAX),
        default: "0",
        meaning: "Row of the upload to measure from, counting from 0.",
    },
    Argument {
        name: "kind",
        alias: None,
        accepts: Accepts::Word(&["biharmonic", "diffusion"]),
        default: "biharmonic",
        meaning: "Biharmonic distance (a length), or diffusion distance (in 1/length).",
    },
    Argument {
        name: "time",
        alias: None,
        accepts: Accepts::Positive,
        default: "1/√(λ₁ λ_max)",
        meaning: "Time of the diffusion, in squared units of the cloud.",
    },
];

resource!(
    /// Query of `GET /jobs/{id}/distances`.
    ReadDistances: OFFERS, ARGUMENTS
);

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
    params(("id" = Uuid, Path, description = "The job."), ReadDistances),
    responses(
        (status = 200, description = "The distances.", content((Distances = "application/json"), (Vec<u8> = "application/x-npy"), (Vec<u8> = "application/ply")), headers(("ETag" = String, description = "Of these bytes."))),
        (status = 206, description = "The range asked for.", content((Vec<u8> = "application/x-npy"), (Vec<u8> = "application/ply"))),
        (status = 304, description = "The client's copy is current."),
        (status = 416, description = "The range lies outside.", body = ProblemDocument, content_type = "application/problem+json"),
        ResultProblems,
    )
)]
pub(crate) async fn distances(asked: Asked<ReadDistances>) -> Result<Response, Problem> {
    let Harmonics { job, modes, bases, reservation } = asked.harmonics().await?;
    let from = asked.arguments.integer("from").unwrap_or(0);
    let kind = match asked.arguments.word("kind") {
        Some("diffusion") => DistanceKind::Diffusion,
        _ => DistanceKind::Biharmonic,
    };
    let time = asked.arguments.number("time");
    if time.is_some() && kind == DistanceKind::Biharmonic {
        return Err(Problem::new(Kind::InvalidParameter, "parameter `time` belongs to kind=diffusion")
            .with("parameter", "time"));
    }
    if from >= bases.rows() as u64 {
        return Err(Problem::new(
            Kind::InvalidParameter,
            format!("parameter `from` is a row of the upload, 0 to {}, not {from}", bases.rows() - 1),
        )
        .with("parameter", "from"));
    }
    let from = from as usize;
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
        tag: asked::tag(job.id, &(kind, from, time.map(f64::to_bits))),
        stem: kind.name(),
        reservation,
    };
    per_row.answer(&asked, &job).await
}

//! Heat and wave kernel signatures of every point.

use std::sync::Arc;

use axum::response::Response;
use serde::Serialize;
use serde_json::Map;
use utoipa::ToSchema;
use uuid::Uuid;

use crate::harmonics::{Signature, SignatureKind};
use crate::http::results::asked::resource;
use crate::http::results::asked::{self, Asked, Harmonics, ResultProblems};
use crate::http::results::per_row::PerRow;
use crate::http::wire::accept::{JSON, NPY, Offer, PLY};
use crate::http::wire::problem::{Kind, Problem, ProblemDocument};
use crate::http::wire::query::{Accepts, Argument};

/// What they can be had as.
pub(crate) const OFFERS: [Offer; 3] = [JSON, NPY, PLY];

/// Scales when nothing is said.
const COUNT_DEFAULT: u64 = 16;

pub(crate) const ARGUMENTS: &[Argument] = &[
    asked::format(
        &["json", "npy", "ply"],
        "by Accept, else json",
        "Format of the answer: `npy` is an array of points × scales; `ply` has the points and one property per scale, `hks_0` and so on.",
    ),
    Argument {
        name: "kind",
        alias: None,
        accepts: Accepts::Word(&["hks", "wks"]),
        default: "hks",
        meaning: "Heat kernel signature, `Σ exp(−λt) H²`, or wave kernel signature, `Σ w H²` with log-normal weights around an energy.",
    },
    Argument {
        name: "count",
        alias: Some("scales"),
        accepts: Accepts::Integer(1, 256),
        default: "16",
        meaning: "Number of scales, spread evenly in the logarithm over what the bases resolve.",
    },
    Argument {
        name: "scaled",
        alias: None,
        accepts: Accepts::Switch,
        default: "false",
        meaning: "Divide every scale of the heat kernel signature by its integral over the surface. The wave kernel signature always is.",
    },
];

resource!(
    /// Query of `GET /jobs/{id}/signatures`.
    ReadSignatures: OFFERS, ARGUMENTS
);

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
    params(("id" = Uuid, Path, description = "The job."), ReadSignatures),
    responses(
        (status = 200, description = "The signatures.", content((Signatures = "application/json"), (Vec<u8> = "application/x-npy"), (Vec<u8> = "application/ply")), headers(("ETag" = String, description = "Of these bytes."))),
        (status = 206, description = "The range asked for.", content((Vec<u8> = "application/x-npy"), (Vec<u8> = "application/ply"))),
        (status = 304, description = "The client's copy is current."),
        (status = 416, description = "The range lies outside.", body = ProblemDocument, content_type = "application/problem+json"),
        ResultProblems,
    )
)]
pub(crate) async fn signatures(asked: Asked<ReadSignatures>) -> Result<Response, Problem> {
    let Harmonics { job, modes, bases, reservation } = asked.harmonics().await?;
    let kind =
        if asked.arguments.word("kind") == Some("wks") { SignatureKind::Wks } else { SignatureKind::Hks };
    let count = asked.arguments.integer("count").unwrap_or(COUNT_DEFAULT) as usize;
    let scaled = asked.arguments.switch("scaled").unwrap_or(false);
    let signature = Signature::new(kind, count, &modes).ok_or_else(|| no_scale(modes.len()))?;
    let signature = if scaled { signature.scaled() } else { signature };
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
        tag: asked::tag(job.id, &(kind, count, scaled)),
        stem: kind.name(),
        reservation,
    };
    per_row.answer(&asked, &job).await
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

//! The bases of a job: JSON, NumPy array, or PLY with the points.

use std::ops::Range;
use std::sync::Arc;

use axum::body::{Body, Bytes};
use axum::response::Response;
use futures_util::stream::{self, StreamExt};
use serde::Serialize;
use utoipa::ToSchema;
use uuid::Uuid;

use super::accept::{JSON, NPY, Offer, PLY};
use super::asked::{self, Asked, ResultProblems};
use super::download::Download;
use super::points;
use super::problem::{Kind, Problem, ProblemDocument};
use super::query::{Accepts, Argument, Arguments, resource};
use super::rows::{self, RowLayout};
use crate::cloud::writer::{Column, encode_rows, ply_columns, ply_properties};
use crate::cloud::{PointCloud, ScalarType};
use crate::jobs::Compute;
use crate::store::{CHUNK_POINTS, Store};

/// What they can be had as.
pub(crate) const OFFERS: [Offer; 3] = [JSON, NPY, PLY];

const ARGUMENTS: &[Argument] = &[
    Argument {
        name: "first",
        alias: None,
        accepts: Accepts::Integer(0, u64::MAX),
        default: "0",
        meaning: "Index of the first basis, from 0.",
    },
    Argument {
        name: "count",
        alias: None,
        accepts: Accepts::Integer(1, u64::MAX),
        default: "all from the first",
        meaning: "Number of bases.",
    },
    asked::format(
        &["json", "npy", "ply"],
        "by Accept, else json",
        "Format of the answer: `npy` is an array of points × bases in C order; `ply` has the points and one property per basis, `basis_0` and so on.",
    ),
    Argument {
        name: "dtype",
        alias: None,
        accepts: Accepts::Word(&["f64", "f32"]),
        default: "f64 for npy, f32 for ply",
        meaning: "Type of the numbers in npy and ply.",
    },
];

resource!(
    /// Query of `GET /jobs/{id}/bases`.
    ReadBases: OFFERS, ARGUMENTS
);

/// Bases as JSON.
#[derive(Debug, Serialize, ToSchema)]
#[allow(dead_code, clippy::struct_field_names)] // describes what is written number by number
pub(crate) struct Bases {
    /// Rows of the upload.
    points: u64,
    /// Index of the first basis.
    first: usize,
    /// Number of bases.
    count: usize,
    /// Their eigenvalues λ.
    eigenvalues: Vec<Option<f64>>,
    /// One array per basis, one number per row of the upload; null for rows without a result.
    bases: Vec<Vec<Option<f64>>>,
}

/// The bases: one number per basis and row of the upload.
///
/// Normalised so that `HᵀBH = I`. Rows without a result are NaN (null in JSON); duplicates have the values of their
/// first occurrence. Answers to npy and ply support ranges.
#[utoipa::path(
    get,
    path = "/jobs/{id}/bases",
    tag = "results",
    params(("id" = Uuid, Path, description = "The job."), ReadBases),
    responses(
        (status = 200, description = "The bases.", content((Bases = "application/json"), (Vec<u8> = "application/x-npy"), (Vec<u8> = "application/ply")), headers(("ETag" = String, description = "Of these bytes."))),
        (status = 206, description = "The range asked for.", content((Vec<u8> = "application/x-npy"), (Vec<u8> = "application/ply"))),
        (status = 304, description = "The client's copy is current."),
        (status = 416, description = "The range lies outside.", body = ProblemDocument, content_type = "application/problem+json"),
        ResultProblems,
    )
)]
pub(crate) async fn bases(asked: Asked<ReadBases>) -> Result<Response, Problem> {
    respond(asked).await
}

/// Which bases of which job, and how to get at them.
#[derive(Clone)]
struct Selection {
    store: Store,
    compute: Compute,
    job: Uuid,
    rows: usize,
    bases: Range<usize>,
}

pub(super) async fn respond(asked: Asked<ReadBases>) -> Result<Response, Problem> {
    let (job, spectrum) = asked.eigen().await?;
    let (service, offer) = (&asked.service, asked.offer);
    let bases = selected(&asked.arguments, spectrum.eigenvalues.len())?;
    let selection = Selection {
        store: service.store.clone(),
        compute: service.compute.clone(),
        job: job.id,
        rows: job.points as usize,
        bases: bases.clone(),
    };
    let kind = match (asked.arguments.word("dtype"), offer) {
        (Some("f32"), _) | (None, PLY) => ScalarType::Float32,
        _ => ScalarType::Float64,
    };
    let tag = format!("{}-{}-{}-{}", job.id.simple(), bases.start, bases.end, kind.ply_name());
    let mut download = Download { offer, tag, stem: format!("bases-{}", job.id), length: None };
    if offer == JSON {
        asked.refuse_large_json(job.points * bases.len() as u64)?;
        let eigenvalues =
            serde_json::to_string(&spectrum.eigenvalues[bases]).map_err(|error| Problem::internal(&error))?;
        return download.answer(&asked.method, &asked.headers, |_| selection.json(&eigenvalues));
    }
    let cloud = match offer {
        PLY => Some(Arc::new(service.store.load_cloud(job.cloud_id).await?)),
        _ => None,
    };
    let (planned, shown) = (selection.clone(), cloud.clone());
    let layout = service.compute.run(move || planned.layout(shown.as_deref(), kind)).await?;
    download.length = Some(layout.length());
    download.answer(&asked.method, &asked.headers, |span| {
        layout.stream(span, move |chunk| selection.clone().chunk(chunk, cloud.clone(), kind))
    })
}

/// The bases that `first` and `count` select of `available`.
fn selected(arguments: &Arguments, available: usize) -> Result<Range<usize>, Problem> {
    let first = arguments.integer("first").unwrap_or(0);
    let count = arguments.integer("count").unwrap_or((available as u64).saturating_sub(first));
    let end = first.saturating_add(count);
    if first < available as u64 && end <= available as u64 {
        return Ok(first as usize..end as usize);
    }
    Err(Problem::new(
        Kind::InvalidParameter,
        format!(
            "the job has {available} bases, 0 to {}; first={first} and count={count} reach beyond",
            available - 1
        ),
    )
    .with("parameter", if first < available as u64 { "count" } else { "first" })
    .with("available", available))
}

impl Selection {
    fn layout(&self, cloud: Option<&PointCloud>, kind: ScalarType) -> RowLayout {
        match cloud {
            None => points::npy_layout(self.rows, self.bases.len(), kind),
            Some(cloud) => {
                let mut properties = ply_properties(cloud);
                properties.truncate(points::axes(cloud));
                properties.extend(self.bases.clone().map(|basis| (format!("basis_{basis}"), kind)));
                points::ply_layout(cloud, properties)
            }
        }
    }

    /// The bytes of a chunk of rows.
    async fn chunk(
        self,
        chunk: usize,
        cloud: Option<Arc<PointCloud>>,
        kind: ScalarType,
    ) -> Result<Vec<u8>, Problem> {
        let Range { start, end } = self.bases;
        let values = self.store.bases_chunk(self.job, start, end - start, chunk).await?;
        let first = chunk * CHUNK_POINTS;
        let rows = CHUNK_POINTS.min(self.rows - first);
        let encode = move || {
            let mut columns = cloud.as_deref().map_or_else(Vec::new, |cloud| ply_columns(cloud, first));
            columns.truncate(cloud.as_deref().map_or(0, points::axes));
            columns.extend(values.iter().map(|values| Column { values, stride: 1, kind }));
            encode_rows(&columns, rows)
        };
        Ok(self.compute.run(encode).await?)
    }

    /// The whole as JSON, a basis at a time.
    fn json(self, eigenvalues: &str) -> Body {
        let (first, count) = (self.bases.start, self.bases.len());
        let head = format!(
            "{{\"points\":{},\"first\":{first},\"count\":{count},\"eigenvalues\":{eigenvalues},\"bases\":[",
            self.rows
        );
        let bases = stream::iter(self.bases.clone()).then(move |basis| {
            let selection = self.clone();
            async move {
                let text = selection.json_basis(basis).await;
                text.map(Bytes::from).map_err(|problem| rows::broken(&problem))
            }
        });
        let whole = stream::iter([Ok(Bytes::from(head))]).chain(bases).chain(stream::iter([Ok("]}".into())]));
        Body::from_stream(whole)
    }

    async fn json_basis(self, basis: usize) -> Result<Vec<u8>, Problem> {
        let values = self.store.basis(self.job, basis).await?;
        let begin: &[u8] = if basis == self.bases.start { b"" } else { b"," };
        let encode = move || {
            let mut text = begin.to_vec();
            serde_json::to_writer(&mut text, &values).map(|()| text)
        };
        self.compute.run(encode).await?.map_err(|error| Problem::internal(&error))
    }
}

//! The bases of a job: JSON, NumPy array or archive, CSV, or PLY with the points.

use std::ops::Range;
use std::sync::Arc;

use axum::response::Response;
use serde::Serialize;
use utoipa::ToSchema;

use super::bases_files::Selection;
use crate::arguments::arguments;
use crate::http::results::offered::offered;
use crate::http::results::per_row;
use crate::http::results::request::{JSON_NUMBER_BYTES, ResultRequest};
use crate::http::results::rows::Table;
use crate::http::wire::accept::{CSV, JSON, NPY, NPZ, PLY};
use crate::http::wire::problem::Problem;
use crate::http::wire::problem_sets::{RangeProblem, ResultProblems};

/// Bytes of a number in memory, and as JSON text.
const BASIS_NUMBER_BYTES: u64 = 8 + JSON_NUMBER_BYTES;

arguments! {
    /// Which bases.
    #[derive(Debug)]
    pub(crate) struct ReadBases {
        /// Index of the first basis, from 0.
        first: usize = integer(0, usize::MAX), default 0;
        /// Number of bases.
        count: Option<usize> = integer(1, usize::MAX), absent "all from the first";
    }
}

offered!(ReadBases: [JSON, NPY, PLY, NPZ, CSV], "Format of the answer: `npy` is an array of points × bases in C order; `ply` has the points and one property per basis, `basis_0` and so on; `csv` the same in columns; `npz` has the arrays `points`, `eigenvalues`, `mass` and `bases`.");

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
/// Normalized so that `HᵀBH = I`. Rows without a result are NaN (null in JSON); duplicates have the values of their
/// first occurrence. Answers in npy, npz and ply support ranges.
#[utoipa::path(
    get,
    path = "/jobs/{id}/bases",
    tag = "results",
    params(("id" = Uuid, Path, description = "The job."), ResultRequest<ReadBases>),
    responses(
        (status = 200, description = "The bases.", body = Bases, headers(("ETag" = String, description = "Of these bytes."))),
        (status = 206, description = "The requested range.", content((Vec<u8> = "application/x-npy"), (Vec<u8> = "application/ply"), (Vec<u8> = "application/x-npz"))),
        (status = 304, description = "The client's copy is current."),
        RangeProblem,
        ResultProblems,
    )
)]
pub(crate) async fn bases(request: ResultRequest<ReadBases>) -> Result<Response, Problem> {
    let (job, spectrum) = request.eigen().await?;
    let (service, offer, rows) = (&request.service, request.offer, job.points as usize);
    let bases = selected(&request.arguments, spectrum.eigenvalues.len())?;
    let selection = Selection {
        store: service.store.clone(),
        compute: service.pools.answering.clone(),
        job: job.id,
        rows,
        chunk_rows: job.chunk_points,
        bases: bases.clone(),
    };
    let (kind, names) = (request.kind(), selection.names());
    let tag = format!("{}-{}-{}", job.id.simple(), bases.start, bases.end);
    let plan = request.plan(tag, format!("bases-{}", job.id));
    // The length of an archive follows from its head, which is made of the cloud.
    let answer = match offer {
        NPZ => plan.unchanged(),
        _ => plan.without_bytes(per_row::length(&request, &job, &names, false).await?),
    };
    if let Some(answer) = answer {
        return Ok(answer);
    }
    let beside = match offer {
        NPY => 0,
        // The archive's head holds the points and the masses again.
        NPZ => 3 * service.store.cloud(job.cloud_id).await?.bytes(),
        _ => service.store.cloud(job.cloud_id).await?.bytes(),
    };
    let eigenvalues = &spectrum.eigenvalues[bases];
    if offer == JSON {
        request.refuse_large_json(job.points * eigenvalues.len() as u64)?;
        // A basis at a time, as numbers and as text; few are on their way.
        let reservation = request.reserve(job.points * 2 * BASIS_NUMBER_BYTES).await?;
        let eigenvalues = serde_json::to_string(eigenvalues).map_err(|error| Problem::internal(&error))?;
        return plan.answer(None, reservation, |_| selection.json(&eigenvalues));
    }
    let reservation = request.reserve(selection.bytes_at_work(kind) + beside).await?;
    let cloud = match offer {
        NPY => None,
        _ => Some(Arc::new(service.store.load_cloud(job.cloud_id).await?)),
    };
    match (offer, cloud) {
        (CSV, Some(cloud)) => plan.answer(None, reservation, |_| selection.csv(cloud)),
        (NPZ, Some(cloud)) => {
            let mass = service.store.mass(job.id).await?;
            let (planned, eigenvalues) = (selection.clone(), eigenvalues.to_vec());
            let archive = move || planned.archive(&cloud, &eigenvalues, &mass, kind);
            let (layout, open) = service.pools.answering.run(archive).await?;
            plan.answer(Some(layout.length()), reservation, |span| {
                let encode = move |chunk| selection.clone().checked_chunk(chunk, kind);
                layout.stream_sealed(span, encode, |checksum| open.tail(checksum))
            })
        }
        (_, cloud) => {
            let table = Table { cloud, kind, is_vector: false };
            let planned = table.clone();
            let layout = service.pools.answering.run(move || planned.layout(rows, &names)).await?;
            let layout = layout.in_chunks_of(selection.chunk_rows);
            plan.answer(Some(layout.length()), reservation, |span| {
                layout.stream(span, move |chunk| selection.clone().chunk(chunk, table.clone()))
            })
        }
    }
}

/// The bases that `first` and `count` select of `available`.
fn selected(arguments: &ReadBases, available: usize) -> Result<Range<usize>, Problem> {
    let first = arguments.first;
    let count = arguments.count.unwrap_or(available.saturating_sub(first));
    let end = first.saturating_add(count);
    if first < available && end <= available {
        return Ok(first..end);
    }
    let told = format!(
        "the job has {available} bases, 0 to {}; first={first} and count={count} reach beyond",
        available - 1
    );
    Err(Problem::invalid(if first < available { "count" } else { "first" }, told)
        .with("available", available))
}

//! The operator applied to functions: `Δf = B⁻¹Q f`.

use std::collections::BTreeMap;

use axum::response::Response;
use serde::Serialize;
use utoipa::ToSchema;
use uuid::Uuid;

use crate::arguments::arguments;
use crate::harmonics::Function;
use crate::harmonics::functions::{carriers, copy_from_first};
use crate::http::results::functions::{self, NumberLists};
use crate::http::results::matrix;
use crate::http::results::offered::offered;
use crate::http::results::request::{self, ResultRequest};
use crate::http::results::rows::npy_file;
use crate::http::wire::accept::{JSON, NPY};
use crate::http::wire::body::IncomingBody;
use crate::http::wire::download;
use crate::http::wire::problem::Problem;
use crate::http::wire::problem_sets::{BodyProblems, ResultProblems};
use crate::jobs::Wanted;
use crate::store::JobRecord;

arguments! {
    /// Arguments of `POST /jobs/{id}/laplacian`: none of its own.
    #[derive(Debug)]
    pub(crate) struct ApplyLaplacian {}
}

offered!(ApplyLaplacian: [JSON, NPY], "Format of the answer: `npy` is an array of points × functions.");

/// Laplacians of functions.
#[derive(Debug, Serialize, ToSchema)]
pub(crate) struct Laplacians {
    /// The job.
    job_id: Uuid,
    /// The cloud it analyzed.
    cloud_id: Uuid,
    /// Rows of the upload.
    points: usize,
    /// Δf of every function by its name, one value per row in the function's unit over length²; null without a result.
    fields: BTreeMap<String, Vec<Option<f64>>>,
    /// What to know before trusting the operator.
    warnings: Vec<String>,
}

/// Δf for posted functions, by the operator of a job of `kind=operator`.
///
/// The body is that of `POST /jobs/{id}/coefficients`. Of rows at the same position the first one's value counts.
#[utoipa::path(
    post,
    path = "/jobs/{id}/laplacian",
    tag = "results",
    params(("id" = Uuid, Path, description = "The job."), ResultRequest<ApplyLaplacian>),
    request_body(content((NumberLists = "application/json"), (Vec<u8> = "application/x-npy")), description = "The functions."),
    responses(
        (status = 200, description = "The Laplacians.", body = Laplacians),
        BodyProblems,
        ResultProblems,
    )
)]
pub(crate) async fn laplacian(
    mut request: ResultRequest<ApplyLaplacian>,
    body: IncomingBody,
) -> Result<Response, Problem> {
    let job = request.job().await?;
    request::check_kept(&job)?;
    let (given, mut reservation) = functions::receive(&request.service, body).await?;
    functions::check_length(&given, job.points as usize)?;
    request.refuse_large_json(given.len() as u64 * job.points)?;
    let store = &request.service.store;
    let cloud = store.cloud(job.cloud_id).await?.bytes();
    // The result is as large as the input and exists twice: as numbers and encoded.
    let fields = given.len() as u64 * job.points * (8 + request.number_bytes());
    reservation.add(matrix::bytes_of(&job) + cloud + fields).await?;
    let (mass, matrix) = (store.mass(job.id).await?, store.operator_matrix(job.id).await?);
    // Rows without mass of their own repeat an earlier one.
    let looked_at = request.service.pools.answering.run(move || (mass.contains(&0.0), mass));
    let (repeats, mass) = looked_at.await?;
    let cloud = if repeats { Some(store.load_cloud(job.cloud_id).await?) } else { None };
    request.forget_conditions();
    let (offer, kind) = (request.offer, request.kind());
    let plan = request.plan(job.id.simple().to_string(), format!("laplacian-{}", job.id));
    let computed = request.service.pools.answering.run_while_wanted(move |wanted| {
        functions::check_finite(&given, &mass)?;
        let first = cloud.as_ref().and_then(|cloud| carriers(cloud, &mass));
        let apply = |function: &Function| {
            let mut values = matrix.laplacian_of(&mass, &function.values);
            if let Some(first) = &first {
                copy_from_first(&mut values, first);
            }
            values
        };
        let found: Vec<Vec<f64>> = given.iter().map(apply).collect();
        if offer == NPY {
            let columns: Vec<&[f64]> = found.iter().map(|values| &values[..]).collect();
            return Ok(npy_file(&columns, kind));
        }
        json(&job, &given, &found, wanted)
    });
    let bytes = computed.await??;
    plan.send(reservation, bytes)
}

fn json(
    job: &JobRecord,
    given: &[Function],
    found: &[Vec<f64>],
    wanted: &Wanted,
) -> Result<Vec<u8>, Problem> {
    let finite = |values: &Vec<f64>| values.iter().map(|&x| Some(x).filter(|x| x.is_finite())).collect();
    let names = given.iter().map(|function| function.name.clone());
    let answer = Laplacians {
        job_id: job.id,
        cloud_id: job.cloud_id,
        points: found.first().map_or(0, Vec::len),
        fields: names.zip(found.iter().map(finite)).collect(),
        warnings: job.report.as_ref().map(|report| report.warnings.clone()).unwrap_or_default(),
    };
    download::json(&answer, wanted)
}

//! The operator of a job: its description, and the matrices Q and B of `L = B⁻¹Q`.

use axum::response::Response;
use serde::Serialize;
use serde_json::{Map, Value};
use utoipa::ToSchema;
use uuid::Uuid;

use crate::analysis::{JobKind, Report, SparseMatrix};
use crate::arguments::{arguments, words};
use crate::http::results::matrix;
use crate::http::results::offered::offered;
use crate::http::results::request::{self, ResultRequest};
use crate::http::wire::accept::{JSON, MTX, NPZ, Offer};
use crate::http::wire::download;
use crate::http::wire::memory::Reservation;
use crate::http::wire::problem::Problem;
use crate::http::wire::problem_sets::ResultProblems;
use crate::store::JobRecord;

words! {
    /// A matrix of `L = B⁻¹Q`.
    pub(crate) enum Matrix {
        /// Minus the stiffness.
        Q,
        /// The mass.
        B,
    }
}

arguments! {
    /// Arguments of `GET /jobs/{id}/operator`.
    #[derive(Debug)]
    pub(crate) struct ReadOperator {
        /// Which matrix of `L = B⁻¹Q`: `Q` (for most operators symmetric, zero row sums, negative semi-definite; the
        /// stiffness is −Q) or `B` (the diagonal mass).
        matrix: Matrix = word(Matrix), default Matrix::Q;
    }
}

/// Bytes of an entry as a line of Matrix Market: row, column, and 17 digits with sign, point and exponent.
const LINE_BYTES: u64 = 45;

offered!(ReadOperator: [JSON, MTX, NPZ], "Format of the answer: `json` describes the operator, `mtx` (Matrix Market) and `npz` (scipy.sparse.load_npz) are a matrix.");

/// An operator's description with its job and cloud.
#[derive(Debug, Serialize, ToSchema)]
pub(crate) struct OperatorView {
    /// The job.
    job_id: Uuid,
    /// The cloud it analyzed.
    cloud_id: Uuid,
    /// What the job computed.
    kind: JobKind,
    /// The report without its spectrum.
    #[serde(flatten)]
    #[schema(value_type = Report)]
    report: Map<String, Value>,
}

/// The operator: its description as JSON, or a matrix of it.
///
/// Rows and columns are the rows of the upload. Every job keeps B; Q is kept by jobs of `kind=operator`.
#[utoipa::path(
    get,
    path = "/jobs/{id}/operator",
    tag = "results",
    params(("id" = Uuid, Path, description = "The job."), ResultRequest<ReadOperator>),
    responses(
        (status = 200, description = "The description or the matrix.", body = OperatorView),
        (status = 304, description = "The client's copy is current."),
        ResultProblems,
    )
)]
pub(crate) async fn operator(request: ResultRequest<ReadOperator>) -> Result<Response, Problem> {
    let job = request.job().await?;
    let (store, compute, offer) = (&request.service.store, &request.service.pools.answering, request.offer);
    let which = request.arguments.matrix;
    let name = if offer == JSON { "operator".to_owned() } else { <&str>::from(which).to_uppercase() };
    let plan = request.plan(format!("{}-{name}", job.id.simple()), format!("{name}-{}", job.id));
    if offer != JSON && which == Matrix::Q {
        request::check_kept(&job)?;
    }
    if let Some(answer) = plan.without_work() {
        return Ok(answer);
    }
    if offer == JSON {
        let described = compute.run_while_wanted(move |wanted| download::json(&describe(&job)?, wanted));
        return plan.send(Reservation::small(), described.await??);
    }
    let reservation = request.reserve(bytes_of(&job, which, offer)).await?;
    let encode = if offer == MTX { matrix::matrix_market } else { matrix::scipy_archive };
    let encoded = match which {
        Matrix::Q => {
            let matrix = store.operator_matrix(job.id).await?;
            compute.run_while_wanted(move |wanted| encode(&matrix, wanted)).await
        }
        Matrix::B => {
            let mass = store.mass(job.id).await?;
            compute.run_while_wanted(move |wanted| encode(&diagonal(&mass), wanted)).await
        }
    };
    plan.send(reservation, encoded??)
}

/// Bytes of memory for a matrix and its encoded file.
fn bytes_of(job: &JobRecord, matrix: Matrix, offer: Offer) -> u64 {
    let (entries, matrix) = match matrix {
        Matrix::B => (job.points, job.points * (matrix::ENTRY_BYTES + 3 * 8)),
        Matrix::Q => (job.report.as_ref().map_or(0, |report| report.nonzeros as u64), matrix::bytes_of(job)),
    };
    let line = if offer == MTX { LINE_BYTES } else { matrix::ENTRY_BYTES };
    matrix + entries * line + job.points * 8
}

fn describe(job: &JobRecord) -> Result<OperatorView, Problem> {
    let report = serde_json::to_value(&job.report).map_err(|error| Problem::internal(&error))?;
    let Value::Object(mut report) = report else {
        return Err(Problem::internal(&format!("job {} succeeded without a report", job.id)));
    };
    report.remove("spectrum");
    Ok(OperatorView { job_id: job.id, cloud_id: job.cloud_id, kind: job.kind, report })
}

/// The diagonal matrix of the masses; rows without one (duplicates, rows without a result) are empty.
fn diagonal(mass: &[f64]) -> SparseMatrix {
    let mut matrix = SparseMatrix { offsets: vec![0], columns: Vec::new(), values: Vec::new() };
    for (row, &value) in mass.iter().enumerate() {
        if value.is_finite() && value != 0.0 {
            matrix.columns.push(row as u32);
            matrix.values.push(value);
        }
        matrix.offsets.push(matrix.values.len() as u64);
    }
    matrix
}

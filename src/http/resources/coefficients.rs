//! The manifold harmonic transform: functions into coefficients, and back.

use std::collections::BTreeMap;
use std::sync::Arc;

use axum::response::Response;
use serde::Serialize;
use serde_json::{Map, Value};
use utoipa::ToSchema;
use uuid::Uuid;

use crate::arguments::arguments;
use crate::cloud::PointCloud;
use crate::harmonics::filtered::Target;
use crate::harmonics::functions::rows_without_result;
use crate::harmonics::{Bands, Block, Energy, Function, Modes, Transformed, transform};
use crate::http::results::functions::{self, NumberLists, own_coefficients, project};
use crate::http::results::offered::offered;
use crate::http::results::per_row::PerRow;
use crate::http::results::request::{self, Harmonics, ResultRequest};
use crate::http::results::rows::npy_file;
use crate::http::wire::accept::{JSON, NPY, PLY};
use crate::http::wire::body::IncomingBody;
use crate::http::wire::download;
use crate::http::wire::problem::Problem;
use crate::http::wire::problem_sets::{BodyProblems, ResultProblems};
use crate::jobs::Wanted;

/// Arguments of `GET` and `POST /jobs/{id}/coefficients`.
pub(crate) type ReadCoefficients = Bands;

offered!(Bands: [JSON, NPY], "Format of the answer: `npy` is an array of bases × functions, without names and energies.");

arguments! {
    /// Arguments of `POST /jobs/{id}/synthesis`: none of its own.
    #[derive(Debug)]
    pub(crate) struct Synthesize {}
}

offered!(Synthesize: [JSON, NPY, PLY], "Format of the answer: `npy` is an array of points × functions; `ply` has the points and one property per function.");

/// Functions in the bases.
#[derive(Debug, Serialize, ToSchema)]
pub(crate) struct Coefficients {
    /// The job.
    job_id: Uuid,
    /// The cloud it analyzed.
    cloud_id: Uuid,
    /// Rows of the upload.
    points: usize,
    /// Rows that carry no result and take no part.
    rows_without_result: usize,
    /// λ of every mode in 1/length²; null where it carries no information.
    eigenvalues: Vec<Option<f64>>,
    /// √λ of every mode in 1/length; null where λ is.
    frequencies: Vec<Option<f64>>,
    /// `fᵀ B H_i` of every function by its name, one number per mode; in the function's units times length.
    #[schema(value_type = BTreeMap<String, Vec<f64>>)]
    fields: Map<String, Value>,
    /// How every function's energy `fᵀBf` is spread over the modes.
    energy: BTreeMap<String, Energy>,
    /// Fields of the upload that have no coefficients, and why.
    omitted: BTreeMap<String, String>,
    /// What to know before trusting the bases.
    warnings: Vec<String>,
    /// Index ranges `[first, last]` of modes inside which single coefficients depend on an arbitrary choice of bases.
    clusters: Vec<[usize; 2]>,
}

/// Coefficients of x, y, z and of every scalar field of the upload.
///
/// `f̃_i = fᵀ B H_i`, with energies by Parseval's identity: `fᵀBf = Σ f̃_i²` plus what lies outside of the span of the
/// bases.
#[utoipa::path(
    get,
    path = "/jobs/{id}/coefficients",
    tag = "harmonics",
    params(("id" = Uuid, Path, description = "The job."), ResultRequest<ReadCoefficients>),
    responses(
        (status = 200, description = "The coefficients.", body = Coefficients),
        (status = 304, description = "The client's copy is current."),
        ResultProblems,
    )
)]
pub(crate) async fn coefficients(request: ResultRequest<ReadCoefficients>) -> Result<Response, Problem> {
    let eigen = request.eigen().await?;
    let tag = request::tag(eigen.0.id, &request.arguments.bands);
    if let Some(answer) = request.plan(tag.clone(), stem(eigen.0.id)).without_work() {
        return Ok(answer);
    }
    let mut harmonics = request.harmonics(eigen, 0).await?;
    let store = &request.service.store;
    let cloud = store.load_cloud(harmonics.job.cloud_id).await?;
    let mass = store.mass(harmonics.job.id).await?;
    let chosen = request.service.pools.answering.run(move || own_functions(&cloud, mass));
    let (given, mass, told) = chosen.await??;
    let (given, found) = own_coefficients(&mut harmonics, given, mass).await?;
    answer(&request, harmonics, given, found, told, tag).await
}

/// Coefficients of posted functions.
///
/// The body is JSON (an array of numbers, one per row of the upload; an array of such arrays; or an object of them by
/// name) or an npy file of n or n × m numbers. Rows without a result may be null or NaN.
#[utoipa::path(
    post,
    path = "/jobs/{id}/coefficients",
    operation_id = "of_posted",
    tag = "harmonics",
    params(("id" = Uuid, Path, description = "The job."), ResultRequest<ReadCoefficients>),
    request_body(content((NumberLists = "application/json"), (Vec<u8> = "application/x-npy")), description = "The functions."),
    responses(
        (status = 200, description = "The coefficients.", body = Coefficients),
        BodyProblems,
        ResultProblems,
    )
)]
pub(crate) async fn posted_coefficients(
    mut request: ResultRequest<ReadCoefficients>,
    body: IncomingBody,
) -> Result<Response, Problem> {
    let eigen = request.eigen().await?;
    let (given, reservation) = functions::receive(&request.service, body).await?;
    functions::check_length(&given, eigen.0.points as usize)?;
    let mut harmonics = request.harmonics_of(eigen, reservation, 0).await?;
    let mass = request.service.store.mass(harmonics.job.id).await?;
    request.forget_conditions();
    let tag = harmonics.job.id.simple().to_string();
    let checked = request.service.pools.answering.run(move || {
        functions::check_finite(&given, &mass)?;
        let told = Accompanying { rows_without_result: rows_without_result(&mass), omitted: BTreeMap::new() };
        Ok::<_, Problem>((given, mass, told))
    });
    let (given, mass, told) = checked.await??;
    let (given, found) = project(&mut harmonics, given, mass).await?;
    answer(&request, harmonics, given, found, told, tag).await
}

/// What accompanies coefficients.
struct Accompanying {
    rows_without_result: usize,
    omitted: BTreeMap<String, String>,
}

/// The coordinates and fields of a cloud, those left out that are not numbers in every row that takes part.
fn own_functions(
    cloud: &PointCloud,
    mass: Vec<f64>,
) -> Result<(Vec<Function>, Vec<f64>, Accompanying), Problem> {
    let mut given = Target::Coordinates.functions(cloud, &mass)?;
    let mut omitted = BTreeMap::new();
    for place in 0..cloud.fields().len() {
        match Target::Fields(vec![place]).functions(cloud, &mass) {
            Ok(field) => given.extend(field),
            Err(error) => {
                omitted.insert(cloud.fields()[place].name.clone(), error.to_string());
            }
        }
    }
    let told = Accompanying { rows_without_result: rows_without_result(&mass), omitted };
    Ok((given, mass, told))
}

fn stem(job: Uuid) -> String {
    format!("coefficients-{job}")
}

async fn answer(
    request: &ResultRequest<ReadCoefficients>,
    harmonics: Harmonics,
    given: Arc<Vec<Function>>,
    found: Vec<Transformed>,
    told: Accompanying,
    tag: String,
) -> Result<Response, Problem> {
    let Harmonics { job, modes, bases, reservation } = harmonics;
    let (offer, kind, bands) = (request.offer, request.kind(), request.arguments.bands);
    let (stem, points) = (stem(job.id), bases.rows());
    let encode = move |wanted: &Wanted| {
        if offer == NPY {
            let columns: Vec<&[f64]> = found.iter().map(|function| &function.coefficients[..]).collect();
            return Ok(npy_file(&columns, kind));
        }
        let finite = |x: f64| Some(x).filter(|x| x.is_finite());
        let named = || given.iter().map(|function| function.name.clone()).zip(&found);
        let answer = Coefficients {
            job_id: job.id,
            cloud_id: job.cloud_id,
            points,
            rows_without_result: told.rows_without_result,
            eigenvalues: modes.eigenvalues().iter().map(|&lambda| finite(lambda)).collect(),
            frequencies: (0..modes.len()).map(|mode| finite(modes.frequency(mode))).collect(),
            energy: named().map(|(name, found)| (name, Energy::of(found, bands))).collect(),
            fields: named().map(|(name, found)| (name, found.coefficients.clone().into())).collect(),
            omitted: told.omitted,
            warnings: job.report.map(|report| report.warnings).unwrap_or_default(),
            clusters: modes.clusters().to_vec(),
        };
        download::json(&answer, wanted)
    };
    let bytes = request.service.pools.answering.run_while_wanted(encode).await??;
    request.plan(tag, stem).send(reservation, bytes)
}

/// Functions from posted coefficients: the inverse of the transform.
///
/// The body is as for `POST …/coefficients`, one number per mode; lists may end early. An answer of
/// `GET …/coefficients` can be sent back as it came.
#[utoipa::path(
    post,
    path = "/jobs/{id}/synthesis",
    tag = "harmonics",
    params(("id" = Uuid, Path, description = "The job."), ResultRequest<Synthesize>),
    request_body(content((NumberLists = "application/json"), (Vec<u8> = "application/x-npy")), description = "The coefficients."),
    responses(
        (status = 200, description = "One number per function and row of the upload: in JSON `names`, and `values` with an array per function.", body = Synthesized),
        BodyProblems,
        ResultProblems,
    )
)]
pub(crate) async fn synthesis(
    mut request: ResultRequest<Synthesize>,
    body: IncomingBody,
) -> Result<Response, Problem> {
    let eigen = request.eigen().await?;
    let (given, reservation) = functions::receive(&request.service, body).await?;
    check_coefficients(&given, &Modes::of(&eigen.1))?;
    let harmonics = request.harmonics_of(eigen, reservation, given.len()).await?;
    request.forget_conditions();
    let (job_id, points) = (harmonics.job.id, harmonics.bases.rows());
    let names: Vec<String> = given.iter().map(|function| function.name.clone()).collect();
    // Coordinates keep their place in PLY: a property of the same name would be read as one.
    let prefix = if request.offer == PLY { "f_" } else { "" };
    let columns = names.iter().map(|name| format!("{prefix}{name}")).collect();
    let plan = request.plan(job_id.simple().to_string(), format!("synthesis-{job_id}"));
    let synthesize = move |block: &Block<Vec<f64>>| {
        let lists: Vec<&[f64]> = given.iter().map(|list| list.values.as_slice()).collect();
        transform::synthesize(block, &lists)
    };
    let json =
        move |values, wanted: &Wanted| download::json(&Synthesized { job_id, points, names, values }, wanted);
    PerRow::new(&request, plan, columns, false).answer(harmonics, synthesize, json).await
}

fn check_coefficients(given: &[Function], modes: &Modes) -> Result<(), Problem> {
    let available = modes.len();
    for list in given {
        let refuse = |what: String| {
            Err(Problem::invalid(&list.name, format!("`{}` {what}", list.name)).with("available", available))
        };
        if list.values.len() > available {
            return refuse(format!("has {} coefficients; the job has {available} bases", list.values.len()));
        }
        if let Some(place) = list.values.iter().position(|c| !c.is_finite()) {
            return refuse(format!("is not a finite number at place {place} (counting from 0)"));
        }
    }
    Ok(())
}

/// Functions on the rows of the upload.
#[derive(Debug, Serialize, ToSchema)]
pub(crate) struct Synthesized {
    /// The job.
    job_id: Uuid,
    /// Rows of the upload.
    points: usize,
    /// Names of the functions.
    names: Vec<String>,
    /// One array per function, one number per row; null without a result.
    #[schema(value_type = Vec<Vec<Option<f64>>>)]
    values: Vec<Vec<f64>>,
}

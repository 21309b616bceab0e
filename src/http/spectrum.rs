//! The spectrum of a job: eigenvalues and what tells how far to trust them.

use std::fmt::Write as _;

use axum::Json;
use axum::extract::{Path, State};
use axum::http::{HeaderMap, Uri, header};
use axum::response::{IntoResponse, Response};
use serde::Serialize;
use utoipa::ToSchema;
use uuid::Uuid;

use super::accept::{self, CSV, JSON, Offer};
use super::problem::{self, Kind, Problem, ProblemDocument};
use super::query::{Accepts, Argument, arguments};
use super::{Service, Shared, parse_id};
use crate::analysis::Report;
use crate::harmonics::heat_trace;
use crate::spectrum::Spectrum;
use crate::store::JobRecord;

/// What it can be had as.
pub(crate) const OFFERS: [Offer; 2] = [JSON, CSV];

const ARGUMENTS: &[Argument] = &[Argument {
    name: "format",
    alias: None,
    accepts: Accepts::Word(&["json", "csv"]),
    default: "by Accept, else json",
    meaning: "Format of the answer.",
}];

arguments!(
    /// Query of `GET /jobs/{id}/spectrum`.
    ReadSpectrum = ARGUMENTS
);

/// A spectrum, and whose it is.
#[derive(Debug, Serialize, ToSchema)]
pub(crate) struct SpectrumView {
    /// The job.
    job_id: Uuid,
    /// The cloud it analysed.
    cloud_id: Uuid,
    /// Area of the surface, measured in two ways.
    area: AreaView,
    /// The spectrum.
    #[serde(flatten)]
    spectrum: Spectrum,
}

/// Areas in the cloud's unit of length, squared.
#[derive(Debug, Serialize, ToSchema)]
pub(crate) struct AreaView {
    /// Sum of the Voronoi cells.
    cells: Option<f64>,
    /// From the heat trace of the eigenvalues; null for fewer than 10 of them.
    heat_trace: Option<f64>,
    /// Of the heat trace's value: its distance to the fit of one order less.
    uncertainty: Option<f64>,
}

impl AreaView {
    fn new(report: Option<&Report>, spectrum: &Spectrum) -> Self {
        // values from the first absent one on say nothing
        let known: Vec<f64> = spectrum.eigenvalues.iter().map_while(|&lambda| lambda).collect();
        let estimate = heat_trace::area(&known);
        Self {
            cells: report.map(|report| report.sampling.area),
            heat_trace: estimate.map(|estimate| estimate.area),
            uncertainty: estimate.map(|estimate| estimate.uncertainty),
        }
    }
}

/// Eigenvalues, residuals, clusters and certificates.
#[utoipa::path(
    get,
    path = "/jobs/{id}/spectrum",
    tag = "results",
    params(("id" = Uuid, Path, description = "The job."), ReadSpectrum),
    responses(
        (status = 200, description = "The spectrum; as CSV one row per eigenvalue.", content((SpectrumView = "application/json"), (String = "text/csv"))),
        (status = 404, description = "No such job.", body = ProblemDocument, content_type = "application/problem+json"),
        (status = 406, description = "None of the formats is acceptable.", body = ProblemDocument, content_type = "application/problem+json"),
        (status = 409, description = "The job has no spectrum, or not yet.", body = ProblemDocument, content_type = "application/problem+json"),
        (status = 422, description = "A parameter is not accepted.", body = ProblemDocument, content_type = "application/problem+json"),
    )
)]
pub(crate) async fn spectrum(
    State(service): State<Shared>,
    Path(id): Path<String>,
    uri: Uri,
    headers: HeaderMap,
) -> Result<Response, Problem> {
    let arguments = ReadSpectrum::read(&uri)?;
    let offer = accept::choose(arguments.word("format"), &headers, &OFFERS)?;
    respond(&service, &id, offer).await
}

pub(super) async fn respond(service: &Service, id: &str, offer: Offer) -> Result<Response, Problem> {
    let (job, spectrum) = of_job(service.store.job(parse_id(id)?).await?)?;
    if offer == CSV {
        return Ok(([(header::CONTENT_TYPE, CSV.media_type())], csv(&spectrum)).into_response());
    }
    let area = AreaView::new(job.report.as_ref(), &spectrum);
    Ok(Json(SpectrumView { job_id: job.id, cloud_id: job.cloud_id, area, spectrum }).into_response())
}

/// The spectrum of a job that has succeeded.
pub(super) fn of_job(mut job: JobRecord) -> Result<(JobRecord, Spectrum), Problem> {
    if let Some(problem) = problem::without_result(&job) {
        return Err(problem);
    }
    let spectrum = job.report.as_mut().and_then(|report| report.spectrum.take());
    match spectrum {
        Some(spectrum) => Ok((job, spectrum)),
        None => Err(Problem::new(
            Kind::NoSuchResult,
            format!(
                "job {} built the operator only; submit {{\"kind\": \"eigen\"}} to /clouds/{}/jobs for bases and spectrum",
                job.id, job.cloud_id
            ),
        )
        .with("links", serde_json::json!({ "jobs": format!("/clouds/{}/jobs", job.cloud_id) }))),
    }
}

fn csv(spectrum: &Spectrum) -> String {
    let mut text = String::from("index,eigenvalue,raw_eigenvalue,residual,frequency\n");
    let rows = spectrum.eigenvalues.iter().zip(&spectrum.raw_eigenvalues).zip(&spectrum.residuals);
    for (index, ((eigenvalue, raw), residual)) in rows.enumerate() {
        let eigenvalue = eigenvalue.unwrap_or(f64::NAN);
        let frequency = if eigenvalue < 0.0 { 0.0 } else { eigenvalue.sqrt() };
        // Writing to a string cannot fail.
        let _ = writeln!(text, "{index},{eigenvalue:?},{raw:?},{residual:?},{frequency:?}");
    }
    text
}

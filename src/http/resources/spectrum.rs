//! The spectrum of a job: eigenvalues and their certificates.

use std::fmt::Write as _;

use axum::response::Response;
use serde::Serialize;
use utoipa::ToSchema;
use uuid::Uuid;

use crate::analysis::Report;
use crate::arguments::arguments;
use crate::harmonics::Modes;
use crate::harmonics::invariants::{self, Invariants};
use crate::http::results::offered::offered;
use crate::http::results::request::{self, ResultRequest};
use crate::http::wire::accept::{CSV, JSON, SVG};
use crate::http::wire::download;
use crate::http::wire::memory::Reservation;
use crate::http::wire::problem::Problem;
use crate::http::wire::problem_sets::ResultProblems;
use crate::jobs::Wanted;
use crate::picture;
use crate::spectrum::Spectrum;
use crate::store::JobRecord;

arguments! {
    /// Arguments of `GET /jobs/{id}/spectrum`: none of its own.
    #[derive(Debug)]
    pub(crate) struct ReadSpectrum {}
}

offered!(ReadSpectrum: [JSON, CSV, SVG], "Format of the answer; `svg` is a plot.");

/// A spectrum with its job and cloud.
#[derive(Debug, Serialize, ToSchema)]
pub(crate) struct SpectrumView {
    /// The job.
    job_id: Uuid,
    /// The cloud it analyzed.
    cloud_id: Uuid,
    /// The areas of `invariants` by the names that version 0.1 gave them.
    area: AreaView,
    /// What the spectrum says of the whole surface; null for curves, volumes and combinatorial operators.
    invariants: Option<Invariants>,
    /// The spectrum.
    #[serde(flatten)]
    spectrum: Spectrum,
}

/// Areas in the cloud's unit of length, squared.
#[derive(Debug, Serialize, ToSchema)]
pub(crate) struct AreaView {
    /// Sum of the Voronoi cells.
    cells: Option<f64>,
    /// `heat_trace_area` of the invariants.
    heat_trace: Option<f64>,
    /// Its uncertainty.
    uncertainty: Option<f64>,
}

/// The report of an analysis whose eigenvalues are those of a surface.
fn surface(report: Option<&Report>) -> Option<&Report> {
    report.filter(|report| report.is_of_surface())
}

/// Eigenvalues, residuals, clusters and certificates.
#[utoipa::path(
    get,
    path = "/jobs/{id}/spectrum",
    tag = "results",
    params(("id" = Uuid, Path, description = "The job."), ResultRequest<ReadSpectrum>),
    responses(
        (status = 200, description = "The spectrum; as CSV one row per eigenvalue; as SVG a plot of the eigenvalues by their number.", body = SpectrumView, headers(("ETag" = String, description = "Of these bytes."))),
        (status = 304, description = "The client's copy is current."),
        ResultProblems,
    )
)]
pub(crate) async fn spectrum(request: ResultRequest<ReadSpectrum>) -> Result<Response, Problem> {
    let (job, spectrum) = request.eigen().await?;
    let plan = request.plan(request::tag(job.id, &"spectrum"), format!("spectrum-{}", job.id));
    if let Some(answer) = plan.without_work() {
        return Ok(answer);
    }
    let offer = request.offer;
    let bytes = request.service.pools.answering.run_while_wanted(move |wanted| match offer {
        CSV => Ok(csv(&spectrum).into_bytes()),
        SVG => Ok(svg(job.report.as_ref(), &spectrum).into_bytes()),
        _ => json(&job, spectrum, wanted),
    });
    // A thousand eigenvalues at most, each with a few numbers.
    plan.send(Reservation::small(), bytes.await??)
}

fn json(job: &JobRecord, spectrum: Spectrum, wanted: &Wanted) -> Result<Vec<u8>, Problem> {
    let report = job.report.as_ref();
    let invariants =
        surface(report).map(|report| invariants::measure(&Modes::of(&spectrum), &report.sampling));
    let traced = invariants.as_ref().and_then(|invariants| invariants.heat_trace_area);
    let area = AreaView {
        cells: report.map(|report| report.sampling.area),
        heat_trace: traced.map(|traced| traced.value),
        uncertainty: traced.map(|traced| traced.uncertainty),
    };
    let view = SpectrumView { job_id: job.id, cloud_id: job.cloud_id, area, invariants, spectrum };
    download::json(&view, wanted)
}

fn svg(report: Option<&Report>, spectrum: &Spectrum) -> String {
    let title = report.map_or_else(String::new, |report| {
        format!("{} eigenvalues, operator {}", spectrum.eigenvalues.len(), report.operator.name())
    });
    picture::plot_spectrum(&picture::Spectrum {
        eigenvalues: &spectrum.eigenvalues,
        clusters: &spectrum.clusters,
        area: surface(report).map(|report| report.sampling.area),
        title: &title,
    })
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

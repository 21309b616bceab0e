//! Two shapes compared by their spectra.

use axum::Json;
use axum::extract::{Path, State};
use serde::Serialize;
use utoipa::ToSchema;
use uuid::Uuid;

use super::signatures::no_scale;
use crate::arguments::groups;
use crate::harmonics::Modes;
use crate::harmonics::shape_dna::{self, Comparison};
use crate::http::results::request;
use crate::http::wait::{self, Wait};
use crate::http::wire::problem::Problem;
use crate::http::wire::problem_sets::ResultProblems;
use crate::http::wire::query::FromQuery;
use crate::http::wire::service::Shared;
use crate::operator::OperatorKind;

groups! {
    /// Query of `GET /jobs/{id}/similarity/{other}`.
    #[derive(Debug)]
    pub(crate) struct Compare {
        /// How.
        comparison: Comparison,
        /// For the end of both jobs.
        wait: Wait,
    }
}

/// Two spectra, compared.
#[derive(Debug, Serialize, ToSchema)]
pub(crate) struct SimilarityView {
    /// The two jobs.
    jobs: [Uuid; 2],
    /// The two clouds.
    clouds: [Uuid; 2],
    /// Areas of the two, the sums of their cells, in length².
    areas: [f64; 2],
    /// Whether two sizes of one shape are distinguished.
    sized: bool,
    /// What to know before trusting the number.
    warnings: Vec<String>,
    /// The comparison.
    #[serde(flatten)]
    similarity: shape_dna::Similarity,
}

/// How far two shapes are from each other, by their spectra (ShapeDNA).
///
/// 0 for the same spectrum, whatever the position, sampling and (unless `sized`) size. Both jobs should use the same
/// operator. Different shapes may have the same spectrum, but hardly ever do.
#[utoipa::path(
    get,
    path = "/jobs/{id}/similarity/{other}",
    tag = "harmonics",
    params(("id" = Uuid, Path, description = "A job."), ("other" = Uuid, Path, description = "Another job."), FromQuery<Compare>),
    responses((status = 200, description = "The comparison.", body = SimilarityView), ResultProblems)
)]
pub(crate) async fn similarity(
    State(service): State<Shared>,
    Path((id, other)): Path<(String, String)>,
    FromQuery(Compare { comparison, wait }): FromQuery<Compare>,
) -> Result<Json<SimilarityView>, Problem> {
    let (Comparison { modes: modes_max, sized }, wait) = (comparison, wait.time());
    let (first, first_spectrum) = request::of_eigen(wait::finished(&service, &id, wait).await?)?;
    let (second, second_spectrum) = request::of_eigen(wait::finished(&service, &other, wait).await?)?;
    let modes = [Modes::of(&first_spectrum), Modes::of(&second_spectrum)];
    let jobs = [&first, &second];
    let areas = jobs.map(|job| job.report.as_ref().map_or(f64::NAN, |report| report.sampling.area));
    let similarity = shape_dna::compare([&modes[0], &modes[1]], areas, sized, modes_max)
        .ok_or_else(|| no_scale(modes[0].len().min(modes[1].len())))?;
    let operators = jobs.map(|job| job.parameters.operator);
    Ok(Json(SimilarityView {
        jobs: jobs.map(|job| job.id),
        clouds: jobs.map(|job| job.cloud_id),
        areas,
        sized,
        warnings: warnings(operators),
        similarity,
    }))
}

fn warnings([first, second]: [OperatorKind; 2]) -> Vec<String> {
    if first == second {
        return Vec::new();
    }
    vec![format!(
        "the jobs use different operators, {} and {}: their spectra differ by more than the shapes do",
        first.name(),
        second.name()
    )]
}

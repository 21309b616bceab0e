//! Two shapes compared by their spectra.

use axum::Json;
use axum::extract::{Path, State};
use axum::http::Uri;
use serde::Serialize;
use utoipa::ToSchema;
use uuid::Uuid;

use super::signatures::no_scale;
use crate::harmonics::{Modes, shape_dna};
use crate::http::results::asked::{self, ResultProblems};
use crate::http::service::Shared;
use crate::http::wait::{self, WAIT};
use crate::http::wire::problem::Problem;
use crate::http::wire::query::{Accepts, Argument, arguments};
use crate::operator::OperatorKind;

/// Modes compared when nothing is said.
const MODES_DEFAULT: u64 = 50;

pub(crate) const ARGUMENTS: &[Argument] = &[
    Argument {
        name: "modes",
        alias: None,
        accepts: Accepts::Integer(1, u64::MAX),
        default: "50",
        meaning: "Number of non-zero modes to compare, at most; as many as both jobs have.",
    },
    Argument {
        name: "sized",
        alias: None,
        accepts: Accepts::Switch,
        default: "false",
        meaning: "Tell the same shape in two sizes apart.",
    },
];

arguments!(
    /// Query of `GET /jobs/{id}/similarity/{other}`.
    Compare = ARGUMENTS, WAIT
);

/// Two spectra, compared.
#[derive(Debug, Serialize, ToSchema)]
pub(crate) struct SimilarityView {
    /// The two jobs.
    jobs: [Uuid; 2],
    /// The two clouds.
    clouds: [Uuid; 2],
    /// Areas of the two, the sums of their cells, in length².
    areas: [f64; 2],
    /// Whether the same shape in two sizes is told apart.
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
    params(("id" = Uuid, Path, description = "A job."), ("other" = Uuid, Path, description = "Another job."), Compare),
    responses((status = 200, description = "The comparison.", body = SimilarityView), ResultProblems)
)]
pub(crate) async fn similarity(
    State(service): State<Shared>,
    Path((id, other)): Path<(String, String)>,
    uri: Uri,
) -> Result<Json<SimilarityView>, Problem> {
    let arguments = Compare::read(&uri)?;
    let wait = std::time::Duration::from_secs(arguments.integer("wait").unwrap_or(0));
    let modes_max = arguments.integer("modes").unwrap_or(MODES_DEFAULT) as usize;
    let sized = arguments.switch("sized").unwrap_or(false);
    let (first, first_spectrum) = asked::of_eigen(wait::finished(&service, &id, wait).await?)?;
    let (second, second_spectrum) = asked::of_eigen(wait::finished(&service, &other, wait).await?)?;
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

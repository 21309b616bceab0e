//! Results under file names, for `curl -O`: `/jobs/{id}/bases.npy` is `/jobs/{id}/bases?format=npy`.

use axum::extract::{Path, State};
use axum::http::{HeaderMap, Method, Uri};
use axum::response::Response;

use super::accept::Offer;
use super::problem::{Kind, Problem, ProblemDocument};
use super::{Shared, bases, operator, spectrum};

/// A result under a file name.
///
/// The same as the resource without the ending, with `?format=`: `bases.json`, `bases.npy`, `bases.ply`,
/// `spectrum.json`, `spectrum.csv`, `operator.json`, `operator.mtx`, `operator.npz`. It takes the same query.
#[utoipa::path(
    get,
    path = "/jobs/{id}/{file}",
    operation_id = "result_file",
    tag = "results",
    params(
        ("id" = Uuid, Path, description = "The job."),
        ("file" = String, Path, description = "Name of the result with the format as its ending, such as `bases.npy`."),
    ),
    responses(
        (status = 200, description = "The file.", body = Vec<u8>, content_type = "application/octet-stream"),
        (status = 206, description = "The range asked for.", body = Vec<u8>, content_type = "application/octet-stream"),
        (status = 304, description = "The client's copy is current."),
        (status = "4XX", description = "As for the resource without the ending.", body = ProblemDocument, content_type = "application/problem+json"),
    )
)]
pub(crate) async fn file(
    State(service): State<Shared>,
    Path((id, file)): Path<(String, String)>,
    method: Method,
    uri: Uri,
    headers: HeaderMap,
) -> Result<Response, Problem> {
    let (resource, ending) = file.split_once('.').unwrap_or((&file, ""));
    let among = |offers: &[Offer]| offers.iter().find(|offer| offer.name == ending).copied();
    let nothing = || {
        Problem::new(
            Kind::NotFound,
            format!("there is no result `{file}`; GET /jobs/{id} links those there are"),
        )
    };
    match resource {
        "bases" => {
            let offer = among(&bases::OFFERS).ok_or_else(nothing)?;
            let arguments = bases::ReadBases::read(&uri)?;
            bases::respond(&service, &id, offer, &arguments, &method, &headers).await
        }
        "spectrum" => {
            let offer = among(&spectrum::OFFERS).ok_or_else(nothing)?;
            spectrum::ReadSpectrum::read(&uri)?;
            spectrum::respond(&service, &id, offer).await
        }
        "operator" => {
            let offer = among(&operator::OFFERS).ok_or_else(nothing)?;
            let arguments = operator::ReadOperator::read(&uri)?;
            operator::respond(&service, &id, offer, &arguments, &method, &headers).await
        }
        _ => Err(nothing()),
    }
}

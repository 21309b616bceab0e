//! Results under file names, for `curl -O`: `/jobs/{id}/bases.npy` is `/jobs/{id}/bases?format=npy`.

use axum::extract::{Path, State};
use axum::http::{Extensions, HeaderMap, Method, Uri};
use axum::response::Response;

use super::{bases, coefficients, distances, features, filtered, operator, signatures, spectrum};
use crate::http::results::asked::Asked;
use crate::http::service::Shared;
use crate::http::wire::owners;
use crate::http::wire::problem::{Kind, Problem, ProblemDocument};

/// Answers the request for `$file` by the handler of its resource, if there is such a file.
macro_rules! dispatch {
    ($service:expr, $id:expr, $file:expr, $request:expr; $($name:literal => $respond:path),+ $(,)?) => {{
        let (resource, ending) = $file.split_once('.').unwrap_or((&$file, ""));
        match resource {
            $($name => match Asked::as_file(&$service, &$id, ending, $request)? {
                Some(asked) => Some($respond(asked).await),
                None => None,
            },)+
            _ => None,
        }
    }};
}

/// A result under a file name.
///
/// The same as the resource without the ending, with `?format=`: `bases.json`, `bases.npy`, `bases.ply`,
/// `bases.npz`, `bases.csv`, `spectrum.json`, `spectrum.csv`, `operator.json`, `operator.mtx`, `operator.npz`. It takes the same query.
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
        (status = 200, description = "The file.", body = Vec<u8>, content_type = "*/*"),
        (status = 206, description = "The range asked for.", body = Vec<u8>, content_type = "*/*"),
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
    extensions: Extensions,
) -> Result<Response, Problem> {
    let owner = owners::owner(&extensions);
    let answer = dispatch!(service, id, file, (&method, &uri, &headers, &owner);
        "bases" => bases::bases,
        "spectrum" => spectrum::spectrum,
        "operator" => operator::operator,
        "coefficients" => coefficients::coefficients,
        "filtered" => filtered::filtered,
        "features" => features::features,
        "signatures" => signatures::signatures,
        "distances" => distances::distances,
    );
    answer.unwrap_or_else(|| {
        Err(Problem::new(
            Kind::NotFound,
            format!("there is no result `{file}`; GET /jobs/{id} links those there are"),
        ))
    })
}

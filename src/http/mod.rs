//! The HTTP interface: one file per resource. The route table below is the index of the service.

mod examples;
mod generators;
mod openapi;
mod paging;
mod resources;
mod results;
mod wait;
mod wire;

use std::sync::{Arc, LazyLock};

use axum::extract::DefaultBodyLimit;
use axum::http::{Method, StatusCode, Uri};
use axum::{Extension, Router, middleware};
use tower_http::catch_panic::CatchPanicLayer;
use utoipa::openapi::OpenApi;
use utoipa_axum::router::OpenApiRouter;
use utoipa_axum::routes;

pub use openapi::yaml;
pub use paging::PAGE_MAX;
pub use results::request::JSON_BYTES_MAX;
pub use wait::WAIT_SECONDS_MAX;
pub use wire::guard::{Hosts, NoPlace, PROBES};
pub use wire::keys::{Keys, KeysError, WAS};
pub use wire::problem::{Problem, ProblemDocument};
pub use wire::service::{Limits, Pools, Service};

use openapi::Description;
use resources::{
    bases, capabilities, clouds, coefficients, distances, docs, events, features, files, filtered,
    further_job, health, image, index, jobs, laplacian, metrics, operator, points, problems, signatures,
    similarity, spectrum, submission, viewer_page,
};
use results::offered::Resource;
use wire::paths::Paths;
use wire::problem::Kind;
use wire::service::Shared;
use wire::{compress, cors, drain, guard, keys, owners, query, request};

/// Every route, and the documents of those in the OpenAPI description.
fn routes() -> OpenApiRouter<Shared> {
    OpenApiRouter::with_openapi(openapi::base())
        .routes(routes!(index::index))
        .routes(routes!(capabilities::capabilities))
        .routes(routes!(docs::openapi_yaml))
        .routes(routes!(docs::openapi_json))
        .routes(routes!(docs::docs))
        .routes(routes!(problems::problem_kind))
        .routes(routes!(health::livez))
        .routes(routes!(health::readyz))
        .routes(routes!(metrics::metrics))
        .routes(routes!(clouds::list, submission::post_cloud, submission::put_cloud))
        .routes(routes!(clouds::show, clouds::delete, submission::put_cloud_named))
        .routes(routes!(points::points))
        .routes(routes!(further_job::post_job))
        .routes(routes!(jobs::list))
        .routes(routes!(jobs::show, jobs::delete))
        .routes(routes!(jobs::cancel))
        .routes(routes!(events::events))
        .routes(routes!(bases::bases))
        .routes(routes!(image::image))
        .routes(routes!(spectrum::spectrum))
        .routes(routes!(operator::operator))
        .routes(routes!(laplacian::laplacian))
        .routes(routes!(coefficients::coefficients, coefficients::posted_coefficients))
        .routes(routes!(coefficients::synthesis))
        .routes(routes!(filtered::filtered, filtered::by_gains))
        .routes(routes!(features::features))
        .routes(routes!(signatures::signatures))
        .routes(routes!(distances::distances))
        .routes(routes!(similarity::similarity))
        .merge(files::router())
        .merge(points::files())
}

/// The OpenAPI document of all routes.
#[must_use]
pub fn document() -> OpenApi {
    let unnamed = [
        ("/jobs/{id}/coefficients", coefficients::ReadCoefficients::OFFERS),
        ("/jobs/{id}/laplacian", laplacian::ApplyLaplacian::OFFERS),
        ("/jobs/{id}/synthesis", coefficients::Synthesize::OFFERS),
    ];
    let results = files::NAMED.iter().map(|result| (format!("/jobs/{{id}}/{}", result.name), result.offers));
    let files: Vec<_> =
        results.chain([("/clouds/{id}/points".to_owned(), points::ReadPoints::OFFERS)]).collect();
    examples::illustrate(generators::complete(routes().into_openapi(), &files, &unnamed))
}

/// Made once, when it is first asked for: it takes milliseconds.
static DESCRIPTION: LazyLock<Description> = LazyLock::new(|| Description::of(&document()));

/// The service's router.
pub fn router(service: Service) -> Router {
    let (keys, metrics) = (service.keys.clone(), Arc::clone(&service.metrics));
    let hosts = service.hosts.clone().filter(|_| keys.is_none());
    let guard = guard::Guard::new(hosts, service.origins.clone());
    let cors = tower::util::option_layer(cors::layer(&service.origins));
    let service = Arc::new(service);
    let (router, _) = routes().split_for_parts();
    router
        // A file name that `curl -T` appends is optional: the bare folder takes uploads too.
        .route("/clouds/", axum::routing::post(submission::post_cloud).put(submission::put_cloud))
        // The page's files are part of the page, not of the API.
        .route("/viewer/{digest}/{name}", axum::routing::get(viewer_page::file))
        .fallback(no_such_path)
        .method_not_allowed_fallback(no_such_method)
        .layer(middleware::from_fn_with_state(Arc::clone(&service), owners::require_ownership))
        .layer(DefaultBodyLimit::disable())
        .layer(Extension(&DESCRIPTION))
        .layer(Extension(query::BasesMax(service.limits.bases_max)))
        .layer(CatchPanicLayer::custom(panicked))
        .layer(middleware::from_fn_with_state(keys, keys::require))
        .layer(middleware::from_fn_with_state(guard, guard::admit))
        .layer(middleware::from_fn(drain::after_errors))
        .layer(cors)
        .layer(middleware::from_fn(request::identify))
        .layer(middleware::from_fn_with_state(metrics, metrics::measure))
        .layer(middleware::from_fn_with_state(Arc::clone(&service), compress::compress))
        .with_state(service)
}

/// The paths that there are.
static PATHS: LazyLock<Paths> =
    LazyLock::new(|| Paths::of(DESCRIPTION.json.as_ref().unwrap_or(&serde_json::Value::Null)));

async fn no_such_path(method: Method, uri: Uri) -> Problem {
    let path = uri.path();
    let uploads = [Method::PUT, Method::POST].contains(&method) && path.matches('/').count() == 1;
    let near = if uploads { vec![format!("/clouds{path}")] } else { PATHS.near(path) };
    let hint = match near.as_slice() {
        [] => "GET / lists the resources".to_owned(),
        [one] => format!("did you mean {one}?"),
        several => format!("similar paths: {}", several.join(", ")),
    };
    Problem::new(Kind::NotFound, format!("there is nothing at {path}; {hint}")).with("near", near)
}

/// OPTIONS is answered by `Allow` alone, which axum adds.
async fn no_such_method(method: Method, uri: Uri) -> Result<StatusCode, Problem> {
    if method == Method::OPTIONS {
        return Ok(StatusCode::NO_CONTENT);
    }
    let path = uri.path();
    // Addresses for one way of using them are not in the document.
    if let Some(known) =
        path.strip_suffix('/').filter(|known| PATHS.methods(known).contains(&method.as_str()))
    {
        let told = format!("{path} does not support {method}; did you mean {known}?");
        return Err(Problem::new(Kind::MethodNotAllowed, told).with("near", vec![known.to_owned()]));
    }
    let methods = if path.starts_with("/viewer/") { vec!["GET", "HEAD"] } else { PATHS.methods(path) };
    let told = format!("{path} does not support {method}; supported: {}", methods.join(", "));
    Err(Problem::new(Kind::MethodNotAllowed, told).with("methods", methods))
}

fn panicked(_: Box<dyn std::any::Any + Send>) -> axum::response::Response {
    axum::response::IntoResponse::into_response(Problem::internal(&"a handler panicked"))
}

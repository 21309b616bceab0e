//! The HTTP interface: one file per resource. The route table below is the index of the service.

mod accept;
mod asked;
mod bases;
mod capabilities;
mod cloud_file;
mod clouds;
mod coefficients;
mod compress;
mod cors;
mod distances;
mod docs;
mod download;
mod drain;
mod events;
mod examples;
mod features;
mod files;
mod filtered;
mod functions;
mod health;
mod idempotency;
mod image;
mod index;
mod jobs;
mod keys;
mod laplacian;
mod matrix;
mod openapi;
mod operator;
mod parameters;
mod per_row;
mod points;
mod problem;
mod problems;
mod query;
mod request;
mod rows;
mod signatures;
mod similarity;
mod spectrum;
mod submission;
mod upload;
mod view;

use std::sync::Arc;
use std::time::Duration;

use axum::Router;
use axum::extract::DefaultBodyLimit;
use axum::http::{HeaderValue, Method, StatusCode, Uri};
use axum::middleware;
use tokio_util::sync::CancellationToken;
use tower_http::catch_panic::CatchPanicLayer;
use utoipa_axum::router::OpenApiRouter;
use utoipa_axum::routes;
use uuid::Uuid;

pub use keys::Keys;
pub use openapi::document;
pub use problem::{Problem, ProblemDocument};

use crate::cloud::reader;
use crate::jobs::{Compute, Jobs};
use crate::store::Store;
use problem::Kind;

/// What the interface accepts at most.
#[derive(Debug, Clone)]
pub struct Limits {
    /// Bytes of a request's body.
    pub body_bytes: u64,
    /// Pause in an upload after which it is given up.
    pub stall: Duration,
    /// Bases of a job.
    pub bases_max: usize,
    /// Jobs that wait.
    pub queue_max: u64,
    /// What is read from a file.
    pub reader: reader::Limits,
}

/// What the handlers work with.
pub struct Service {
    /// The database.
    pub store: Store,
    /// Threads that parse and encode, apart from those that analyse.
    pub compute: Compute,
    /// The workers, to be woken when a job was queued.
    pub jobs: Arc<Jobs>,
    /// Limits.
    pub limits: Limits,
    /// Origins of pages that may use the service from browsers; `*` is any.
    pub origins: Vec<HeaderValue>,
    /// Accepted keys; `None` when none is asked for.
    pub keys: Option<Keys>,
    /// Canceled when the service stops: waiting requests then answer at once.
    pub stopping: CancellationToken,
}

/// The state of every handler.
type Shared = Arc<Service>;

/// Every route, and the documents of those in the OpenAPI description.
fn routes() -> OpenApiRouter<Shared> {
    OpenApiRouter::with_openapi(openapi::base())
        .routes(routes!(index::index))
        .routes(routes!(capabilities::capabilities))
        .routes(routes!(openapi::openapi))
        .routes(routes!(docs::docs))
        .routes(routes!(problems::problem_kind))
        .routes(routes!(health::livez))
        .routes(routes!(health::readyz))
        .routes(routes!(clouds::list, submission::post_cloud, submission::put_cloud))
        .routes(routes!(clouds::show, clouds::delete, submission::put_cloud_named))
        .routes(routes!(points::points))
        .routes(routes!(submission::post_job))
        .routes(routes!(jobs::list))
        .routes(routes!(jobs::show, jobs::delete))
        .routes(routes!(jobs::cancel))
        .routes(routes!(events::events))
        .routes(routes!(bases::bases))
        .routes(routes!(image::image))
        .routes(routes!(spectrum::spectrum))
        .routes(routes!(operator::operator))
        .routes(routes!(laplacian::laplacian))
        .routes(routes!(coefficients::coefficients, coefficients::of_posted))
        .routes(routes!(coefficients::synthesis))
        .routes(routes!(filtered::filtered, filtered::by_gains))
        .routes(routes!(features::features))
        .routes(routes!(signatures::signatures))
        .routes(routes!(distances::distances))
        .routes(routes!(similarity::similarity))
        .routes(routes!(files::file))
}

/// The service's router.
pub fn router(service: Service) -> Router {
    let keys = service.keys.clone();
    let cors = tower::util::option_layer(cors::layer(&service.origins));
    let service = Arc::new(service);
    let (router, _) = routes().split_for_parts();
    router
        // A file name that `curl -T` appends is optional: the bare folder takes uploads too.
        .route("/clouds/", axum::routing::post(submission::post_cloud).put(submission::put_cloud))
        .fallback(no_such_path)
        .method_not_allowed_fallback(no_such_method)
        .layer(DefaultBodyLimit::disable())
        .layer(CatchPanicLayer::custom(panicked))
        .layer(middleware::from_fn_with_state(keys, keys::require))
        .layer(middleware::from_fn(drain::after_errors))
        .layer(cors)
        .layer(middleware::from_fn(request::identify))
        .layer(compress::layer())
        .layer(middleware::from_fn(compress::weaken_tags))
        .with_state(service)
}

async fn no_such_path(uri: Uri) -> Problem {
    Problem::new(Kind::NotFound, format!("there is nothing at {}; GET / lists what there is", uri.path()))
}

/// OPTIONS is answered by `Allow` alone, which axum adds.
async fn no_such_method(method: Method, uri: Uri) -> Result<StatusCode, Problem> {
    if method == Method::OPTIONS {
        return Ok(StatusCode::NO_CONTENT);
    }
    Err(Problem::new(
        Kind::MethodNotAllowed,
        format!("{} does not support {method}; Allow lists what it does", uri.path()),
    ))
}

fn panicked(_: Box<dyn std::any::Any + Send>) -> axum::response::Response {
    axum::response::IntoResponse::into_response(Problem::internal(&"a handler panicked"))
}

/// An id of a path; what is no UUID names nothing.
fn parse_id(text: &str) -> Result<Uuid, Problem> {
    text.parse().map_err(|_| {
        let shown: String = text.chars().take(80).collect();
        Problem::new(Kind::NotFound, format!("`{shown}` is not an id; ids are UUIDs"))
    })
}

/// A time as the interface shows it: RFC 3339, UTC.
fn timestamp(milliseconds: crate::store::Milliseconds) -> String {
    jiff::Timestamp::from_millisecond(milliseconds).unwrap_or_default().to_string()
}

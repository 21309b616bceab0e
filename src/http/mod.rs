//! The HTTP interface: one file per resource. The route table below is the index of the service.

mod accept;
mod answer_memory;
mod asked;
mod bases;
mod bases_files;
mod body;
mod body_memory;
mod capabilities;
mod cloud_file;
mod clouds;
mod coding;
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
mod metrics;
mod number_lists;
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

pub use keys::{Keys, KeysError};
pub use openapi::document;
pub use problem::{Problem, ProblemDocument};

use crate::cloud::reader;
use crate::jobs::{Compute, Jobs};
use crate::metrics::Metrics;
use crate::store::Store;
use answer_memory::AnswerMemory;
use body_memory::BodyMemory;
use problem::Kind;

/// What the interface accepts at most.
#[derive(Debug, Clone)]
pub struct Limits {
    /// Bytes of a request's body as it is sent.
    pub body_bytes: u64,
    /// Bytes of a compressed body once it is decompressed.
    pub decoded_bytes: u64,
    /// Times as much that may come out of a compressed body as went in, beyond the first megabyte.
    pub decoded_ratio_max: u64,
    /// Time for a request's body.
    pub body_time: Duration,
    /// Pause in a body, or in the taking of an answer, after which the client is given up.
    pub stall: Duration,
    /// Time for a request's head.
    pub header_time: Duration,
    /// Connections that are open.
    pub connections_max: usize,
    /// Bytes of memory for bodies and what they are parsed into; half as many again for large answers.
    pub body_memory: u64,
    /// Bytes of memory that the analyses running at one time may be estimated to take.
    pub memory_budget: u64,
    /// Bytes that stay free on the disk.
    pub disk_floor: u64,
    /// Jobs that run.
    pub jobs_at_once: usize,
    /// Days that jobs are kept after their end.
    pub keep_jobs_days: Option<u64>,
    /// Days that clouds without jobs are kept.
    pub keep_clouds_days: Option<u64>,
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
    store: Store,
    /// Threads that parse and encode, apart from those that analyse.
    compute: Compute,
    /// The workers, to be woken when a job was queued.
    jobs: Arc<Jobs>,
    /// Limits.
    limits: Limits,
    /// What bodies share.
    body_memory: BodyMemory,
    /// What large answers share.
    answer_memory: AnswerMemory,
    /// Origins of pages that may use the service from browsers; `*` is any.
    origins: Vec<HeaderValue>,
    /// Accepted keys; `None` when none is asked for.
    keys: Option<Keys>,
    /// Canceled when the service stops: waiting requests then answer at once.
    stopping: CancellationToken,
    /// What is counted.
    metrics: Arc<Metrics>,
}

impl Service {
    /// What the handlers work with.
    #[must_use]
    pub fn new(
        store: Store,
        compute: Compute,
        jobs: Arc<Jobs>,
        limits: Limits,
        keys: Option<Keys>,
        metrics: Arc<Metrics>,
        stopping: CancellationToken,
    ) -> Self {
        let body_memory = BodyMemory::new(limits.body_memory, limits.stall);
        let answer_memory = AnswerMemory::new(limits.body_memory / 2, limits.stall);
        let origins = Vec::new();
        Self { store, compute, jobs, limits, body_memory, answer_memory, origins, keys, stopping, metrics }
    }

    /// The same, open to pages of these origins; `*` is any.
    #[must_use]
    pub fn allowing(self, origins: Vec<HeaderValue>) -> Self {
        Self { origins, ..self }
    }
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
        .routes(routes!(metrics::metrics))
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
    let (keys, metrics) = (service.keys.clone(), Arc::clone(&service.metrics));
    let cors = tower::util::option_layer(cors::layer(&service.origins));
    let service = Arc::new(service);
    let (router, _) = routes().split_for_parts();
    router
        // A file name that `curl -T` appends is optional: the bare folder takes uploads too.
        .route("/clouds/", axum::routing::post(submission::post_cloud).put(submission::put_cloud))
        .fallback(no_such_path)
        .method_not_allowed_fallback(no_such_method)
        .layer(middleware::from_fn_with_state(Arc::clone(&service), body::bound))
        .layer(middleware::from_fn_with_state(Arc::clone(&service), keys::only_own))
        .layer(DefaultBodyLimit::disable())
        .layer(CatchPanicLayer::custom(panicked))
        .layer(middleware::from_fn_with_state(keys, keys::require))
        .layer(middleware::from_fn(drain::after_errors))
        .layer(cors)
        .layer(middleware::from_fn(request::identify))
        .layer(middleware::from_fn_with_state(metrics, metrics::measure))
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

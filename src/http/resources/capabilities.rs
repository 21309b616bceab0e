//! `GET /capabilities`: formats, parameters, limits.

use std::collections::BTreeMap;

use axum::Json;
use axum::extract::State;
use serde::Serialize;
use serde_json::Value;
use utoipa::ToSchema;

use super::{
    bases, coefficients, features, filtered, image, laplacian, operator, points, similarity, spectrum,
    submission,
};
use crate::arguments::{Accepts, Argument, Arguments};
use crate::cloud::reader::Format;
use crate::harmonics::{DistanceRequest, FilterKind, SignatureRequest};
use crate::http::paging;
use crate::http::results::offered::Resource;
use crate::http::results::request::{self, Query};
use crate::http::service::{Limits, Shared};
use crate::http::wait;
use crate::http::wire::accept::{JSON, Offer};
use crate::http::wire::query;
use crate::operator::OperatorKind;

/// What the service can do, and how much of it.
#[derive(Debug, Serialize, ToSchema)]
pub(crate) struct Capabilities {
    /// Formats of clouds.
    formats: Formats,
    /// Operators by name.
    operators: Vec<&'static str>,
    /// Parameters of a job.
    parameters: Vec<ParameterView>,
    /// Parameters of an upload.
    upload_parameters: Vec<ParameterView>,
    /// Filters by name.
    filters: Vec<&'static str>,
    /// Results of jobs by name: their formats and parameters.
    results: BTreeMap<&'static str, ResultView>,
    /// Limits.
    limits: LimitsView,
}

/// Formats of clouds and results.
#[derive(Debug, Serialize, ToSchema)]
pub(crate) struct Formats {
    /// Formats of uploads.
    upload: Vec<FormatView>,
    /// Formats of `/clouds/{id}/points`.
    points: Vec<FormatView>,
    /// Formats of `/jobs/{id}/bases`.
    bases: Vec<FormatView>,
}

/// A result of jobs, at `/jobs/{id}/{name}`.
#[derive(Debug, Serialize, ToSchema)]
pub(crate) struct ResultView {
    /// Its formats, the default first.
    formats: Vec<FormatView>,
    /// Its parameters.
    parameters: Vec<ParameterView>,
}

/// A file format.
#[derive(Debug, Serialize, ToSchema)]
pub(crate) struct FormatView {
    /// As in `?format=`.
    name: &'static str,
    /// Its media type.
    media_type: &'static str,
}

/// A parameter.
#[derive(Debug, Serialize, ToSchema)]
pub(crate) struct ParameterView {
    /// Its name.
    name: &'static str,
    /// Another name for it.
    alias: Option<&'static str>,
    /// `integer`, `number`, `boolean` or `string`.
    #[serde(rename = "type")]
    kind: &'static str,
    /// Its values, in words.
    accepted: String,
    /// Its values, as a JSON schema.
    #[schema(value_type = Object)]
    schema: Value,
    /// Its value when absent, in words if it depends on other things.
    default: String,
    /// What it does, with units.
    meaning: &'static str,
}

/// Limits of this service.
#[derive(Debug, Serialize, ToSchema)]
pub(crate) struct LimitsView {
    /// Bytes of a request's body, as it is sent.
    body_bytes: u64,
    /// Bytes of a compressed body once it is decompressed.
    decoded_bytes: u64,
    /// Times as much that may come out of a compressed body as went in, beyond the first megabyte.
    decoded_ratio_max: u64,
    /// Seconds for a body.
    body_seconds: u64,
    /// Bytes per second that a body brings at least, on average over `stall_seconds`; 0 for none.
    body_rate_min_bytes: u64,
    /// Seconds without a byte of a body, or of an answer taken, after which the client is given up.
    stall_seconds: u64,
    /// Seconds for the head of a request.
    header_seconds: u64,
    /// Open connections; further ones wait to be accepted.
    connections_max: usize,
    /// Bytes of memory for bodies and what they are parsed into, a fifth of it for the largest; half as many again for
    /// large answers and what they are made of.
    body_memory_bytes: u64,
    /// Points of a cloud.
    points_max: usize,
    /// Coordinates per point.
    dimension_max: usize,
    /// Per-point scalars of a cloud.
    fields_max: usize,
    /// Triangles of a cloud.
    faces_max: usize,
    /// Bases of a job.
    bases_max: usize,
    /// Jobs that wait.
    queue_max: u64,
    /// Jobs of one key that wait; null for as many as may wait in all.
    queue_max_per_key: Option<u64>,
    /// Bytes that the clouds and results of one key take; null for no limit.
    stored_bytes_max_per_key: Option<u64>,
    /// Bytes beyond which the database file does not grow; null for as many as the disk has.
    database_bytes_max: Option<u64>,
    /// Seconds that one attempt at a job may take.
    job_seconds: u64,
    /// Jobs that run at one time.
    jobs_at_once: usize,
    /// Bytes of memory that the analyses running at one time may be estimated to take.
    memory_budget_bytes: u64,
    /// Bytes that stay free on the disk.
    disk_floor_bytes: u64,
    /// Days after their end at which jobs are deleted; null keeps them.
    keep_jobs_days: Option<u64>,
    /// Days after their upload at which clouds without jobs are deleted; null keeps them.
    keep_clouds_days: Option<u64>,
    /// Bytes of bases as JSON; more is to be had as npy.
    json_bytes: u64,
    /// Seconds of `?wait=`.
    wait_seconds_max: u64,
    /// Entries of a page of a listing.
    page_max: u64,
}

impl From<&Argument> for ParameterView {
    fn from(argument: &Argument) -> Self {
        let kind = match argument.accepts {
            Accepts::Integer(..) => "integer",
            Accepts::Positive | Accepts::NonNegative | Accepts::Range(..) => "number",
            Accepts::Switch => "boolean",
            Accepts::Word(_) | Accepts::Id | Accepts::Text | Accepts::Names => "string",
        };
        Self {
            name: argument.name,
            alias: argument.alias,
            kind,
            accepted: argument.accepts.in_words(),
            schema: serde_json::to_value(query::schema(argument.accepts)).unwrap_or_default(),
            default: argument.absent.in_words(),
            meaning: argument.meaning,
        }
    }
}

fn offered(offers: &[Offer]) -> Vec<FormatView> {
    offers.iter().map(|offer| FormatView { name: offer.name, media_type: offer.media_type() }).collect()
}

fn parameters<A: Arguments>() -> Vec<ParameterView> {
    query::table::<A>().iter().map(ParameterView::from).collect()
}

fn result<R: Resource>() -> ResultView {
    ResultView { formats: offered(R::OFFERS), parameters: parameters::<Query<R>>() }
}

fn results() -> BTreeMap<&'static str, ResultView> {
    BTreeMap::from([
        ("bases", result::<bases::ReadBases>()),
        ("bases/{basis}/image.png", result::<image::ReadImage>()),
        ("spectrum", result::<spectrum::ReadSpectrum>()),
        ("operator", result::<operator::ReadOperator>()),
        ("coefficients", result::<coefficients::ReadCoefficients>()),
        ("laplacian", result::<laplacian::ApplyLaplacian>()),
        ("synthesis", result::<coefficients::Synthesize>()),
        ("filtered", result::<filtered::ReadFiltered>()),
        ("features", result::<features::ReadFeatures>()),
        ("signatures", result::<SignatureRequest>()),
        ("distances", result::<DistanceRequest>()),
        (
            "similarity",
            ResultView { formats: offered(&[JSON]), parameters: parameters::<similarity::Compare>() },
        ),
    ])
}

/// Formats, operators, filters, parameters with type, range, default and meaning, and limits.
#[utoipa::path(get, path = "/capabilities", tag = "service", responses((status = 200, description = "What the service can do.", body = Capabilities)))]
pub(crate) async fn capabilities(State(service): State<Shared>) -> Json<Capabilities> {
    let limits = &service.limits;
    Json(Capabilities {
        formats: Formats {
            upload: Format::ALL
                .iter()
                .map(|format| FormatView { name: format.name(), media_type: format.media_type() })
                .collect(),
            points: offered(points::ReadPoints::OFFERS),
            bases: offered(bases::ReadBases::OFFERS),
        },
        operators: OperatorKind::ALL.map(OperatorKind::name).to_vec(),
        parameters: submission::narrowed(limits.bases_max).iter().map(ParameterView::from).collect(),
        filters: FilterKind::ALL.map(FilterKind::name).to_vec(),
        results: results(),
        upload_parameters: parameters::<submission::ReadUpload>(),
        limits: limits.into(),
    })
}

impl From<&Limits> for LimitsView {
    fn from(limits: &Limits) -> Self {
        Self {
            body_bytes: limits.body_bytes,
            decoded_bytes: limits.decoded_bytes,
            decoded_ratio_max: limits.decoded_ratio_max,
            body_seconds: limits.body_time.as_secs(),
            body_rate_min_bytes: limits.body_rate_min,
            stall_seconds: limits.stall.as_secs(),
            header_seconds: limits.header_time.as_secs(),
            connections_max: limits.connections_max,
            body_memory_bytes: limits.body_memory,
            points_max: limits.reader.points_max,
            dimension_max: limits.reader.dimension_max,
            fields_max: limits.reader.fields_max,
            faces_max: limits.reader.faces_max,
            bases_max: limits.bases_max,
            queue_max: limits.queue_max,
            queue_max_per_key: limits.queue_max_per_key,
            stored_bytes_max_per_key: limits.stored_bytes_max_per_key,
            database_bytes_max: limits.database_bytes_max,
            job_seconds: limits.job_time.as_secs(),
            jobs_at_once: limits.jobs_at_once,
            memory_budget_bytes: limits.memory_budget,
            disk_floor_bytes: limits.disk_floor,
            keep_jobs_days: limits.keep_jobs_days,
            keep_clouds_days: limits.keep_clouds_days,
            json_bytes: request::JSON_BYTES_MAX,
            wait_seconds_max: wait::WAIT_SECONDS_MAX,
            page_max: paging::PAGE_MAX as u64,
        }
    }
}

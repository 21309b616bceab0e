//! What goes wrong, as RFC 9457 problems. The only place that knows status codes of errors.

use axum::body::Body;
use axum::http::{HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Response};
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};
use utoipa::ToSchema;

use super::retry;
use crate::analysis::AnalysisError;
use crate::arguments::words;
use crate::cloud::CloudError;
use crate::cloud::reader::ReadError;
use crate::geometry::GeometryError;
use crate::harmonics::FilterError;
use crate::harmonics::filtered::TargetError;
use crate::jobs::{BasesError, ComputeError};
use crate::store::{JobFailure, StoreError};

/// Media type of a problem.
pub(crate) const MEDIA_TYPE: &str = "application/problem+json";

words! {
    /// The kinds of problem; the word of each is the last part of its stable `type`.
    pub(crate) enum Kind {
        /// The request cannot be understood: its query, JSON or multipart structure.
        MalformedRequest,
        /// The client left before its request was whole.
        Interrupted,
        /// The uploaded file does not follow its format.
        MalformedFile,
        /// No key, or not one of ours.
        Unauthorized,
        /// The request is for another host.
        HostNotAllowed,
        /// A page of another origin wants to change something.
        OriginNotAllowed,
        /// No such resource.
        NotFound,
        /// The resource does not know the method.
        MethodNotAllowed,
        /// None of the representations is acceptable.
        NotAcceptable,
        /// The body stopped arriving.
        RequestTimeout,
        /// The job has no result yet.
        NotFinished,
        /// The job failed and will have no result.
        JobFailed,
        /// The job was canceled and will have no result.
        JobCanceled,
        /// The job has results, but not of this kind.
        NoSuchResult,
        /// The cloud has live jobs.
        CloudInUse,
        /// Body, points or another size over its limit.
        TooLarge,
        /// The format of the upload is unknown.
        UnsupportedFormat,
        /// The body is compressed in a way that is not known.
        UnsupportedEncoding,
        /// The range lies outside of the result.
        RangeNotSatisfiable,
        /// A parameter that does not exist.
        UnknownParameter,
        /// A parameter with a value that is not accepted.
        InvalidParameter,
        /// A submission's name was given to another one.
        KeyReused,
        /// The cloud cannot carry the analysis.
        UnusableCloud,
        /// The analysis needs more memory than there is.
        OverBudget,
        /// The queue is full.
        QueueFull,
        /// The database's disk is full.
        StorageFull,
        /// Our fault.
        Internal,
        /// Not now: stopping, or the database does not take writes.
        Unavailable,
    }
}

impl Kind {
    /// One phrase, the same for every occurrence.
    #[must_use]
    pub(crate) fn title(self) -> &'static str {
        self.title_and_status().0
    }

    /// The status of the answer.
    #[must_use]
    pub(crate) fn status(self) -> StatusCode {
        self.title_and_status().1
    }

    fn title_and_status(self) -> (&'static str, StatusCode) {
        use StatusCode as S;
        match self {
            Self::MalformedRequest => ("The request is malformed", S::BAD_REQUEST),
            Self::Interrupted => ("The request ended early", S::BAD_REQUEST),
            Self::MalformedFile => ("The file does not follow its format", S::BAD_REQUEST),
            Self::Unauthorized => ("A key is needed", S::UNAUTHORIZED),
            Self::HostNotAllowed => ("The service does not answer to this host name", S::MISDIRECTED_REQUEST),
            Self::OriginNotAllowed => ("Pages of this origin may not change anything", S::FORBIDDEN),
            Self::NotFound => ("There is no such resource", S::NOT_FOUND),
            Self::MethodNotAllowed => ("The resource does not support this method", S::METHOD_NOT_ALLOWED),
            Self::NotAcceptable => ("None of the formats offered is acceptable", S::NOT_ACCEPTABLE),
            Self::RequestTimeout => ("The body stopped arriving", S::REQUEST_TIMEOUT),
            Self::NotFinished => ("The job has not finished", S::CONFLICT),
            Self::JobFailed => ("The job failed", S::CONFLICT),
            Self::JobCanceled => ("The job was canceled", S::CONFLICT),
            Self::NoSuchResult => ("The job has no result of this kind", S::CONFLICT),
            Self::CloudInUse => ("The cloud has jobs that are not finished", S::CONFLICT),
            Self::TooLarge => ("The upload is over a limit", S::PAYLOAD_TOO_LARGE),
            Self::UnsupportedFormat => ("The format is not supported", S::UNSUPPORTED_MEDIA_TYPE),
            Self::UnsupportedEncoding => ("The body's encoding is not supported", S::UNSUPPORTED_MEDIA_TYPE),
            Self::RangeNotSatisfiable => ("The range is outside of the result", S::RANGE_NOT_SATISFIABLE),
            Self::UnknownParameter => ("A parameter does not exist", S::UNPROCESSABLE_ENTITY),
            Self::InvalidParameter => {
                ("A parameter has a value that is not accepted", S::UNPROCESSABLE_ENTITY)
            }
            Self::KeyReused => ("The idempotency key names another submission", S::UNPROCESSABLE_ENTITY),
            Self::UnusableCloud => ("The cloud cannot carry the analysis", S::UNPROCESSABLE_ENTITY),
            Self::OverBudget => ("The analysis needs too much memory", S::UNPROCESSABLE_ENTITY),
            Self::QueueFull => ("The queue is full", S::TOO_MANY_REQUESTS),
            Self::StorageFull => ("There is no space left", S::INSUFFICIENT_STORAGE),
            Self::Internal => ("Something went wrong on our side", S::INTERNAL_SERVER_ERROR),
            Self::Unavailable => ("The service is not available", S::SERVICE_UNAVAILABLE),
        }
    }
}

/// A problem on its way to the client; `super::request` completes it with the request's id.
#[derive(Debug, Clone, PartialEq)]
pub struct Problem(Box<Content>);

#[derive(Debug, Clone, PartialEq)]
struct Content {
    kind: Kind,
    detail: String,
    members: Map<String, Value>,
    headers: Vec<(header::HeaderName, String)>,
}

impl Problem {
    /// A problem whose `detail` says what is wrong and what would be accepted.
    #[must_use]
    pub(crate) fn new(kind: Kind, detail: impl Into<String>) -> Self {
        Self(Box::new(Content { kind, detail: detail.into(), members: Map::new(), headers: Vec::new() }))
    }

    /// A parameter whose value is not accepted.
    #[must_use]
    pub(crate) fn invalid(parameter: &str, detail: impl Into<String>) -> Self {
        Self::new(Kind::InvalidParameter, detail).with("parameter", parameter)
    }

    /// An error of ours: `cause` is logged, the client learns only that it happened.
    #[must_use]
    pub(crate) fn internal(cause: &dyn std::fmt::Display) -> Self {
        tracing::error!(%cause, "internal error");
        Self::new(
            Kind::Internal,
            "the request could not be completed; the service's log has the cause under request_id",
        )
    }

    /// Adds an extension member.
    #[must_use]
    pub(crate) fn with(mut self, member: &str, value: impl Into<Value>) -> Self {
        self.0.members.insert(member.to_owned(), value.into());
        self
    }

    /// Adds a header to the answer.
    #[must_use]
    pub(crate) fn with_header(mut self, name: header::HeaderName, value: impl Into<String>) -> Self {
        self.0.headers.push((name, value.into()));
        self
    }

    /// Its kind.
    pub(crate) fn kind(&self) -> Kind {
        self.0.kind
    }

    /// The document.
    #[must_use]
    pub(crate) fn document(&self, instance: Option<String>, request_id: Option<String>) -> ProblemDocument {
        ProblemDocument {
            kind: format!("/problems/{}", self.0.kind.name()),
            title: self.0.kind.title().to_owned(),
            status: self.0.kind.status().as_u16(),
            detail: self.0.detail.clone(),
            instance,
            request_id,
            members: self.0.members.clone(),
        }
    }

    /// The answer's body, complete.
    pub(crate) fn render(&self, instance: &str, request_id: &str, response: &mut Response) {
        let document = self.document(Some(instance.to_owned()), Some(request_id.to_owned()));
        let body = serde_json::to_vec(&document).unwrap_or_default();
        response.headers_mut().insert(header::CONTENT_TYPE, HeaderValue::from_static(MEDIA_TYPE));
        response.headers_mut().insert(header::CONTENT_LENGTH, HeaderValue::from(body.len()));
        *response.body_mut() = Body::from(body);
    }
}

impl IntoResponse for Problem {
    fn into_response(self) -> Response {
        let mut response = self.0.kind.status().into_response();
        for (name, value) in &self.0.headers {
            if let Ok(value) = HeaderValue::from_str(value) {
                response.headers_mut().insert(name, value);
            }
        }
        response.extensions_mut().insert(self);
        response
    }
}

/// An RFC 9457 problem.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[schema(as = Problem)]
pub struct ProblemDocument {
    /// Stable name of the kind of problem, a URI reference such as `/problems/not-finished`.
    #[serde(rename = "type")]
    pub kind: String,
    /// One phrase, the same for every occurrence of the type.
    pub title: String,
    /// The HTTP status.
    pub status: u16,
    /// What is wrong here, naming the field, line or byte, and what would be accepted.
    pub detail: String,
    /// Path of the request.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub instance: Option<String>,
    /// Names this request in the service's log.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub request_id: Option<String>,
    /// Further members, by type: `parameter`, `accepted`, `nearest`, `state`, `links`.
    #[serde(flatten)]
    pub members: Map<String, Value>,
}

impl From<StoreError> for Problem {
    fn from(error: StoreError) -> Self {
        match error {
            StoreError::NotFound => Self::new(Kind::NotFound, "there is no cloud or job with this id"),
            StoreError::CloudInUse => Self::new(
                Kind::CloudInUse,
                "the cloud has jobs that are queued or running; cancel them or wait for their end",
            ),
            StoreError::QueueFull { limit } => {
                Self::new(Kind::QueueFull, format!("the queue already holds {limit} jobs; try again later"))
                    .with_header(header::RETRY_AFTER, retry::QUEUE_SECONDS.to_string())
            }
            StoreError::OverBudget { need, budget } => Self::new(
                Kind::OverBudget,
                format!(
                    "the analysis needs about {need} bytes of memory and the service has {budget}; thin the cloud out, \
                     ask for fewer bases, or leave out `exact` if it is set"
                ),
            )
            .with("need", need)
            .with("budget", budget),
            StoreError::NoResult => Self::new(Kind::NoSuchResult, "the job has no result of this kind"),
            StoreError::StorageFull => {
                tracing::error!(%error, "the database cannot grow");
                Self::new(Kind::StorageFull, "the service has no disk space left; stored data can still be read")
            }
            StoreError::OwnerQueueFull { .. } => Self::new(Kind::QueueFull, format!("{error}; try again later"))
                .with_header(header::RETRY_AFTER, retry::QUEUE_SECONDS.to_string()),
            StoreError::OwnerStorageFull { .. } => {
                Self::new(Kind::StorageFull, format!("{error}; delete clouds or jobs first"))
            }
            StoreError::Busy => {
                tracing::warn!("the database was busy for too long");
                Self::new(Kind::Unavailable, "the database is busy; try again")
                    .with_header(header::RETRY_AFTER, retry::BUSY_SECONDS.to_string())
            }
            StoreError::Unreachable(_) => {
                tracing::error!(%error, "a request could not be served");
                Self::new(Kind::Unavailable, "the database cannot be reached at the moment; try again")
                    .with_header(header::RETRY_AFTER, retry::BUSY_SECONDS.to_string())
            }
            StoreError::LostClaim
            | StoreError::InUse { .. }
            | StoreError::Damaged(_)
            | StoreError::Database(_) => Self::internal(&error),
        }
    }
}

impl From<AnalysisError> for Problem {
    fn from(error: AnalysisError) -> Self {
        match error {
            AnalysisError::Parameter { name, reason } => {
                Self::invalid(name, format!("parameter `{name}`: {reason}"))
            }
            AnalysisError::Cloud(reason) | AnalysisError::Unsupported(reason) => {
                Self::new(Kind::UnusableCloud, reason)
            }
            AnalysisError::Numerical(_) | AnalysisError::Scratch(_) | AnalysisError::Canceled(_) => {
                Self::internal(&error)
            }
        }
    }
}

impl From<CloudError> for Problem {
    fn from(error: CloudError) -> Self {
        Self::new(Kind::UnusableCloud, error.to_string())
    }
}

impl From<ReadError> for Problem {
    fn from(error: ReadError) -> Self {
        let kind = match &error {
            ReadError::Empty
            | ReadError::NoRows { .. }
            | ReadError::NoAxes { .. }
            | ReadError::Truncated { .. }
            | ReadError::Malformed { .. } => Kind::MalformedFile,
            ReadError::TooManyPoints { .. }
            | ReadError::TooCompressed { .. }
            | ReadError::TooMuchMemory { .. }
            | ReadError::TooManyFields { .. }
            | ReadError::TooManyFaces { .. } => Kind::TooLarge,
            ReadError::Foreign { .. } => Kind::UnsupportedFormat,
            ReadError::DimensionColumns { .. } | ReadError::NoSuchScan { .. } => Kind::InvalidParameter,
            ReadError::Dimension { .. } | ReadError::Cloud(_) => Kind::UnusableCloud,
        };
        Self::new(kind, error.to_string())
    }
}

impl From<ComputeError> for Problem {
    fn from(error: ComputeError) -> Self {
        Self::internal(&error)
    }
}

impl From<BasesError> for Problem {
    fn from(error: BasesError) -> Self {
        match error {
            BasesError::Store(error) => error.into(),
            BasesError::Compute(error) => error.into(),
        }
    }
}

impl From<FilterError> for Problem {
    fn from(error: FilterError) -> Self {
        Self::invalid(error.parameter, error.to_string())
    }
}

impl From<TargetError> for Problem {
    fn from(error: TargetError) -> Self {
        let problem = Self::invalid("field", error.to_string());
        match error {
            TargetError::Unknown { fields, .. } => problem.with("accepted", fields),
            TargetError::NonFinite { row, .. } => problem.with("row", row),
        }
    }
}

impl From<GeometryError> for Problem {
    fn from(error: GeometryError) -> Self {
        Self::from(AnalysisError::from(error))
    }
}

impl From<&JobFailure> for Problem {
    fn from(failure: &JobFailure) -> Self {
        Self::new(Kind::JobFailed, failure.detail.clone()).with("code", failure.code.clone())
    }
}

#[cfg(test)]
mod tests;

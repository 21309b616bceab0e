//! What every request for a job's result has in common: arguments, the format to answer in, and a job that has finished.

use std::time::Duration;

use axum::extract::{FromRequestParts, Path};
use axum::http::request::Parts;
use axum::http::{HeaderMap, Method};
use utoipa::IntoParams;
use utoipa::openapi::path::{Parameter, ParameterIn};
use uuid::Uuid;

use super::offered::{ArrayType, Offered, Resource, Typed};
use super::view;
use crate::analysis::JobKind;
use crate::arguments::groups;
use crate::cloud::ScalarType;
use crate::harmonics::Modes;
use crate::http::wait::{self, Wait};
use crate::http::wire::accept::{self, JSON, NPY, Offer, PLY, PNG};
use crate::http::wire::download::Plan;
use crate::http::wire::memory::Reservation;
use crate::http::wire::notation::short_digest;
use crate::http::wire::owners;
use crate::http::wire::problem::{Kind, Problem};
use crate::http::wire::query::FromQuery;
use crate::http::wire::service::Shared;
use crate::jobs::StoredBases;
use crate::spectrum::Spectrum;
use crate::store::{JobRecord, Owner};

/// Answers as JSON, at most: text is three times the size of the numbers, and slow to read.
pub const JSON_BYTES_MAX: u64 = 64 << 20;
/// Bytes of a number as JSON text, comma included: 17 digits, sign, point, and often an exponent.
pub(crate) const JSON_NUMBER_BYTES: u64 = 22;
/// Bytes of a number in blocks and in columns.
const VALUE_BYTES: u64 = 8 + 8;

groups! {
    /// The query of a request for a result.
    #[derive(Debug)]
    pub(crate) struct Query<R> where R: Resource {
        /// Arguments and format.
        offered: Offered<R>,
        /// Waiting for the job's end.
        wait: Wait,
    }
}

groups! {
    /// The query of a request for a result under a file name.
    #[derive(Debug)]
    struct FileQuery<R> where R: Resource {
        /// Arguments.
        typed: Typed<R>,
        /// Waiting for the job's end.
        wait: Wait,
    }
}

/// A request for the result of a job of which R are the arguments.
pub(crate) struct ResultRequest<R> {
    /// What the handlers work with.
    pub service: Shared,
    /// The job as named in the path.
    pub id: String,
    /// How to answer.
    pub offer: Offer,
    /// The arguments.
    pub arguments: R,
    array: ArrayType,
    /// How long to wait for the job's end.
    pub wait: Duration,
    /// GET, HEAD or POST.
    pub method: Method,
    /// The request's headers.
    pub headers: HeaderMap,
    /// Whose request it is.
    pub owner: Owner,
}

impl<R: Resource> FromRequestParts<Shared> for ResultRequest<R> {
    type Rejection = Problem;

    async fn from_request_parts(parts: &mut Parts, service: &Shared) -> Result<Self, Problem> {
        let FromQuery(Query { offered, wait }) =
            FromQuery::<Query<R>>::from_request_parts(parts, service).await?;
        let offer = accept::choose(offered.format, &parts.headers, R::OFFERS)?;
        Self::new(parts, service, offered.typed, offer, wait).await
    }
}

impl<R: Resource> IntoParams for ResultRequest<R> {
    fn into_params(parameter_in: impl Fn() -> Option<ParameterIn>) -> Vec<Parameter> {
        FromQuery::<Query<R>>::into_params(parameter_in)
    }
}

impl<R: Resource> ResultRequest<R> {
    async fn new(
        parts: &mut Parts,
        service: &Shared,
        Typed { arguments, array }: Typed<R>,
        offer: Offer,
        wait: Wait,
    ) -> Result<Self, Problem> {
        let ids = Path::<Vec<(String, String)>>::from_request_parts(parts, service).await;
        let Path(ids) = ids.map_err(|rejection| Problem::new(Kind::NotFound, rejection.body_text()))?;
        let id = ids.into_iter().find(|(name, _)| name == "id").map(|(_, id)| id).unwrap_or_default();
        let (method, headers) = (parts.method.clone(), parts.headers.clone());
        let (service, owner) = (service.clone(), owners::owner(&parts.extensions));
        Ok(Self { service, id, offer, arguments, array, wait: wait.time(), method, headers, owner })
    }

    /// The request for a file whose ending names the format: `?format=` and `Accept` have no say.
    ///
    /// # Errors
    /// A problem with the query.
    pub(crate) async fn of_file(parts: &mut Parts, service: &Shared, offer: Offer) -> Result<Self, Problem> {
        let FromQuery(FileQuery { typed, wait }) =
            FromQuery::<FileQuery<R>>::from_request_parts(parts, service).await?;
        Self::new(parts, service, typed, offer, wait).await
    }

    /// The answer to come, named by what determines it.
    pub(crate) fn plan(&self, tag: String, stem: String) -> Plan<'_> {
        let tag = self.array.tagged(tag, self.offer);
        Plan { method: &self.method, headers: &self.headers, offer: self.offer, tag, stem }
    }

    /// Type of the numbers of the answer.
    pub(crate) fn kind(&self) -> ScalarType {
        self.array.kind(self.offer)
    }

    /// The job, once it has succeeded.
    ///
    /// # Errors
    /// A problem that tells the state of a job without a result.
    pub(crate) async fn job(&self) -> Result<JobRecord, Problem> {
        wait::finished(&self.service, &self.id, self.wait).await
    }

    /// The job and its spectrum, once it has succeeded.
    ///
    /// # Errors
    /// As [`Self::job`], and for jobs that built the operator only.
    pub(crate) async fn eigen(&self) -> Result<(JobRecord, Spectrum), Problem> {
        of_eigen(self.job().await?)
    }

    /// Waits for the memory that an answer takes.
    ///
    /// # Errors
    /// A problem: there was none in time.
    pub(crate) async fn reserve(&self, bytes: u64) -> Result<Reservation, Problem> {
        self.service.memory.reserve(self.owner.clone(), bytes).await
    }

    /// The modes and stored bases of a job, for an answer of `columns` numbers per row of the upload.
    ///
    /// # Errors
    /// A problem: there is no memory for the answer, or it would be too much text.
    pub(crate) async fn harmonics(
        &self,
        eigen: (JobRecord, Spectrum),
        columns: usize,
    ) -> Result<Harmonics, Problem> {
        self.harmonics_of(eigen, self.service.memory.begin(self.owner.clone()), columns).await
    }

    /// The same beside what a request has reserved for its body already: nothing is reserved for the answer before the body
    /// is there, and then all of it at once, because a request that holds memory while waiting for more blocks others.
    ///
    /// # Errors
    /// As [`Self::harmonics`].
    pub(crate) async fn harmonics_of(
        &self,
        (job, spectrum): (JobRecord, Spectrum),
        mut reservation: Reservation,
        columns: usize,
    ) -> Result<Harmonics, Problem> {
        self.refuse_large_json(job.points * columns as u64)?;
        let (store, compute) = (self.service.store.clone(), self.service.pools.answering.clone());
        let bases = StoredBases::new(store, compute, &job, spectrum.eigenvalues.len());
        let cloud = self.service.store.cloud(job.cloud_id).await?.bytes();
        // The cloud, the functions on it, and what becomes of them: text of three times the size, or a picture.
        let answer = match self.offer {
            JSON => 10 * cloud,
            PNG => 3 * cloud + view::bytes(&self.arguments.view(), job.points),
            _ => 3 * cloud,
        };
        // Of binary files, blocks are sent as they are made; JSON is put together from all of them.
        let numbers = if self.offer == JSON { job.points * columns as u64 } else { 0 };
        let listed = numbers * (VALUE_BYTES + self.number_bytes());
        reservation.add(bases.bytes_at_work() + answer + listed).await?;
        Ok(Harmonics { modes: Modes::of(&spectrum), job, bases, reservation })
    }

    /// Bytes of a number in the answer, at most.
    pub(crate) fn number_bytes(&self) -> u64 {
        // JSON is made of numbers that may be missing, beside the text.
        if self.offer == JSON { 16 + JSON_NUMBER_BYTES } else { 8 }
    }

    /// POST answers support neither conditions nor ranges.
    pub(crate) fn forget_conditions(&mut self) {
        use axum::http::header::{IF_NONE_MATCH, RANGE};
        for name in [IF_NONE_MATCH, RANGE] {
            self.headers.remove(name);
        }
    }

    /// Refuses an answer of `numbers` numbers in JSON when that is too much text.
    ///
    /// # Errors
    /// A problem that names another format, if there is one.
    pub(crate) fn refuse_large_json(&self, numbers: u64) -> Result<(), Problem> {
        let bytes = numbers.saturating_mul(JSON_NUMBER_BYTES);
        if self.offer != JSON || bytes <= JSON_BYTES_MAX {
            return Ok(());
        }
        let others = R::OFFERS.iter().filter(|offer| [NPY, PLY].contains(offer));
        let told =
            |offer: &Offer| format!("{0} (?format={0} or Accept: {1})", offer.name, offer.media_type());
        let told: Vec<_> = others.clone().map(told).collect();
        Err(Problem::new(
            Kind::NotAcceptable,
            format!(
                "the JSON answer would be about {} MB; the limit is {} MB. Request less, or {}",
                bytes >> 20,
                JSON_BYTES_MAX >> 20,
                told.join(" or ")
            ),
        )
        .with("accepted", others.map(|offer| offer.name).collect::<Vec<_>>()))
    }
}

/// An eigenbasis in the store.
pub(crate) struct Harmonics {
    /// The job that computed it, its spectrum taken out.
    pub job: JobRecord,
    /// Eigenvalues.
    pub modes: Modes,
    /// Bases.
    pub bases: StoredBases,
    /// Held until the answer is sent.
    pub reservation: Reservation,
}

/// The spectrum of a job that has succeeded, taken out of it.
///
/// # Errors
/// A problem for jobs that built the operator only.
pub(crate) fn of_eigen(mut job: JobRecord) -> Result<(JobRecord, Spectrum), Problem> {
    let spectrum = job.report.as_mut().and_then(|report| report.spectrum.take());
    let Some(spectrum) = spectrum else {
        let why = "built the operator only; for bases and spectrum submit {\"kind\": \"eigen\"}";
        return Err(no_result(&job, why));
    };
    Ok((job, spectrum))
}

/// Refuses jobs that did not keep Q.
///
/// # Errors
/// A problem that says what to submit.
pub(crate) fn check_kept(job: &JobRecord) -> Result<(), Problem> {
    if job.kind == JobKind::Operator {
        return Ok(());
    }
    let why = "keeps its bases and B, not Q; for Q submit {\"kind\": \"operator\"} with the same parameters";
    Err(no_result(job, why))
}

/// A job that succeeded without this result; `why` ends with what to submit instead.
fn no_result(job: &JobRecord, why: &str) -> Problem {
    let jobs = format!("/clouds/{}/jobs", job.cloud_id);
    Problem::new(Kind::NoSuchResult, format!("job {} {why} to {jobs}", job.id))
        .with("links", serde_json::json!({ "jobs": jobs }))
}

/// A tag that names an answer by what determines it.
pub(crate) fn tag(job: Uuid, parts: &impl serde::Serialize) -> String {
    format!("{}-{}", job.simple(), short_digest(&serde_json::to_vec(parts).unwrap_or_default()))
}

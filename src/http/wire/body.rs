//! A request's body on its way to its handler: bounded in bytes, time and memory, and decompressed.
//!
//! The only way to a body. A handler takes an [`IncomingBody`] and receives it once the request's arguments are checked.

use std::time::Duration;

use axum::body::{Body, BodyDataStream, Bytes};
use axum::extract::{FromRequest, Request};
use axum::http::request::Parts;
use axum::http::{HeaderMap, header};
use futures_util::StreamExt;
use tokio::time::{Instant, timeout};

use super::decompress::{Bounds, Coding};
use super::memory::{Arrival, Reservation};
use super::owners;
use super::pace::Pace;
use super::problem::{Kind, Problem};
use super::service::Shared;
use crate::store::Owner;

/// Bytes for which room is reserved ahead of those that are there, at least and at most; between, half of those.
const AHEAD_BYTES: (u64, u64) = (4 << 10, 1 << 20);
/// Bytes that are decompressed at once, at least and at most; between, half of what is there.
const DECODED_BYTES: (u64, u64) = (64 << 10, 16 << 20);
/// From then on a body counts as slow: it no longer has a claim to the memory that is kept for small ones.
const SLOW: Duration = Duration::from_secs(5);

/// A body of which nothing has been read.
pub(crate) struct IncomingBody {
    body: Body,
    parts: Parts,
    service: Shared,
}

/// A body that is there, and the memory for it and for what it is parsed into.
#[derive(Debug)]
pub(crate) struct Received {
    /// Its bytes, decompressed.
    pub bytes: Bytes,
    /// Held until the request is answered.
    pub reservation: Reservation,
}

impl FromRequest<Shared> for IncomingBody {
    type Rejection = Problem;

    async fn from_request(request: Request, service: &Shared) -> Result<Self, Problem> {
        let (parts, body) = request.into_parts();
        Ok(Self { body, parts, service: service.clone() })
    }
}

impl IncomingBody {
    /// What came before the body.
    pub(crate) fn parts(&self) -> &Parts {
        &self.parts
    }

    /// Whose request it is.
    pub(crate) fn owner(&self) -> Owner {
        owners::owner(&self.parts.extensions)
    }

    /// The whole body, of at most `bytes_max` bytes as it is sent.
    ///
    /// # Errors
    /// A problem: too large, too slow, cut off, compressed in a way that is not known or damaged, a part of a file, or no
    /// memory for it.
    pub(crate) async fn receive(self, bytes_max: u64) -> Result<Received, Problem> {
        let headers = &self.parts.headers;
        refuse_parts(headers)?;
        let coding = Coding::of(headers)?;
        let announced = headers.get(header::CONTENT_LENGTH);
        let announced = announced.and_then(|length| length.to_str().ok()?.parse::<u64>().ok());
        let bytes_max = bytes_max.min(self.service.limits.body_bytes);
        if announced.is_some_and(|length| length > bytes_max) {
            return Err(too_large(bytes_max));
        }
        let reservation = self.service.memory.begin(self.owner());
        let Self { body, service, .. } = self;
        let mut intake = Intake { service, announced, reservation };
        let mut bytes = intake.receive(body.into_data_stream(), bytes_max).await?;
        if let Some(coding) = coding {
            bytes = intake.decode(coding, bytes).await?;
        }
        intake.reservation.arrived(bytes.len() as u64);
        Ok(Received { bytes: bytes.into(), reservation: intake.reservation })
    }
}

/// A body while it is received.
struct Intake {
    service: Shared,
    announced: Option<u64>,
    reservation: Reservation,
}

impl Intake {
    async fn receive(&mut self, mut chunks: BodyDataStream, bytes_max: u64) -> Result<Vec<u8>, Problem> {
        let limits = &self.service.limits;
        let mut pace = Pace::new(limits.stall(), limits.body_rate_min_bytes);
        let deadline = Instant::now() + limits.body_time();
        let (mut bytes, mut covered) = (Vec::new(), 0);
        loop {
            let chunk = self.next(&mut chunks, bytes.len() as u64, &mut pace, deadline).await?;
            let Some(chunk) = chunk else { return Ok(bytes) };
            let length = (bytes.len() + chunk.len()) as u64;
            if length > bytes_max {
                return Err(too_large(bytes_max));
            }
            self.service.metrics.received(chunk.len() as u64);
            if length > covered {
                covered = length + (length / 2).clamp(AHEAD_BYTES.0, AHEAD_BYTES.1);
                covered = covered.min(self.announced.unwrap_or(u64::MAX).max(length));
                self.grow_to(covered, pace.waited() > SLOW).await?;
            }
            bytes.extend_from_slice(&chunk);
        }
    }

    /// What comes next, within the time that there is for it.
    async fn next(
        &mut self,
        chunks: &mut BodyDataStream,
        there: u64,
        pace: &mut Pace,
        deadline: Instant,
    ) -> Result<Option<Bytes>, Problem> {
        let mut stalled = Duration::ZERO;
        loop {
            let stall = self.service.limits.stall().saturating_sub(stalled);
            let left = deadline.saturating_duration_since(Instant::now());
            let patience = stall.min(left).min(pace.left());
            let becomes_slow = SLOW.checked_sub(pace.waited()).filter(|rest| *rest < patience);
            let began = Instant::now();
            let chunk = timeout(becomes_slow.unwrap_or(patience), chunks.next()).await;
            pace.wait(began.elapsed());
            stalled += began.elapsed();
            match chunk {
                Ok(None) => return Ok(None),
                Ok(Some(Ok(chunk))) => {
                    pace.arrive(chunk.len());
                    return Ok(Some(chunk));
                }
                Ok(Some(Err(error))) => {
                    tracing::debug!(%error, "upload interrupted");
                    return Err(Problem::new(
                        Kind::Interrupted,
                        "the connection closed before the whole body arrived",
                    ));
                }
                Err(_) if becomes_slow.is_some() => self.grow_to(there, true).await?,
                Err(_) if left <= patience => return Err(self.too_long()),
                Err(_) if stall <= patience => return Err(self.stalled()),
                Err(_) => return Err(self.too_slow()),
            }
        }
    }

    async fn grow_to(&mut self, bytes: u64, is_slow: bool) -> Result<(), Problem> {
        let left = self.announced.map(|length| length.saturating_sub(bytes));
        self.reservation.grow(Arrival { bytes, left, is_slow }).await
    }

    /// What the body holds, decompressed piece by piece as room is found for it.
    async fn decode(&mut self, coding: Coding, bytes: Vec<u8>) -> Result<Vec<u8>, Problem> {
        let limits = &self.service.limits;
        let bounds = Bounds { bytes_max: limits.decoded_bytes, ratio_max: limits.decoded_ratio_max };
        let compressed = bytes.len() as u64;
        let mut decoder = coding.decoder(bytes.into(), bounds);
        loop {
            let piece = (decoder.decoded() / 2).clamp(DECODED_BYTES.0, DECODED_BYTES.1);
            let bytes = compressed.max(decoder.decoded() + piece);
            self.reservation.grow(Arrival { bytes, left: None, is_slow: false }).await?;
            let decode = move || decoder.decode(piece as usize).map(|is_whole| (is_whole, decoder));
            let is_whole;
            (is_whole, decoder) = self.service.pools.reading.run(decode).await??;
            if is_whole {
                return Ok(decoder.into_bytes());
            }
        }
    }

    fn too_long(&self) -> Problem {
        let seconds = self.service.limits.body_seconds;
        Problem::new(Kind::RequestTimeout, format!("the body took longer than {seconds} seconds"))
    }

    fn stalled(&self) -> Problem {
        let seconds = self.service.limits.stall_seconds;
        Problem::new(Kind::RequestTimeout, format!("no data arrived for {seconds} seconds"))
    }

    fn too_slow(&self) -> Problem {
        let limits = &self.service.limits;
        Problem::new(
            Kind::RequestTimeout,
            format!(
                "the body arrived at less than {} bytes per second over {} seconds",
                limits.body_rate_min_bytes, limits.stall_seconds
            ),
        )
    }
}

/// A part of a file stored as if it were the file would be wrong (RFC 9110 §14.5).
fn refuse_parts(headers: &HeaderMap) -> Result<(), Problem> {
    if !headers.contains_key(header::CONTENT_RANGE) {
        return Ok(());
    }
    Err(Problem::new(
        Kind::MalformedRequest,
        "Content-Range announces a part of a file, and uploads cannot be continued; send the whole file, with curl \
         without -C",
    ))
}

fn too_large(limit: u64) -> Problem {
    Problem::new(Kind::TooLarge, format!("the body is larger than {limit} bytes, the limit of this service"))
        .with("limit", limit)
}

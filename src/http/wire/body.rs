//! Every request's body on its way to its handler: bounded in bytes, time and memory, and decompressed.
//!
//! A layer around all routes, so that none can forget it. The body is read when its handler asks for it, after the
//! request's parameters were checked, and arrives in one piece.

use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use axum::body::{Body, Bytes, HttpBody};
use axum::extract::{Request, State};
use axum::http::{HeaderMap, header};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};
use futures_util::{StreamExt, stream};
use tokio::time::{Instant, timeout};

use super::body_memory::Held;
use super::coding::{Bounds, Coding};
use super::problem::{Kind, Problem};
use crate::cloud::reader;
use crate::http::service::{Limits, Shared};
use crate::jobs::Compute;
use crate::metrics::Metrics;

/// Bytes that are reserved at once for a body, at most, before they are there.
const RESERVED_BYTES_MAX: u64 = 64 << 20;

/// Bounds the body, and tells what was wrong with it in place of whatever its handler made of that.
pub(crate) async fn bound(State(service): State<Shared>, request: Request, next: Next) -> Response {
    if request.body().is_end_stream() {
        return next.run(request).await;
    }
    let (mut parts, body) = request.into_parts();
    let intake = match Intake::of(&service, &parts.headers, body) {
        Ok(intake) => intake,
        Err(problem) => return problem.into_response(),
    };
    if intake.coding.is_some() {
        parts.headers.remove(header::CONTENT_ENCODING);
        parts.headers.remove(header::CONTENT_LENGTH);
    }
    // Held until there is an answer: what the handler makes of the body counts too.
    let held = Arc::new(tokio::sync::Mutex::new(service.body_memory.hold()));
    let fault = Arc::new(Mutex::new(None));
    let (holding, told) = (Arc::clone(&held), Arc::clone(&fault));
    let whole = stream::once(async move {
        let mut held = holding.lock().await;
        intake.whole(&mut held).await.map_err(|problem| {
            *told.lock().unwrap_or_else(PoisonError::into_inner) = Some(problem);
            std::io::Error::other("told by the layer")
        })
    });
    let response = next.run(Request::from_parts(parts, Body::from_stream(whole))).await;
    let fault = fault.lock().unwrap_or_else(PoisonError::into_inner).take();
    drop(held);
    match fault {
        Some(problem) if !response.status().is_success() => problem.into_response(),
        _ => response,
    }
}

/// A body that is still to be read.
struct Intake {
    body: Body,
    announced: Option<u64>,
    coding: Option<Coding>,
    limits: Limits,
    compute: Compute,
    metrics: Arc<Metrics>,
}

impl Intake {
    /// # Errors
    /// A problem that can be told from the headers alone.
    fn of(service: &Shared, headers: &HeaderMap, body: Body) -> Result<Self, Problem> {
        let coding = Coding::of(headers)?;
        let announced = headers.get(header::CONTENT_LENGTH);
        let announced = announced.and_then(|length| length.to_str().ok()?.parse::<u64>().ok());
        let limits = service.limits.clone();
        if announced.is_some_and(|length| length > limits.body_bytes) {
            return Err(too_large(limits.body_bytes));
        }
        let (compute, metrics) = (service.compute.clone(), Arc::clone(&service.metrics));
        Ok(Self { body, announced, coding, limits, compute, metrics })
    }

    /// The whole body, decompressed.
    async fn whole(mut self, held: &mut Held) -> Result<Bytes, Problem> {
        let mut bytes = self.receive(held).await?;
        if let Some(coding) = self.coding {
            let bounds =
                Bounds { bytes_max: self.limits.decoded_bytes, ratio_max: self.limits.decoded_ratio_max };
            bytes = self.compute.run(move || coding.decode(&bytes, bounds)).await??;
            held.grow_to(bytes.len() as u64)?;
        }
        let bytes = Bytes::from(bytes);
        let looked_at = bytes.clone();
        let unpacked = self.compute.run(move || reader::unpacked_bytes(&looked_at)).await?;
        held.grow_to(unpacked as u64)?;
        Ok(bytes)
    }

    async fn receive(&mut self, held: &mut Held) -> Result<Vec<u8>, Problem> {
        if let Some(length) = self.announced {
            held.wait_for(length).await?;
        }
        let reserved = self.announced.unwrap_or(0).min(RESERVED_BYTES_MAX);
        let mut bytes = Vec::with_capacity(reserved as usize);
        let deadline = Instant::now() + self.limits.body_time;
        let mut chunks = std::mem::take(&mut self.body).into_data_stream();
        loop {
            let left = deadline.saturating_duration_since(Instant::now());
            let chunk = timeout(self.limits.stall.min(left), chunks.next()).await;
            let Some(chunk) = chunk.map_err(|_| self.too_slow(left))? else { return Ok(bytes) };
            let chunk = chunk.map_err(|error| {
                tracing::debug!(%error, "upload interrupted");
                Problem::new(Kind::Interrupted, "the body ended before all of it had come")
            })?;
            let length = (bytes.len() + chunk.len()) as u64;
            if length > self.limits.body_bytes {
                return Err(too_large(self.limits.body_bytes));
            }
            self.metrics.received(chunk.len() as u64);
            held.grow_to(length)?;
            bytes.extend_from_slice(&chunk);
        }
    }

    fn too_slow(&self, left: Duration) -> Problem {
        let told = if left <= self.limits.stall {
            format!("the body took longer than {} seconds", self.limits.body_time.as_secs_f64())
        } else {
            format!("no data came for {} seconds", self.limits.stall.as_secs_f64())
        };
        Problem::new(Kind::RequestTimeout, told)
    }
}

fn too_large(limit: u64) -> Problem {
    Problem::new(Kind::TooLarge, format!("the body is larger than {limit} bytes, the limit of this service"))
        .with("limit", limit)
}

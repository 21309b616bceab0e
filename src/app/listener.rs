//! Accepts connections: how many, how long their heads may take, and how they end.
//!
//! `axum::serve` sets no timer, so a client that sends half a head would hold its connection forever.

mod places;
mod turn;

use std::convert::Infallible;
use std::future::Future;
use std::io;
use std::pin::Pin;
use std::sync::Arc;
use std::time::{Duration, Instant};

use axum::Router;
use axum::body::Body;
use axum::extract::Request;
use axum::http::{HeaderValue, header};
use axum::response::Response;
use hyper::body::Incoming;
use hyper::server::conn::http1;
use hyper::service::service_fn;
use hyper_util::rt::{TokioIo, TokioTimer};
use hyper_util::server::graceful::GracefulShutdown;
use tokio::net::{TcpListener, TcpStream};
use tokio::task::JoinSet;
use tokio_io_timeout::TimeoutStream;
use tokio_util::sync::CancellationToken;
use tower::ServiceExt;

use crate::http::{NoPlace, PROBES};
use places::{Place, Places};
pub(crate) use turn::Patience;
use turn::{Answering, Receiving, Watched};

/// Bytes of a request's head, at most.
const HEAD_BYTES_MAX: usize = 64 << 10;
/// Pause after a failed accept: the process is out of descriptors, and only time helps.
const ACCEPT_PAUSE: Duration = Duration::from_millis(100);
/// Pause before a connection is closed whose request found no place.
const ANSWER_PAUSE: Duration = Duration::from_millis(100);
/// Failed accepts are logged once in this time.
const COMPLAINT_PERIOD: Duration = Duration::from_mins(1);
/// Answered although all places for everybody are taken, as the probes are.
const METRICS: &str = "/metrics";

/// Limits of connections.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Connections {
    /// Open ones.
    pub at_once: usize,
    /// When a client's place may be given to another.
    pub patience: Patience,
    /// Time for a request's head.
    pub header: Duration,
    /// Time without a byte of an answer taken.
    pub stall: Duration,
    /// Time for answers to end at a stop.
    pub grace: Duration,
}

/// Accepts until `stopping`, then lets the open answers end within the grace time.
pub(crate) async fn serve(
    listener: TcpListener,
    router: Router,
    limits: Connections,
    stopping: CancellationToken,
) {
    let places = Places::new(limits.at_once, limits.patience);
    let graceful = GracefulShutdown::new();
    let mut open = JoinSet::new();
    let mut complaint = Complaint::default();
    loop {
        let accepted = tokio::select! {
            accepted = listener.accept() => accepted,
            () = stopping.cancelled() => break,
        };
        let stream = match accepted {
            Ok((stream, _)) => stream,
            Err(error) => {
                complaint.about(&error);
                tokio::time::sleep(ACCEPT_PAUSE).await;
                continue;
            }
        };
        let place = tokio::select! {
            place = places.take() => Arc::new(place),
            () = stopping.cancelled() => break,
        };
        let connection = connection(stream, router.clone(), limits, Arc::clone(&place));
        let connection = graceful.watcher().watch(connection);
        open.spawn(async move {
            let left = async {
                place.leave.cancelled().await;
                if place.is_spare() {
                    // What waits for a place answers first.
                    tokio::time::sleep(ANSWER_PAUSE).await;
                }
            };
            tokio::select! {
                ended = connection => if let Err(error) = ended {
                    tracing::debug!(%error, "connection ended early");
                },
                () = left => tracing::debug!("connection closed: its place was needed"),
            }
        });
        while open.try_join_next().is_some() {}
    }
    drop(listener);
    if tokio::time::timeout(limits.grace, graceful.shutdown()).await.is_err() {
        tracing::warn!(connections = open.len(), "grace time over; closing connections");
    }
    open.shutdown().await;
}

/// Logs failures to accept once in a period, with their number.
#[derive(Default)]
struct Complaint {
    last: Option<Instant>,
    since: u64,
}

impl Complaint {
    fn about(&mut self, error: &io::Error) {
        self.since += 1;
        if self.last.is_none_or(|last| last.elapsed() >= COMPLAINT_PERIOD) {
            tracing::warn!(%error, failures = self.since, "cannot accept connections");
            *self = Self { last: Some(Instant::now()), since: 0 };
        }
    }
}

/// A connection of HTTP/1.1, as a future.
fn connection(
    stream: TcpStream,
    router: Router,
    limits: Connections,
    place: Arc<Place>,
) -> impl hyper_util::server::graceful::GracefulConnection<Error = hyper::Error> {
    if let Err(error) = stream.set_nodelay(true) {
        tracing::debug!(%error, "cannot send small packets at once");
    }
    // hyper bounds the time for heads, `http` that for bodies; a client that takes no answer is nobody else's.
    let mut stream = TimeoutStream::new(stream);
    stream.set_write_timeout(Some(limits.stall));
    let stream = Watched { stream: Box::pin(stream), turn: place.turn.clone() };
    let answer = service_fn(move |request: hyper::Request<Incoming>| {
        answer(request, router.clone(), Arc::clone(&place))
    });
    http1::Builder::new()
        .timer(TokioTimer::new())
        .header_read_timeout(limits.header)
        .max_header_size(HEAD_BYTES_MAX)
        .serve_connection(TokioIo::new(stream), answer)
}

type Answer = Pin<Box<dyn Future<Output = Result<Response, Infallible>> + Send>>;

/// Hands a request to the router, and notes whose turn it is meanwhile.
fn answer(request: hyper::Request<Incoming>, router: Router, place: Arc<Place>) -> Answer {
    place.turn.ours();
    let turn = place.turn.clone();
    let mut request: Request = request.map(|body| Body::new(Receiving { body, turn }));
    Box::pin(async move {
        let path = request.uri().path();
        let waits = place.is_spare() && path != METRICS && !PROBES.contains(&path);
        if waits && !place.wait_for_open().await {
            request.extensions_mut().insert(NoPlace);
        }
        let mut response = router.oneshot(request).await?;
        if place.is_spare() {
            response.headers_mut().insert(header::CONNECTION, HeaderValue::from_static("close"));
        }
        let turn = place.turn.clone();
        Ok(response.map(|body| Body::new(Answering { body, turn })))
    })
}

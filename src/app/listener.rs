//! Accepts connections: how many, how long their heads may take, and how they end.
//!
//! `axum::serve` sets no timer, so a client that sends half a head would hold its connection for ever.

use std::pin::Pin;
use std::sync::Arc;
use std::time::Duration;

use axum::Router;
use hyper::server::conn::http1;
use hyper_util::rt::{TokioIo, TokioTimer};
use hyper_util::server::graceful::GracefulShutdown;
use hyper_util::service::TowerToHyperService;
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::Semaphore;
use tokio::task::JoinSet;
use tokio_io_timeout::TimeoutStream;
use tokio_util::sync::CancellationToken;

/// Bytes of a request's head, at most.
const HEAD_BYTES_MAX: usize = 64 << 10;
/// Pause after a failed accept: the process is out of descriptors, and only time helps.
const ACCEPT_PAUSE: Duration = Duration::from_millis(100);

/// Limits of connections.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Connections {
    /// Open ones.
    pub at_once: usize,
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
    let places = Arc::new(Semaphore::new(limits.at_once));
    let graceful = GracefulShutdown::new();
    let mut open = JoinSet::new();
    loop {
        let place = tokio::select! {
            place = Arc::clone(&places).acquire_owned() => place,
            () = stopping.cancelled() => break,
        };
        let stream = tokio::select! {
            accepted = listener.accept() => match accepted {
                Ok((stream, _)) => stream,
                Err(error) => {
                    tracing::warn!(%error, "cannot accept a connection");
                    tokio::time::sleep(ACCEPT_PAUSE).await;
                    continue;
                }
            },
            () = stopping.cancelled() => break,
        };
        let connection = graceful.watcher().watch(connection(stream, router.clone(), limits));
        open.spawn(async move {
            if let Err(error) = connection.await {
                tracing::debug!(%error, "connection ended early");
            }
            drop(place);
        });
        while open.try_join_next().is_some() {}
    }
    drop(listener);
    if tokio::time::timeout(limits.grace, graceful.shutdown()).await.is_err() {
        tracing::warn!(connections = open.len(), "grace time over; closing connections");
    }
    open.shutdown().await;
}

/// A stream whose writes are given up after a time.
type Bounded = Pin<Box<TimeoutStream<TcpStream>>>;

/// A connection of HTTP/1.1.
fn connection(
    stream: TcpStream,
    router: Router,
    limits: Connections,
) -> http1::Connection<TokioIo<Bounded>, TowerToHyperService<Router>> {
    if let Err(error) = stream.set_nodelay(true) {
        tracing::debug!(%error, "cannot send small packets at once");
    }
    // hyper bounds the time for heads, `http` that for bodies; a client that takes no answer is nobody else's.
    let mut stream = TimeoutStream::new(stream);
    stream.set_write_timeout(Some(limits.stall));
    http1::Builder::new()
        .timer(TokioTimer::new())
        .header_read_timeout(limits.header)
        .max_header_size(HEAD_BYTES_MAX)
        .serve_connection(TokioIo::new(Box::pin(stream)), TowerToHyperService::new(router))
}

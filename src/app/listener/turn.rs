//! Whose turn it is on a connection: the client's, and for how long already, or ours.

use std::io::{self, IoSlice};
use std::pin::Pin;
use std::sync::{Arc, Mutex, PoisonError};
use std::task::{Context, Poll};
use std::time::{Duration, Instant};

use axum::body::{Body, Bytes, HttpBody};
use hyper::body::{Frame, SizeHint};
use tokio::io::{AsyncRead, AsyncWrite, ReadBuf};

/// What a connection is waiting for.
#[derive(Debug)]
enum Wait {
    /// For a request, whose head may have come in part.
    Request(Instant),
    /// For us: the client can do nothing.
    Us,
    /// For the rest of a request's body; since a moment for us, who have not asked for more of it.
    Body { rate: Rate, ours_since: Option<Instant> },
}

/// Bytes by time: of the last whole window, and of the present one.
#[derive(Debug, Clone, Copy)]
struct Rate {
    since: Instant,
    bytes: u64,
    /// Bytes per second.
    before: Option<f64>,
}

impl Rate {
    fn new() -> Self {
        Self { since: Instant::now(), bytes: 0, before: None }
    }

    fn add(&mut self, bytes: u64, window: Duration) {
        self.bytes += bytes;
        let elapsed = self.since.elapsed();
        if elapsed >= window {
            *self = Self { before: Some(self.bytes as f64 / elapsed.as_secs_f64()), ..Self::new() };
        }
    }

    /// Bytes per second, once a window has passed.
    fn get(&self, window: Duration) -> Option<f64> {
        let elapsed = self.since.elapsed();
        if elapsed >= window { Some(self.bytes as f64 / elapsed.as_secs_f64()) } else { self.before }
    }
}

/// How a connection keeps its place, the least deserving first.
#[derive(Debug, Clone, Copy, PartialEq, PartialOrd)]
pub(super) enum Claim {
    /// Seconds since its last whole request (negative, so that the longest comes first).
    Idle(f64),
    /// Bytes per second at which its body arrives.
    Trickling(f64),
    /// Seconds since it took a part of an answer (negative).
    Deaf(f64),
}

/// Times after which a client at its turn may lose its place to another.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Patience {
    /// Without a request.
    pub idle: Duration,
    /// With a body, or an answer, that hardly moves.
    pub slow: Duration,
    /// Bytes per second of a body that moves.
    pub body_rate_min: f64,
}

/// Whose turn it is on one connection. Shared by what sees its bytes and what sees its requests.
#[derive(Debug, Clone)]
pub(super) struct Turn {
    patience: Patience,
    state: Arc<Mutex<(Wait, Option<Instant>)>>,
}

impl Turn {
    pub(super) fn new(patience: Patience) -> Self {
        Self { patience, state: Arc::new(Mutex::new((Wait::Request(Instant::now()), None))) }
    }

    fn state(&self) -> std::sync::MutexGuard<'_, (Wait, Option<Instant>)> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Whether the place may be given to another, and how little the client would deserve it.
    pub(super) fn claim(&self) -> Option<Claim> {
        let state = self.state();
        let long = |since: Instant, patience: Duration| {
            let elapsed = since.elapsed();
            (elapsed >= patience).then_some(-elapsed.as_secs_f64())
        };
        let deaf = state.1.and_then(|since| long(since, self.patience.slow)).map(Claim::Deaf);
        match &state.0 {
            // The last bytes of an answer may still be on their way.
            _ if state.1.is_some() => deaf,
            Wait::Request(since) => long(*since, self.patience.idle).map(Claim::Idle),
            Wait::Us | Wait::Body { ours_since: Some(_), .. } => None,
            Wait::Body { rate, ours_since: None } => rate
                .get(self.patience.slow)
                .filter(|rate| *rate < self.patience.body_rate_min)
                .map(Claim::Trickling),
        }
    }

    /// A request's head has come.
    pub(super) fn ours(&self) {
        self.state().0 = Wait::Us;
    }

    /// The answer has been handed over.
    fn theirs(&self) {
        self.state().0 = Wait::Request(Instant::now());
    }

    fn body(&self, polled: &Poll<Option<u64>>) {
        let mut state = self.state();
        match (polled, &mut state.0) {
            (Poll::Pending, Wait::Body { rate, ours_since }) => {
                // The client is not to blame for the time that we took.
                rate.since += ours_since.take().map_or(Duration::ZERO, |since| since.elapsed());
            }
            (Poll::Pending, wait) => *wait = Wait::Body { rate: Rate::new(), ours_since: None },
            (Poll::Ready(None), wait) => *wait = Wait::Us,
            (Poll::Ready(Some(bytes)), Wait::Body { rate, ours_since }) => {
                rate.add(*bytes, self.patience.slow);
                *ours_since = Some(Instant::now());
            }
            (Poll::Ready(Some(_)), _) => {}
        }
    }

    fn wrote(&self, blocked: bool) {
        let mut state = self.state();
        state.1 = if blocked { state.1.or_else(|| Some(Instant::now())) } else { None };
    }
}

/// A connection's bytes, seen from the side of writing.
#[derive(Debug)]
pub(super) struct Watched<S> {
    pub(super) stream: S,
    pub(super) turn: Turn,
}

impl<S: AsyncRead + Unpin> AsyncRead for Watched<S> {
    fn poll_read(
        mut self: Pin<&mut Self>,
        cx: &mut Context<'_>,
        buf: &mut ReadBuf<'_>,
    ) -> Poll<io::Result<()>> {
        Pin::new(&mut self.stream).poll_read(cx, buf)
    }
}

impl<S: AsyncWrite + Unpin> AsyncWrite for Watched<S> {
    fn poll_write(mut self: Pin<&mut Self>, cx: &mut Context<'_>, buf: &[u8]) -> Poll<io::Result<usize>> {
        let polled = Pin::new(&mut self.stream).poll_write(cx, buf);
        self.turn.wrote(polled.is_pending());
        polled
    }

    fn poll_write_vectored(
        mut self: Pin<&mut Self>,
        cx: &mut Context<'_>,
        bufs: &[IoSlice<'_>],
    ) -> Poll<io::Result<usize>> {
        let polled = Pin::new(&mut self.stream).poll_write_vectored(cx, bufs);
        self.turn.wrote(polled.is_pending());
        polled
    }

    fn is_write_vectored(&self) -> bool {
        self.stream.is_write_vectored()
    }

    fn poll_flush(mut self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.stream).poll_flush(cx)
    }

    fn poll_shutdown(mut self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.stream).poll_shutdown(cx)
    }
}

/// A request's body: while it is waited for, it is the client's turn.
pub(super) struct Receiving<B> {
    pub(super) body: B,
    pub(super) turn: Turn,
}

impl<B: HttpBody<Data = Bytes> + Unpin> HttpBody for Receiving<B> {
    type Data = Bytes;
    type Error = B::Error;

    fn poll_frame(
        mut self: Pin<&mut Self>,
        cx: &mut Context<'_>,
    ) -> Poll<Option<Result<Frame<Bytes>, B::Error>>> {
        let polled = Pin::new(&mut self.body).poll_frame(cx);
        self.turn.body(&match &polled {
            Poll::Pending => Poll::Pending,
            Poll::Ready(Some(Ok(frame))) => Poll::Ready(Some(frame.data_ref().map_or(0, Bytes::len) as u64)),
            Poll::Ready(Some(Err(_)) | None) => Poll::Ready(None),
        });
        polled
    }

    fn is_end_stream(&self) -> bool {
        self.body.is_end_stream()
    }

    fn size_hint(&self) -> SizeHint {
        self.body.size_hint()
    }
}

impl<B> Drop for Receiving<B> {
    /// What reads the body may leave it before its end.
    fn drop(&mut self) {
        let mut state = self.turn.state();
        if matches!(state.0, Wait::Body { .. }) {
            state.0 = Wait::Us;
        }
    }
}

/// An answer's body: when it has gone, the next request is waited for.
pub(super) struct Answering {
    pub(super) body: Body,
    pub(super) turn: Turn,
}

impl HttpBody for Answering {
    type Data = Bytes;
    type Error = axum::Error;

    fn poll_frame(
        mut self: Pin<&mut Self>,
        cx: &mut Context<'_>,
    ) -> Poll<Option<Result<Frame<Bytes>, axum::Error>>> {
        Pin::new(&mut self.body).poll_frame(cx)
    }

    fn is_end_stream(&self) -> bool {
        self.body.is_end_stream()
    }

    fn size_hint(&self) -> SizeHint {
        self.body.size_hint()
    }
}

impl Drop for Answering {
    fn drop(&mut self) {
        self.turn.theirs();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn turn(milliseconds: u64) -> Turn {
        let time = Duration::from_millis(milliseconds);
        Turn::new(Patience { idle: time, slow: time, body_rate_min: 1e3 })
    }

    #[test]
    fn a_place_may_be_lost_only_at_the_clients_turn() {
        let turn = turn(0);
        assert!(matches!(turn.claim(), Some(Claim::Idle(_))));
        turn.ours();
        assert_eq!(turn.claim(), None);
        turn.body(&Poll::Pending);
        assert!(matches!(turn.claim(), Some(Claim::Trickling(_))));
        turn.body(&Poll::Ready(None));
        assert_eq!(turn.claim(), None);
        turn.wrote(true);
        assert!(matches!(turn.claim(), Some(Claim::Deaf(_))));
        turn.wrote(false);
        assert_eq!(turn.claim(), None);
        turn.theirs();
        assert!(matches!(turn.claim(), Some(Claim::Idle(_))));
    }

    #[test]
    fn nobody_loses_a_place_before_the_time() {
        let turn = turn(60_000);
        assert_eq!(turn.claim(), None);
        turn.body(&Poll::Pending);
        turn.wrote(true);
        assert_eq!(turn.claim(), None);
    }

    #[test]
    fn a_body_that_moves_or_that_we_do_not_ask_for_keeps_its_place() {
        let rate = Rate { since: Instant::now(), bytes: 0, before: Some(5e3) };
        assert_eq!(rate.get(Duration::from_mins(1)), Some(5e3), "by the window before");
        let turn = turn(0);
        turn.body(&Poll::Pending);
        assert!(turn.claim().is_some(), "by the present window, once it has passed");
        turn.body(&Poll::Ready(Some(1)));
        assert_eq!(turn.claim(), None, "it is our turn");
        turn.body(&Poll::Pending);
        assert!(turn.claim().is_some());
    }

    #[test]
    fn the_longest_idle_deserves_its_place_least() {
        assert!(Claim::Idle(-5.0) < Claim::Idle(-2.0));
        assert!(Claim::Idle(-1.0) < Claim::Trickling(0.0));
        assert!(Claim::Trickling(1.0) < Claim::Trickling(2.0));
        assert!(Claim::Trickling(9.0) < Claim::Deaf(-50.0));
    }
}

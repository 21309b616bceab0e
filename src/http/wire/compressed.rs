//! A body compressed piece by piece, away from the threads that serve requests, and the compression that its client wants.

use std::future::Future;
use std::io::{self, Write};
use std::pin::Pin;
use std::task::{Context, Poll};

use axum::body::{Body, Bytes, HttpBody};
use axum::http::{HeaderMap, header};
use flate2::write::GzEncoder;
use hyper::body::Frame;
use zstd::stream::write::Encoder as ZstdEncoder;

use super::accept::weighted;
use super::memory::Reservation;
use crate::arguments::words;
use crate::jobs::{Compute, ComputeError};

/// Bytes that are compressed at once.
const PIECE_BYTES: usize = 64 << 10;
/// Level of zstd: its fastest but for the negative ones, which hardly compress.
const ZSTD_LEVEL: i32 = 1;

words! {
    /// A compression of answers, as `Content-Encoding` says it.
    pub(crate) enum Compression {
        /// RFC 8878.
        Zstd,
        /// RFC 1952.
        Gzip,
    }
}

impl Compression {
    /// The one that the client likes best, zstd of equals; `None` where it prefers the bytes as they are, or says nothing
    /// (RFC 9110 §12.5.3).
    pub(crate) fn accepted(headers: &HeaderMap) -> Option<Self> {
        let accepted = weighted(headers, &header::ACCEPT_ENCODING);
        let weight = |names: &[&str]| {
            let named = accepted.iter().find(|(name, _)| names.contains(&name.as_str()));
            named.or_else(|| accepted.iter().find(|(name, _)| name == "*")).map(|(_, weight)| *weight)
        };
        let identity = accepted.iter().find(|(name, _)| name == "identity").map_or(0.0, |(_, q)| *q);
        let (zstd, gzip) = (weight(&["zstd"]).unwrap_or(0.0), weight(&["gzip", "x-gzip"]).unwrap_or(0.0));
        let (best, choice) = if gzip > zstd { (gzip, Self::Gzip) } else { (zstd, Self::Zstd) };
        (best > 0.0 && best >= identity).then_some(choice)
    }
}

/// A compressor, and what came out of it.
pub(crate) enum Encoder {
    /// RFC 1952.
    Gzip(GzEncoder<Vec<u8>>),
    /// RFC 8878.
    Zstd(ZstdEncoder<'static, Vec<u8>>),
}

impl Encoder {
    /// # Errors
    /// The compressor's, for lack of memory.
    pub(crate) fn new(compression: Compression) -> io::Result<Self> {
        Ok(match compression {
            Compression::Gzip => Self::Gzip(GzEncoder::new(Vec::new(), flate2::Compression::fast())),
            Compression::Zstd => Self::Zstd(ZstdEncoder::new(Vec::new(), ZSTD_LEVEL)?),
        })
    }

    /// Compresses `bytes`, and takes what comes out: nothing, where it waits for more.
    fn encode(&mut self, bytes: &[u8]) -> io::Result<Vec<u8>> {
        match self {
            Self::Gzip(gzip) => {
                gzip.write_all(bytes)?;
                Ok(std::mem::take(gzip.get_mut()))
            }
            Self::Zstd(zstd) => {
                zstd.write_all(bytes)?;
                Ok(std::mem::take(zstd.get_mut()))
            }
        }
    }

    /// What is left to come out.
    fn finish(self) -> io::Result<Vec<u8>> {
        match self {
            Self::Gzip(gzip) => gzip.finish(),
            Self::Zstd(zstd) => zstd.finish(),
        }
    }
}

/// What comes out of a piece, and the compressor, unless that was the last.
type Encoded = io::Result<(Option<Encoder>, Vec<u8>)>;

/// A body under compression.
pub(crate) struct CompressedBody {
    body: Body,
    /// Of the body's last frame, what is not compressed yet.
    rest: Bytes,
    state: State,
    compute: Compute,
    _reservation: Reservation,
}

enum State {
    Idle(Encoder),
    Encoding(Pin<Box<dyn Future<Output = Result<Encoded, ComputeError>> + Send>>),
    Ended,
}

impl CompressedBody {
    /// Pieces of at most this size are compressed at once, in a fraction of a millisecond: they do not wait for those of
    /// large answers.
    pub(crate) const PROMPT_BYTES: usize = 8 << 10;

    /// `body` compressed by `encoder` on the threads of `compute`.
    pub(crate) fn new(body: Body, encoder: Encoder, compute: Compute, reservation: Reservation) -> Self {
        Self { body, rest: Bytes::new(), state: State::Idle(encoder), compute, _reservation: reservation }
    }

    /// Begins to compress the next piece, or what is left to come out when there is none.
    fn encode(&self, mut encoder: Encoder, piece: Option<Bytes>) -> State {
        let is_prompt = piece.as_ref().is_none_or(|piece| piece.len() <= Self::PROMPT_BYTES);
        let work = move || match piece {
            Some(piece) => encoder.encode(&piece).map(|bytes| (Some(encoder), bytes)),
            None => encoder.finish().map(|bytes| (None, bytes)),
        };
        if is_prompt {
            let encoded = work();
            return State::Encoding(Box::pin(std::future::ready(Ok(encoded))));
        }
        State::Encoding(Box::pin(self.compute.run(work)))
    }
}

impl HttpBody for CompressedBody {
    type Data = Bytes;
    type Error = axum::Error;

    fn poll_frame(
        mut self: Pin<&mut Self>,
        cx: &mut Context<'_>,
    ) -> Poll<Option<Result<Frame<Bytes>, axum::Error>>> {
        loop {
            match std::mem::replace(&mut self.state, State::Ended) {
                State::Ended => return Poll::Ready(None),
                State::Encoding(mut encoding) => {
                    let Poll::Ready(encoded) = encoding.as_mut().poll(cx) else {
                        self.state = State::Encoding(encoding);
                        return Poll::Pending;
                    };
                    let (encoder, bytes) = match encoded.map_err(axum::Error::new) {
                        Ok(encoded) => encoded.map_err(axum::Error::new)?,
                        Err(error) => return Poll::Ready(Some(Err(error))),
                    };
                    self.state = encoder.map_or(State::Ended, State::Idle);
                    if !bytes.is_empty() {
                        return Poll::Ready(Some(Ok(Frame::data(bytes.into()))));
                    }
                }
                State::Idle(encoder) if !self.rest.is_empty() => {
                    let length = self.rest.len().min(PIECE_BYTES);
                    let piece = self.rest.split_to(length);
                    self.state = self.encode(encoder, Some(piece));
                }
                State::Idle(encoder) => {
                    let Poll::Ready(frame) = Pin::new(&mut self.body).poll_frame(cx) else {
                        self.state = State::Idle(encoder);
                        return Poll::Pending;
                    };
                    match frame.transpose()? {
                        Some(frame) => {
                            // Our answers have no trailers.
                            self.rest = frame.into_data().unwrap_or_default();
                            self.state = State::Idle(encoder);
                        }
                        None => self.state = self.encode(encoder, None),
                    }
                }
            }
        }
    }

    fn is_end_stream(&self) -> bool {
        matches!(self.state, State::Ended)
    }
}

#[cfg(test)]
mod tests {
    use axum::http::HeaderValue;

    use super::*;

    fn accepted(value: &'static str) -> Option<Compression> {
        let headers = HeaderMap::from_iter([(header::ACCEPT_ENCODING, HeaderValue::from_static(value))]);
        Compression::accepted(&headers)
    }

    #[test]
    fn the_client_chooses_and_zstd_goes_before_gzip_among_equals() {
        use Compression::{Gzip, Zstd};
        assert_eq!(accepted("gzip, deflate, br, zstd"), Some(Zstd));
        assert_eq!(accepted("gzip;q=1.0, zstd;q=0.5"), Some(Gzip));
        assert_eq!(accepted("x-gzip"), Some(Gzip));
        assert_eq!(accepted("*"), Some(Zstd));
        assert_eq!(accepted("*, zstd;q=0"), Some(Gzip));
        assert_eq!(accepted("GZIP; Q = 0.5"), Some(Gzip));
        assert_eq!(accepted("identity, gzip;q=0.5"), None);
        assert_eq!(accepted("gzip;q=0, br"), None);
        assert_eq!(accepted(""), None);
        assert_eq!(Compression::accepted(&HeaderMap::new()), None);
    }
}

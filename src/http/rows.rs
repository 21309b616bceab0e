//! Results of n rows of fixed width, streamed a chunk of rows at a time.

use std::future::Future;
use std::io;
use std::ops::Range;

use axum::body::{Body, Bytes};
use futures_util::stream::{self, StreamExt};

use super::problem::Problem;
use crate::store::CHUNK_POINTS;

/// Chunks read and encoded ahead of the one being sent.
const CHUNKS_AHEAD: usize = 2;

/// A file that is a header, n rows of `stride` bytes, and a tail.
#[derive(Debug)]
pub(crate) struct RowLayout {
    /// What stands before the rows.
    pub header: Vec<u8>,
    /// Bytes of a row, at least 1.
    pub stride: usize,
    /// Number of rows n.
    pub rows: usize,
    /// What stands behind the rows.
    pub tail: Vec<u8>,
}

impl RowLayout {
    /// Length of the file in bytes.
    #[must_use]
    pub(crate) fn length(&self) -> u64 {
        (self.header.len() + self.tail.len()) as u64 + self.stride as u64 * self.rows as u64
    }

    /// The bytes `span` of the file, where `encode` makes the bytes of a whole chunk of [`CHUNK_POINTS`] rows.
    ///
    /// An error in the middle breaks the connection off, so that the client sees a short answer for what it is.
    pub(crate) fn stream<F, Encoded>(self, span: Range<u64>, encode: F) -> Body
    where
        F: Fn(usize) -> Encoded + Send + 'static,
        Encoded: Future<Output = Result<Vec<u8>, Problem>> + Send + 'static,
    {
        let rows_begin = self.header.len() as u64;
        let rows_length = self.stride as u64 * self.rows as u64;
        let head = part(self.header, 0, &span);
        let tail = part(self.tail, rows_begin + rows_length, &span);
        let within = |x: u64| x.saturating_sub(rows_begin).min(rows_length);
        let rows = within(span.start)..within(span.end);
        let chunk_bytes = (CHUNK_POINTS * self.stride) as u64;
        let chunks = (rows.start / chunk_bytes) as usize..rows.end.div_ceil(chunk_bytes) as usize;
        let encoded = stream::iter(chunks)
            .map(move |chunk| {
                let bytes = encode(chunk);
                let rows = rows.clone();
                async move {
                    let bytes = bytes.await.map_err(|problem| broken(&problem))?;
                    Ok(part(bytes, chunk as u64 * chunk_bytes, &rows))
                }
            })
            .buffered(CHUNKS_AHEAD);
        let ready = |bytes| stream::iter([Ok::<Bytes, io::Error>(bytes)]);
        Body::from_stream(ready(head).chain(encoded).chain(ready(tail)))
    }
}

/// What `span` selects of `bytes`, which begin at `begin`.
fn part(bytes: Vec<u8>, begin: u64, span: &Range<u64>) -> Bytes {
    let clip = |x: u64| x.saturating_sub(begin).min(bytes.len() as u64) as usize;
    let (from, to) = (clip(span.start), clip(span.end));
    Bytes::from(bytes).slice(from..to)
}

/// The error that ends a stream early.
pub(super) fn broken(problem: &Problem) -> io::Error {
    io::Error::other(problem.document(None, None).detail)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Rows are their own number, four bytes each; then a tail.
    fn layout() -> RowLayout {
        RowLayout {
            header: b"HEADER".to_vec(),
            stride: 4,
            rows: 2 * CHUNK_POINTS + 100,
            tail: b"TAIL".to_vec(),
        }
    }

    async fn bytes(span: Range<u64>) -> Vec<u8> {
        let rows = layout().rows;
        let body = layout().stream(span, move |chunk| async move {
            let end = ((chunk + 1) * CHUNK_POINTS).min(rows);
            Ok((chunk * CHUNK_POINTS..end).flat_map(|row| (row as u32).to_le_bytes()).collect())
        });
        axum::body::to_bytes(body, usize::MAX).await.unwrap().to_vec()
    }

    #[tokio::test]
    async fn every_span_is_that_part_of_the_whole() {
        let length = layout().length();
        let whole = bytes(0..length).await;
        assert_eq!(whole.len() as u64, length);
        assert_eq!(&whole[..10], b"HEADER\0\0\0\0");
        let chunk = (CHUNK_POINTS * 4) as u64;
        for span in [
            0..3,
            2..9,
            6..7,
            5 + chunk..8 + chunk,
            6 + chunk..6 + 2 * chunk,
            length - 1..length,
            length - 9..length - 2,
        ] {
            assert_eq!(bytes(span.clone()).await, whole[span.start as usize..span.end as usize], "{span:?}");
        }
    }

    #[tokio::test]
    async fn an_error_in_the_middle_breaks_the_answer_off() {
        let body = layout().stream(0..layout().length(), |chunk| async move {
            if chunk == 1 {
                Err(Problem::new(super::super::problem::Kind::Internal, "damaged"))
            } else {
                Ok(vec![0; CHUNK_POINTS * 4])
            }
        });
        assert!(axum::body::to_bytes(body, usize::MAX).await.is_err());
    }
}

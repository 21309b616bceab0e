//! The memory that large answers share, from the reading of what they are made of until they are made, or sent.

use std::sync::Arc;
use std::time::Duration;

use axum::body::{Body, HttpBody};
use axum::http::header;
use axum::response::Response;
use futures_util::StreamExt;
use tokio::sync::{OwnedSemaphorePermit, Semaphore};

use super::problem::{Kind, Problem};

/// The semaphore counts in these: it hands out at most 2³² of a kind.
const UNIT_BYTES: u64 = 16 << 10;
/// Seconds after which a client that found no room may try again.
const RETRY_SECONDS: u64 = 5;

/// A budget of bytes.
#[derive(Debug, Clone)]
pub(crate) struct AnswerMemory {
    units: Arc<Semaphore>,
    all: u32,
    patience: Duration,
}

/// One answer's share; given back when it is dropped.
#[derive(Debug)]
pub(crate) struct Share {
    _permit: OwnedSemaphorePermit,
}

impl AnswerMemory {
    /// A budget of `budget` bytes, for a share of which answers wait up to `patience`.
    pub(crate) fn new(budget: u64, patience: Duration) -> Self {
        let all = u32::try_from(budget / UNIT_BYTES).unwrap_or(u32::MAX).max(1);
        Self { units: Arc::new(Semaphore::new(all as usize)), all, patience }
    }

    /// Waits for room for an answer that takes `bytes` bytes of memory; one that takes more than there is waits until it
    /// is alone.
    ///
    /// # Errors
    /// A problem: there was no room in time.
    pub(crate) async fn share(&self, bytes: u64) -> Result<Share, Problem> {
        let units = u32::try_from(bytes.div_ceil(UNIT_BYTES)).unwrap_or(u32::MAX).min(self.all);
        let waiting = Arc::clone(&self.units).acquire_many_owned(units);
        let permit = tokio::time::timeout(self.patience, waiting).await;
        Ok(Share { _permit: permit.map_err(|_| busy())?.map_err(|_| busy())? })
    }
}

impl Share {
    /// The answer, which keeps its share until its last byte is taken.
    pub(crate) fn until_sent(self, answer: Response) -> Response {
        // What has no body is left as it is: of unknown length, it would be announced in chunks.
        if answer.body().is_end_stream() {
            return answer;
        }
        answer.map(|body| {
            Body::from_stream(body.into_data_stream().inspect(move |_| {
                let _kept = &self;
            }))
        })
    }
}

fn busy() -> Problem {
    Problem::new(
        Kind::Unavailable,
        "the service makes as many large answers as it has memory for; try again later",
    )
    .with_header(header::RETRY_AFTER, RETRY_SECONDS.to_string())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[tokio::test]
    async fn answers_wait_for_each_other_and_are_told_when_it_takes_too_long() {
        let memory = AnswerMemory::new(100 * UNIT_BYTES, Duration::from_mins(1));
        let first = memory.share(60 * UNIT_BYTES).await.unwrap();
        let impatient = AnswerMemory { patience: Duration::ZERO, ..memory.clone() };
        assert_eq!(impatient.share(41 * UNIT_BYTES).await.unwrap_err().kind(), Kind::Unavailable);
        drop(impatient.share(40 * UNIT_BYTES).await.unwrap());
        let mut large = Box::pin(memory.share(u64::MAX));
        assert!(futures_util::poll!(&mut large).is_pending());
        drop(first);
        large.await.unwrap();
    }

    #[tokio::test]
    async fn a_share_is_kept_until_the_answer_is_sent() {
        let memory = AnswerMemory::new(UNIT_BYTES, Duration::ZERO);
        let share = memory.share(1).await.unwrap();
        let answer = share.until_sent(Response::new(Body::from("numbers")));
        assert!(memory.share(1).await.is_err());
        assert_eq!(axum::body::to_bytes(answer.into_body(), 100).await.unwrap(), "numbers");
        assert!(memory.share(1).await.is_ok());
    }
}

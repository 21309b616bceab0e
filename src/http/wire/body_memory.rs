//! The memory that requests' bodies share, from their first byte until their answer.

use std::sync::Arc;
use std::time::Duration;

use axum::http::header;
use tokio::sync::{OwnedSemaphorePermit, Semaphore};

use super::problem::{Kind, Problem};

/// Bytes that a body of one byte may come to: itself, and four times as much once it is parsed.
const FACTOR: u64 = 5;
/// The semaphore counts in these: it hands out at most 2³² of a kind.
const UNIT_BYTES: u64 = 16 << 10;
/// Seconds after which a client that found no room may try again.
const RETRY_SECONDS: u64 = 5;

/// A budget of bytes.
#[derive(Debug, Clone)]
pub(crate) struct BodyMemory {
    units: Arc<Semaphore>,
    budget: u64,
    patience: Duration,
}

/// One body's share; given back when it is dropped.
#[derive(Debug)]
pub(crate) struct Held {
    memory: BodyMemory,
    permit: Option<OwnedSemaphorePermit>,
}

impl BodyMemory {
    /// A budget of `budget` bytes, for which a body that tells its length waits up to `patience`.
    pub(crate) fn new(budget: u64, patience: Duration) -> Self {
        let units = (budget / UNIT_BYTES).min(u64::from(u32::MAX)) as usize;
        Self { units: Arc::new(Semaphore::new(units)), budget, patience }
    }

    /// Holds nothing yet.
    pub(crate) fn hold(&self) -> Held {
        Held { memory: self.clone(), permit: None }
    }

    /// Bytes that are held.
    pub(crate) fn taken(&self) -> u64 {
        self.budget - (self.units.available_permits() as u64 * UNIT_BYTES).min(self.budget)
    }

    /// Units for a body of so many bytes.
    fn units(&self, body: u64) -> Result<u32, Problem> {
        let units = body.saturating_mul(FACTOR).div_ceil(UNIT_BYTES);
        let all = self.budget / UNIT_BYTES;
        if units > all {
            let limit = self.budget / FACTOR;
            return Err(Problem::new(
                Kind::TooLarge,
                format!(
                    "the service has memory for bodies of up to {limit} bytes; this one has {body} or more"
                ),
            )
            .with("limit", limit));
        }
        Ok(u32::try_from(units).unwrap_or(u32::MAX))
    }
}

impl Held {
    /// Waits for room for a body that is `body` bytes long.
    ///
    /// # Errors
    /// A problem: it will never have room, or had none in time.
    pub(crate) async fn wait_for(&mut self, body: u64) -> Result<(), Problem> {
        let units = self.memory.units(body)?;
        let waiting = Arc::clone(&self.memory.units).acquire_many_owned(units);
        let permit = tokio::time::timeout(self.memory.patience, waiting).await;
        self.permit = Some(permit.map_err(|_| busy())?.map_err(|_| busy())?);
        Ok(())
    }

    /// Takes room for a body that has grown to `body` bytes, if there is some: bodies that wait for each other while they
    /// hold what they have would wait for ever.
    ///
    /// # Errors
    /// A problem: there is no room.
    pub(crate) fn grow_to(&mut self, body: u64) -> Result<(), Problem> {
        let units = self.memory.units(body)?;
        let held = self.permit.as_ref().map_or(0, OwnedSemaphorePermit::num_permits) as u32;
        if units <= held {
            return Ok(());
        }
        let more = Arc::clone(&self.memory.units).try_acquire_many_owned(units - held).map_err(|_| busy())?;
        match &mut self.permit {
            Some(permit) => permit.merge(more),
            none => *none = Some(more),
        }
        Ok(())
    }
}

fn busy() -> Problem {
    Problem::new(Kind::Unavailable, "the service receives as much as it has memory for; try again later")
        .with_header(header::RETRY_AFTER, RETRY_SECONDS.to_string())
}

#[cfg(test)]
mod tests {
    use super::*;

    const BUDGET: u64 = 100 * UNIT_BYTES;

    #[tokio::test]
    async fn bodies_take_five_times_their_size_and_give_it_back() {
        let memory = BodyMemory::new(BUDGET, Duration::ZERO);
        let mut held = memory.hold();
        held.wait_for(10 * UNIT_BYTES).await.unwrap();
        assert_eq!(memory.taken(), 50 * UNIT_BYTES);
        held.grow_to(12 * UNIT_BYTES).unwrap();
        assert_eq!(memory.taken(), 60 * UNIT_BYTES);
        held.grow_to(UNIT_BYTES).unwrap();
        assert_eq!(memory.taken(), 60 * UNIT_BYTES);
        drop(held);
        assert_eq!(memory.taken(), 0);
    }

    #[tokio::test]
    async fn a_body_waits_for_room_and_is_told_when_there_is_none() {
        let memory = BodyMemory::new(BUDGET, Duration::from_mins(1));
        let mut first = memory.hold();
        first.wait_for(15 * UNIT_BYTES).await.unwrap();
        let mut second = memory.hold();
        assert_eq!(second.grow_to(10 * UNIT_BYTES).unwrap_err().kind(), Kind::Unavailable);
        let mut waiting = Box::pin(second.wait_for(10 * UNIT_BYTES));
        assert!(futures_util::poll!(&mut waiting).is_pending());
        drop(first);
        waiting.await.unwrap();
        let mut impatient = BodyMemory { patience: Duration::ZERO, ..memory.clone() }.hold();
        assert_eq!(impatient.wait_for(15 * UNIT_BYTES).await.unwrap_err().kind(), Kind::Unavailable);
    }

    #[tokio::test]
    async fn a_body_that_will_never_have_room_is_too_large() {
        let memory = BodyMemory::new(BUDGET, Duration::from_mins(1));
        assert_eq!(memory.hold().wait_for(BUDGET / 5 + 1).await.unwrap_err().kind(), Kind::TooLarge);
        assert!(memory.hold().wait_for(BUDGET / 5).await.is_ok());
    }
}

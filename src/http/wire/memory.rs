//! The memory that requests share: bodies as they arrive and what they are parsed into, and large answers until they
//! are sent.
//!
//! One budget. Bodies and answers overlap in it, but neither can take all of it; small ones have a part of their own; a
//! named owner holds at most half. Nothing is reserved by what a client announces. That only says which of the bodies
//! that grow at the same time may go on, so that they never wait for each other.

use std::collections::HashMap;
use std::fmt;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use axum::body::{Body, HttpBody};
use axum::http::header;
use axum::response::Response;
use futures_util::StreamExt;
use tokio::sync::Notify;

use super::problem::{Kind, Problem};
use super::retry;
use crate::store::Owner;

/// Bytes of memory that a byte of a body may come to: itself, and four times as much once it is parsed.
const FACTOR: u64 = 5;
/// Bodies and answers of at most this many bytes draw on the part for small ones first.
const SMALL_BYTES: u64 = 1 << 20;

/// A budget of bytes; cheap to clone.
#[derive(Clone)]
pub(crate) struct MemoryBudget(Arc<Shared>);

struct Shared {
    parts: Parts,
    patience: Duration,
    held: Mutex<Held>,
    /// Told whenever some of it was given back.
    freed: Notify,
}

/// How the budget is divided, in bytes.
#[derive(Debug, Clone, Copy)]
struct Parts {
    /// For small bodies and answers alone.
    small: u64,
    /// For all others together.
    common: u64,
    /// Of the common part, for bodies at most.
    bodies: u64,
    /// Of the common part, for answers at most.
    answers: u64,
    /// Of everything, for one named owner at most.
    owner: u64,
}

/// What is held, in bytes.
#[derive(Debug, Default)]
struct Held {
    small: u64,
    bodies: u64,
    answers: u64,
    owners: HashMap<Owner, u64>,
    /// Bodies in the common part that are still arriving.
    arriving: HashMap<u64, Arriving>,
    arrived: u64,
}

/// A body that is still arriving, in bytes of memory.
#[derive(Debug, Clone)]
struct Arriving {
    owner: Owner,
    held: u64,
    left: u64,
}

/// One request's part of the budget; given back when it is dropped.
#[must_use = "the memory is given back when this is dropped"]
pub(crate) struct Reservation {
    /// `None` for an answer that needs no part of it.
    budget: Option<MemoryBudget>,
    owner: Owner,
    small: u64,
    bodies: u64,
    answers: u64,
    /// Its number among the bodies that are arriving.
    arriving: Option<u64>,
}

/// How far a body has come.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Arrival {
    /// Bytes that are there, or for which room is wanted now.
    pub bytes: u64,
    /// Bytes that are still to come, as far as the client said.
    pub left: Option<u64>,
    /// Whether the client has kept the service waiting for long.
    pub is_slow: bool,
}

impl MemoryBudget {
    /// A budget of `bytes` for bodies, and of half as many again for answers beside them. Who finds no room waits up to
    /// `patience`.
    pub(crate) fn new(bytes: u64, patience: Duration) -> Self {
        let small = bytes / 8;
        let parts = Parts {
            small,
            common: bytes + bytes / 2 - small,
            bodies: bytes,
            answers: bytes,
            owner: bytes / 4 * 3,
        };
        let (held, freed) = (Mutex::default(), Notify::new());
        Self(Arc::new(Shared { parts, patience, held, freed }))
    }

    /// A reservation of nothing yet.
    pub(crate) fn begin(&self, owner: Owner) -> Reservation {
        Reservation { budget: Some(self.clone()), owner, small: 0, bodies: 0, answers: 0, arriving: None }
    }

    /// Waits for room for an answer, as [`Reservation::add`].
    ///
    /// # Errors
    /// A problem: there was no room in time.
    pub(crate) async fn reserve(&self, owner: Owner, bytes: u64) -> Result<Reservation, Problem> {
        let mut reservation = self.begin(owner);
        reservation.add(bytes).await?;
        Ok(reservation)
    }

    /// Room for an answer if there is some now.
    pub(crate) fn try_reserve(&self, owner: Owner, bytes: u64) -> Option<Reservation> {
        let mut reservation = self.begin(owner);
        let is_taken = reservation.take_answer(&mut self.lock(), &self.0.parts, bytes);
        is_taken.then_some(reservation)
    }

    /// Bytes that are held.
    pub(crate) fn taken(&self) -> u64 {
        let held = self.lock();
        held.small + held.bodies + held.answers
    }

    fn lock(&self) -> MutexGuard<'_, Held> {
        self.0.held.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Tries again whenever memory was given back. There is no queue: small requests pass while large ones
    /// wait.
    async fn wait(&self, mut take: impl FnMut(&mut Held, &Parts) -> bool) -> Result<(), Problem> {
        let granted = async {
            loop {
                let mut freed = std::pin::pin!(self.0.freed.notified());
                freed.as_mut().enable();
                if take(&mut self.lock(), &self.0.parts) {
                    return;
                }
                freed.await;
            }
        };
        tokio::time::timeout(self.0.patience, granted).await.map_err(|_| busy())
    }
}

impl Parts {
    /// What is left to an owner who holds `held` bytes. Nobody is not one: where no key is asked for, all are nobody.
    fn room_of(&self, owner: &Owner, held: &Held) -> u64 {
        if *owner == Owner::nobody() {
            return u64::MAX;
        }
        self.owner.saturating_sub(held.owners.get(owner).copied().unwrap_or(0))
    }

    /// The most that one body's reservation can come to.
    fn body_max(&self, owner: &Owner) -> u64 {
        self.bodies.min(self.room_of(owner, &Held::default()))
    }
}

impl Held {
    /// Whether all bodies that are arriving can end one after the other if `number` is given `more` (Dijkstra's banker,
    /// EWD 623): all of them within the bodies' part, and those of one owner within its share.
    fn is_safe(&self, parts: &Parts, number: Option<u64>, grown: &Arriving) -> bool {
        let others = self.arriving.iter().filter(|(other, _)| Some(**other) != number).map(|(_, body)| body);
        let all: Vec<&Arriving> = others.chain([grown]).collect();
        let of_owner: Vec<_> = all.iter().copied().filter(|body| body.owner == grown.owner).collect();
        can_end(parts.bodies, all)
            && (grown.owner == Owner::nobody() || can_end(parts.owner.min(parts.bodies), of_owner))
    }
}

fn can_end(all: u64, mut bodies: Vec<&Arriving>) -> bool {
    bodies.sort_unstable_by_key(|body| body.left);
    let mut free = all.saturating_sub(bodies.iter().map(|body| body.held).sum());
    bodies.into_iter().all(|body| {
        let can_end = body.left <= free;
        free += body.held;
        can_end
    })
}

impl Reservation {
    /// For an answer of a few hundred kilobytes at most.
    pub(crate) fn small() -> Self {
        Self { budget: None, owner: Owner::nobody(), small: 0, bodies: 0, answers: 0, arriving: None }
    }

    /// Waits for room for a body that has come so far.
    ///
    /// # Errors
    /// A problem: it will never have room, or had none in time.
    pub(crate) async fn grow(&mut self, arrival: Arrival) -> Result<(), Problem> {
        let Some(budget) = self.budget.clone() else { return Ok(()) };
        let most = budget.0.parts.body_max(&self.owner);
        if arrival.bytes.saturating_mul(FACTOR) > most {
            return Err(too_large(most / FACTOR, arrival.bytes));
        }
        budget.wait(|held, parts| self.take_body(held, parts, arrival)).await
    }

    /// The body is there, and has `bytes` bytes: gives back what was reserved beyond.
    pub(crate) fn arrived(&mut self, bytes: u64) {
        self.keep(bytes.saturating_mul(FACTOR));
    }

    /// The body is gone, and what it became takes `bytes` bytes of memory: gives back what was reserved beyond.
    pub(crate) fn keep(&mut self, bytes: u64) {
        let Some(budget) = self.budget.clone() else { return };
        let (small, bodies) = (self.small.saturating_sub(bytes), self.bodies.saturating_sub(bytes));
        {
            let mut held = budget.lock();
            held.small -= small;
            held.bodies -= bodies;
            self.settle_owner(&mut held, 0, small + bodies);
            if let Some(number) = self.arriving.take() {
                held.arriving.remove(&number);
            }
        }
        self.small -= small;
        self.bodies -= bodies;
        budget.0.freed.notify_waiters();
    }

    /// Waits for room for an answer that takes `bytes` bytes of memory; one that takes more than there is waits until it
    /// is alone.
    ///
    /// # Errors
    /// A problem: there was no room in time.
    pub(crate) async fn add(&mut self, bytes: u64) -> Result<(), Problem> {
        let Some(budget) = self.budget.clone() else { return Ok(()) };
        budget.wait(|held, parts| self.take_answer(held, parts, bytes)).await
    }

    /// The answer, which keeps its reservation until its last byte is taken.
    pub(crate) fn until_sent(self, answer: Response) -> Response {
        // What has no body is left as it is: of unknown length, it would be announced in chunks.
        if self.budget.is_none() || answer.body().is_end_stream() {
            return answer;
        }
        answer.map(|body| {
            Body::from_stream(body.into_data_stream().inspect(move |_| {
                let _kept = &self;
            }))
        })
    }

    fn take_body(&mut self, held: &mut Held, parts: &Parts, arrival: Arrival) -> bool {
        let target = arrival.bytes.saturating_mul(FACTOR);
        let now = self.small + self.bodies;
        let is_small =
            !arrival.is_slow && arrival.bytes.saturating_add(arrival.left.unwrap_or(0)) <= SMALL_BYTES;
        if target <= now && (self.small == 0 || is_small) {
            return true;
        }
        let of_owner = parts.room_of(&self.owner, held);
        if target.saturating_sub(now) > of_owner {
            return false;
        }
        if is_small && self.bodies == 0 && held.small + (target - self.small) <= parts.small {
            held.small += target - self.small;
            self.small = target;
        } else {
            let more = target.max(now) - self.bodies;
            let free = (parts.bodies - held.bodies).min(parts.common - held.bodies - held.answers);
            let room = free.min(of_owner.saturating_add(self.small));
            // Of unknown length, a body is expected to double.
            let left = arrival.left.unwrap_or(arrival.bytes).saturating_mul(FACTOR);
            let left = left.min(parts.body_max(&self.owner).saturating_sub(self.bodies + more));
            let grown = Arriving { owner: self.owner.clone(), held: self.bodies + more, left };
            let can_end = more.saturating_add(left) <= room;
            if more > room || !(can_end || held.is_safe(parts, self.arriving, &grown)) {
                return false;
            }
            held.small -= self.small;
            held.bodies += more;
            (self.small, self.bodies) = (0, self.bodies + more);
            let number = *self.arriving.get_or_insert_with(|| {
                held.arrived += 1;
                held.arrived
            });
            held.arriving.insert(number, grown);
        }
        self.settle_owner(held, (self.small + self.bodies).saturating_sub(now), 0);
        true
    }

    fn take_answer(&mut self, held: &mut Held, parts: &Parts, bytes: u64) -> bool {
        let own = self.small + self.bodies + self.answers;
        let of_owner = parts.room_of(&self.owner, held);
        if bytes <= SMALL_BYTES && held.small + bytes <= parts.small && bytes <= of_owner {
            held.small += bytes;
            self.small += bytes;
            self.settle_owner(held, bytes, 0);
            return true;
        }
        let most = parts.room_of(&self.owner, &Held::default()).saturating_sub(own);
        let need = bytes.min(parts.answers - self.answers).min(parts.common - self.bodies).min(most);
        let free = (parts.answers - held.answers).min(parts.common - held.bodies - held.answers);
        if need > free.min(of_owner) {
            return false;
        }
        held.answers += need;
        self.answers += need;
        self.settle_owner(held, need, 0);
        true
    }

    fn settle_owner(&self, held: &mut Held, more: u64, less: u64) {
        if self.owner == Owner::nobody() {
            return;
        }
        let of_owner = held.owners.entry(self.owner.clone()).or_default();
        *of_owner = (*of_owner + more).saturating_sub(less);
        if *of_owner == 0 {
            held.owners.remove(&self.owner);
        }
    }
}

impl Drop for Reservation {
    fn drop(&mut self) {
        let Some(budget) = self.budget.take() else { return };
        {
            let mut held = budget.lock();
            held.small -= self.small;
            held.bodies -= self.bodies;
            held.answers -= self.answers;
            if let Some(number) = self.arriving.take() {
                held.arriving.remove(&number);
            }
            self.settle_owner(&mut held, 0, self.small + self.bodies + self.answers);
        }
        budget.0.freed.notify_waiters();
    }
}

impl fmt::Debug for MemoryBudget {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "MemoryBudget({} bytes taken)", self.taken())
    }
}

impl fmt::Debug for Reservation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Reservation({} + {} + {} bytes)", self.small, self.bodies, self.answers)
    }
}

fn too_large(limit: u64, bytes: u64) -> Problem {
    Problem::new(
        Kind::TooLarge,
        format!("the body has at least {bytes} bytes; the memory budget allows {limit}"),
    )
    .with("limit", limit)
}

fn busy() -> Problem {
    Problem::new(Kind::Unavailable, "not enough memory is free for this request; try again later")
        .with_header(header::RETRY_AFTER, retry::MEMORY_SECONDS.to_string())
}

#[cfg(test)]
mod tests;

//! The places of connections: those for everybody, and a few more in which probes are answered when the others are taken.
//!
//! When all are taken, the client that has kept us waiting longest gives its place up: one without a request first, then
//! the slowest body, then the answer that is not taken. So clients that send a byte now and then hold no place that
//! another needs, and a full house does not look dead to an orchestrator.

use std::cmp::Ordering;
use std::collections::HashMap;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use tokio::sync::{OwnedSemaphorePermit, Semaphore};
use tokio_util::sync::CancellationToken;

use super::turn::{Patience, Turn};

/// Places beyond the limit, for probes.
const SPARE: usize = 16;
/// The time that a connection which was told to go needs to free its place, at most.
const LEAVING: Duration = Duration::from_secs(1);

/// All places, and who holds them.
pub(super) struct Places {
    open: Arc<Semaphore>,
    spare: Arc<Semaphore>,
    patience: Patience,
    held: Arc<Mutex<Held>>,
}

#[derive(Default)]
struct Held {
    next: u64,
    by: HashMap<u64, Holder>,
}

struct Holder {
    turn: Turn,
    leave: CancellationToken,
    is_spare: bool,
    /// Its request waits for a place that anybody may have; it is answered when it has to go.
    waits: bool,
}

/// What a connection holds until it ends.
pub(super) struct Place {
    number: u64,
    held: Arc<Mutex<Held>>,
    open: Arc<Semaphore>,
    permit: Mutex<OwnedSemaphorePermit>,
    patience: Patience,
    /// Whose turn it is on the connection.
    pub(super) turn: Turn,
    /// Canceled when another needs the place.
    pub(super) leave: CancellationToken,
}

impl Places {
    pub(super) fn new(count: usize, patience: Patience) -> Self {
        let (open, spare) = (Arc::new(Semaphore::new(count)), Arc::new(Semaphore::new(SPARE)));
        Self { open, spare, patience, held: Arc::default() }
    }

    /// A place for a connection that has been accepted; waits only while nobody can be asked to go.
    pub(super) async fn take(&self) -> Place {
        loop {
            if let Ok(permit) = Arc::clone(&self.open).try_acquire_owned() {
                return self.hold(permit, false);
            }
            if ask_one_to_leave(&self.held, false)
                && let Ok(Ok(permit)) =
                    tokio::time::timeout(LEAVING, Arc::clone(&self.open).acquire_owned()).await
            {
                return self.hold(permit, false);
            }
            if let Ok(permit) = Arc::clone(&self.spare).try_acquire_owned() {
                return self.hold(permit, true);
            }
            ask_one_to_leave(&self.held, true);
            tokio::select! {
                Ok(permit) = Arc::clone(&self.open).acquire_owned() => return self.hold(permit, false),
                Ok(permit) = Arc::clone(&self.spare).acquire_owned() => return self.hold(permit, true),
                // Somebody may have become idle meanwhile.
                () = tokio::time::sleep(self.patience.idle) => {}
            }
        }
    }

    fn hold(&self, permit: OwnedSemaphorePermit, is_spare: bool) -> Place {
        let (turn, leave) = (Turn::new(self.patience), CancellationToken::new());
        let mut held = lock(&self.held);
        let number = held.next;
        held.next += 1;
        let holder = Holder { turn: turn.clone(), leave: leave.clone(), is_spare, waits: false };
        held.by.insert(number, holder);
        let (open, permit, patience) = (Arc::clone(&self.open), Mutex::new(permit), self.patience);
        Place { number, held: Arc::clone(&self.held), open, permit, patience, turn, leave }
    }
}

/// Asks the connection that deserves its place least, of the spare ones or of the others; false when all deserve theirs.
fn ask_one_to_leave(held: &Mutex<Held>, of_spare: bool) -> bool {
    let held = lock(held);
    let staying = held.by.iter().filter(|(_, holder)| !holder.leave.is_cancelled());
    let of_kind = staying.filter(|(_, holder)| holder.is_spare == of_spare);
    let waiting = of_kind.clone().filter(|(_, holder)| holder.waits).min_by_key(|(number, _)| **number);
    let claims = of_kind.filter_map(|(_, holder)| Some((holder.turn.claim()?, holder)));
    let least = claims.min_by(|(one, _), (other, _)| one.partial_cmp(other).unwrap_or(Ordering::Equal));
    let leaving = least.map(|(_, holder)| holder).or(waiting.map(|(_, holder)| holder));
    if let Some(holder) = leaving {
        holder.leave.cancel();
    }
    leaving.is_some()
}

impl Place {
    /// Whether only probes are answered here.
    pub(super) fn is_spare(&self) -> bool {
        lock(&self.held).by.get(&self.number).is_some_and(|holder| holder.is_spare)
    }

    /// Waits for a place for everybody and moves there; false when it was told to go before.
    pub(super) async fn wait_for_open(&self) -> bool {
        self.note(|holder| holder.waits = true);
        let permit = loop {
            ask_one_to_leave(&self.held, false);
            tokio::select! {
                Ok(permit) = Arc::clone(&self.open).acquire_owned() => break permit,
                () = self.leave.cancelled() => return false,
                // Somebody may have become idle meanwhile.
                () = tokio::time::sleep(self.patience.idle) => {}
            }
        };
        *self.permit.lock().unwrap_or_else(PoisonError::into_inner) = permit;
        self.note(|holder| (holder.waits, holder.is_spare) = (false, false));
        true
    }

    fn note(&self, change: impl FnOnce(&mut Holder)) {
        if let Some(holder) = lock(&self.held).by.get_mut(&self.number) {
            change(holder);
        }
    }
}

impl Drop for Place {
    fn drop(&mut self) {
        lock(&self.held).by.remove(&self.number);
    }
}

fn lock(held: &Mutex<Held>) -> std::sync::MutexGuard<'_, Held> {
    held.lock().unwrap_or_else(PoisonError::into_inner)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn places(count: usize, milliseconds: u64) -> Places {
        let time = Duration::from_millis(milliseconds);
        Places::new(count, Patience { idle: time, slow: time, body_rate_min: 1e3 })
    }

    #[tokio::test]
    async fn a_connection_without_a_request_gives_its_place_up_and_one_that_is_served_does_not() {
        let places = places(2, 0);
        let (served, idle) = (places.take().await, places.take().await);
        served.turn.ours();
        let leaving = async {
            idle.leave.cancelled().await;
            drop(idle);
        };
        let (next, ()) = tokio::join!(places.take(), leaving);
        assert!(!next.is_spare() && !served.leave.is_cancelled());
    }

    #[tokio::test]
    async fn while_all_are_served_the_spare_places_are_given_and_then_the_oldest_that_waits_goes() {
        let places = places(1, 60_000);
        let served = places.take().await;
        served.turn.ours();
        let mut spare = Vec::new();
        let mut waiting = Vec::new();
        for _ in 0..SPARE {
            let place = Arc::new(places.take().await);
            place.turn.ours();
            assert!(place.is_spare());
            waiting.push(tokio::spawn({
                let place = Arc::clone(&place);
                async move { place.wait_for_open().await }
            }));
            tokio::task::yield_now().await;
            spare.push(place);
        }
        let oldest = async {
            assert!(!waiting.remove(0).await.unwrap(), "it is to answer that there is no place");
            drop(spare.remove(0));
        };
        let (next, ()) = tokio::join!(places.take(), oldest);
        assert!(next.is_spare());
        drop(served);
        assert!(waiting.remove(0).await.unwrap(), "who waits longest gets the place that is free");
        assert!(!spare[0].is_spare());
    }
}

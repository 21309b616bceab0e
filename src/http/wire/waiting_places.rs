//! Places of those who wait for jobs.

use std::collections::HashMap;
use std::sync::{Arc, Mutex, PoisonError};

use crate::store::Owner;

/// Places of those who wait for jobs, each of which holds a connection: half of all are for any one owner, so that nobody
/// keeps the others out.
#[derive(Debug, Clone)]
pub(crate) struct WaitingPlaces {
    share: usize,
    taken: Arc<Mutex<HashMap<Owner, usize>>>,
}

/// One of them, given back when it is dropped.
#[derive(Debug)]
pub(crate) struct WaitingPlace {
    owner: Owner,
    taken: Arc<Mutex<HashMap<Owner, usize>>>,
}

impl WaitingPlaces {
    /// Of a service with so many connections.
    pub(crate) fn new(connections: usize) -> Self {
        Self { share: (connections / 2).max(1), taken: Arc::default() }
    }

    /// A place; `None` when the owner has its share.
    pub(crate) fn take(&self, owner: &Owner) -> Option<WaitingPlace> {
        let mut taken = self.taken.lock().unwrap_or_else(PoisonError::into_inner);
        let own = taken.entry(owner.clone()).or_default();
        if *own >= self.share {
            return None;
        }
        *own += 1;
        Some(WaitingPlace { owner: owner.clone(), taken: Arc::clone(&self.taken) })
    }
}

impl Drop for WaitingPlace {
    fn drop(&mut self) {
        let mut taken = self.taken.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(own) = taken.get_mut(&self.owner) {
            *own -= 1;
            if *own == 0 {
                taken.remove(&self.owner);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nobody_waits_in_more_than_half_of_the_places() {
        let places = WaitingPlaces::new(5);
        let (greedy, modest) = (Owner::named("greedy"), Owner::named("modest"));
        let mut held: Vec<_> = (0..2).map(|_| places.take(&greedy).unwrap()).collect();
        assert!(places.take(&greedy).is_none());
        assert!(places.take(&modest).is_some());
        held.pop();
        assert!(places.take(&greedy).is_some());
    }
}

//! The thread that beats for a running job.

use std::sync::mpsc::{self, RecvTimeoutError};
use std::time::{Duration, Instant};

use tokio::runtime::Handle;
use tokio::sync::oneshot;

use super::JobsSettings;
use super::task::Task;
use crate::store::{Claim, Order, Store, StoreError};

/// How long an answer is waited for: a fraction of a lease.
const ANSWER: Duration = Duration::from_secs(15);

/// Beats until it is dropped, or until it hears that the job is to end.
pub(super) struct Heartbeat {
    /// Dropped with the heartbeat, which ends the thread.
    _life: mpsc::Sender<()>,
    heard: oneshot::Receiver<Order>,
}

impl Heartbeat {
    /// Starts the thread. What it hears it passes on to the computation itself, at once.
    pub(super) fn start(
        store: Store,
        claim: Claim,
        task: Task,
        settings: &JobsSettings,
    ) -> std::io::Result<Self> {
        let (life, alive) = mpsc::channel::<()>();
        let (tell, heard) = oneshot::channel();
        let beating = Beating { store, claim, task, settings: settings.clone(), runtime: Handle::current() };
        std::thread::Builder::new().name("heartbeat".to_owned()).spawn(move || {
            if let Some(order) = beating.until_ordered(&alive) {
                // The order first: whoever sees the computation end for it finds it there. Nobody may, when the job has
                // ended by itself meanwhile.
                let _ = tell.send(order);
                beating.task.progress.cancel();
            }
        })?;
        Ok(Self { _life: life, heard })
    }

    /// Waits for an order to end: [`Order::Cancel`] or [`Order::Lost`].
    pub(super) async fn order(&mut self) -> Order {
        match (&mut self.heard).await {
            Ok(order) => order,
            // A thread that panicked: without a heartbeat the lease runs out.
            Err(_) => Order::Lost,
        }
    }
}

struct Beating {
    store: Store,
    claim: Claim,
    task: Task,
    settings: JobsSettings,
    runtime: Handle,
}

impl Beating {
    fn until_ordered(&self, alive: &mpsc::Receiver<()>) -> Option<Order> {
        let mut beaten: Option<Instant> = None;
        loop {
            let due = beaten.is_none_or(|last| last.elapsed() >= self.settings.heartbeat);
            if due {
                beaten = Some(Instant::now());
            }
            match self.runtime.block_on(self.beat(due)) {
                Ok(Order::Continue) => {}
                Ok(order) => return Some(order),
                // The next beat may succeed; if none does, the lease runs out.
                Err(error) => tracing::warn!(job = %self.claim.job.id, %error, "a heartbeat failed"),
            }
            match alive.recv_timeout(self.settings.order_poll) {
                Err(RecvTimeoutError::Timeout) => {}
                Ok(()) | Err(RecvTimeoutError::Disconnected) => return None,
            }
        }
    }

    /// A server that was cut off answers nothing, not even an error: then the next beat goes by another connection.
    async fn beat(&self, due: bool) -> Result<Order, StoreError> {
        let beat = async {
            if due {
                self.store.heartbeat(&self.claim, &self.task.vitals()).await
            } else {
                self.store.order(&self.claim).await
            }
        };
        tokio::time::timeout(ANSWER, beat).await.unwrap_or(Err(StoreError::Busy))
    }
}

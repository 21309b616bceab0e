//! Connections to the server.

use std::sync::{Arc, PoisonError, RwLock};
use std::time::Duration;

use sqlx::postgres::{PgConnectOptions, PgPoolOptions};
use sqlx::{Executor, PgPool};
use tokio::sync::watch;

use crate::store::StoreSettings;

/// How long a caller waits for a connection; meanwhile a server that is being restarted may come back.
const ACQUIRE: Duration = Duration::from_secs(30);

/// Connections that write, beside those that read.
const WRITERS: u32 = 4;

/// A node that was stopped or cut off within a transaction must not keep what it locked; and nobody waits longer for a lock.
const TIMEOUTS: &str = "SET idle_in_transaction_session_timeout = '30s'; SET lock_timeout = '30s'";

/// The pools, which may be made anew.
#[derive(Debug, Clone)]
pub(super) struct Connections(Arc<Shared>);

#[derive(Debug)]
struct Shared {
    options: PgConnectOptions,
    /// How many read records, and how many read arrays.
    readers: (u32, u32),
    current: RwLock<Pools>,
    /// How often they were made anew.
    renewals: watch::Sender<u64>,
}

#[derive(Debug, Clone)]
struct Pools {
    /// For everything but arrays that are read.
    records: PgPool,
    arrays: PgPool,
    /// Of the listener alone.
    news: PgPool,
}

impl Pools {
    fn new(options: &PgConnectOptions, (readers, array_readers): (u32, u32)) -> Self {
        Self {
            records: pool(readers + WRITERS, options),
            arrays: pool(array_readers, options),
            news: pool(1, options),
        }
    }

    async fn close(self) {
        tokio::join!(self.arrays.close(), self.records.close(), self.news.close());
    }
}

impl Connections {
    /// None is made before it is needed.
    pub(super) fn new(options: PgConnectOptions, settings: &StoreSettings) -> Self {
        let readers = (settings.readers, settings.array_readers);
        let current = RwLock::new(Pools::new(&options, readers));
        Self(Arc::new(Shared { options, readers, current, renewals: watch::Sender::new(0) }))
    }

    pub(super) fn records(&self) -> PgPool {
        self.current().records
    }

    pub(super) fn arrays(&self) -> PgPool {
        self.current().arrays
    }

    pub(super) fn news(&self) -> PgPool {
        self.current().news
    }

    /// Changes when they are made anew.
    pub(super) fn renewals(&self) -> watch::Receiver<u64> {
        self.0.renewals.subscribe()
    }

    /// Makes all anew. Whoever still waits for an old one is not disturbed.
    pub(super) fn renew(&self) {
        let shared = &self.0;
        let fresh = Pools::new(&shared.options, shared.readers);
        let old =
            std::mem::replace(&mut *shared.current.write().unwrap_or_else(PoisonError::into_inner), fresh);
        shared.renewals.send_modify(|count| *count += 1);
        // Those in use end with their use.
        tokio::spawn(old.close());
    }

    pub(super) async fn close(&self) {
        self.current().close().await;
    }

    fn current(&self) -> Pools {
        self.0.current.read().unwrap_or_else(PoisonError::into_inner).clone()
    }
}

fn pool(connections: u32, options: &PgConnectOptions) -> PgPool {
    PgPoolOptions::new()
        .max_connections(connections)
        .acquire_timeout(ACQUIRE)
        .after_connect(|connection, _| {
            Box::pin(async move {
                connection.execute(TIMEOUTS).await?;
                Ok(())
            })
        })
        .connect_lazy_with(options.clone())
}

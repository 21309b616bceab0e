//! What nodes tell each other: that a job was queued, or may have changed.
//!
//! By `LISTEN` and `NOTIFY`, whose messages are lost while a connection is made anew
//! (<https://github.com/launchbadge/sqlx/issues/447>) and do not pass a pooler that shares connections between transactions
//! (<https://github.com/pgbouncer/pgbouncer/issues/655>). So whoever waits is also woken every few seconds.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use sqlx::PgPool;
use sqlx::postgres::PgListener;
use tokio::sync::Notify;
use tokio_util::sync::CancellationToken;
use uuid::Uuid;

use super::connections::Connections;
use crate::store::{News, Subject};

const CHANNEL: &str = "chladni";

/// What is told within this time is told once.
const PAUSE: Duration = Duration::from_millis(50);

/// What cannot be told within this time need not be: the others have looked by then.
const TOLD: Duration = Duration::from_secs(4);

/// Without any message, something may have happened after this time.
const POLL: Duration = Duration::from_secs(2);

/// Between two attempts to listen.
const RETRY: Duration = Duration::from_secs(1);

/// A message is a node's id and one of these.
const CHANGE: &str = "change";
const ARRIVAL: &str = "arrival";

/// Sends what is to be told, from a task of its own.
#[derive(Debug, Clone, Default)]
pub(super) struct Teller(Arc<Pending>);

#[derive(Debug, Default)]
struct Pending {
    change: AtomicBool,
    arrival: AtomicBool,
    any: Notify,
}

impl Teller {
    pub(super) fn start(connections: Connections, node: Uuid, stopping: CancellationToken) -> Self {
        let teller = Self::default();
        let telling = teller.clone();
        tokio::spawn(async move {
            tokio::select! {
                () = telling.keep_telling(&connections, node) => {}
                () = stopping.cancelled() => {}
            }
        });
        teller
    }

    pub(super) fn tell(&self, subject: Subject) {
        match subject {
            Subject::Change => self.0.change.store(true, Ordering::SeqCst),
            Subject::Arrival => self.0.arrival.store(true, Ordering::SeqCst),
        }
        self.0.any.notify_one();
    }

    async fn keep_telling(&self, connections: &Connections, node: Uuid) {
        loop {
            self.0.any.notified().await;
            let (change, arrival) =
                (self.0.change.swap(false, Ordering::SeqCst), self.0.arrival.swap(false, Ordering::SeqCst));
            let word = match (change, arrival) {
                (_, true) => ARRIVAL,
                (true, false) => CHANGE,
                (false, false) => continue,
            };
            let pool = connections.records();
            let telling = sqlx::query("SELECT pg_notify($1, $2)")
                .bind(CHANNEL)
                .bind(format!("{node} {word}"))
                .execute(&pool);
            if !matches!(tokio::time::timeout(TOLD, telling).await, Ok(Ok(_))) {
                tracing::debug!("other nodes are not told; they look by themselves");
            }
            tokio::time::sleep(PAUSE).await;
        }
    }
}

/// Passes on what other nodes tell, until `stopping`.
pub(super) async fn listen(connections: Connections, node: Uuid, news: News, stopping: CancellationToken) {
    tokio::select! {
        () = keep_listening(&connections, node, &news) => {}
        () = keep_polling(&news) => {}
        () = stopping.cancelled() => {}
    }
}

async fn keep_polling(news: &News) {
    let mut ticks = tokio::time::interval(POLL);
    ticks.set_missed_tick_behavior(tokio::time::MissedTickBehavior::Delay);
    loop {
        ticks.tick().await;
        news.tell(Subject::Change);
    }
}

/// On connections that are made anew it begins anew.
async fn keep_listening(connections: &Connections, node: Uuid, news: &News) {
    let mut renewals = connections.renewals();
    loop {
        let pool = connections.news();
        tokio::select! {
            () = listen_once(&pool, node, news) => tokio::time::sleep(RETRY).await,
            _ = renewals.changed() => {}
        }
    }
}

/// Until the connection is lost.
async fn listen_once(pool: &PgPool, node: Uuid, news: &News) {
    let own = node.to_string();
    match listener(pool).await {
        Ok(mut listener) => {
            // Whatever was told before is not known.
            news.tell(Subject::Arrival);
            while let Ok(Some(message)) = listener.try_recv().await {
                match message.payload().split_once(' ') {
                    Some((sender, _)) if sender == own => {}
                    Some((_, ARRIVAL)) => news.tell(Subject::Arrival),
                    _ => news.tell(Subject::Change),
                }
            }
        }
        Err(error) => {
            tracing::warn!(%error, "cannot listen to other nodes; it is looked for changes every few seconds");
        }
    }
}

async fn listener(pool: &PgPool) -> Result<PgListener, sqlx::Error> {
    let mut listener = PgListener::connect_with(pool).await?;
    // A lost connection ends the listener; the next one begins by telling that anything may have happened.
    listener.eager_reconnect(false);
    listener.listen(CHANNEL).await?;
    Ok(listener)
}

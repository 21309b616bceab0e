//! PostgreSQL: one database that many nodes share.
//!
//! Every node serves all clouds and results, and takes jobs that fit it from the one queue. Nobody touches what another node
//! has claimed before its lease has run out by the server's clock.

mod connections;
mod news;
mod nodes;
mod opening;
mod silence;

use std::sync::Arc;

use sqlx::{Executor, PgConnection, PgPool, Postgres, Transaction};
use tokio_util::sync::{CancellationToken, DropGuard};
use uuid::Uuid;

pub(super) use nodes::{memory_budget, other_version_computes};
pub(super) use silence::{answer, answers};

use super::settings::Time;
use super::{DatabaseAddress, Milliseconds, News, Space, StoreError, StoreSettings, Subject};
use connections::Connections;
use news::Teller;

/// All statements of a reading see one state. It takes no lock that a writer would wait for.
const SNAPSHOT: &str = "BEGIN ISOLATION LEVEL REPEATABLE READ READ ONLY";

/// Connections to the database, and the tasks that listen to it and beat for this node.
#[derive(Debug, Clone)]
pub(super) struct Database {
    connections: Connections,
    teller: Teller,
    stopping: CancellationToken,
    /// Ends the tasks when nobody holds the database any more.
    _guard: Arc<DropGuard>,
}

impl Database {
    /// Connects, migrates, and makes the node known.
    pub(super) async fn open(
        address: &DatabaseAddress,
        settings: &StoreSettings,
        node: Uuid,
        news: News,
    ) -> Result<Self, StoreError> {
        let options = opening::prepare(address).await?;
        let connections = Connections::new(options, settings);
        nodes::beat(&connections.records(), settings, node).await?;
        let stopping = CancellationToken::new();
        let teller = Teller::start(connections.clone(), node, stopping.clone());
        tokio::spawn(news::listen(connections.clone(), node, news, stopping.clone()));
        tokio::spawn(nodes::keep_beating(connections.clone(), settings.clone(), node, stopping.clone()));
        let guard = Arc::new(stopping.clone().drop_guard());
        Ok(Self { connections, teller, stopping, _guard: guard })
    }

    pub(super) async fn close(&self) {
        self.stopping.cancel();
        self.connections.close().await;
    }

    /// For everything but arrays that are read.
    pub(super) fn records(&self) -> PgPool {
        self.connections.records()
    }

    /// Begun in a task of its own: a dropped beginning would leave an open transaction in the pool
    /// (<https://github.com/launchbadge/sqlx/issues/4385>), and readers are dropped with their clients.
    pub(super) async fn snapshot(&self) -> Result<Transaction<'static, Postgres>, StoreError> {
        let arrays = self.connections.arrays();
        super::detached(async move { Ok(answer(arrays.begin_with(SNAPSHOT)).await?) }).await
    }

    pub(super) async fn space(&self) -> Result<Space, StoreError> {
        let bytes: i64 = sqlx::query_scalar("SELECT pg_database_size(current_database())")
            .fetch_one(&self.records())
            .await?;
        Ok(Space { file: bytes as u64, free_pages: 0, disk_free: None })
    }

    /// Tells the other nodes, soon and together with whatever else happens until then.
    pub(super) fn tell(&self, subject: Subject) {
        self.teller.tell(subject);
    }
}

/// The server's clock. While the server was away no lease could be renewed: for the time of one lease after its start, none
/// has run out.
pub(super) async fn time(connection: &mut PgConnection, lease: Milliseconds) -> Result<Time, StoreError> {
    let (now, started): (Milliseconds, Milliseconds) = sqlx::query_as(
        "SELECT (extract(epoch FROM clock_timestamp()) * 1000)::bigint, \
         (extract(epoch FROM pg_postmaster_start_time()) * 1000)::bigint",
    )
    .fetch_one(connection)
    .await?;
    Ok(Time { now, leases_end: if now - started < lease { 0 } else { now } })
}

/// Lets nobody else write to clouds and jobs until the transaction ends: for what decides by all of them.
pub(super) async fn keep_others_out(connection: &mut PgConnection) -> Result<(), StoreError> {
    connection.execute("LOCK TABLE clouds, jobs, idempotency_keys IN SHARE ROW EXCLUSIVE MODE").await?;
    Ok(())
}

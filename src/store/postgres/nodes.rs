//! The nodes that share the database, as they make themselves known.

use std::time::Duration;

use sqlx::{PgConnection, PgPool};
use tokio_util::sync::CancellationToken;
use uuid::Uuid;

use super::connections::Connections;
use crate::store::columns::integer;
use crate::store::{Milliseconds, StoreError, StoreSettings};

/// Between two signs of life.
const BEAT: Duration = Duration::from_secs(10);

/// How long a sign of life may take.
const ANSWER: Duration = Duration::from_secs(20);

/// A node that was seen within this time counts when it is judged what a job may need: it may only be starting anew.
const SEEN: Milliseconds = 60 * 60 * 1000;

/// A node that was seen within this time is there now.
const PRESENT: Milliseconds = 60 * 1000;

/// A node that was not seen for this long is forgotten.
const FORGOTTEN: Milliseconds = 7 * 24 * 60 * 60 * 1000;

/// Tells that the node is there.
pub(super) async fn beat(pool: &PgPool, settings: &StoreSettings, node: Uuid) -> Result<(), StoreError> {
    let mut connection = pool.acquire().await?;
    let now = match settings.clock.told() {
        Some(now) => now,
        None => super::time(&mut connection, settings.lease).await?.now,
    };
    sqlx::query(
        "INSERT INTO nodes (id, version, memory_budget, threads, workers, heartbeat) VALUES ($1, $2, $3, $4, $5, $6) \
         ON CONFLICT (id) DO UPDATE SET heartbeat = excluded.heartbeat",
    )
    .bind(node)
    .bind(env!("CARGO_PKG_VERSION"))
    .bind(integer(settings.memory_budget))
    .bind(integer(settings.node.threads))
    .bind(integer(settings.node.workers))
    .bind(now)
    .execute(&mut *connection)
    .await?;
    sqlx::query("DELETE FROM nodes WHERE heartbeat < $1")
        .bind(now - FORGOTTEN)
        .execute(&mut *connection)
        .await?;
    Ok(())
}

/// Tells it again and again, until `stopping`. Where the server does not even refuse, the connections are made anew: a network
/// that was cut may have forgotten them.
pub(super) async fn keep_beating(
    connections: Connections,
    settings: StoreSettings,
    node: Uuid,
    stopping: CancellationToken,
) {
    loop {
        tokio::select! {
            () = tokio::time::sleep(BEAT) => {}
            () = stopping.cancelled() => return,
        }
        match tokio::time::timeout(ANSWER, beat(&connections.records(), &settings, node)).await {
            Ok(Ok(())) => {}
            Ok(Err(error)) => tracing::warn!(%error, "the node cannot tell the others that it is there"),
            Err(_) => {
                tracing::warn!(
                    "the server did not answer in {} seconds; the node connects anew",
                    ANSWER.as_secs()
                );
                connections.renew();
            }
        }
    }
}

/// Bytes that the largest node has for analyses: this one, if it computes, or one that was seen lately. Where no node
/// computes, this one's budget stands for those that are to come.
pub(in crate::store) async fn memory_budget(
    connection: &mut PgConnection,
    settings: &StoreSettings,
    now: Milliseconds,
) -> Result<u64, StoreError> {
    let largest: Option<i64> =
        sqlx::query_scalar("SELECT max(memory_budget) FROM nodes WHERE workers > 0 AND heartbeat > $1")
            .bind(now - SEEN)
            .fetch_one(connection)
            .await?;
    let others = largest.map(|bytes| bytes as u64);
    let own = (settings.node.workers > 0 || others.is_none()).then_some(settings.memory_budget);
    Ok(others.max(own).unwrap_or_default())
}

/// Whether a node of another version computes: it may be able to read what this one cannot.
pub(in crate::store) async fn other_version_computes(
    connection: &mut PgConnection,
    now: Milliseconds,
) -> Result<bool, StoreError> {
    Ok(sqlx::query_scalar(
        "SELECT EXISTS (SELECT 1 FROM nodes WHERE workers > 0 AND version <> $1 AND heartbeat > $2)",
    )
    .bind(env!("CARGO_PKG_VERSION"))
    .bind(now - PRESENT)
    .fetch_one(connection)
    .await?)
}

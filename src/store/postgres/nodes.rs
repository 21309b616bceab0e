//! The nodes that share the database, as they make themselves known.

use std::time::Duration;

use sqlx::{PgConnection, PgPool};
use tokio_util::sync::CancellationToken;
use uuid::Uuid;

use crate::store::columns::integer;
use crate::store::{Milliseconds, StoreError, StoreSettings};

/// Between two signs of life.
const BEAT: Duration = Duration::from_secs(10);

/// A node that was seen within this time counts when it is judged what a job may need: it may only be starting anew.
const SEEN: Milliseconds = 60 * 60 * 1000;

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

/// Tells it again and again, until `stopping`.
pub(super) async fn keep_beating(
    pool: PgPool,
    settings: StoreSettings,
    node: Uuid,
    stopping: CancellationToken,
) {
    loop {
        tokio::select! {
            () = tokio::time::sleep(BEAT) => {}
            () = stopping.cancelled() => return,
        }
        if let Err(error) = beat(&pool, &settings, node).await {
            tracing::warn!(%error, "the node cannot tell the others that it is there");
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

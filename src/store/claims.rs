//! Claims: which job a worker gets next.

use sqlx::{Row, SqliteConnection};
use uuid::Uuid;

use super::rows::{integer, job_record, select_jobs, to_json, unreadable};
use super::{Claim, Milliseconds, Store, StoreError, detached};

/// Longer than any delay after which a job is tried again. One that is to wait longer was put back before the clock was
/// set back, and is let go.
const DELAY_MAX: Milliseconds = 15 * 60 * 1000;

impl Store {
    /// Claims the next job for `process`; `None` when none waits. Owners take turns: next is the oldest job of the owner
    /// who was served longest ago.
    ///
    /// Jobs whose lease ran out are put back first, or ended when their attempts are used up.
    ///
    /// # Errors
    /// [`StoreError::Database`].
    pub async fn claim(&self, process: Uuid) -> Result<Option<Claim>, StoreError> {
        self.claim_within(process, u64::MAX, true).await
    }

    /// As [`Self::claim`], when the job is estimated to take at most `free` bytes of memory, and when either it is its
    /// first attempt or nothing else runs (`idle`): a job that may have killed the process must not take others with it.
    /// A job that cannot be claimed yet keeps those behind it waiting: were they let past, it might wait for ever.
    ///
    /// A job whose record cannot be read ends failed.
    ///
    /// # Errors
    /// [`StoreError::Database`].
    pub async fn claim_within(
        &self,
        process: Uuid,
        free: u64,
        idle: bool,
    ) -> Result<Option<Claim>, StoreError> {
        if !self.has_work().await? {
            return Ok(None);
        }
        let store = self.clone();
        detached(async move {
            let mut transaction = store.write().await?;
            let mut changed = store.give_up_running(&mut transaction, None).await? > 0;
            let claim = loop {
                let Some((id, lease)) = store.mark_claimed(&mut transaction, process, free, idle).await?
                else {
                    break None;
                };
                changed = true;
                let row = sqlx::query(concat!(select_jobs!(), "WHERE j.id = ?1"))
                    .bind(id)
                    .fetch_one(&mut *transaction)
                    .await?;
                match job_record(&row) {
                    Ok(job) => break Some(Claim { job, lease }),
                    Err(StoreError::Damaged(cause)) => {
                        tracing::error!(job = %id, %cause, "a job that cannot be read ends failed");
                        mark_unreadable(&mut transaction, id, store.now(), &cause).await?;
                    }
                    Err(error) => return Err(error),
                }
            };
            transaction.commit().await?;
            if changed {
                store.announce();
            }
            Ok(claim)
        })
        .await
    }

    /// Sets the next job running and gives its owner the last turn; its id and its new lease.
    async fn mark_claimed(
        &self,
        connection: &mut SqliteConnection,
        process: Uuid,
        free: u64,
        idle: bool,
    ) -> Result<Option<(Uuid, i64)>, StoreError> {
        let claimed = sqlx::query(
            "UPDATE jobs SET state = 'running', attempt = attempt + 1, lease = lease + 1, process_id = ?1, \
             lease_until = ?2 + ?3, started = ?2, phase = 'preparation', progress = 0.0, phase_seconds = '[]' \
             WHERE id = (SELECT w.id FROM (SELECT owner, min(id) AS id FROM jobs WHERE state = 'queued' \
             AND (not_before <= ?2 OR not_before > ?2 + ?6) GROUP BY owner) w \
             LEFT JOIN turns t ON t.owner = w.owner ORDER BY coalesce(t.turn, 0), w.id LIMIT 1) \
             AND memory <= ?4 AND (attempt = 0 OR ?5) RETURNING id, lease, owner",
        )
        .bind(process)
        .bind(self.now())
        .bind(self.settings.lease)
        .bind(integer(free))
        .bind(idle)
        .bind(DELAY_MAX)
        .fetch_optional(&mut *connection)
        .await?;
        let Some(row) = claimed else { return Ok(None) };
        sqlx::query(
            "INSERT INTO turns (owner, turn) SELECT ?1, coalesce(max(turn), 0) + 1 FROM turns WHERE true \
             ON CONFLICT (owner) DO UPDATE SET turn = excluded.turn",
        )
        .bind(row.try_get::<&str, _>("owner")?)
        .execute(connection)
        .await?;
        Ok(Some((row.try_get("id")?, row.try_get("lease")?)))
    }

    /// Whether a job may be claimed or given up. Only reads: idle workers ask every second.
    async fn has_work(&self) -> Result<bool, StoreError> {
        let has_work = sqlx::query_scalar(
            "SELECT EXISTS (SELECT 1 FROM jobs WHERE state = 'queued' AND (not_before <= ?1 OR not_before > ?1 + ?2)) \
             OR EXISTS (SELECT 1 FROM jobs WHERE state = 'running' AND (lease_until < ?1 OR lease_until > ?1 + ?3))",
        )
        .bind(self.now())
        .bind(DELAY_MAX)
        .bind(self.settings.lease)
        .fetch_one(&self.readers)
        .await?;
        Ok(has_work)
    }
}

/// Ends a claimed job that cannot be read.
async fn mark_unreadable(
    connection: &mut SqliteConnection,
    job: Uuid,
    now: Milliseconds,
    cause: &str,
) -> Result<(), StoreError> {
    sqlx::query(
        "UPDATE jobs SET state = 'failed', failure = ?2, finished = ?3, lease_until = NULL, process_id = NULL \
         WHERE id = ?1",
    )
    .bind(job)
    .bind(to_json(&unreadable(cause))?)
    .bind(now)
    .execute(connection)
    .await?;
    Ok(())
}

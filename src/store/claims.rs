//! Claims: which job a worker gets next.

use uuid::Uuid;

use super::connection::Connection;
use super::engine::Engine;
use super::rows::{integer, job_record, select_jobs, to_json, unreadable};
use super::settings::Time;
use super::{Claim, Milliseconds, Store, StoreError, detached};

/// What a claim writes: `$1` is the process, `$2` the time, `$3` the length of a lease.
macro_rules! claim {
    () => {
        "UPDATE jobs SET state = 'running', attempt = attempt + 1, lease = lease + 1, process_id = $1, \
         lease_until = $2 + $3, started = $2, phase = 'preparation', progress = 0.0, phase_seconds = '[]' "
    };
}

/// Longer than any delay after which a job is tried again. One that is to wait longer was put back before the clock was
/// set back, and is let go.
const DELAY_MAX: Milliseconds = 15 * 60 * 1000;

/// How long a job that this version cannot read is kept from being claimed, so that a node of another version comes upon it.
const LEFT: Milliseconds = 5 * 1000;

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
    /// A job that cannot be claimed yet keeps those behind it waiting: were they let past, it might wait forever. Only a
    /// job that this node can never run, because it needs more than its budget, is left to larger nodes.
    ///
    /// A job whose record cannot be read is left to a node of another version, and ends failed where there is none.
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
            let time = store.time(&mut transaction).await?;
            let mut changed = store.give_up_running(&mut transaction, time, None).await? > 0;
            let claim = loop {
                let Some((id, lease)) =
                    store.mark_claimed(&mut transaction, time.now, process, free, idle).await?
                else {
                    break None;
                };
                changed = true;
                let row = transaction
                    .query(concat!(select_jobs!(), "WHERE j.id = $1"))
                    .bind(id)
                    .fetch_one()
                    .await?;
                match job_record(&row) {
                    Ok(job) => break Some(Claim { job, lease }),
                    Err(StoreError::Damaged(_))
                        if Engine::other_version_computes(&mut transaction, time.now).await? =>
                    {
                        tracing::info!(job = %id, "a job that this version cannot read is left to another version");
                        leave(&mut transaction, id, time.now).await?;
                    }
                    Err(StoreError::Damaged(cause)) => {
                        tracing::error!(job = %id, %cause, "a job that cannot be read ends failed");
                        mark_unreadable(&mut transaction, id, time.now, &cause).await?;
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
        connection: &mut Connection,
        now: Milliseconds,
        process: Uuid,
        free: u64,
        idle: bool,
    ) -> Result<Option<(Uuid, i64)>, StoreError> {
        // Where nobody else could take it, such a job is not passed over; it ends failed at the next start.
        let largest = if connection.is_postgres() { integer(self.settings.memory_budget) } else { i64::MAX };
        let claimed = connection.query_either(
            concat!(
                claim!(),
                "WHERE id = (SELECT w.id FROM (SELECT owner, min(id) AS id FROM jobs WHERE state = 'queued' \
                 AND (not_before <= $2 OR not_before > $2 + $6) AND memory <= $7 GROUP BY owner) w \
                 LEFT JOIN turns t ON t.owner = w.owner ORDER BY coalesce(t.turn, 0), w.id LIMIT 1) \
                 AND memory <= $4 AND (attempt = 0 OR $5) RETURNING id, lease, owner"
            ),
            // The first by turn and id is the first of the owner whose turn it is. What another node is claiming at this
            // moment is passed over.
            concat!(
                "WITH next AS MATERIALIZED (SELECT j.id FROM jobs j LEFT JOIN turns t ON t.owner = j.owner \
                 WHERE j.state = 'queued' AND (j.not_before <= $2 OR j.not_before > $2 + $6) AND j.memory <= $7 \
                 ORDER BY coalesce(t.turn, 0), j.id LIMIT 1 FOR UPDATE OF j SKIP LOCKED) ",
                claim!(),
                "WHERE id = (SELECT id FROM next) AND memory <= $4 AND (attempt = 0 OR $5) RETURNING id, lease, owner"
            ),
        )
        .bind(process)
        .bind(now)
        .bind(self.settings.lease)
        .bind(integer(free))
        .bind(idle)
        .bind(DELAY_MAX)
        .bind(largest)
        .fetch_optional()
        .await?;
        let Some(row) = claimed else { return Ok(None) };
        connection
            .query(
                "INSERT INTO turns (owner, turn) SELECT $1, coalesce(max(turn), 0) + 1 FROM turns WHERE true \
             ON CONFLICT (owner) DO UPDATE SET turn = excluded.turn",
            )
            .bind(row.try_get::<&str, _>("owner")?)
            .execute()
            .await?;
        Ok(Some((row.try_get("id")?, row.try_get("lease")?)))
    }

    /// Whether a job may be claimed or given up. Only reads: idle workers ask every second.
    async fn has_work(&self) -> Result<bool, StoreError> {
        let mut reader = self.reader().await?;
        let Time { now, leases_end } = self.time(&mut reader).await?;
        let has_work = reader.query(
            "SELECT EXISTS (SELECT 1 FROM jobs WHERE state = 'queued' AND (not_before <= $1 OR not_before > $1 + $2)) \
             OR EXISTS (SELECT 1 FROM jobs WHERE state = 'running' AND (lease_until < $4 OR lease_until > $1 + $3))",
        )
        .bind(now)
        .bind(DELAY_MAX)
        .bind(self.settings.lease)
        .bind(leases_end)
        .scalar()
        .await?;
        Ok(has_work)
    }
}

/// Gives a claimed job back to its place in the queue, its attempt not counted, for others to claim.
async fn leave(connection: &mut Connection, job: Uuid, now: Milliseconds) -> Result<(), StoreError> {
    connection.query(
        "UPDATE jobs SET state = 'queued', attempt = attempt - 1, not_before = $2, lease_until = NULL, process_id = NULL \
         WHERE id = $1",
    )
    .bind(job)
    .bind(now + LEFT)
    .execute()
    .await?;
    Ok(())
}

/// Ends a claimed job that cannot be read.
async fn mark_unreadable(
    connection: &mut Connection,
    job: Uuid,
    now: Milliseconds,
    cause: &str,
) -> Result<(), StoreError> {
    connection.query(
        "UPDATE jobs SET state = 'failed', failure = $2, finished = $3, lease_until = NULL, process_id = NULL \
         WHERE id = $1",
    )
    .bind(job)
    .bind(to_json(&unreadable(cause))?)
    .bind(now)
    .execute()
    .await?;
    Ok(())
}

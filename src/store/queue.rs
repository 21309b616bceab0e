//! The queue as its workers see it: claims, heartbeats, ends.
//!
//! A claim carries the job's lease number, which goes up with every claim and never down. Whatever a worker writes
//! names its lease, and is refused when the job is no longer running under it: a worker that was given up for dead
//! cannot disturb its successor.

use sqlx::{Row, SqliteConnection};
use uuid::Uuid;

use super::rows::{integer, job_with_id, to_json, word};
use super::{Claim, Heartbeat, JobFailure, JobState, Milliseconds, Store, StoreError, Vitals, detached};
use crate::analysis::Report;

impl Store {
    /// Claims the job that has waited longest, for `process`; `None` when none waits.
    ///
    /// Jobs whose lease ran out are put back first, or ended when their attempts are used up.
    ///
    /// # Errors
    /// [`StoreError::Database`].
    pub async fn claim(&self, process: Uuid) -> Result<Option<Claim>, StoreError> {
        self.claim_within(process, u64::MAX).await
    }

    /// As [`Self::claim`], when the job is estimated to take at most `free` bytes of memory. A job that takes more keeps
    /// those behind it waiting: were they let past, it might wait for ever.
    ///
    /// # Errors
    /// [`StoreError::Database`].
    pub async fn claim_within(&self, process: Uuid, free: u64) -> Result<Option<Claim>, StoreError> {
        if !self.has_work().await? {
            return Ok(None);
        }
        let store = self.clone();
        detached(async move {
            let mut transaction = store.write().await?;
            let given_up = store.give_up_running(&mut transaction, None).await?;
            let claimed = sqlx::query(
                "UPDATE jobs SET state = 'running', attempt = attempt + 1, lease = lease + 1, process_id = ?1, \
                 lease_until = ?2 + ?3, started = ?2, phase = 'preparation', progress = 0.0, phase_seconds = '[]' \
                 WHERE id = (SELECT id FROM jobs WHERE state = 'queued' AND not_before <= ?2 ORDER BY id LIMIT 1) \
                 AND memory <= ?4 RETURNING id, lease",
            )
            .bind(process)
            .bind(store.now())
            .bind(store.settings.lease)
            .bind(integer(free))
            .fetch_optional(&mut *transaction)
            .await?;
            let claim = match claimed {
                Some(row) => {
                    let job = job_with_id(&mut transaction, row.try_get("id")?).await?;
                    Some(Claim { job, lease: row.try_get("lease")? })
                }
                None => None,
            };
            transaction.commit().await?;
            if claim.is_some() || given_up > 0 {
                store.announce();
            }
            Ok(claim)
        })
        .await
    }

    /// Whether a job may be claimed or given up. Only reads: idle workers ask every second.
    async fn has_work(&self) -> Result<bool, StoreError> {
        let has_work = sqlx::query_scalar(
            "SELECT EXISTS (SELECT 1 FROM jobs WHERE state = 'queued' AND not_before <= ?1) \
             OR EXISTS (SELECT 1 FROM jobs WHERE state = 'running' AND lease_until < ?1)",
        )
        .bind(self.now())
        .fetch_one(&self.readers)
        .await?;
        Ok(has_work)
    }

    /// At start: ends the queued jobs that need more memory than there is now, which would wait for ever. Returns how
    /// many there were.
    ///
    /// # Errors
    /// [`StoreError::Database`].
    pub async fn fail_over_budget(&self) -> Result<u64, StoreError> {
        let budget = self.settings.memory_budget;
        let failure = JobFailure {
            code: "memory".to_owned(),
            detail: format!(
                "the analysis needs more memory than the budget of the service, which is now {budget} bytes"
            ),
        };
        let failed = sqlx::query(
            "UPDATE jobs SET state = 'failed', failure = ?2, finished = ?3 WHERE state = 'queued' AND memory > ?1",
        )
        .bind(integer(budget))
        .bind(to_json(&failure)?)
        .bind(self.now())
        .execute(&self.writer)
        .await?;
        Ok(failed.rows_affected())
    }

    /// At start: every job that runs in a process other than `process` was left by a dead one. It goes back to its
    /// place in the queue, or ends when its attempts are used up (`crashed`) or somebody asked to cancel it. What such
    /// jobs had stored of a result is deleted. Returns how many there were.
    ///
    /// # Errors
    /// [`StoreError::Database`].
    pub async fn requeue_orphans(&self, process: Uuid) -> Result<u64, StoreError> {
        let store = self.clone();
        detached(async move {
            let mut transaction = store.write().await?;
            let orphans = store.give_up_running(&mut transaction, Some(process)).await?;
            for statement in [
                "DELETE FROM basis_chunks WHERE job_id IN (SELECT id FROM jobs WHERE state IN ('queued', 'failed', 'canceled'))",
                "DELETE FROM bases WHERE job_id IN (SELECT id FROM jobs WHERE state IN ('queued', 'failed', 'canceled'))",
                "DELETE FROM array_chunks WHERE job_id IN (SELECT id FROM jobs WHERE state IN ('queued', 'failed', 'canceled'))",
                "DELETE FROM arrays WHERE job_id IN (SELECT id FROM jobs WHERE state IN ('queued', 'failed', 'canceled'))",
                "DELETE FROM coefficients WHERE job_id IN (SELECT id FROM jobs WHERE state IN ('queued', 'failed', 'canceled'))",
            ] {
                sqlx::query(statement).execute(&mut *transaction).await?;
            }
            transaction.commit().await?;
            store.announce();
            Ok(orphans)
        })
        .await
    }

    /// Tells how the job is doing, and renews its lease. The stored progress never decreases.
    ///
    /// # Errors
    /// [`StoreError::Database`].
    pub async fn heartbeat(&self, claim: &Claim, vitals: &Vitals) -> Result<Heartbeat, StoreError> {
        let cancel: Option<bool> = sqlx::query_scalar(
            "UPDATE jobs SET phase = ?3, progress = max(progress, ?4), phase_seconds = ?5, lease_until = ?6 \
             WHERE id = ?1 AND lease = ?2 AND state = 'running' RETURNING cancel_requested",
        )
        .bind(claim.job.id)
        .bind(claim.lease)
        .bind(word(&vitals.phase)?)
        .bind(vitals.progress.clamp(0.0, 1.0))
        .bind(to_json(&vitals.phase_seconds)?)
        .bind(self.now() + self.settings.lease)
        .fetch_optional(&self.writer)
        .await?;
        self.announce();
        Ok(learned(cancel))
    }

    /// What a heartbeat would learn, without writing anything.
    ///
    /// # Errors
    /// [`StoreError::Database`].
    pub async fn pulse(&self, claim: &Claim) -> Result<Heartbeat, StoreError> {
        let cancel = sqlx::query_scalar(
            "SELECT cancel_requested FROM jobs WHERE id = ?1 AND lease = ?2 AND state = 'running'",
        )
        .bind(claim.job.id)
        .bind(claim.lease)
        .fetch_optional(&self.readers)
        .await?;
        Ok(learned(cancel))
    }

    /// Ends the job with its result, which must be stored whole: the last transaction of a job that succeeds. A job that
    /// somebody asked to cancel ends canceled instead. Returns the state in which it ended.
    ///
    /// # Errors
    /// [`StoreError::LostClaim`]; [`StoreError::Damaged`] when the report or the stored arrays are not whole.
    pub async fn finish(
        &self,
        claim: &Claim,
        report: &Report,
        vitals: &Vitals,
    ) -> Result<JobState, StoreError> {
        let (store, claim) = (self.clone(), claim.clone());
        let (text, phase_seconds) = (readable_report(report)?, to_json(&vitals.phase_seconds)?);
        let phase = word(&vitals.phase)?;
        let bases = report.spectrum.as_ref().map(|spectrum| spectrum.eigenvalues.len());
        detached(async move {
            let mut transaction = store.write().await?;
            if store.check_claim(&mut transaction, &claim).await? == Heartbeat::Cancel {
                drop(transaction);
                store.cancel_claimed(&claim).await?;
                return Ok(JobState::Canceled);
            }
            store.check_whole(&mut transaction, &claim, bases).await?;
            sqlx::query(
                "UPDATE jobs SET state = 'succeeded', phase = ?2, progress = 1.0, phase_seconds = ?3, report = ?4, \
                 finished = ?5, lease_until = NULL, process_id = NULL WHERE id = ?1",
            )
            .bind(claim.job.id)
            .bind(phase)
            .bind(phase_seconds)
            .bind(text)
            .bind(store.now())
            .execute(&mut *transaction)
            .await?;
            transaction.commit().await?;
            store.announce();
            Ok(JobState::Succeeded)
        })
        .await
    }

    /// Ends the job with an error or, with a delay after which to `retry` and attempts left, puts it back into the queue
    /// (then, if somebody asked to cancel it, it ends canceled). Returns the state after.
    ///
    /// # Errors
    /// [`StoreError::LostClaim`], [`StoreError::Database`].
    pub async fn fail(
        &self,
        claim: &Claim,
        failure: JobFailure,
        retry: Option<Milliseconds>,
    ) -> Result<JobState, StoreError> {
        let ending = match retry {
            Some(delay) if claim.job.attempt < self.settings.attempts_max => {
                Ending::Requeued { attempts_back: 0, delay }
            }
            _ => Ending::Failed(failure),
        };
        self.end(claim, ending).await
    }

    /// Ends the job as canceled.
    ///
    /// # Errors
    /// [`StoreError::LostClaim`], [`StoreError::Database`].
    pub async fn cancel_claimed(&self, claim: &Claim) -> Result<(), StoreError> {
        self.end(claim, Ending::Canceled).await.map(|_| ())
    }

    /// Gives the job back to its place in the queue, its attempt not counted: the process ends in good order. A job that
    /// somebody asked to cancel ends canceled. Returns the state after.
    ///
    /// # Errors
    /// [`StoreError::LostClaim`], [`StoreError::Database`].
    pub async fn release(&self, claim: &Claim) -> Result<JobState, StoreError> {
        self.end(claim, Ending::Requeued { attempts_back: 1, delay: 0 }).await
    }

    async fn end(&self, claim: &Claim, ending: Ending) -> Result<JobState, StoreError> {
        let (store, claim) = (self.clone(), claim.clone());
        detached(async move {
            let mut transaction = store.write().await?;
            let cancel = store.check_claim(&mut transaction, &claim).await? == Heartbeat::Cancel;
            let (state, failure, attempts_back, delay) = match ending {
                Ending::Failed(failure) => (JobState::Failed, Some(to_json(&failure)?), 0, 0),
                Ending::Requeued { attempts_back, delay } if !cancel => {
                    (JobState::Queued, None, attempts_back, delay)
                }
                Ending::Requeued { .. } | Ending::Canceled => (JobState::Canceled, None, 0, 0),
            };
            sqlx::query(
                "UPDATE jobs SET state = ?2, failure = ?3, finished = ?4, attempt = attempt - ?5, not_before = ?6, \
                 lease_until = NULL, process_id = NULL WHERE id = ?1",
            )
            .bind(claim.job.id)
            .bind(word(&state)?)
            .bind(failure)
            .bind(state.is_terminal().then(|| store.now()))
            .bind(attempts_back)
            .bind(store.now() + delay)
            .execute(&mut *transaction)
            .await?;
            transaction.commit().await?;
            store.announce();
            // Apart, because deleting much takes long and the end is what others wait for.
            store.clear_result_unless_live(claim.job.id).await?;
            Ok(state)
        })
        .await
    }

    /// Whether the job still runs under this claim, and whether somebody asked to cancel it.
    pub(super) async fn check_claim(
        &self,
        connection: &mut SqliteConnection,
        claim: &Claim,
    ) -> Result<Heartbeat, StoreError> {
        let cancel = sqlx::query_scalar(
            "SELECT cancel_requested FROM jobs WHERE id = ?1 AND lease = ?2 AND state = 'running'",
        )
        .bind(claim.job.id)
        .bind(claim.lease)
        .fetch_optional(connection)
        .await?;
        match learned(cancel) {
            Heartbeat::Lost => Err(StoreError::LostClaim),
            learned => Ok(learned),
        }
    }

    /// Ends the claims whose lease ran out and, given a living process, those of all others.
    async fn give_up_running(
        &self,
        connection: &mut SqliteConnection,
        living: Option<Uuid>,
    ) -> Result<u64, StoreError> {
        let crashed = JobFailure {
            code: "crashed".to_owned(),
            detail: format!(
                "the computation did not come to an end in {} attempts: each time the process died or stopped answering",
                self.settings.attempts_max
            ),
        };
        let given_up = sqlx::query(
            "UPDATE jobs SET \
             state = CASE WHEN cancel_requested THEN 'canceled' WHEN attempt >= ?3 THEN 'failed' ELSE 'queued' END, \
             failure = CASE WHEN NOT cancel_requested AND attempt >= ?3 THEN ?4 END, \
             finished = CASE WHEN cancel_requested OR attempt >= ?3 THEN ?1 END, \
             lease_until = NULL, process_id = NULL \
             WHERE state = 'running' AND (lease_until < ?1 OR process_id <> ?2)",
        )
        .bind(self.now())
        .bind(living)
        .bind(i64::from(self.settings.attempts_max))
        .bind(to_json(&crashed)?)
        .execute(connection)
        .await?;
        Ok(given_up.rows_affected())
    }
}

/// How a claim ends, unless with a result.
enum Ending {
    Failed(JobFailure),
    Canceled,
    Requeued { attempts_back: i64, delay: Milliseconds },
}

fn learned(cancel_requested: Option<bool>) -> Heartbeat {
    match cancel_requested {
        Some(false) => Heartbeat::Continue,
        Some(true) => Heartbeat::Cancel,
        None => Heartbeat::Lost,
    }
}

/// The report as JSON that can be read back: JSON has no NaN, and a result that nobody can read is none.
fn readable_report(report: &Report) -> Result<String, StoreError> {
    let text = to_json(report)?;
    match serde_json::from_str::<Report>(&text) {
        Ok(back) if back == *report => Ok(text),
        _ => Err(StoreError::Damaged("the report has numbers that are not finite".to_owned())),
    }
}

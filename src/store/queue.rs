//! The queue as its workers see it: heartbeats, ends, and who is given up. Claims are made in `claims`.
//!
//! A claim carries the job's lease number, which goes up with every claim and never down. Whatever a worker writes
//! names its lease, and is refused when the job is no longer running under it: a worker that was given up for dead
//! cannot disturb its successor.

use uuid::Uuid;

use super::arrays::text_checksum;
use super::connection::Connection;
use super::engine::Engine;
use super::results::clear_result;
use super::rows::{integer, to_json, word};
use super::settings::Time;
use super::{Claim, JobFailure, JobState, Milliseconds, Order, Store, StoreError, Vitals, detached};
use crate::analysis::Report;

/// What becomes of a job whose claim is given up: `$1` is the time, `$3` the number of attempts, `$4` the failure.
macro_rules! give_up {
    () => {
        "UPDATE jobs SET state = CASE WHEN cancel_requested = 1 THEN 'canceled' \
         WHEN attempt >= $3 THEN 'failed' ELSE 'queued' END, \
         failure = CASE WHEN cancel_requested = 0 AND attempt >= $3 THEN $4 END, \
         finished = CASE WHEN cancel_requested = 1 OR attempt >= $3 THEN $1 END, \
         lease_until = NULL, process_id = NULL "
    };
}

impl Store {
    /// Ends the queued jobs that need more memory than there is now, on whichever node, which would wait forever. Returns
    /// how many there were.
    ///
    /// # Errors
    /// [`StoreError::Database`].
    pub async fn fail_over_budget(&self) -> Result<u64, StoreError> {
        let store = self.clone();
        detached(async move {
        let mut transaction = store.write().await?;
        let now = store.now(&mut transaction).await?;
        let budget = Engine::memory_budget(&mut transaction, &store.settings).await?;
        let failure = JobFailure {
            code: "memory".to_owned(),
            detail: format!(
                "the analysis needs more memory than the budget of the service, which is now {budget} bytes"
            ),
        };
        let failed = transaction.query(
            "UPDATE jobs SET state = 'failed', failure = $2, finished = $3 WHERE state = 'queued' AND memory > $1",
        )
        .bind(integer(budget))
        .bind(to_json(&failure)?)
        .bind(now)
        .execute()
        .await?;
        transaction.commit().await?;
        if failed > 0 {
            store.announce();
        }
        Ok(failed)
        }).await
    }

    /// At start: every job that runs in a process other than `process` was left by a dead one, where one process has the
    /// database to itself; where nodes share it, every job whose lease has run out. It goes back to its place in the queue,
    /// or ends when its attempts are used up (`crashed`) or somebody asked to cancel it. What such jobs had stored of a
    /// result is deleted. Returns how many there were.
    ///
    /// # Errors
    /// [`StoreError::Database`].
    pub async fn requeue_orphans(&self, process: Uuid) -> Result<u64, StoreError> {
        let store = self.clone();
        detached(async move {
            let mut transaction = store.write().await?;
            let living = (!transaction.is_postgres()).then_some(process);
            let time = store.time(&mut transaction).await?;
            let orphans = store.give_up_running(&mut transaction, time, living).await?;
            // A job that waits may be claimed by another node at any moment, which then clears what it finds itself.
            let left: Vec<Uuid> = transaction
                .query_either(
                    "SELECT id FROM jobs j WHERE state IN ('queued', 'failed', 'canceled') \
                 AND (EXISTS (SELECT 1 FROM arrays a WHERE a.job_id = j.id) \
                 OR EXISTS (SELECT 1 FROM bases b WHERE b.job_id = j.id))",
                    "SELECT id FROM jobs j WHERE state IN ('queued', 'failed', 'canceled') \
                 AND (EXISTS (SELECT 1 FROM arrays a WHERE a.job_id = j.id) \
                 OR EXISTS (SELECT 1 FROM bases b WHERE b.job_id = j.id)) ORDER BY id FOR UPDATE SKIP LOCKED",
                )
                .scalars()
                .await?;
            for job in left {
                clear_result(&mut transaction, job).await?;
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
    pub async fn heartbeat(&self, claim: &Claim, vitals: &Vitals) -> Result<Order, StoreError> {
        let (store, claim, vitals) = (self.clone(), claim.clone(), vitals.clone());
        detached(async move {
            let mut transaction = store.write().await?;
            let now = store.now(&mut transaction).await?;
            let cancel: Option<i64> = transaction
                .query(
                    "UPDATE jobs SET phase = $3, progress = CASE WHEN progress < $4 THEN $4 ELSE progress END, \
                     phase_seconds = $5, lease_until = $6, memory = CASE WHEN memory < $7 THEN $7 ELSE memory END \
                     WHERE id = $1 AND lease = $2 AND state = 'running' RETURNING cancel_requested",
                )
                .bind(claim.job.id)
                .bind(claim.lease)
                .bind(word(&vitals.phase)?)
                .bind(vitals.progress.clamp(0.0, 1.0))
                .bind(to_json(&vitals.phase_seconds)?)
                .bind(now + store.settings.lease)
                .bind(integer(vitals.memory))
                .scalar_optional()
                .await?;
            transaction.commit().await?;
            store.announce();
            Ok(learned(cancel))
        })
        .await
    }

    /// What a heartbeat would learn, without writing anything.
    ///
    /// # Errors
    /// [`StoreError::Database`].
    pub async fn order(&self, claim: &Claim) -> Result<Order, StoreError> {
        let cancel = self
            .reader()
            .await?
            .query("SELECT cancel_requested FROM jobs WHERE id = $1 AND lease = $2 AND state = 'running'")
            .bind(claim.job.id)
            .bind(claim.lease)
            .scalar_optional()
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
        let (phase, memory) = (word(&vitals.phase)?, integer(vitals.memory));
        let bases = report.spectrum.as_ref().map(|spectrum| spectrum.eigenvalues.len());
        detached(async move {
            let mut transaction = store.write().await?;
            if store.check_claim(&mut transaction, &claim).await? == Order::Cancel {
                transaction.commit().await?;
                store.cancel_claimed(&claim).await?;
                return Ok(JobState::Canceled);
            }
            store.check_whole(&mut transaction, &claim, bases).await?;
            let now = store.now(&mut transaction).await?;
            let bases_bytes = 8 * claim.job.points * bases.unwrap_or(0) as u64;
            transaction.query(
                "UPDATE jobs SET state = 'succeeded', phase = $2, progress = 1.0, phase_seconds = $3, report = $4, \
                 finished = $5, lease_until = NULL, process_id = NULL, report_checksum = $6, \
                 memory = CASE WHEN memory < $8 THEN $8 ELSE memory END, bytes = $7 + (SELECT \
                 CAST(sum(numbers * CASE name WHEN 'columns' THEN 4 ELSE 8 END) AS BIGINT) FROM arrays WHERE job_id = $1) \
                 WHERE id = $1",
            )
            .bind(claim.job.id)
            .bind(phase)
            .bind(phase_seconds)
            .bind(&text)
            .bind(now)
            .bind(text_checksum(&[&text]).as_slice())
            .bind(integer(bases_bytes))
            .bind(memory)
            .execute()
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
                Ending::Requeued { attempts_back: 0, delay, memory: claim.job.memory }
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
        self.end(claim, Ending::Requeued { attempts_back: 1, delay: 0, memory: claim.job.memory }).await
    }

    /// Gives the job back to its place in the queue with a better estimate of the memory that it needs, its attempt not
    /// counted; ends it when it needs more than the budget. Returns the state after.
    ///
    /// # Errors
    /// [`StoreError::LostClaim`], [`StoreError::Database`].
    pub async fn release_for_memory(&self, claim: &Claim, need: u64) -> Result<JobState, StoreError> {
        let mut reader = self.reader().await?;
        let budget = Engine::memory_budget(&mut reader, &self.settings).await?;
        drop(reader);
        let ending = if need > budget {
            Ending::Failed(JobFailure {
                code: "memory".to_owned(),
                detail: StoreError::OverBudget { need, budget }.to_string(),
            })
        } else {
            Ending::Requeued { attempts_back: 1, delay: 0, memory: need }
        };
        self.end(claim, ending).await
    }

    async fn end(&self, claim: &Claim, ending: Ending) -> Result<JobState, StoreError> {
        let (store, claim) = (self.clone(), claim.clone());
        detached(async move {
            let mut transaction = store.write().await?;
            let cancel = store.check_claim(&mut transaction, &claim).await? == Order::Cancel;
            let (memory, now) = (claim.job.memory, store.now(&mut transaction).await?);
            let (state, failure, attempts_back, not_before, memory) = match ending {
                Ending::Failed(failure) => (JobState::Failed, Some(to_json(&failure)?), 0, 0, memory),
                Ending::Requeued { attempts_back, delay, memory } if !cancel => {
                    (JobState::Queued, None, attempts_back, if delay > 0 { now + delay } else { 0 }, memory)
                }
                Ending::Requeued { .. } | Ending::Canceled => (JobState::Canceled, None, 0, 0, memory),
            };
            transaction.query(
                "UPDATE jobs SET state = $2, failure = $3, finished = $4, attempt = attempt - $5, not_before = $6, \
                 memory = $7, lease_until = NULL, process_id = NULL WHERE id = $1",
            )
            .bind(claim.job.id)
            .bind(word(&state)?)
            .bind(failure)
            .bind(state.is_terminal().then_some(now))
            .bind(attempts_back)
            .bind(not_before)
            .bind(integer(memory))
            .execute()
            .await?;
            transaction.commit().await?;
            if state == JobState::Queued { store.announce_arrival() } else { store.announce() }
            // Apart, because deleting much takes long and the end is what others wait for.
            store.clear_result_unless_live(claim.job.id).await?;
            Ok(state)
        })
        .await
    }

    /// Whether the job still runs under this claim, and whether somebody asked to cancel it.
    pub(super) async fn check_claim(
        &self,
        connection: &mut Connection,
        claim: &Claim,
    ) -> Result<Order, StoreError> {
        let cancel = connection.query_either(
            "SELECT cancel_requested FROM jobs WHERE id = $1 AND lease = $2 AND state = 'running'",
            // Until the transaction ends nobody else can take the claim.
            "SELECT cancel_requested FROM jobs WHERE id = $1 AND lease = $2 AND state = 'running' FOR NO KEY UPDATE",
        )
        .bind(claim.job.id)
        .bind(claim.lease)
        .scalar_optional()
        .await?;
        match learned(cancel) {
            Order::Lost => Err(StoreError::LostClaim),
            learned => Ok(learned),
        }
    }

    /// Ends the claims whose lease ran out and, given a living process, those of all others.
    pub(super) async fn give_up_running(
        &self,
        connection: &mut Connection,
        time: Time,
        living: Option<Uuid>,
    ) -> Result<u64, StoreError> {
        let crashed = JobFailure {
            code: "crashed".to_owned(),
            detail: format!(
                "the computation did not come to an end in {} attempts: each time the process died or stopped answering",
                self.settings.attempts_max
            ),
        };
        // A lease longer than any that is given was given before the clock was set back: it gets the usual time from now.
        connection
            .query("UPDATE jobs SET lease_until = $1 + $2 WHERE state = 'running' AND lease_until > $1 + $2")
            .bind(time.now)
            .bind(self.settings.lease)
            .execute()
            .await?;
        let given_up = connection.query_either(
            concat!(give_up!(), "WHERE state = 'running' AND (lease_until < $5 OR process_id <> $2)"),
            // Those of a transaction that is under way, as of another node that gives them up, are let be.
            concat!(
                give_up!(),
                "WHERE id IN (SELECT id FROM jobs WHERE state = 'running' AND (lease_until < $5 OR process_id <> $2) \
                 ORDER BY id FOR UPDATE SKIP LOCKED)"
            ),
        )
        .bind(time.now)
        .bind(living)
        .bind(i64::from(self.settings.attempts_max))
        .bind(to_json(&crashed)?)
        .bind(time.leases_end)
        .execute()
        .await?;
        Ok(given_up)
    }
}

/// How a claim ends, unless with a result.
enum Ending {
    Failed(JobFailure),
    Canceled,
    Requeued { attempts_back: i64, delay: Milliseconds, memory: u64 },
}

fn learned(cancel_requested: Option<i64>) -> Order {
    match cancel_requested {
        Some(0) => Order::Continue,
        Some(_) => Order::Cancel,
        None => Order::Lost,
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

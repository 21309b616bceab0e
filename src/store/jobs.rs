//! Jobs as their owners see them: queued, listed, canceled, deleted.

use std::collections::HashMap;

use futures_util::TryStreamExt;
use sqlx::{QueryBuilder, Sqlite, SqliteConnection};
use uuid::Uuid;

use super::arrays::basis_chunk_points;
use super::line::place;
use super::rows::{from_word, integer, job_with_id, readable_job, select_jobs, to_json, word};
use super::{CloudRecord, JobRecord, JobState, Milliseconds, Owner, Page, Store, StoreError, detached};
use crate::analysis::{JobKind, Parameters, memory_estimate};

/// Entries of a row of an operator's matrix, about, before the matrix is known.
const ENTRIES_PER_ROW: u64 = 60;

impl JobState {
    /// Lowercase name, as in the interface.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Queued => "queued",
            Self::Running => "running",
            Self::Succeeded => "succeeded",
            Self::Failed => "failed",
            Self::Canceled => "canceled",
        }
    }

    /// Whether a job in this state stays in it.
    #[must_use]
    pub fn is_terminal(self) -> bool {
        match self {
            Self::Queued | Self::Running => false,
            Self::Succeeded | Self::Failed | Self::Canceled => true,
        }
    }
}

impl Store {
    /// A job's record.
    ///
    /// # Errors
    /// [`StoreError::NotFound`], [`StoreError::Database`].
    pub async fn job(&self, id: Uuid) -> Result<JobRecord, StoreError> {
        job_with_id(&mut *self.readers.acquire().await?, id).await
    }

    /// Jobs of an owner, newest first, after `cursor`; their reports come without spectra, which may be a hundred
    /// kilobytes of JSON each.
    ///
    /// # Errors
    /// [`StoreError::Database`].
    pub async fn jobs(
        &self,
        owner: &Owner,
        state: Option<JobState>,
        cloud: Option<Uuid>,
        cursor: Option<Uuid>,
        limit: u32,
    ) -> Result<Page<JobRecord>, StoreError> {
        let mut query = QueryBuilder::<Sqlite>::new(concat!(
            select_jobs!("json_remove(j.report, '$.spectrum')", "NULL"),
            "WHERE j.owner = "
        ));
        query.push_bind(owner.name().to_owned());
        if let Some(state) = state {
            query.push(" AND j.state = ").push_bind(word(&state)?);
        }
        if let Some(cloud) = cloud {
            query.push(" AND j.cloud_id = ").push_bind(cloud);
        }
        if let Some(cursor) = cursor {
            query.push(" AND j.id < ").push_bind(cursor);
        }
        query.push(" ORDER BY j.id DESC LIMIT ").push_bind(i64::from(limit.max(1)) + 1);
        let mut records = Vec::new();
        let mut snapshot = self.read().await?;
        {
            let mut rows = query.build().fetch(&mut *snapshot);
            while let Some(row) = rows.try_next().await? {
                records.push(readable_job(&row)?);
                // Rows that are ready already come without a pause: let others onto this thread between them.
                tokio::task::yield_now().await;
            }
        }
        place(&mut snapshot, &mut records).await?;
        Ok(Page::cut(records, limit, |job| job.id))
    }

    /// Number of jobs in every state in which there are any.
    ///
    /// # Errors
    /// [`StoreError::Database`].
    pub async fn jobs_by_state(&self) -> Result<HashMap<JobState, u64>, StoreError> {
        let counts: Vec<(String, i64)> = sqlx::query_as("SELECT state, count(*) FROM jobs GROUP BY state")
            .fetch_all(&self.readers)
            .await?;
        counts.into_iter().map(|(state, jobs)| Ok((from_word(&state)?, jobs as u64))).collect()
    }

    /// Seconds since the submission of the job that has waited longest; 0 when none waits.
    ///
    /// # Errors
    /// [`StoreError::Database`].
    pub async fn oldest_queued_seconds(&self) -> Result<f64, StoreError> {
        let oldest: Option<Milliseconds> =
            sqlx::query_scalar("SELECT min(created) FROM jobs WHERE state = 'queued'")
                .fetch_one(&self.readers)
                .await?;
        Ok(oldest.map_or(0.0, |created| (self.now() - created).max(0) as f64 / 1e3))
    }

    /// Asks to cancel: a queued job ends at once, a running one at its next heartbeat and never with a result. A
    /// terminal one stays as it is. Returns the record after.
    ///
    /// # Errors
    /// [`StoreError::NotFound`], [`StoreError::Database`].
    pub async fn request_cancel(&self, id: Uuid) -> Result<JobRecord, StoreError> {
        let store = self.clone();
        detached(async move {
            let mut transaction = store.write().await?;
            store.mark_canceled(&mut transaction, id).await?;
            let job = job_with_id(&mut transaction, id).await?;
            transaction.commit().await?;
            store.announce();
            Ok(job)
        })
        .await
    }

    /// Deletes a job with its result, true; one that runs is asked to cancel and goes when its attempt ends, false.
    ///
    /// # Errors
    /// [`StoreError::NotFound`], [`StoreError::Database`].
    pub async fn delete_job(&self, id: Uuid) -> Result<bool, StoreError> {
        let store = self.clone();
        detached(async move {
            let mut transaction = store.write().await?;
            store.mark_canceled(&mut transaction, id).await?;
            let terminal = job_with_id(&mut transaction, id).await?.state.is_terminal();
            let statement = if terminal {
                "DELETE FROM jobs WHERE id = ?1"
            } else {
                "UPDATE jobs SET delete_requested = 1 WHERE id = ?1"
            };
            sqlx::query(statement).bind(id).execute(&mut *transaction).await?;
            transaction.commit().await?;
            store.announce();
            Ok(terminal)
        })
        .await
    }

    async fn mark_canceled(&self, connection: &mut SqliteConnection, id: Uuid) -> Result<(), StoreError> {
        sqlx::query(
            "UPDATE jobs SET cancel_requested = 1, \
             finished = CASE state WHEN 'queued' THEN ?2 END, \
             state = CASE state WHEN 'queued' THEN 'canceled' ELSE state END \
             WHERE id = ?1 AND state IN ('queued', 'running')",
        )
        .bind(id)
        .bind(self.now())
        .execute(connection)
        .await?;
        Ok(())
    }

    /// The job that does this analysis: the one that is there, else a new one (true).
    ///
    /// The caller holds the write lock, so what is looked up here cannot change before the insertion; the index
    /// `jobs_once` says the same to every other writer.
    pub(super) async fn enqueue(
        &self,
        connection: &mut SqliteConnection,
        cloud: &CloudRecord,
        kind: JobKind,
        parameters: &Parameters,
    ) -> Result<(JobRecord, bool), StoreError> {
        let memory = memory_estimate(cloud.points, cloud.dimension, cloud.faces, kind, parameters);
        let chunk_points = basis_chunk_points(parameters.bases);
        let bytes = result_bytes(cloud.points, kind, parameters.bases);
        // Fields in the order of their declaration, numbers in their shortest form: equal parameters, equal text.
        let (kind, parameters) = (word(&kind)?, to_json(parameters)?);
        let same = sqlx::query(concat!(
            select_jobs!(),
            "WHERE j.cloud_id = ?1 AND j.kind = ?2 AND j.parameters = ?3 \
             AND j.state IN ('queued', 'running', 'succeeded') AND j.cancel_requested = 0"
        ))
        .bind(cloud.id)
        .bind(&kind)
        .bind(&parameters)
        .fetch_optional(&mut *connection)
        .await?;
        if let Some(row) = same {
            let mut job = readable_job(&row)?;
            place(connection, std::slice::from_mut(&mut job)).await?;
            return Ok((job, false));
        }
        let budget = self.settings.memory_budget;
        if memory > budget {
            return Err(StoreError::OverBudget { need: memory, budget });
        }
        let owner = &cloud.owner;
        self.refuse_when_queue_full(connection, owner).await?;
        self.refuse_when_owner_full(connection, owner, bytes).await?;
        let id = Uuid::now_v7();
        sqlx::query(
            "INSERT INTO jobs (id, owner, cloud_id, created, kind, parameters, memory, chunk_points, bytes, state) \
             VALUES (?1, ?2, ?3, ?4, ?5, ?6, ?7, ?8, ?9, 'queued')",
        )
        .bind(id)
        .bind(owner.name())
        .bind(cloud.id)
        .bind(self.now())
        .bind(kind)
        .bind(parameters)
        .bind(integer(memory))
        .bind(integer(chunk_points))
        .bind(integer(bytes))
        .execute(&mut *connection)
        .await?;
        Ok((job_with_id(connection, id).await?, true))
    }

    /// Refuses what would make the queue, or the owner's part of it, longer than it may be. An owner of whom nothing waits
    /// is let in even when others have filled the queue.
    pub(super) async fn refuse_when_queue_full(
        &self,
        connection: &mut SqliteConnection,
        owner: &Owner,
    ) -> Result<(), StoreError> {
        let (limit, own_limit) = (self.settings.queue_max, self.settings.queue_max_per_owner);
        let (queued, own): (i64, i64) = sqlx::query_as(
            "SELECT (SELECT count(*) FROM jobs WHERE state = 'queued'), \
             (SELECT count(*) FROM jobs WHERE state = 'queued' AND owner = ?1)",
        )
        .bind(owner.name())
        .fetch_one(connection)
        .await?;
        if own as u64 >= own_limit {
            return Err(StoreError::OwnerQueueFull { limit: own_limit });
        }
        if queued as u64 >= limit && (own > 0 || limit == 0) {
            return Err(StoreError::QueueFull { limit });
        }
        Ok(())
    }

    /// Refuses what would make an owner's clouds and results take more than they may.
    pub(super) async fn refuse_when_owner_full(
        &self,
        connection: &mut SqliteConnection,
        owner: &Owner,
        more: u64,
    ) -> Result<(), StoreError> {
        let limit = self.settings.stored_bytes_max_per_owner;
        if limit == u64::MAX {
            return Ok(());
        }
        let stored: i64 = sqlx::query_scalar(
            "SELECT (SELECT coalesce(sum(bytes), 0) FROM clouds WHERE owner = ?1) \
             + (SELECT coalesce(sum(bytes), 0) FROM jobs WHERE owner = ?1 AND state IN ('queued', 'running', 'succeeded'))",
        )
        .bind(owner.name())
        .fetch_one(connection)
        .await?;
        let stored = stored as u64;
        if stored.saturating_add(more) > limit {
            return Err(StoreError::OwnerStorageFull { stored, more, limit });
        }
        Ok(())
    }
}

/// Bytes of the result of a job before it is known: mass and bases, or a matrix of as many entries per row as the heat
/// kernel's default cut-off has on an even surface.
fn result_bytes(points: u64, kind: JobKind, bases: usize) -> u64 {
    let per_point = match kind {
        JobKind::Eigen => 8 * (1 + bases as u64),
        JobKind::Operator => 8 + 8 + 12 * ENTRIES_PER_ROW,
    };
    points.saturating_mul(per_point)
}

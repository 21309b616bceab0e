//! Jobs as their owners see them: queued, listed, canceled, deleted.

use std::collections::HashMap;

use futures_util::TryStreamExt;
use sqlx::{QueryBuilder, Sqlite, SqliteConnection};
use uuid::Uuid;

use super::arrays::basis_chunk_points;
use super::rows::{from_word, integer, job_record, job_with_id, select_jobs, to_json, word};
use super::{CloudRecord, JobRecord, JobState, Owner, Page, Store, StoreError, detached};
use crate::analysis::{JobKind, Parameters, memory_estimate};

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
            select_jobs!("json_remove(j.report, '$.spectrum')"),
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
        let mut rows = query.build().fetch(&self.readers);
        while let Some(row) = rows.try_next().await? {
            records.push(job_record(&row)?);
            // Rows that are ready already come without a pause: let others onto this thread between them.
            tokio::task::yield_now().await;
        }
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
            return Ok((job_record(&row)?, false));
        }
        let budget = self.settings.memory_budget;
        if memory > budget {
            return Err(StoreError::OverBudget { need: memory, budget });
        }
        self.refuse_when_full(connection).await?;
        let id = Uuid::now_v7();
        sqlx::query(
            "INSERT INTO jobs (id, owner, cloud_id, created, kind, parameters, memory, chunk_points, state) \
             VALUES (?1, ?2, ?3, ?4, ?5, ?6, ?7, ?8, 'queued')",
        )
        .bind(id)
        .bind(cloud.owner.name())
        .bind(cloud.id)
        .bind(self.now())
        .bind(kind)
        .bind(parameters)
        .bind(integer(memory))
        .bind(integer(chunk_points))
        .execute(&mut *connection)
        .await?;
        Ok((job_with_id(connection, id).await?, true))
    }

    /// Refuses what would make the queue longer than it may be.
    pub(super) async fn refuse_when_full(&self, connection: &mut SqliteConnection) -> Result<(), StoreError> {
        let limit = self.settings.queue_max;
        let queued: i64 = sqlx::query_scalar("SELECT count(*) FROM jobs WHERE state = 'queued'")
            .fetch_one(connection)
            .await?;
        if queued as u64 >= limit { Err(StoreError::QueueFull { limit }) } else { Ok(()) }
    }
}

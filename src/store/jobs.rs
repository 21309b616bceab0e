//! Jobs as their owners see them: queued, listed, canceled, deleted.

use std::collections::HashMap;

use futures_util::TryStreamExt;
use uuid::Uuid;

use super::arrays::{basis_chunk_points, toasted_basis_chunk_points};
use super::connection::Connection;
use super::engine::Engine;
use super::line::place;
use super::rows::{from_word, integer, job_with_id, readable_job, select_jobs, to_json, word};
use super::{CloudRecord, JobRecord, JobState, Milliseconds, Owner, Page, Store, StoreError, detached};
use crate::analysis::{JobKind, Parameters, memory_within};

/// Entries of a row of an operator's matrix, about, before the matrix is known.
const ENTRIES_PER_ROW: u64 = 60;

/// Parameters that came after the first version.
const LATER: [&str; 3] = ["exact", "solved_points", "local_bandwidth"];

impl JobState {
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
        job_with_id(&mut self.reader().await?, id).await
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
        let mut snapshot = self.read().await?;
        let mut text = if snapshot.is_postgres() {
            select_jobs!("(CAST(j.report AS jsonb) - 'spectrum')::text", "CAST(NULL AS BYTEA)").to_owned()
        } else {
            select_jobs!("json_remove(j.report, '$.spectrum')", "NULL").to_owned()
        };
        text.push_str("WHERE j.owner = $1 AND j.id <= $2");
        text.push_str(match (state.is_some(), cloud.is_some()) {
            (false, false) => " ORDER BY j.id DESC LIMIT $3",
            (true, false) => " AND j.state = $4 ORDER BY j.id DESC LIMIT $3",
            (false, true) => " AND j.cloud_id = $4 ORDER BY j.id DESC LIMIT $3",
            (true, true) => " AND j.state = $4 AND j.cloud_id = $5 ORDER BY j.id DESC LIMIT $3",
        });
        let state = state.map(|state| word(&state)).transpose()?;
        let mut records = Vec::new();
        {
            let mut query = snapshot
                .query_composed(text)
                .bind(owner.name())
                .bind(before(cursor))
                .bind(i64::from(limit.max(1)) + 1);
            if let Some(state) = state {
                query = query.bind(state);
            }
            if let Some(cloud) = cloud {
                query = query.bind(cloud);
            }
            let mut rows = query.fetch();
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
        let counts: Vec<(String, i64)> = self
            .reader()
            .await?
            .query("SELECT state, count(*) FROM jobs GROUP BY state")
            .fetch_all_as()
            .await?;
        counts.into_iter().map(|(state, jobs)| Ok((from_word(&state)?, jobs as u64))).collect()
    }

    /// Seconds since the submission of the job that has waited longest; 0 when none waits.
    ///
    /// # Errors
    /// [`StoreError::Database`].
    pub async fn oldest_queued_seconds(&self) -> Result<f64, StoreError> {
        let mut reader = self.reader().await?;
        let oldest: Option<Milliseconds> =
            reader.query("SELECT min(created) FROM jobs WHERE state = 'queued'").scalar().await?;
        let now = self.now(&mut reader).await?;
        Ok(oldest.map_or(0.0, |created| (now - created).max(0) as f64 / 1e3))
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
                "DELETE FROM jobs WHERE id = $1"
            } else {
                "UPDATE jobs SET delete_requested = 1 WHERE id = $1"
            };
            transaction.query(statement).bind(id).execute().await?;
            transaction.commit().await?;
            store.announce();
            Ok(terminal)
        })
        .await
    }

    async fn mark_canceled(&self, connection: &mut Connection, id: Uuid) -> Result<(), StoreError> {
        let now = self.now(connection).await?;
        connection
            .query(
                "UPDATE jobs SET cancel_requested = 1, \
             finished = CASE state WHEN 'queued' THEN $2 END, \
             state = CASE state WHEN 'queued' THEN 'canceled' ELSE state END \
             WHERE id = $1 AND state IN ('queued', 'running')",
            )
            .bind(id)
            .bind(now)
            .execute()
            .await?;
        Ok(())
    }

    /// The job that does this analysis: the one that is there, else a new one (true).
    ///
    /// On SQLite the caller holds the write lock, so what is looked up here cannot change before the insertion. On
    /// PostgreSQL another node may be as fast: the index `jobs_once` lets one of them in, and the other finds its job. Nodes
    /// that count a queue or what an owner has at the same moment may each let one more in than the limit allows.
    pub(super) async fn enqueue(
        &self,
        connection: &mut Connection,
        cloud: &CloudRecord,
        kind: JobKind,
        parameters: &Parameters,
    ) -> Result<(JobRecord, bool), StoreError> {
        let budget = Engine::memory_budget(connection, &self.settings).await?;
        let parameters = &parameters.fitted(cloud.points, cloud.dimension, cloud.faces, kind, budget);
        let memory = memory_within(budget, cloud.points, cloud.dimension, cloud.faces, kind, parameters);
        let chunk_points = if connection.is_postgres() {
            toasted_basis_chunk_points(parameters.bases)
        } else {
            basis_chunk_points(parameters.bases)
        };
        let bytes = result_bytes(cloud.points, kind, parameters.bases);
        let (kind, parameters) = (word(&kind)?, text_of(parameters)?);
        if let Some(job) = same_job(connection, cloud.id, &kind, &parameters).await? {
            return Ok((job, false));
        }
        if memory > budget {
            return Err(StoreError::OverBudget { need: memory, budget });
        }
        let owner = &cloud.owner;
        self.refuse_when_queue_full(connection, owner).await?;
        self.refuse_when_owner_full(connection, owner, bytes).await?;
        let (id, now) = (Uuid::now_v7(), self.now(connection).await?);
        let inserted = connection.query(
            "INSERT INTO jobs (id, owner, cloud_id, created, kind, parameters, memory, chunk_points, bytes, state) \
             VALUES ($1, $2, $3, $4, $5, $6, $7, $8, $9, 'queued') \
             ON CONFLICT (cloud_id, kind, parameters) \
             WHERE state IN ('queued', 'running', 'succeeded') AND cancel_requested = 0 DO NOTHING",
        )
        .bind(id)
        .bind(owner.name())
        .bind(cloud.id)
        .bind(now)
        .bind(&kind)
        .bind(&parameters)
        .bind(integer(memory))
        .bind(integer(chunk_points))
        .bind(integer(bytes))
        .execute()
        .await?;
        if inserted == 0 {
            // It may have ended between the two statements; whoever asks again gets a job of their own.
            let same = same_job(connection, cloud.id, &kind, &parameters).await?;
            return Ok((same.ok_or(StoreError::Busy)?, false));
        }
        Ok((job_with_id(connection, id).await?, true))
    }

    /// Refuses what would make the queue, or the owner's part of it, longer than it may be. An owner who has less than an
    /// equal share of a full queue is let in, so that it may become up to twice as long.
    pub(super) async fn refuse_when_queue_full(
        &self,
        connection: &mut Connection,
        owner: &Owner,
    ) -> Result<(), StoreError> {
        let (limit, own_limit) = (self.settings.queue_max, self.settings.queue_max_per_owner);
        let (queued, own, others): (i64, i64, i64) = connection
            .query(
                "SELECT (SELECT count(*) FROM jobs WHERE state = 'queued'), \
             (SELECT count(*) FROM jobs WHERE state = 'queued' AND owner = $1), \
             (SELECT count(DISTINCT owner) FROM jobs WHERE state = 'queued' AND owner <> $1)",
            )
            .bind(owner.name())
            .fetch_one_as()
            .await?;
        if own as u64 >= own_limit {
            return Err(StoreError::OwnerQueueFull { limit: own_limit });
        }
        let share = limit.div_ceil(others as u64 + 1);
        if queued as u64 >= limit && own as u64 >= share {
            return Err(StoreError::QueueFull { limit });
        }
        Ok(())
    }

    /// Refuses what would make an owner's clouds and results take more than they may.
    pub(super) async fn refuse_when_owner_full(
        &self,
        connection: &mut Connection,
        owner: &Owner,
        more: u64,
    ) -> Result<(), StoreError> {
        let limit = self.settings.stored_bytes_max_per_owner;
        if limit == u64::MAX {
            return Ok(());
        }
        let stored: i64 = connection
            .query(
                "SELECT CAST((SELECT coalesce(sum(bytes), 0) FROM clouds WHERE owner = $1) \
             + (SELECT coalesce(sum(bytes), 0) FROM jobs WHERE owner = $1 \
             AND state IN ('queued', 'running', 'succeeded')) AS BIGINT)",
            )
            .bind(owner.name())
            .scalar()
            .await?;
        let stored = stored as u64;
        if stored.saturating_add(more) > limit {
            return Err(StoreError::OwnerStorageFull { stored, more, limit });
        }
        Ok(())
    }
}

/// Parameters as they stand in a row: fields in the order of their declaration, numbers in their shortest form, so that equal
/// parameters are equal text.
///
/// What came after the first version is left out where it is not used. The same analysis is the same in databases of all
/// versions, and nodes of an older one, which refuse fields that they do not know, read it.
fn text_of(parameters: &Parameters) -> Result<String, StoreError> {
    let fields = |parameters: &Parameters| {
        serde_json::to_value(parameters).map_err(|error| StoreError::Database(error.to_string()))
    };
    let (mut used, unused) = (fields(parameters)?, fields(&Parameters::default())?);
    if let Some(used) = used.as_object_mut() {
        used.retain(|name, value| !LATER.contains(&name.as_str()) || unused.get(name) != Some(value));
    }
    to_json(&used)
}

/// The job that does this analysis, unless it failed or is being canceled.
async fn same_job(
    connection: &mut Connection,
    cloud: Uuid,
    kind: &str,
    parameters: &str,
) -> Result<Option<JobRecord>, StoreError> {
    let same = connection
        .query(concat!(
            select_jobs!(),
            "WHERE j.cloud_id = $1 AND j.kind = $2 AND j.parameters = $3 \
             AND j.state IN ('queued', 'running', 'succeeded') AND j.cancel_requested = 0"
        ))
        .bind(cloud)
        .bind(kind)
        .bind(parameters)
        .fetch_optional()
        .await?;
    let Some(row) = same else { return Ok(None) };
    let mut job = readable_job(&row)?;
    place(connection, std::slice::from_mut(&mut job)).await?;
    Ok(Some(job))
}

/// The largest id that comes before `cursor`; any at all without one.
pub(super) fn before(cursor: Option<Uuid>) -> Uuid {
    cursor.map_or(Uuid::max(), |cursor| Uuid::from_u128(cursor.as_u128().saturating_sub(1)))
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parameters_are_the_text_of_the_first_version_unless_they_use_what_came_later() {
        let first = r#"{"operator":"pb-mhb","dimension":2,"bases":100,"tolerance":0.0001,"t":null,"t_factor":null,"delta":null,"delta_factor":null,"epsilon":null,"distance":null,"parameterization":null,"paper":false,"isometric_cells":null,"truncation_compensation":null,"sheet_aware":null,"surface_distances":null,"moment_calibration":null,"heat_correction":null}"#;
        assert_eq!(text_of(&Parameters::default()).unwrap(), first);
        for used in [
            Parameters::default(),
            Parameters { exact: true, ..Parameters::default() },
            Parameters { solved_points: Some(5_000), ..Parameters::default() },
            Parameters { local_bandwidth: Some(false), ..Parameters::default() },
        ] {
            let read: Parameters = serde_json::from_str(&text_of(&used).unwrap()).unwrap();
            assert_eq!(read, used);
        }
    }
}

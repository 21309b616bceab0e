//! Submissions that clients have named, so that sending one again is not submitting it again.

use super::connection::{Connection, Row};
use super::rows::{cloud_with_id, flag, job_with_id};
use super::{Milliseconds, Owner, Store, StoreError, Submitted, detached};

/// Milliseconds after which a name is forgotten.
pub const REMEMBERED: Milliseconds = 24 * 60 * 60 * 1000;

/// What a name stands for.
#[derive(Debug, Clone, PartialEq)]
pub struct Remembered {
    /// SHA-256 of the request that was named.
    pub request: [u8; 32],
    /// What it was answered with; the records are as they are now.
    pub submitted: Submitted,
}

impl Store {
    /// What an owner submitted under a name in the last day; `None` when nothing was, or it has been deleted since.
    ///
    /// # Errors
    /// [`StoreError::Database`].
    pub async fn remembered(&self, owner: &Owner, name: &str) -> Result<Option<Remembered>, StoreError> {
        let mut snapshot = self.read().await?;
        let since = self.now(&mut snapshot).await? - REMEMBERED;
        remembered(&mut snapshot, owner, name, since).await
    }

    /// Names a submission. Of two requests under one name at the same time the first counts: it is returned.
    ///
    /// # Errors
    /// [`StoreError::NotFound`] when what was submitted has been deleted meanwhile; [`StoreError::Database`].
    pub async fn remember(
        &self,
        owner: &Owner,
        name: String,
        request: [u8; 32],
        submitted: Submitted,
    ) -> Result<Remembered, StoreError> {
        let (store, owner) = (self.clone(), owner.clone());
        detached(async move {
            let mut transaction = store.write().await?;
            let now = store.now(&mut transaction).await?;
            transaction.query("DELETE FROM idempotency_keys WHERE created < $1")
                .bind(now - REMEMBERED)
                .execute()
                .await?;
            transaction.query(
                "INSERT INTO idempotency_keys (name, request, created, cloud_id, job_id, cloud_created, job_created, owner) \
                 SELECT $1, $2, $3, $4, $5, $6, $7, $8 WHERE EXISTS (SELECT 1 FROM clouds WHERE id = $4) \
                 AND ($5 IS NULL OR EXISTS (SELECT 1 FROM jobs WHERE id = $5)) ON CONFLICT (owner, name) DO NOTHING",
            )
            .bind(&name)
            .bind(request.as_slice())
            .bind(now)
            .bind(submitted.cloud.id)
            .bind(submitted.job.as_ref().map(|job| job.id))
            .bind(i64::from(submitted.cloud_created))
            .bind(i64::from(submitted.job_created))
            .bind(owner.name())
            .execute()
            .await?;
            let found = remembered(&mut transaction, &owner, &name, now - REMEMBERED).await?;
            transaction.commit().await?;
            found.ok_or(StoreError::NotFound)
        })
        .await
    }
}

async fn remembered(
    connection: &mut Connection,
    owner: &Owner,
    name: &str,
    since: Milliseconds,
) -> Result<Option<Remembered>, StoreError> {
    let row = connection
        .query("SELECT * FROM idempotency_keys WHERE owner = $1 AND name = $2 AND created >= $3")
        .bind(owner.name())
        .bind(name)
        .bind(since)
        .fetch_optional()
        .await?;
    let Some(row) = row else { return Ok(None) };
    let cloud = cloud_with_id(connection, row.try_get("cloud_id")?).await?;
    let job = match row.try_get("job_id")? {
        Some(id) => Some(job_with_id(connection, id).await?),
        None => None,
    };
    let (cloud_created, job_created) = (flag(&row, "cloud_created")?, flag(&row, "job_created")?);
    let submitted = Submitted { cloud, job, cloud_created, job_created };
    Ok(Some(Remembered { request: request(&row)?, submitted }))
}

fn request(row: &Row) -> Result<[u8; 32], StoreError> {
    let bytes: Vec<u8> = row.try_get("request")?;
    bytes
        .try_into()
        .map_err(|_| StoreError::Damaged("the request of an idempotency key is not a digest".to_owned()))
}

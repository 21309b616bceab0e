//! Deletes jobs and clouds that are older than they are kept.

use uuid::Uuid;

use super::{Milliseconds, Store, StoreError, detached};

/// Clouds that were stored before `$1` and have no job.
macro_rules! without_jobs {
    () => {
        "SELECT c.id FROM clouds c WHERE c.created < $1 \
         AND NOT EXISTS (SELECT 1 FROM jobs j WHERE j.cloud_id = c.id) "
    };
}

impl Store {
    /// Deletes the terminal job that ended first, with its result, if it ended longer than `age` ago. Returns whether
    /// there was one. One at a time, because deleting a result takes long and other writers wait.
    ///
    /// # Errors
    /// [`StoreError::Database`].
    pub async fn expire_job(&self, age: Milliseconds) -> Result<bool, StoreError> {
        let store = self.clone();
        detached(async move {
            let mut write = store.write().await?;
            let before = store.now(&mut write).await?.saturating_sub(age);
            let deleted = write
                .query(
                    "DELETE FROM jobs WHERE id = (SELECT id FROM jobs WHERE finished < $1 ORDER BY finished LIMIT 1)",
                )
                .bind(before)
                .execute()
                .await?;
            write.commit().await?;
            if deleted > 0 {
                store.announce();
            }
            Ok(deleted > 0)
        })
        .await
    }

    /// Deletes the oldest cloud that was stored longer than `age` ago and has no job. Returns whether there was one.
    ///
    /// # Errors
    /// [`StoreError::Database`].
    pub async fn expire_cloud(&self, age: Milliseconds) -> Result<bool, StoreError> {
        let store = self.clone();
        detached(async move {
            let mut write = store.write().await?;
            let before = store.now(&mut write).await?.saturating_sub(age);
            let oldest: Option<Uuid> = write
                .query_either(
                    concat!(without_jobs!(), "ORDER BY c.id LIMIT 1"),
                    concat!(without_jobs!(), "ORDER BY c.id LIMIT 1 FOR UPDATE SKIP LOCKED"),
                )
                .bind(before)
                .scalar_optional()
                .await?;
            let Some(oldest) = oldest else { return Ok(false) };
            // Another node may have queued a job on it before it was locked.
            let deleted = write
                .query("DELETE FROM clouds WHERE id = $1 AND NOT EXISTS (SELECT 1 FROM jobs WHERE cloud_id = $1)")
                .bind(oldest)
                .execute()
                .await?;
            write.commit().await?;
            store.announce();
            Ok(deleted > 0)
        })
        .await
    }
}

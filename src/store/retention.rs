//! Deletes jobs and clouds that are older than they are kept.

use super::{Milliseconds, Store, StoreError, detached};

impl Store {
    /// Deletes the terminal job that ended first, with its result, if it ended longer than `age` ago. Returns whether
    /// there was one. One at a time, because deleting a result takes long and other writers wait.
    ///
    /// # Errors
    /// [`StoreError::Database`].
    pub async fn expire_job(&self, age: Milliseconds) -> Result<bool, StoreError> {
        self.expire(
            "DELETE FROM jobs WHERE id = (SELECT id FROM jobs WHERE finished < ?1 ORDER BY finished LIMIT 1)",
            age,
        )
        .await
    }

    /// Deletes the oldest cloud that was stored longer than `age` ago and has no job. Returns whether there was one.
    ///
    /// # Errors
    /// [`StoreError::Database`].
    pub async fn expire_cloud(&self, age: Milliseconds) -> Result<bool, StoreError> {
        self.expire(
            "DELETE FROM clouds WHERE id = (SELECT c.id FROM clouds c WHERE c.created < ?1 \
             AND NOT EXISTS (SELECT 1 FROM jobs j WHERE j.cloud_id = c.id) ORDER BY c.id LIMIT 1)",
            age,
        )
        .await
    }

    async fn expire(&self, statement: &'static str, age: Milliseconds) -> Result<bool, StoreError> {
        let store = self.clone();
        detached(async move {
            let before = store.now().saturating_sub(age);
            let mut write = store.write().await?;
            let deleted = sqlx::query(statement).bind(before).execute(&mut *write).await?;
            write.commit().await?;
            if deleted.rows_affected() > 0 {
                store.announce();
            }
            Ok(deleted.rows_affected() > 0)
        })
        .await
    }
}

//! Reads free space and shrinks the database file.

use super::engine::Engine;
use super::{Space, Store, StoreError, detached, sqlite};

impl Store {
    /// What the database takes of its disk, and what is free.
    ///
    /// # Errors
    /// [`StoreError::Database`].
    pub async fn space(&self) -> Result<Space, StoreError> {
        self.engine.space().await
    }

    /// Refuses to go on when there is less room, on the disk and in free pages of the file, than must stay free.
    ///
    /// # Errors
    /// [`StoreError::StorageFull`], [`StoreError::Database`].
    pub async fn refuse_when_disk_full(&self) -> Result<(), StoreError> {
        let refused = self.engine.refuse_when_disk_full().await;
        if matches!(refused, Err(StoreError::StorageFull)) {
            self.last_commit.forget();
        }
        refused
    }

    /// Moves up to `pages` pages from the end of the file into its free pages, so that the file becomes shorter with the
    /// next checkpoint. Does nothing to databases made before version 0.2, which [`Store::compact`] prepares for it, and to
    /// those of a server, which does such things itself.
    ///
    /// # Errors
    /// [`StoreError::Database`].
    pub async fn shrink(&self, pages: u32) -> Result<(), StoreError> {
        if matches!(self.engine, Engine::Postgres(_)) {
            return Ok(());
        }
        let store = self.clone();
        detached(async move {
            let mut write = store.write().await?;
            write.query_composed(sqlite::shrinking(pages)).execute().await?;
            write.commit().await
        })
        .await
    }

    /// Whether the file can be made shorter while it is served; `None` when a server has it.
    ///
    /// # Errors
    /// [`StoreError::Database`].
    pub async fn can_shrink(&self) -> Result<Option<bool>, StoreError> {
        match &self.engine {
            Engine::Sqlite(database) => database.can_shrink().await.map(Some),
            Engine::Postgres(_) => Ok(None),
        }
    }
}

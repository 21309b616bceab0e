//! Transactions that write: one at a time, on a connection that is never used again after anything went wrong in it.
//!
//! SQLite rolls back by itself when the disk is full, on an I/O error and without memory
//! (<https://www.sqlite.org/lang_transaction.html>, "Response to errors within a transaction"). A connection pool that
//! counts its transactions does not notice, and from then on refuses to begin another. So these transactions are begun
//! and committed by statements of our own, and a connection whose transaction was not committed is closed: SQLite then
//! rolls back whatever is left, and the next writer opens a connection that has seen no error.

use std::ops::{Deref, DerefMut};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use sqlx::pool::PoolConnection;
use sqlx::{Sqlite, SqliteConnection};

use super::{Store, StoreError, detached};

/// Age at which a committed write no longer proves that the next one will succeed.
const RECENT: Duration = Duration::from_secs(2);

/// When the last transaction was committed; `None` after one that could not be.
#[derive(Debug, Clone, Default)]
pub(super) struct LastCommit(Arc<Mutex<Option<Instant>>>);

impl LastCommit {
    fn set(&self, committed: Option<Instant>) {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner) = committed;
    }

    /// Something was refused for want of room: whether a write succeeds must be tried anew.
    pub(super) fn forget(&self) {
        self.set(None);
    }

    fn is_recent(&self) -> bool {
        let last = *self.0.lock().unwrap_or_else(PoisonError::into_inner);
        last.is_some_and(|committed| committed.elapsed() < RECENT)
    }
}

/// A transaction that holds the write lock. Dropped without [`Self::commit`], it has changed nothing.
pub(super) struct Write {
    connection: PoolConnection<Sqlite>,
    last: LastCommit,
    committed: bool,
}

impl Write {
    /// Makes the transaction's changes durable.
    pub(super) async fn commit(mut self) -> Result<(), StoreError> {
        let result = sqlx::query("COMMIT").execute(&mut *self.connection).await;
        self.committed = result.is_ok();
        self.last.set(self.committed.then(Instant::now));
        result?;
        Ok(())
    }
}

impl Deref for Write {
    type Target = SqliteConnection;

    fn deref(&self) -> &SqliteConnection {
        &self.connection
    }
}

impl DerefMut for Write {
    fn deref_mut(&mut self) -> &mut SqliteConnection {
        &mut self.connection
    }
}

impl Drop for Write {
    fn drop(&mut self) {
        if !self.committed {
            self.connection.close_on_drop();
            self.last.set(None);
        }
    }
}

impl Store {
    /// Begins a transaction that holds the write lock from its start: one that reads first and asks for the lock later
    /// fails at once when another wrote in between, whatever the busy timeout.
    pub(super) async fn write(&self) -> Result<Write, StoreError> {
        let connection = self.writer.acquire().await?;
        let mut write = Write { connection, last: self.last_commit.clone(), committed: false };
        if let Err(error) = sqlx::query("BEGIN IMMEDIATE").execute(&mut *write.connection).await {
            self.last_commit.set(None);
            return Err(error.into());
        }
        Ok(write)
    }

    /// Proves that the database takes writes: by one that was committed within the last seconds, otherwise by a small one
    /// of its own. So the proof does not queue behind the writes of a busy service.
    ///
    /// # Errors
    /// [`StoreError::Database`], [`StoreError::StorageFull`], [`StoreError::Busy`].
    pub async fn probe(&self) -> Result<(), StoreError> {
        if self.last_commit.is_recent() {
            return Ok(());
        }
        let store = self.clone();
        detached(async move {
            let mut write = store.write().await?;
            sqlx::query(
                "INSERT INTO probes (id, beats) VALUES (1, 1) ON CONFLICT (id) DO UPDATE SET beats = beats + 1",
            )
            .execute(&mut *write)
            .await?;
            write.commit().await
        })
        .await
    }
}

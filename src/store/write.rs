//! Transactions that write, and the proof that they can.
//!
//! On SQLite they follow each other, on a connection that is never used again after anything went wrong in it. SQLite
//! rolls back by itself when the disk is full, on an I/O error and without memory
//! (<https://www.sqlite.org/lang_transaction.html>, "Response to errors within a transaction"). A connection pool that
//! counts its transactions does not notice, and from then on refuses to begin another. So these transactions are begun
//! and committed by statements of our own, and a connection whose transaction was not committed is closed: SQLite then
//! rolls back whatever is left, and the next writer opens a connection that has seen no error.
//!
//! On PostgreSQL they run beside each other, in this process and in others. What one decides by, it locks: the row of a job
//! ([`Store::check_claim`]), the row of a cloud that is to be deleted.

use std::ops::{Deref, DerefMut};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use super::connection::Connection;
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

    /// Something was refused because the disk is full: whether a write succeeds must be tried anew.
    pub(super) fn forget(&self) {
        self.set(None);
    }

    fn is_recent(&self) -> bool {
        let last = *self.0.lock().unwrap_or_else(PoisonError::into_inner);
        last.is_some_and(|committed| committed.elapsed() < RECENT)
    }
}

/// Remembers when the transaction was committed, or that it was not.
struct Outcome {
    last: LastCommit,
    committed: bool,
}

impl Drop for Outcome {
    fn drop(&mut self) {
        self.last.set(self.committed.then(Instant::now));
    }
}

/// A transaction that writes. Dropped without [`Self::commit`], it has changed nothing.
pub(super) struct Write {
    connection: Connection,
    outcome: Outcome,
}

impl Write {
    /// Makes the transaction's changes durable.
    pub(super) async fn commit(self) -> Result<(), StoreError> {
        let Self { connection, mut outcome } = self;
        connection.commit().await?;
        outcome.committed = true;
        Ok(())
    }
}

impl Deref for Write {
    type Target = Connection;

    fn deref(&self) -> &Connection {
        &self.connection
    }
}

impl DerefMut for Write {
    fn deref_mut(&mut self) -> &mut Connection {
        &mut self.connection
    }
}

impl Store {
    /// Begins a transaction. On SQLite it holds the write lock from its start: one that reads first and asks for the lock
    /// later fails at once when another wrote in between, whatever the busy timeout.
    ///
    /// It is begun and ended in a task of its own, for a dropped beginning would leave an open transaction behind
    /// (<https://github.com/launchbadge/sqlx/issues/4385>): see [`detached`].
    pub(super) async fn write(&self) -> Result<Write, StoreError> {
        let outcome = Outcome { last: self.last_commit.clone(), committed: false };
        let connection = self.engine.begin().await?;
        Ok(Write { connection, outcome })
    }

    /// Proves that the database takes writes: by one that was committed within the last seconds, otherwise by a small one
    /// of its own. So the proof does not queue behind the writes of a busy service.
    ///
    /// # Errors
    /// [`StoreError::Database`], [`StoreError::StorageFull`], [`StoreError::Busy`], [`StoreError::Unreachable`].
    pub async fn probe(&self) -> Result<(), StoreError> {
        if self.last_commit.is_recent() {
            return Ok(());
        }
        let store = self.clone();
        detached(async move {
            let mut write = store.write().await?;
            write
                .query(
                    "INSERT INTO probes (id, beats) VALUES (1, 1) \
                     ON CONFLICT (id) DO UPDATE SET beats = probes.beats + 1",
                )
                .execute()
                .await?;
            write.commit().await
        })
        .await
    }
}

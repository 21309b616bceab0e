//! A transaction that holds the write lock, on a connection that is closed unless it is committed.

use std::time::Duration;

use sqlx::pool::PoolConnection;
use sqlx::{AssertSqlSafe, Sqlite, SqliteConnection};

use crate::store::StoreError;

pub(in crate::store) struct Writer {
    connection: PoolConnection<Sqlite>,
    committed: bool,
}

impl Writer {
    /// Waits for as long as `patience` for the file's lock, which another process may hold.
    pub(in crate::store) async fn begin(
        connection: PoolConnection<Sqlite>,
        patience: Duration,
    ) -> Result<Self, StoreError> {
        let mut writer = Self { connection, committed: false };
        let timeout = AssertSqlSafe(format!("PRAGMA busy_timeout = {}", patience.as_millis()));
        sqlx::query(timeout).persistent(false).execute(&mut *writer.connection).await?;
        sqlx::query("BEGIN IMMEDIATE").execute(&mut *writer.connection).await?;
        Ok(writer)
    }

    pub(in crate::store) async fn commit(mut self) -> Result<(), StoreError> {
        sqlx::query("COMMIT").execute(&mut *self.connection).await?;
        self.committed = true;
        Ok(())
    }

    pub(in crate::store) fn connection(&mut self) -> &mut SqliteConnection {
        &mut self.connection
    }
}

impl Drop for Writer {
    fn drop(&mut self) {
        if !self.committed {
            self.connection.close_on_drop();
        }
    }
}

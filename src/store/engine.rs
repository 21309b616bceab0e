//! The two engines behind the store: an SQLite file of this process, or a PostgreSQL database of many.

use super::connection::Connection;
use super::settings::{Time, system_time};
use super::{Milliseconds, Space, StoreError, StoreSettings, Subject, postgres, sqlite};

/// Connections to the database.
#[derive(Debug, Clone)]
pub(super) enum Engine {
    Sqlite(sqlite::Database),
    Postgres(postgres::Database),
}

impl Engine {
    /// A connection that reads records.
    pub(super) async fn reader(&self) -> Result<Connection, StoreError> {
        Ok(match self {
            Self::Sqlite(database) => Connection::Sqlite(database.readers.acquire().await?),
            Self::Postgres(database) => {
                Connection::Postgres(postgres::answer(database.records().acquire()).await?)
            }
        })
    }

    /// A transaction in which several statements read arrays from one snapshot.
    pub(super) async fn snapshot(&self) -> Result<Connection, StoreError> {
        Ok(match self {
            Self::Sqlite(database) => Connection::SqliteSnapshot(database.arrays.begin().await?),
            Self::Postgres(database) => Connection::PostgresTransaction(database.snapshot().await?),
        })
    }

    /// A transaction that writes. The caller runs to its end whatever happens to whoever asked for it.
    pub(super) async fn begin(&self) -> Result<Connection, StoreError> {
        match self {
            Self::Sqlite(database) => Ok(Connection::SqliteWriter(database.begin().await?)),
            Self::Postgres(database) => {
                Ok(Connection::PostgresTransaction(postgres::answer(database.records().begin()).await?))
            }
        }
    }

    /// Refuses to go on when there is less room than must stay free. A PostgreSQL server says so itself when a write fails.
    pub(super) async fn refuse_when_disk_full(&self) -> Result<(), StoreError> {
        match self {
            Self::Sqlite(database) => database.refuse_when_disk_full().await,
            Self::Postgres(_) => Ok(()),
        }
    }

    pub(super) async fn space(&self) -> Result<Space, StoreError> {
        match self {
            Self::Sqlite(database) => database.space().await,
            Self::Postgres(database) => database.space().await,
        }
    }

    /// The database's clock, and the moment before which a lease must have ended to count as run out.
    pub(super) async fn time(
        connection: &mut Connection,
        settings: &StoreSettings,
    ) -> Result<Time, StoreError> {
        match (settings.clock.told(), connection.postgres()) {
            (None, Some(connection)) => postgres::time(connection, settings.lease).await,
            (told, _) => {
                let now = told.unwrap_or_else(system_time);
                Ok(Time { now, leases_end: now })
            }
        }
    }

    /// Tells other nodes, where there may be any.
    pub(super) fn tell(&self, subject: Subject) {
        if let Self::Postgres(database) = self {
            database.tell(subject);
        }
    }

    /// Bytes that the analyses running at one time may be estimated to take, on the largest node that could run one.
    pub(super) async fn memory_budget(
        connection: &mut Connection,
        settings: &StoreSettings,
    ) -> Result<u64, StoreError> {
        let now = Self::time(connection, settings).await?.now;
        match connection.postgres() {
            None => Ok(settings.memory_budget),
            Some(connection) => postgres::memory_budget(connection, settings, now).await,
        }
    }

    /// Whether a node of another version computes jobs of this database. An SQLite file has one node.
    pub(super) async fn other_version_computes(
        connection: &mut Connection,
        now: Milliseconds,
    ) -> Result<bool, StoreError> {
        match connection.postgres() {
            None => Ok(false),
            Some(connection) => postgres::other_version_computes(connection, now).await,
        }
    }

    pub(super) async fn close(&self) {
        match self {
            Self::Sqlite(database) => database.close().await,
            Self::Postgres(database) => database.close().await,
        }
    }
}

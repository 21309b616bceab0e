//! A connection to either engine, and statements that mean the same on both.
//!
//! Both drivers number parameters as `$1`, so that a statement is one text unless the engines' dialects differ; then both
//! texts stand side by side, at [`Connection::query_either`]. Types are chosen so that both drivers read and write the same
//! Rust types: counts and times are 64-bit integers, flags integers of 0 or 1, JSON is text.

use std::borrow::Cow;

use futures_util::stream::{BoxStream, StreamExt, TryStreamExt};
use sqlx::pool::PoolConnection;
use sqlx::postgres::{PgArguments, PgRow};
use sqlx::query::Query as SqlxQuery;
use sqlx::sqlite::{SqliteArguments, SqliteRow};
use sqlx::{
    AssertSqlSafe, ColumnIndex, Decode, Encode, Error, FromRow, PgConnection, Postgres, Row as _, Sqlite,
    SqliteConnection, Transaction, Type,
};

use super::{StoreError, postgres, sqlite};

/// A connection, or a transaction on one.
pub(super) enum Connection {
    Sqlite(PoolConnection<Sqlite>),
    SqliteWriter(sqlite::Writer),
    SqliteSnapshot(Transaction<'static, Sqlite>),
    Postgres(PoolConnection<Postgres>),
    PostgresTransaction(Transaction<'static, Postgres>),
}

impl Connection {
    /// A statement that both engines understand.
    pub(super) fn query(&mut self, text: &'static str) -> Query<'_> {
        self.query_either(text, text)
    }

    /// A statement in the dialects of SQLite and of PostgreSQL.
    pub(super) fn query_either(&mut self, sqlite: &'static str, postgres: &'static str) -> Query<'_> {
        match self.driver() {
            Driver::Sqlite(connection) => Query::Sqlite(connection, sqlx::query(sqlite)),
            Driver::Postgres(connection) => Query::Postgres(connection, sqlx::query(postgres)),
        }
    }

    /// A statement put together from constant parts.
    pub(super) fn query_composed(&mut self, text: String) -> Query<'_> {
        let text = AssertSqlSafe(text);
        match self.driver() {
            Driver::Sqlite(connection) => Query::Sqlite(connection, sqlx::query(text)),
            Driver::Postgres(connection) => Query::Postgres(connection, sqlx::query(text)),
        }
    }

    /// The PostgreSQL connection, if it is one.
    pub(super) fn postgres(&mut self) -> Option<&mut PgConnection> {
        match self.driver() {
            Driver::Sqlite(_) => None,
            Driver::Postgres(connection) => Some(connection),
        }
    }

    pub(super) fn is_postgres(&self) -> bool {
        matches!(self, Self::Postgres(_) | Self::PostgresTransaction(_))
    }

    /// Text as the engine can hold it: PostgreSQL's has no zero character.
    pub(super) fn text<'t>(&self, text: &'t str) -> Cow<'t, str> {
        if self.is_postgres() && text.contains('\0') {
            Cow::Owned(text.replace('\0', "\u{fffd}"))
        } else {
            Cow::Borrowed(text)
        }
    }

    /// Ends a transaction that writes, for good.
    pub(super) async fn commit(self) -> Result<(), StoreError> {
        match self {
            Self::SqliteWriter(writer) => writer.commit().await,
            Self::SqliteSnapshot(transaction) => Ok(transaction.commit().await?),
            Self::PostgresTransaction(transaction) => Ok(postgres::answer(transaction.commit()).await?),
            Self::Sqlite(_) | Self::Postgres(_) => Ok(()),
        }
    }

    pub(super) fn driver(&mut self) -> Driver<'_> {
        match self {
            Self::Sqlite(connection) => Driver::Sqlite(connection),
            Self::SqliteWriter(writer) => Driver::Sqlite(writer.connection()),
            Self::SqliteSnapshot(transaction) => Driver::Sqlite(transaction),
            Self::Postgres(connection) => Driver::Postgres(connection),
            Self::PostgresTransaction(transaction) => Driver::Postgres(transaction),
        }
    }
}

pub(super) enum Driver<'c> {
    Sqlite(&'c mut SqliteConnection),
    Postgres(&'c mut PgConnection),
}

/// What both drivers can be given.
pub(super) trait Value<'t>:
    Encode<'t, Sqlite> + Type<Sqlite> + Encode<'t, Postgres> + Type<Postgres>
{
}

impl<'t, T> Value<'t> for T where T: Encode<'t, Sqlite> + Type<Sqlite> + Encode<'t, Postgres> + Type<Postgres> {}

/// A statement on its connection, with the values bound so far.
#[must_use = "a statement does nothing until it is executed"]
pub(super) enum Query<'c> {
    Sqlite(&'c mut SqliteConnection, SqlxQuery<'static, Sqlite, SqliteArguments>),
    Postgres(&'c mut PgConnection, SqlxQuery<'static, Postgres, PgArguments>),
}

impl<'c> Query<'c> {
    pub(super) fn bind<'t>(self, value: impl Value<'t>) -> Self {
        match self {
            Self::Sqlite(connection, query) => Self::Sqlite(connection, query.bind(value)),
            Self::Postgres(connection, query) => Self::Postgres(connection, query.bind(value)),
        }
    }

    /// The number of rows that were changed.
    pub(super) async fn execute(self) -> Result<u64, Error> {
        Ok(match self {
            Self::Sqlite(connection, query) => query.execute(connection).await?.rows_affected(),
            Self::Postgres(connection, query) => {
                postgres::answer(query.execute(connection)).await?.rows_affected()
            }
        })
    }

    pub(super) async fn fetch_one(self) -> Result<Row, Error> {
        self.fetch_optional().await?.ok_or(Error::RowNotFound)
    }

    pub(super) async fn fetch_optional(self) -> Result<Option<Row>, Error> {
        Ok(match self {
            Self::Sqlite(connection, query) => query.fetch_optional(connection).await?.map(Row::Sqlite),
            Self::Postgres(connection, query) => {
                postgres::answer(query.fetch_optional(connection)).await?.map(Row::Postgres)
            }
        })
    }

    pub(super) async fn fetch_all(self) -> Result<Vec<Row>, Error> {
        self.fetch().try_collect().await
    }

    pub(super) fn fetch(self) -> BoxStream<'c, Result<Row, Error>> {
        match self {
            Self::Sqlite(connection, query) => query.fetch(connection).map_ok(Row::Sqlite).boxed(),
            Self::Postgres(connection, query) => {
                postgres::answers(query.fetch(connection)).map_ok(Row::Postgres).boxed()
            }
        }
    }

    /// The columns of the only row.
    pub(super) async fn fetch_one_as<T: Columns>(self) -> Result<T, Error> {
        self.fetch_one().await?.columns()
    }

    pub(super) async fn fetch_all_as<T: Columns>(self) -> Result<Vec<T>, Error> {
        self.fetch_all().await?.iter().map(Row::columns).collect()
    }

    /// The only column of the only row.
    pub(super) async fn scalar<T>(self) -> Result<T, Error>
    where
        (T,): Columns,
    {
        Ok(self.fetch_one_as::<(T,)>().await?.0)
    }

    pub(super) async fn scalar_optional<T>(self) -> Result<Option<T>, Error>
    where
        (T,): Columns,
    {
        let row = self.fetch_optional().await?;
        Ok(row.map(|row| row.columns::<(T,)>()).transpose()?.map(|(value,)| value))
    }

    pub(super) async fn scalars<T>(self) -> Result<Vec<T>, Error>
    where
        (T,): Columns,
    {
        Ok(self.fetch_all_as::<(T,)>().await?.into_iter().map(|(value,)| value).collect())
    }
}

/// What a whole row can be read as: a tuple of its columns.
pub(super) trait Columns: for<'r> FromRow<'r, SqliteRow> + for<'r> FromRow<'r, PgRow> {}

impl<T> Columns for T where T: for<'r> FromRow<'r, SqliteRow> + for<'r> FromRow<'r, PgRow> {}

/// A row of a result.
pub(super) enum Row {
    Sqlite(SqliteRow),
    Postgres(PgRow),
}

impl Row {
    /// A column, by its name or its place.
    pub(super) fn try_get<'r, T, I>(&'r self, column: I) -> Result<T, Error>
    where
        T: Decode<'r, Sqlite> + Type<Sqlite> + Decode<'r, Postgres> + Type<Postgres>,
        I: ColumnIndex<SqliteRow> + ColumnIndex<PgRow>,
    {
        match self {
            Self::Sqlite(row) => row.try_get(column),
            Self::Postgres(row) => row.try_get(column),
        }
    }

    fn columns<T: Columns>(&self) -> Result<T, Error> {
        match self {
            Self::Sqlite(row) => T::from_row(row),
            Self::Postgres(row) => T::from_row(row),
        }
    }
}

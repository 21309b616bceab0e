//! Many rows with arrays in them: on SQLite one insertion each, on PostgreSQL a stream of rows in its binary format, which is
//! three times as fast.

use sqlx::postgres::PgCopyIn;
use sqlx::{PgConnection, SqliteConnection};
use uuid::Uuid;

use super::StoreError;
use super::connection::{Connection, Driver};
use super::postgres;

/// Bytes that are gathered before they are sent.
const SENT_BYTES: usize = 1 << 20;

/// What begins and ends a stream of rows
/// (<https://www.postgresql.org/docs/current/sql-copy.html>, "Binary Format"): signature, no flags, no extension; a row of
/// -1 columns.
const HEAD: &[u8] = b"PGCOPY\n\xff\r\n\0\0\0\0\0\0\0\0\0";
const TAIL: &[u8] = &(-1_i16).to_be_bytes();

/// Where rows go to: as an insertion of one row, and as the beginning of a stream.
#[derive(Debug, Clone, Copy)]
pub(super) struct Destination {
    insert: &'static str,
    copy: &'static str,
}

impl Destination {
    /// A stream into PostgreSQL only.
    pub(super) const fn copying(copy: &'static str) -> Self {
        Self { insert: "", copy }
    }
}

macro_rules! destination {
    ($columns:literal, $places:literal) => {
        Destination {
            insert: concat!("INSERT INTO ", $columns, " VALUES ", $places),
            copy: concat!("COPY ", $columns, " FROM STDIN (FORMAT BINARY)"),
        }
    };
}

pub(super) const CLOUD_CHUNKS: Destination =
    destination!("cloud_chunks (cloud_id, part, chunk, encoding, data)", "($1, $2, $3, $4, $5)");
pub(super) const BASES: Destination = destination!("bases (job_id, idx, digest)", "($1, $2, $3)");
pub(super) const BASIS_CHUNKS: Destination =
    destination!("basis_chunks (job_id, chunk, idx, checksum, data)", "($1, $2, $3, $4, $5)");
pub(super) const ARRAY_CHUNKS: Destination =
    destination!("array_chunks (job_id, name, chunk, checksum, data)", "($1, $2, $3, $4, $5)");

/// A value of a row.
pub(super) enum Field {
    Uuid(Uuid),
    Integer(i64),
    Text(String),
    Bytes(Vec<u8>),
    Real(f64),
    Null,
}

impl Field {
    /// Its length and its bytes, as in a stream.
    fn append(&self, row: &mut Vec<u8>) {
        let number;
        let bytes: &[u8] = match self {
            Self::Uuid(id) => id.as_bytes(),
            Self::Integer(integer) => {
                number = integer.to_be_bytes();
                &number
            }
            Self::Text(text) => text.as_bytes(),
            Self::Bytes(bytes) => bytes,
            Self::Real(real) => {
                number = real.to_be_bytes();
                &number
            }
            Self::Null => return row.extend((-1_i32).to_be_bytes()),
        };
        row.extend((bytes.len() as u32).to_be_bytes());
        row.extend(bytes);
    }
}

/// Takes rows until it is finished. Dropped before, it takes the transaction's success with it.
pub(super) enum Rows<'c> {
    Sqlite(&'c mut SqliteConnection, &'static str),
    Postgres(PgCopyIn<&'c mut PgConnection>, Vec<u8>),
}

impl<'c> Rows<'c> {
    pub(super) async fn into(
        connection: &'c mut Connection,
        destination: Destination,
    ) -> Result<Self, StoreError> {
        Ok(match connection.driver() {
            Driver::Sqlite(connection) => Self::Sqlite(connection, destination.insert),
            Driver::Postgres(connection) => {
                let stream = postgres::answer(connection.copy_in_raw(destination.copy)).await?;
                Self::Postgres(stream, HEAD.to_vec())
            }
        })
    }

    pub(super) async fn put<const N: usize>(&mut self, fields: [Field; N]) -> Result<(), StoreError> {
        match self {
            Self::Sqlite(connection, insert) => {
                let mut query = sqlx::query(*insert);
                for field in fields {
                    query = match field {
                        Field::Uuid(id) => query.bind(id),
                        Field::Integer(integer) => query.bind(integer),
                        Field::Text(text) => query.bind(text),
                        Field::Bytes(bytes) => query.bind(bytes),
                        Field::Real(real) => query.bind(real),
                        Field::Null => query.bind(None::<i64>),
                    };
                }
                query.execute(&mut **connection).await?;
            }
            Self::Postgres(..) => self.stream(&fields).await?,
        }
        Ok(())
    }

    /// A row of as many columns as a table has, into PostgreSQL.
    pub(super) async fn stream(&mut self, fields: &[Field]) -> Result<(), StoreError> {
        let Self::Postgres(stream, gathered) = self else { return Ok(()) };
        gathered.extend((fields.len() as u16).to_be_bytes());
        for field in fields {
            field.append(gathered);
        }
        if gathered.len() >= SENT_BYTES {
            postgres::answer(stream.send(&gathered[..])).await?;
            gathered.clear();
        }
        Ok(())
    }

    pub(super) async fn finish(self) -> Result<(), StoreError> {
        if let Self::Postgres(mut stream, mut gathered) = self {
            gathered.extend(TAIL);
            postgres::answer(stream.send(gathered)).await?;
            postgres::answer(stream.finish()).await?;
        }
        Ok(())
    }
}

//! From an SQLite file to a PostgreSQL database: clouds, jobs and results, record by record, each checked once it is there.
//!
//! A record is one transaction of the new database, so that a move that was broken off goes on where it ended. The file keeps
//! everything; jobs that ran when its service ended wait again.

use futures_util::TryStreamExt;
use uuid::Uuid;

use super::bulk::{Destination, Field, Rows};
use super::connection::Row;
use super::engine::Engine;
use super::{DatabaseLock, Milliseconds, Store, StoreError};
use crate::analysis::JobKind;

/// A node that was seen within this time may be serving.
const LIVING: Milliseconds = 60_000;

/// What was copied.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Moved {
    /// Clouds, and of these those that an earlier attempt had brought over.
    pub clouds: u64,
    /// Jobs with their results.
    pub jobs: u64,
    /// Clouds and jobs that were there from an earlier attempt.
    pub found: u64,
}

/// Type of a column.
#[derive(Clone, Copy)]
enum Kind {
    Uuid,
    Integer,
    Real,
    Text,
    Bytes,
}

/// A table as it is copied: rows of one cloud, job or owner.
struct Table {
    select: &'static str,
    destination: Destination,
    kinds: &'static [Kind],
}

macro_rules! table {
    ($name:literal, $columns:literal, $condition:literal, [$($kind:ident),*]) => {
        Table {
            select: concat!("SELECT ", $columns, " FROM ", $name, " WHERE ", $condition),
            destination: Destination::copying(concat!("COPY ", $name, " (", $columns, ") FROM STDIN (FORMAT BINARY)")),
            kinds: &[$(Kind::$kind),*],
        }
    };
}

const CLOUD: [Table; 2] = [
    table!(
        "clouds",
        "id, owner, name, created, digest, points, dimension, nonfinite, duplicates, bounding_box, coordinate_type, \
         fields, faces, grids, origin, bytes, checksum, examined",
        "id = $1",
        [
            Uuid, Text, Text, Integer, Bytes, Integer, Integer, Integer, Integer, Text, Text, Text, Integer,
            Text, Text, Integer, Bytes, Text
        ]
    ),
    table!(
        "cloud_chunks",
        "cloud_id, part, chunk, encoding, data",
        "cloud_id = $1",
        [Uuid, Text, Integer, Text, Bytes]
    ),
];

const JOB: [Table; 6] = [
    table!(
        "jobs",
        "id, owner, cloud_id, created, kind, parameters, memory, chunk_points, bytes, state, phase, progress, \
         phase_seconds, attempt, lease, not_before, cancel_requested, delete_requested, started, finished, report, \
         report_checksum, failure",
        "id = $1",
        [
            Uuid, Text, Uuid, Integer, Text, Text, Integer, Integer, Integer, Text, Text, Real, Text,
            Integer, Integer, Integer, Integer, Integer, Integer, Integer, Text, Bytes, Text
        ]
    ),
    table!("bases", "job_id, idx, digest", "job_id = $1", [Uuid, Integer, Bytes]),
    table!(
        "basis_chunks",
        "job_id, chunk, idx, checksum, data",
        "job_id = $1",
        [Uuid, Integer, Integer, Bytes, Bytes]
    ),
    table!("arrays", "job_id, name, numbers, digest", "job_id = $1", [Uuid, Text, Integer, Bytes]),
    table!(
        "array_chunks",
        "job_id, name, chunk, checksum, data",
        "job_id = $1",
        [Uuid, Text, Integer, Bytes, Bytes]
    ),
    table!(
        "coefficients",
        "job_id, place, name, energy, checksum, numbers, head_checksum",
        "job_id = $1",
        [Uuid, Integer, Text, Real, Bytes, Bytes, Bytes]
    ),
];

const KEYS: Table = table!(
    "idempotency_keys",
    "owner, name, request, created, cloud_id, job_id, cloud_created, job_created",
    "created > $1",
    [Text, Text, Bytes, Integer, Uuid, Uuid, Integer, Integer]
);

const TURNS: Table = table!("turns", "owner, turn", "turn > $1", [Text, Integer]);

impl Store {
    /// Copies everything in this store's file to a database that is empty, or that an earlier attempt from the same file left
    /// unfinished. Whoever calls holds the file's lock: nothing changes meanwhile. `tell` hears of every record.
    ///
    /// # Errors
    /// [`StoreError::Database`] when `to` is not empty, is served, or is not on a PostgreSQL server;
    /// [`StoreError::Damaged`] when what was copied does not match its digest; [`StoreError`].
    pub async fn move_to(
        &self,
        to: &Self,
        source: &str,
        _lock: &DatabaseLock,
        mut tell: impl FnMut(Moved),
    ) -> Result<Moved, StoreError> {
        self.requeue_orphans(self.node).await?;
        to.begin_move(source).await?;
        let mut moved = Moved::default();
        for cloud in self.ids("SELECT id FROM clouds ORDER BY id").await? {
            let copied = self.move_record(to, "SELECT id FROM clouds WHERE id = $1", &CLOUD, cloud).await?;
            // Also what was found: nobody knows whether the earlier attempt got as far as looking.
            to.load_cloud(cloud).await?;
            moved.found += u64::from(!copied);
            moved.clouds += 1;
            tell(moved);
        }
        for job in self.ids("SELECT id FROM jobs ORDER BY id").await? {
            let copied = self.move_record(to, "SELECT id FROM jobs WHERE id = $1", &JOB, job).await?;
            to.check_result(job).await?;
            moved.found += u64::from(!copied);
            moved.jobs += 1;
            tell(moved);
        }
        self.end_move(to, source).await?;
        Ok(moved)
    }

    async fn ids(&self, query: &'static str) -> Result<Vec<Uuid>, StoreError> {
        Ok(self.reader().await?.query(query).scalars().await?)
    }

    /// Marks the database as being filled from this source.
    async fn begin_move(&self, source: &str) -> Result<(), StoreError> {
        let refuse = |why: &str| Err(StoreError::Database(why.to_owned()));
        if !matches!(self.engine, Engine::Postgres(_)) {
            return refuse("only a PostgreSQL database can be moved to");
        }
        let mut write = self.write().await?;
        let now = self.now(&mut write).await?;
        let living: bool = write
            // A node computes or answers by threads; who only moves has none.
            .query("SELECT EXISTS (SELECT 1 FROM nodes WHERE heartbeat > $1 AND threads > 0)")
            .bind(now - LIVING)
            .scalar()
            .await?;
        if living {
            return refuse("it is served by a node, or was within the last minute; stop all nodes first");
        }
        let begun: Option<String> =
            write.query("SELECT source FROM moves WHERE finished IS NULL").scalar_optional().await?;
        match begun {
            Some(begun) if begun == source => return Ok(()),
            Some(begun) => {
                return Err(StoreError::Database(format!(
                    "a move from {begun} was begun and not finished; finish that one, or give an empty database"
                )));
            }
            None => {}
        }
        let holds_something: bool = write
            .query("SELECT EXISTS (SELECT 1 FROM clouds) OR EXISTS (SELECT 1 FROM jobs)")
            .scalar()
            .await?;
        if holds_something {
            return refuse("it is not empty; give a database without clouds and jobs");
        }
        write
            .query("INSERT INTO moves (source, begun) VALUES ($1, $2) ON CONFLICT (source) DO UPDATE SET finished = NULL")
            .bind(source)
            .bind(now)
            .execute()
            .await?;
        write.commit().await
    }

    /// Copies the rows of one cloud or job; false when they are there already.
    async fn move_record(
        &self,
        to: &Self,
        is_there: &'static str,
        tables: &[Table],
        id: Uuid,
    ) -> Result<bool, StoreError> {
        let mut from = self.read().await?;
        let mut write = to.write().await?;
        if write.query(is_there).bind(id).fetch_optional().await?.is_some() {
            return Ok(false);
        }
        for table in tables {
            let mut rows = Rows::into(&mut write, table.destination).await?;
            let mut found = from.query(table.select).bind(id).fetch();
            while let Some(row) = found.try_next().await? {
                rows.stream(&table.fields(&row)?).await?;
            }
            rows.finish().await?;
        }
        write.commit().await?;
        Ok(true)
    }

    /// Reads a result whole, which checks its digests.
    async fn check_result(&self, job: Uuid) -> Result<(), StoreError> {
        let record = self.job(job).await?;
        if let Some(failure) =
            record.failure.filter(|failure| failure.code == "internal" && record.report.is_none())
        {
            tracing::warn!(%job, failure.detail, "a job is copied as it is");
        }
        let Some(report) = record.report else { return Ok(()) };
        self.mass(job).await?;
        self.coefficients(job).await?;
        if record.kind == JobKind::Operator {
            self.operator_matrix(job).await?;
        }
        for index in 0..report.spectrum.map_or(0, |spectrum| spectrum.eigenvalues.len()) {
            self.basis(job, index).await?;
        }
        Ok(())
    }

    /// Copies what is small, and marks the database as complete.
    async fn end_move(&self, to: &Self, source: &str) -> Result<(), StoreError> {
        let mut from = self.read().await?;
        let mut write = to.write().await?;
        for table in [&KEYS, &TURNS] {
            let mut rows = Rows::into(&mut write, table.destination).await?;
            let mut found = from.query(table.select).bind(0_i64).fetch();
            while let Some(row) = found.try_next().await? {
                rows.stream(&table.fields(&row)?).await?;
            }
            rows.finish().await?;
        }
        let now = to.now(&mut write).await?;
        write
            .query("UPDATE moves SET finished = $2 WHERE source = $1")
            .bind(source)
            .bind(now)
            .execute()
            .await?;
        write.commit().await
    }
}

impl Table {
    fn fields(&self, row: &Row) -> Result<Vec<Field>, StoreError> {
        let field = |(place, kind): (usize, &Kind)| {
            let field = match kind {
                Kind::Uuid => row.try_get::<Option<Uuid>, _>(place)?.map(Field::Uuid),
                Kind::Integer => row.try_get::<Option<i64>, _>(place)?.map(Field::Integer),
                Kind::Real => row.try_get::<Option<f64>, _>(place)?.map(Field::Real),
                Kind::Text => row.try_get::<Option<String>, _>(place)?.map(|text| {
                    // PostgreSQL's text has no zero character.
                    Field::Text(text.replace('\0', "\u{fffd}"))
                }),
                Kind::Bytes => row.try_get::<Option<Vec<u8>>, _>(place)?.map(Field::Bytes),
            };
            Ok(field.unwrap_or(Field::Null))
        };
        self.kinds.iter().enumerate().map(field).collect()
    }
}

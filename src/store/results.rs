//! Results as workers write them: bases and other arrays of a job, each write under its claim.

use uuid::Uuid;

use super::arrays::{Chunked, cut};
use super::bulk::{ARRAY_CHUNKS, BASES, BASIS_CHUNKS, Field, Rows};
use super::connection::Connection;
use super::rows::integer;
use super::{CHUNK_POINTS, Claim, Store, StoreError, detached, off_thread};
use crate::analysis::JobKind;
use crate::arguments::words;

/// The eigenvector of an eigenpair; the report has its numbers.
#[derive(Debug, Clone, PartialEq)]
pub struct BasisValues {
    /// Its place in the spectrum, from 0.
    pub index: usize,
    /// One value per row of the cloud.
    pub values: Vec<f64>,
}

words! {
    /// An array of a job that is not a basis.
    pub enum ArrayName {
        /// Mass B of every row.
        Mass,
        /// Row offsets of Q.
        Offsets,
        /// Columns of Q.
        Columns,
        /// Entries of Q.
        Values,
    }
}

/// The numbers of an array.
#[derive(Debug, Clone, PartialEq)]
pub enum Numbers {
    /// Doubles.
    F64(Vec<f64>),
    /// 64-bit counts.
    U64(Vec<u64>),
    /// 32-bit indices.
    U32(Vec<u32>),
}

impl Numbers {
    fn len(&self) -> usize {
        match self {
            Self::F64(values) => values.len(),
            Self::U64(values) => values.len(),
            Self::U32(values) => values.len(),
        }
    }

    fn cut(&self) -> Chunked {
        match self {
            Self::F64(values) => cut(0, values, CHUNK_POINTS),
            Self::U64(values) => cut(0, values, CHUNK_POINTS),
            Self::U32(values) => cut(0, values, CHUNK_POINTS),
        }
    }
}

impl Store {
    /// Deletes what earlier attempts left of a result.
    ///
    /// # Errors
    /// [`StoreError::LostClaim`], [`StoreError::Database`].
    pub async fn begin_result(&self, claim: &Claim) -> Result<(), StoreError> {
        let (store, claim) = (self.clone(), claim.clone());
        detached(async move {
            let mut transaction = store.write().await?;
            store.check_claim(&mut transaction, &claim).await?;
            clear_result(&mut transaction, claim.job.id).await?;
            transaction.commit().await
        })
        .await
    }

    /// Stores eigenpairs, all of them in one transaction: a commit waits for the disk, so several per call is faster than
    /// one. They are invisible until [`Store::finish`].
    ///
    /// # Errors
    /// [`StoreError::LostClaim`]; [`StoreError::Damaged`] for a basis of the wrong length; [`StoreError::Database`].
    pub async fn put_bases(&self, claim: &Claim, bases: Vec<BasisValues>) -> Result<(), StoreError> {
        let (store, claim) = (self.clone(), claim.clone());
        for basis in &bases {
            check_basis(basis, claim.job.points)?;
        }
        let chunk_points = claim.job.chunk_points;
        detached(async move {
            let chunked = off_thread(move || {
                Ok(bases
                    .into_iter()
                    .map(|basis| (basis.index, cut(basis.index, &basis.values, chunk_points)))
                    .collect::<Vec<_>>())
            })
            .await?;
            let mut transaction = store.write().await?;
            store.check_claim(&mut transaction, &claim).await?;
            insert_bases(&mut transaction, claim.job.id, chunked).await?;
            transaction.commit().await
        })
        .await
    }

    /// Stores an array in place of one of the same name.
    ///
    /// # Errors
    /// [`StoreError::LostClaim`], [`StoreError::Database`].
    pub async fn put_array(
        &self,
        claim: &Claim,
        name: ArrayName,
        numbers: Numbers,
    ) -> Result<(), StoreError> {
        let (store, claim) = (self.clone(), claim.clone());
        detached(async move {
            let length = numbers.len();
            let chunked = off_thread(move || Ok(numbers.cut())).await?;
            let mut transaction = store.write().await?;
            store.check_claim(&mut transaction, &claim).await?;
            insert_array(&mut transaction, claim.job.id, name, length, chunked).await?;
            transaction.commit().await
        })
        .await
    }

    /// Refuses to call a result whole that lacks its mass, an eigenpair, or any of an eigenpair's chunks.
    pub(super) async fn check_whole(
        &self,
        connection: &mut Connection,
        claim: &Claim,
        bases: Option<usize>,
    ) -> Result<(), StoreError> {
        let (stored, last, chunks, arrays): (i64, i64, i64, i64) = connection
            .query(
                "SELECT (SELECT count(*) FROM bases WHERE job_id = $1), \
             (SELECT coalesce(max(idx), -1) FROM bases WHERE job_id = $1), \
             (SELECT count(*) FROM basis_chunks WHERE job_id = $1), \
             (SELECT count(*) FROM arrays WHERE job_id = $1)",
            )
            .bind(claim.job.id)
            .fetch_one_as()
            .await?;
        let bases = bases.unwrap_or(0);
        let expected_chunks = bases * (claim.job.points as usize).div_ceil(claim.job.chunk_points);
        // The mass, and for an operator job the three arrays of its matrix.
        let expected_arrays = if claim.job.kind == JobKind::Operator { 4 } else { 1 };
        let expected = (integer(bases), integer(bases), integer(expected_chunks), expected_arrays);
        if (stored, last + 1, chunks, arrays) == expected {
            return Ok(());
        }
        Err(StoreError::Damaged(format!(
            "{stored} of {bases} bases and {arrays} of {expected_arrays} other arrays were stored"
        )))
    }

    /// Deletes what a job stored of a result, unless it succeeded or another attempt may be writing.
    pub(super) async fn clear_result_unless_live(&self, job: Uuid) -> Result<(), StoreError> {
        let mut transaction = self.write().await?;
        let ended: bool = transaction
            .query("SELECT EXISTS (SELECT 1 FROM jobs WHERE id = $1 AND state IN ('failed', 'canceled'))")
            .bind(job)
            .scalar()
            .await?;
        if ended {
            clear_result(&mut transaction, job).await?;
        }
        transaction.commit().await
    }
}

/// Deletes whatever is stored of a job's result.
pub(super) async fn clear_result(connection: &mut Connection, job: Uuid) -> Result<(), StoreError> {
    for statement in [
        "DELETE FROM basis_chunks WHERE job_id = $1",
        "DELETE FROM bases WHERE job_id = $1",
        "DELETE FROM array_chunks WHERE job_id = $1",
        "DELETE FROM arrays WHERE job_id = $1",
        "DELETE FROM coefficients WHERE job_id = $1",
    ] {
        connection.query(statement).bind(job).execute().await?;
    }
    Ok(())
}

fn check_basis(basis: &BasisValues, points: u64) -> Result<(), StoreError> {
    if basis.values.len() as u64 == points {
        return Ok(());
    }
    let (index, values) = (basis.index, basis.values.len());
    Err(StoreError::Damaged(format!("basis {index} has {values} values for {points} points")))
}

async fn insert_bases(
    connection: &mut Connection,
    job: Uuid,
    bases: Vec<(usize, Chunked)>,
) -> Result<(), StoreError> {
    let mut rows = Rows::into(connection, BASES).await?;
    for (index, basis) in &bases {
        let digest = Field::Bytes(basis.digest.to_vec());
        rows.put([Field::Uuid(job), Field::Integer(integer(*index)), digest]).await?;
    }
    rows.finish().await?;
    let mut rows = Rows::into(connection, BASIS_CHUNKS).await?;
    for (index, basis) in bases {
        for (chunk, (checksum, data)) in basis.chunks.into_iter().enumerate() {
            let [chunk, index] = [chunk, index].map(|place| Field::Integer(integer(place)));
            let checksum = Field::Bytes(checksum.to_vec());
            rows.put([Field::Uuid(job), chunk, index, checksum, Field::Bytes(data)]).await?;
        }
    }
    rows.finish().await
}

async fn insert_array(
    connection: &mut Connection,
    job: Uuid,
    name: ArrayName,
    length: usize,
    chunked: Chunked,
) -> Result<(), StoreError> {
    for statement in [
        "DELETE FROM array_chunks WHERE job_id = $1 AND name = $2",
        "DELETE FROM arrays WHERE job_id = $1 AND name = $2",
    ] {
        connection.query(statement).bind(job).bind(name.name()).execute().await?;
    }
    connection
        .query("INSERT INTO arrays (job_id, name, numbers, digest) VALUES ($1, $2, $3, $4)")
        .bind(job)
        .bind(name.name())
        .bind(integer(length))
        .bind(chunked.digest.as_slice())
        .execute()
        .await?;
    let mut rows = Rows::into(connection, ARRAY_CHUNKS).await?;
    for (chunk, (checksum, data)) in chunked.chunks.into_iter().enumerate() {
        let (name, checksum) = (Field::Text(name.name().to_owned()), Field::Bytes(checksum.to_vec()));
        let chunk = Field::Integer(integer(chunk));
        rows.put([Field::Uuid(job), name, chunk, checksum, Field::Bytes(data)]).await?;
    }
    rows.finish().await
}

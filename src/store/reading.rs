//! Results as they are served: read once the job has succeeded, by column or by chunk, and checked.

use uuid::Uuid;

use super::arrays::{ArrayDigest, Number, read_checked};
use super::connection::{Connection, Row};
use super::rows::{count, integer};
use super::{ArrayName, Store, StoreError, off_thread};
use crate::analysis::SparseMatrix;

impl Store {
    /// Values of basis `index` of a succeeded eigen job, all rows, digest checked.
    ///
    /// # Errors
    /// [`StoreError::NoResult`], [`StoreError`].
    pub async fn basis(&self, job: Uuid, index: usize) -> Result<Vec<f64>, StoreError> {
        let mut snapshot = self.read().await?;
        let Finished { points, chunk_points } = finished(&mut snapshot, job).await?;
        let digest: Option<Vec<u8>> = snapshot
            .query("SELECT digest FROM bases WHERE job_id = $1 AND idx = $2")
            .bind(job)
            .bind(integer(index))
            .scalar_optional()
            .await?;
        let digest = digest.ok_or(StoreError::NoResult)?;
        let chunks = points.div_ceil(chunk_points);
        let rows = snapshot.query_either(
            "WITH RECURSIVE numbers (chunk) AS \
             (SELECT 0 UNION ALL SELECT chunk + 1 FROM numbers WHERE chunk + 1 < $3) \
             SELECT b.checksum, b.data FROM numbers n \
             CROSS JOIN basis_chunks b ON b.job_id = $1 AND b.chunk = n.chunk AND b.idx = $2",
            "SELECT checksum, data FROM basis_chunks WHERE job_id = $1 AND idx = $2 AND chunk < $3 ORDER BY chunk",
        )
        .bind(job)
        .bind(integer(index))
        .bind(integer(chunks))
        .fetch_all()
        .await?;
        off_thread(move || join(index, points, &rows, &digest)).await
    }

    /// Values of bases `first .. first + count` in the rows of chunk `chunk` (see [`super::JobRecord::chunk_points`]): one
    /// vector per basis.
    ///
    /// # Errors
    /// [`StoreError::NoResult`], [`StoreError`].
    pub async fn bases_chunk(
        &self,
        job: Uuid,
        first: usize,
        count: usize,
        chunk: usize,
    ) -> Result<Vec<Vec<f64>>, StoreError> {
        let mut snapshot = self.read().await?;
        let Finished { points, chunk_points } = finished(&mut snapshot, job).await?;
        if chunk >= points.div_ceil(chunk_points) {
            return Err(StoreError::NoResult);
        }
        let rows = snapshot
            .query(
                "SELECT idx, checksum, data FROM basis_chunks \
             WHERE job_id = $1 AND chunk = $2 AND idx >= $3 AND idx < $4 ORDER BY idx",
            )
            .bind(job)
            .bind(integer(chunk))
            .bind(integer(first))
            .bind(integer(first.saturating_add(count)))
            .fetch_all()
            .await?;
        if rows.len() != count {
            let bases: i64 =
                snapshot.query("SELECT count(*) FROM bases WHERE job_id = $1").bind(job).scalar().await?;
            if first.saturating_add(count) > bases as usize {
                return Err(StoreError::NoResult);
            }
            return Err(StoreError::Damaged(format!("chunk {chunk} lacks {} bases", count - rows.len())));
        }
        let length = chunk_points.min(points - chunk * chunk_points);
        off_thread(move || {
            rows.iter().zip(first..).map(|(row, index)| values_of_length(row, index, chunk, length)).collect()
        })
        .await
    }

    /// Mass B of every row of a succeeded job.
    ///
    /// # Errors
    /// [`StoreError::NoResult`], [`StoreError`].
    pub async fn mass(&self, job: Uuid) -> Result<Vec<f64>, StoreError> {
        let mut snapshot = self.read().await?;
        finished(&mut snapshot, job).await?;
        read_array(&mut snapshot, job, ArrayName::Mass).await
    }

    /// Q of a succeeded operator job.
    ///
    /// # Errors
    /// [`StoreError::NoResult`], [`StoreError`].
    pub async fn operator_matrix(&self, job: Uuid) -> Result<SparseMatrix, StoreError> {
        let mut snapshot = self.read().await?;
        finished(&mut snapshot, job).await?;
        Ok(SparseMatrix {
            offsets: read_array(&mut snapshot, job, ArrayName::Offsets).await?,
            columns: read_array(&mut snapshot, job, ArrayName::Columns).await?,
            values: read_array(&mut snapshot, job, ArrayName::Values).await?,
        })
    }
}

/// How the result of a job is laid out.
pub(super) struct Finished {
    /// Rows of its cloud.
    pub(super) points: usize,
    /// Rows of a chunk of its bases.
    pub(super) chunk_points: usize,
}

/// The layout of a job that succeeded.
pub(super) async fn finished(connection: &mut Connection, job: Uuid) -> Result<Finished, StoreError> {
    let row = connection
        .query(
            "SELECT j.state = 'succeeded' AS succeeded, j.chunk_points, c.points \
         FROM jobs j JOIN clouds c ON c.id = j.cloud_id WHERE j.id = $1",
        )
        .bind(job)
        .fetch_optional()
        .await?
        .ok_or(StoreError::NotFound)?;
    if !row.try_get::<bool, _>("succeeded")? {
        return Err(StoreError::NoResult);
    }
    Ok(Finished {
        points: count(&row, "points")? as usize,
        chunk_points: count(&row, "chunk_points")?.max(1) as usize,
    })
}

async fn read_array<T: Number + Send + 'static>(
    connection: &mut Connection,
    job: Uuid,
    name: ArrayName,
) -> Result<Vec<T>, StoreError> {
    let head = connection
        .query("SELECT numbers, digest FROM arrays WHERE job_id = $1 AND name = $2")
        .bind(job)
        .bind(name.name())
        .fetch_optional()
        .await?
        .ok_or(StoreError::NoResult)?;
    let (length, digest) = (count(&head, "numbers")? as usize, head.try_get::<Vec<u8>, _>("digest")?);
    let rows = connection
        .query("SELECT checksum, data FROM array_chunks WHERE job_id = $1 AND name = $2 ORDER BY chunk")
        .bind(job)
        .bind(name.name())
        .fetch_all()
        .await?;
    off_thread(move || join(0, length, &rows, &digest)).await
}

/// Puts chunks together to the array that has this length and digest.
fn join<T: Number>(index: usize, length: usize, rows: &[Row], expected: &[u8]) -> Result<Vec<T>, StoreError> {
    let mut values = Vec::with_capacity(length);
    let mut digest = ArrayDigest::default();
    for (chunk, row) in rows.iter().enumerate() {
        let bytes: &[u8] = row.try_get("data")?;
        digest.add(&read_checked((index, chunk), row.try_get("checksum")?, bytes, &mut values)?);
    }
    if values.len() != length || digest.finish().as_slice() != expected {
        return Err(StoreError::Damaged(format!("array {index} does not match its digest")));
    }
    Ok(values)
}

/// The values of one chunk of one basis.
fn values_of_length(row: &Row, index: usize, chunk: usize, length: usize) -> Result<Vec<f64>, StoreError> {
    let mut values = Vec::with_capacity(length);
    let bytes: &[u8] = row.try_get("data")?;
    read_checked((index, chunk), row.try_get("checksum")?, bytes, &mut values)?;
    if values.len() != length || row.try_get::<i64, _>("idx")? != integer(index) {
        return Err(StoreError::Damaged(format!("chunk {chunk} of basis {index} is not what it should be")));
    }
    Ok(values)
}

//! Clouds: submitted once, kept in chunks, deleted with everything that was derived from them.

use std::sync::Arc;

use futures_util::TryStreamExt;
use uuid::Uuid;

use super::arrays::Checksum;
use super::bulk::{CLOUD_CHUNKS, Field, Rows};
use super::connection::{Connection, Row};
use super::content::{self, Part};
use super::jobs::before;
use super::rows::{cloud_checksum, cloud_record, cloud_with_id, from_word, hex, integer, to_json, word};
use super::{
    CloudRecord, FieldRecord, Milliseconds, Owner, Page, Store, StoreError, Submitted, detached, off_thread,
};
use crate::analysis::{Examined, JobKind, Parameters};
use crate::cloud::{NonFinite, PointCloud, ScalarField};

impl Store {
    /// Stores a cloud and, if asked, queues a job on it: one transaction, so that neither is there without the other.
    ///
    /// Copies the cloud, which becomes nobody's, and looks at it on the caller's thread; [`Self::submit_shared`] does neither.
    ///
    /// # Errors
    /// [`StoreError`].
    pub async fn submit(
        &self,
        cloud: &PointCloud,
        job: Option<(JobKind, Parameters)>,
    ) -> Result<Submitted, StoreError> {
        let (cloud, examined) = (Arc::new(cloud.clone()), Examined::of(cloud));
        self.submit_shared(&Owner::nobody(), cloud, &examined, job).await
    }

    /// As [`Self::submit`], for an owner: the same content of another owner is another cloud.
    ///
    /// # Errors
    /// [`StoreError`].
    pub async fn submit_shared(
        &self,
        owner: &Owner,
        cloud: Arc<PointCloud>,
        examined: &Examined,
        job: Option<(JobKind, Parameters)>,
    ) -> Result<Submitted, StoreError> {
        let (store, owner, examined) = (self.clone(), owner.clone(), *examined);
        detached(async move {
            store.refuse_when_disk_full().await?;
            let shared = Arc::clone(&cloud);
            let digest = off_thread(move || content::digest(&shared)).await?;
            let mut transaction = store.write().await?;
            let known = cloud_with_digest(&mut transaction, &owner, &digest).await?;
            let (record, cloud_created) = if let Some(record) = known {
                (record, false)
            } else {
                if job.is_some() {
                    store.refuse_when_queue_full(&mut transaction, &owner).await?;
                }
                let now = store.now(&mut transaction).await?;
                let record = describe(&cloud, owner.clone(), now, &digest, examined);
                store.refuse_when_owner_full(&mut transaction, &owner, record.bytes()).await?;
                if insert_cloud(&mut transaction, &record, &cloud, &digest).await? {
                    (record, true)
                } else {
                    // Another node stored the same content at the same moment.
                    let same = cloud_with_digest(&mut transaction, &owner, &digest).await?;
                    (same.ok_or(StoreError::Busy)?, false)
                }
            };
            let queued = match job {
                Some((kind, parameters)) => {
                    Some(store.enqueue(&mut transaction, &record, kind, &parameters).await?)
                }
                None => None,
            };
            transaction.commit().await?;
            let job_created = queued.as_ref().is_some_and(|(_, created)| *created);
            store.announce_arrival();
            Ok(Submitted { cloud: record, job: queued.map(|(job, _)| job), cloud_created, job_created })
        })
        .await
    }

    /// Queues a job on a stored cloud.
    ///
    /// # Errors
    /// [`StoreError`].
    pub async fn submit_job(
        &self,
        cloud: Uuid,
        kind: JobKind,
        parameters: Parameters,
    ) -> Result<Submitted, StoreError> {
        let store = self.clone();
        detached(async move {
            store.refuse_when_disk_full().await?;
            let mut transaction = store.write().await?;
            let cloud = cloud_with_id(&mut transaction, cloud).await?;
            let (job, job_created) = store.enqueue(&mut transaction, &cloud, kind, &parameters).await?;
            transaction.commit().await?;
            store.announce_arrival();
            Ok(Submitted { cloud, job: Some(job), cloud_created: false, job_created })
        })
        .await
    }

    /// Names a cloud that has no name yet, after the file that it came in.
    ///
    /// # Errors
    /// [`StoreError::NotFound`] when it has been deleted; [`StoreError::Database`].
    pub async fn name_cloud(&self, id: Uuid, name: String) -> Result<CloudRecord, StoreError> {
        let store = self.clone();
        detached(async move {
            let mut transaction = store.write().await?;
            let name = transaction.text(&name).into_owned();
            transaction
                .query("UPDATE clouds SET name = $2 WHERE id = $1 AND name IS NULL")
                .bind(id)
                .bind(name)
                .execute()
                .await?;
            let cloud = cloud_with_id(&mut transaction, id).await?;
            transaction.commit().await?;
            Ok(cloud)
        })
        .await
    }

    /// A cloud's record.
    ///
    /// # Errors
    /// [`StoreError::NotFound`], [`StoreError::Database`].
    pub async fn cloud(&self, id: Uuid) -> Result<CloudRecord, StoreError> {
        cloud_with_id(&mut self.reader().await?, id).await
    }

    /// A cloud with its points, fields and faces, digest checked.
    ///
    /// # Errors
    /// [`StoreError`].
    pub async fn load_cloud(&self, id: Uuid) -> Result<PointCloud, StoreError> {
        let mut snapshot = self.read().await?;
        let record = cloud_with_id(&mut snapshot, id).await?;
        let mut coordinates = Vec::with_capacity(record.points as usize * record.dimension);
        let mut faces = Vec::with_capacity(record.faces as usize);
        let mut continued = Vec::new();
        let mut fields: Vec<ScalarField> = Vec::with_capacity(record.fields.len());
        for field in &record.fields {
            let values = Vec::with_capacity(record.points as usize);
            fields.push(ScalarField { name: field.name.clone(), kind: field.kind, values });
        }
        for part in Part::all(fields.len()) {
            let mut chunks = snapshot.query(
                "SELECT encoding, data FROM cloud_chunks WHERE cloud_id = $1 AND part = $2 ORDER BY chunk",
            )
            .bind(id)
            .bind(part.name())
            .fetch();
            while let Some(row) = chunks.try_next().await? {
                match part {
                    Part::Coordinates => read_numbers(&row, &mut coordinates)?,
                    Part::Field(field) => read_numbers(&row, &mut fields[field].values)?,
                    Part::Faces => read_faces(&row, &mut faces)?,
                    Part::Polygons => read_polygons(&row, &mut continued)?,
                }
                // Rows that are ready already come without a pause: let others onto this thread between them.
                tokio::task::yield_now().await;
            }
        }
        off_thread(move || assemble(&record, coordinates, fields, (faces, continued))).await
    }

    /// Whether `id` is a cloud or a job of `owner`.
    ///
    /// # Errors
    /// [`StoreError::Database`].
    pub async fn owns(&self, owner: &Owner, id: Uuid) -> Result<bool, StoreError> {
        let owns = self
            .reader()
            .await?
            .query(
                "SELECT EXISTS (SELECT 1 FROM clouds WHERE id = $1 AND owner = $2) \
             OR EXISTS (SELECT 1 FROM jobs WHERE id = $1 AND owner = $2)",
            )
            .bind(id)
            .bind(owner.name())
            .scalar()
            .await?;
        Ok(owns)
    }

    /// Clouds of an owner, newest first, after `cursor`.
    ///
    /// # Errors
    /// [`StoreError::Database`].
    pub async fn clouds(
        &self,
        owner: &Owner,
        cursor: Option<Uuid>,
        limit: u32,
    ) -> Result<Page<CloudRecord>, StoreError> {
        let mut reader = self.reader().await?;
        let rows = reader
            .query("SELECT * FROM clouds WHERE owner = $1 AND id <= $2 ORDER BY id DESC LIMIT $3")
            .bind(owner.name())
            .bind(before(cursor))
            .bind(i64::from(limit.max(1)) + 1)
            .fetch_all()
            .await?;
        let page =
            rows.iter().map(|row| Ok((row.try_get("id")?, row))).collect::<Result<Vec<_>, StoreError>>()?;
        let Page { items, next } = Page::cut(page, limit, |(id, _)| *id);
        let mut records = Vec::with_capacity(items.len());
        for (_, row) in items {
            match cloud_record(row) {
                // One bad row must not hide the others.
                Err(StoreError::Damaged(cause)) => {
                    tracing::error!(%cause, "a cloud is left out of a listing");
                }
                record => records.push(record?),
            }
        }
        Ok(Page { items: records, next })
    }

    /// Deletes a cloud with its terminal jobs and their results.
    ///
    /// # Errors
    /// [`StoreError::CloudInUse`], [`StoreError::NotFound`], [`StoreError::Database`].
    pub async fn delete_cloud(&self, id: Uuid) -> Result<(), StoreError> {
        let store = self.clone();
        detached(async move {
            let mut transaction = store.write().await?;
            // On PostgreSQL another node may be queuing a job on it: that one waits, and then finds no cloud.
            transaction
                .query_either(
                    "SELECT id FROM clouds WHERE id = $1",
                    "SELECT id FROM clouds WHERE id = $1 FOR UPDATE",
                )
                .bind(id)
                .fetch_optional()
                .await?;
            let in_use: bool = transaction.query(
                "SELECT EXISTS (SELECT 1 FROM jobs WHERE cloud_id = $1 AND state IN ('queued', 'running'))",
            )
            .bind(id)
            .scalar()
            .await?;
            if in_use {
                return Err(StoreError::CloudInUse);
            }
            let deleted = transaction.query("DELETE FROM clouds WHERE id = $1").bind(id).execute().await?;
            if deleted == 0 {
                return Err(StoreError::NotFound);
            }
            transaction.commit().await?;
            store.announce();
            Ok(())
        })
        .await
    }
}

/// The record of a new cloud.
fn describe(
    cloud: &PointCloud,
    owner: Owner,
    created: Milliseconds,
    digest: &Checksum,
    examined: Examined,
) -> CloudRecord {
    let field = |field: &ScalarField| FieldRecord { name: field.name.clone(), kind: field.kind };
    CloudRecord {
        id: Uuid::now_v7(),
        owner,
        name: None,
        created,
        digest: hex(digest),
        points: cloud.len() as u64,
        dimension: cloud.dimension(),
        nonfinite: cloud.nonfinite() as u64,
        duplicates: examined.duplicates() as u64,
        examined: Some(examined),
        bounding_box: cloud.bounding_box().unwrap_or_default(),
        coordinate_type: cloud.coordinate_type(),
        grids: cloud.grids(),
        origin: cloud.origin().clone(),
        fields: cloud.fields().iter().map(field).collect(),
        faces: cloud.faces().len() as u64,
    }
}

/// False when the owner has a cloud of this digest.
async fn insert_cloud(
    connection: &mut Connection,
    record: &CloudRecord,
    cloud: &PointCloud,
    digest: &Checksum,
) -> Result<bool, StoreError> {
    let inserted = connection.query(
        "INSERT INTO clouds (id, owner, created, digest, points, dimension, nonfinite, duplicates, bounding_box, \
         coordinate_type, fields, faces, grids, bytes, checksum, origin, examined) \
         VALUES ($1, $2, $3, $4, $5, $6, $7, $8, $9, $10, $11, $12, $13, $14, $15, $16, $17) \
         ON CONFLICT (owner, digest) DO NOTHING",
    )
    .bind(record.id)
    .bind(record.owner.name())
    .bind(record.created)
    .bind(digest.as_slice())
    .bind(integer(record.points))
    .bind(integer(record.dimension))
    .bind(integer(record.nonfinite))
    .bind(integer(record.duplicates))
    .bind(to_json(&record.bounding_box)?)
    .bind(word(&record.coordinate_type)?)
    .bind(to_json(&record.fields)?)
    .bind(integer(record.faces))
    .bind(record.grids.map(|grids| to_json(&grids)).transpose()?)
    .bind(0_i64)
    .bind(cloud_checksum(record)?.as_slice())
    .bind((!record.origin.is_empty()).then(|| to_json(&record.origin)).transpose()?)
    .bind(record.examined.map(|examined| to_json(&examined)).transpose()?)
    .execute()
    .await?;
    if inserted == 0 {
        return Ok(false);
    }
    let mut bytes = 0;
    let mut rows = Rows::into(connection, CLOUD_CHUNKS).await?;
    for part in Part::all(record.fields.len()) {
        // Cut one by one: a second copy of the whole cloud never exists.
        let mut chunk = 0;
        while let Some((encoding, data)) = part.chunk(cloud, chunk) {
            bytes += data.len();
            let (id, place) = (Field::Uuid(record.id), Field::Integer(integer(chunk)));
            let encoding = Field::Text(word(&encoding)?);
            rows.put([id, Field::Text(part.name()), place, encoding, Field::Bytes(data)]).await?;
            chunk += 1;
        }
    }
    rows.finish().await?;
    connection
        .query("UPDATE clouds SET bytes = $2 WHERE id = $1")
        .bind(record.id)
        .bind(integer(bytes))
        .execute()
        .await?;
    Ok(true)
}

async fn cloud_with_digest(
    connection: &mut Connection,
    owner: &Owner,
    digest: &Checksum,
) -> Result<Option<CloudRecord>, StoreError> {
    let row = connection
        .query("SELECT * FROM clouds WHERE owner = $1 AND digest = $2")
        .bind(owner.name())
        .bind(digest.as_slice())
        .fetch_optional()
        .await?;
    row.as_ref().map(cloud_record).transpose()
}

fn read_numbers(row: &Row, values: &mut Vec<f64>) -> Result<(), StoreError> {
    content::read_numbers(from_word(row.try_get("encoding")?)?, row.try_get("data")?, values)
}

fn read_faces(row: &Row, faces: &mut Vec<[u32; 3]>) -> Result<(), StoreError> {
    if content::read_faces(row.try_get("data")?, faces) {
        return Ok(());
    }
    Err(StoreError::Damaged("a chunk of faces has a broken length".to_owned()))
}

fn read_polygons(row: &Row, continued: &mut Vec<u32>) -> Result<(), StoreError> {
    if content::read_polygons(row.try_get("data")?, continued) {
        return Ok(());
    }
    Err(StoreError::Damaged("a chunk of polygons has a broken length".to_owned()))
}

/// The cloud that `record` describes, if these are its numbers.
fn assemble(
    record: &CloudRecord,
    coordinates: Vec<f64>,
    fields: Vec<ScalarField>,
    (faces, continued): (Vec<[u32; 3]>, Vec<u32>),
) -> Result<PointCloud, StoreError> {
    let cloud = PointCloud::new(record.dimension, coordinates, NonFinite::Drop)
        .and_then(|cloud| cloud.with_fields(fields))
        .and_then(|cloud| cloud.with_faces(faces))
        .and_then(|cloud| cloud.with_polygons(continued))
        .map_err(|e| StoreError::Damaged(format!("cloud {}: {e}", record.id)))?
        .with_coordinate_type(record.coordinate_type)
        .with_grids(record.grids)
        .with_origin(record.origin.clone());
    if !content::has_digest(&cloud, &record.digest)? {
        return Err(StoreError::Damaged(format!("cloud {} does not match its digest", record.id)));
    }
    Ok(cloud)
}

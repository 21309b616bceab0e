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
use super::{CloudRecord, FieldRecord, Owner, Page, Store, StoreError, Submitted, detached, off_thread};
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
            // All that looks at every point comes before the transaction, which other writers wait for.
            let (digest, described) =
                off_thread(move || Ok((content::digest(&shared)?, describe(&shared, examined)))).await?;
            let mut transaction = store.write().await?;
            let known = cloud_with_digest(&mut transaction, &owner, &digest).await?;
            let (record, cloud_created) = if let Some(record) = known {
                (record, false)
            } else {
                if job.is_some() {
                    store.refuse_when_queue_full(&mut transaction, &owner).await?;
                }
                let created = store.now(&mut transaction).await?;
                let (id, owner) = (Uuid::now_v7(), owner.clone());
                let record = CloudRecord { id, owner, created, digest: hex(&digest), ..described };
                store.refuse_when_owner_full(&mut transaction, &record.owner, record.bytes()).await?;
                if insert_cloud(&mut transaction, &record, &cloud, &digest).await? {
                    (record, true)
                } else {
                    // Another node stored the same content at the same moment.
                    let same = cloud_with_digest(&mut transaction, &record.owner, &digest).await?;
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
        let mut pieces = Pieces::of(&record);
        for part in Part::all(record.fields.len()) {
            let mut chunks = snapshot.query(
                "SELECT encoding, data FROM cloud_chunks WHERE cloud_id = $1 AND part = $2 ORDER BY chunk",
            )
            .bind(id)
            .bind(part.name())
            .fetch();
            loop {
                let mut rows = Vec::with_capacity(CHUNKS_AT_ONCE);
                while rows.len() < CHUNKS_AT_ONCE
                    && let Some(row) = chunks.try_next().await?
                {
                    rows.push(row);
                    // Rows that are ready already come without a pause: let others onto this thread between them.
                    tokio::task::yield_now().await;
                }
                if rows.is_empty() {
                    break;
                }
                pieces = off_thread(move || pieces.with(part, &rows)).await?;
            }
        }
        off_thread(move || pieces.assemble(&record)).await
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

/// Chunks that are encoded or decoded in one go away from the threads that serve requests, 3 MiB of points in space.
const CHUNKS_AT_ONCE: usize = 16;

/// The record of a new cloud, but for what its transaction decides: id, owner, time and digest.
fn describe(cloud: &PointCloud, examined: Examined) -> CloudRecord {
    let field = |field: &ScalarField| FieldRecord { name: field.name.clone(), kind: field.kind };
    CloudRecord {
        id: Uuid::nil(),
        owner: Owner::nobody(),
        name: None,
        created: 0,
        digest: String::new(),
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
    cloud: &Arc<PointCloud>,
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
        // Cut a few at a time: a second copy of the whole cloud never exists.
        for first in (0..).step_by(CHUNKS_AT_ONCE) {
            let cloud = Arc::clone(cloud);
            let cut =
                move || Ok((first..first + CHUNKS_AT_ONCE).map_while(|i| part.chunk(&cloud, i)).collect());
            let chunks: Vec<_> = off_thread(cut).await?;
            let is_last = chunks.len() < CHUNKS_AT_ONCE;
            for (chunk, (encoding, data)) in (first..).zip(chunks) {
                bytes += data.len();
                let (id, place) = (Field::Uuid(record.id), Field::Integer(integer(chunk)));
                let encoding = Field::Text(word(&encoding)?);
                rows.put([id, Field::Text(part.name()), place, encoding, Field::Bytes(data)]).await?;
            }
            if is_last {
                break;
            }
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

/// What has been read of a cloud.
struct Pieces {
    coordinates: Vec<f64>,
    fields: Vec<Vec<f64>>,
    faces: Vec<[u32; 3]>,
    continued: Vec<u32>,
}

impl Pieces {
    /// Nothing yet, with room for all that `record` describes.
    fn of(record: &CloudRecord) -> Self {
        let points = record.points as usize;
        Self {
            coordinates: Vec::with_capacity(points * record.dimension),
            fields: record.fields.iter().map(|_| Vec::with_capacity(points)).collect(),
            faces: Vec::with_capacity(record.faces as usize),
            continued: Vec::new(),
        }
    }

    /// With further chunks of a part.
    fn with(mut self, part: Part, rows: &[Row]) -> Result<Self, StoreError> {
        for row in rows {
            let bytes: &[u8] = row.try_get("data")?;
            let numbers = match part {
                Part::Coordinates => &mut self.coordinates,
                Part::Field(field) => &mut self.fields[field],
                Part::Faces if content::read_faces(bytes, &mut self.faces) => continue,
                Part::Polygons if content::read_polygons(bytes, &mut self.continued) => continue,
                Part::Faces | Part::Polygons => {
                    let part = part.name();
                    return Err(StoreError::Damaged(format!("a chunk of {part} has a broken length")));
                }
            };
            content::read_numbers(from_word(row.try_get("encoding")?)?, bytes, numbers)?;
        }
        Ok(self)
    }

    /// The cloud that `record` describes, if these are its numbers.
    fn assemble(self, record: &CloudRecord) -> Result<PointCloud, StoreError> {
        let fields = record.fields.iter().zip(self.fields);
        let fields = fields.map(|(FieldRecord { name, kind }, values)| ScalarField {
            name: name.clone(),
            kind: *kind,
            values: values.into(),
        });
        let cloud = PointCloud::new(record.dimension, self.coordinates, NonFinite::Drop)
            .and_then(|cloud| cloud.with_fields(fields.collect()))
            .and_then(|cloud| cloud.with_faces(self.faces))
            .and_then(|cloud| cloud.with_polygons(self.continued))
            .map_err(|e| StoreError::Damaged(format!("cloud {}: {e}", record.id)))?
            .with_coordinate_type(record.coordinate_type)
            .with_grids(record.grids)
            .with_origin(record.origin.clone());
        if !content::has_digest(&cloud, &record.digest)? {
            return Err(StoreError::Damaged(format!("cloud {} does not match its digest", record.id)));
        }
        Ok(cloud)
    }
}

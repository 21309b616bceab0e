//! Jobs that somebody follows, read once for all who do.
//!
//! Every heartbeat of every job may change what a follower sees. Were each to ask the database, five hundred event
//! streams would ask five hundred times a second; here one task asks for all jobs that are followed, in one query, and not
//! more often than every [`PAUSE`].

use std::collections::HashMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use tokio::sync::watch;
use uuid::Uuid;

use super::line::place;
use super::rows::{readable_job, select_jobs};
use super::{JobRecord, Store, StoreError};

/// Least time between two readings.
const PAUSE: Duration = Duration::from_millis(50);

/// Jobs of one query.
const BATCH: usize = 500;

/// The channels of the jobs that are followed.
#[derive(Debug, Clone, Default)]
pub(super) struct Followed(Arc<Mutex<Channels>>);

#[derive(Debug, Default)]
struct Channels {
    jobs: HashMap<Uuid, watch::Sender<Arc<JobRecord>>>,
    /// Whether the task that reads is there.
    is_read: bool,
}

impl Followed {
    fn lock(&self) -> MutexGuard<'_, Channels> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The jobs that somebody still follows; `None`, and the end of the task, when there are none.
    fn wanted(&self) -> Option<Vec<Uuid>> {
        let mut channels = self.lock();
        channels.jobs.retain(|_, channel| channel.receiver_count() > 0);
        channels.is_read = !channels.jobs.is_empty();
        channels.is_read.then(|| channels.jobs.keys().copied().collect())
    }

    /// Tells what was read: what has changed is sent on, and whoever follows a job that has ended or is gone hears nothing
    /// more.
    fn tell(&self, wanted: &[Uuid], jobs: Vec<JobRecord>) {
        let mut channels = self.lock();
        let mut read: HashMap<Uuid, JobRecord> = jobs.into_iter().map(|job| (job.id, job)).collect();
        for id in wanted {
            let Some(channel) = channels.jobs.get(id) else { continue };
            let job = read.remove(id);
            let has_ended = job.as_ref().is_none_or(|job| job.state.is_terminal());
            if let Some(job) = job.filter(|job| **channel.borrow() != *job) {
                channel.send_replace(Arc::new(job));
            }
            if has_ended {
                channels.jobs.remove(id);
            }
        }
    }
}

impl Store {
    /// A job's record, now and after every change. The channel is closed after the job's end, and when it is deleted.
    ///
    /// # Errors
    /// [`StoreError::NotFound`], [`StoreError::Database`].
    pub async fn follow(&self, id: Uuid) -> Result<watch::Receiver<Arc<JobRecord>>, StoreError> {
        if let Some(channel) = self.followed.lock().jobs.get(&id) {
            return Ok(channel.subscribe());
        }
        // A change after this is seen below: whoever reads from then on looks for changes since.
        let mut changes = self.news.changes.subscribe();
        changes.mark_changed();
        let job = self.job(id).await?;
        if job.state.is_terminal() {
            return Ok(watch::channel(Arc::new(job)).1);
        }
        let mut channels = self.followed.lock();
        let channel = channels.jobs.entry(id).or_insert_with(|| watch::channel(Arc::new(job)).0);
        let receiver = channel.subscribe();
        if std::mem::replace(&mut channels.is_read, true) {
            self.announce();
        } else {
            tokio::spawn(read_followed(self.clone(), changes));
        }
        Ok(receiver)
    }
}

/// Reads the jobs that are followed after every change, as long as there are any.
async fn read_followed(store: Store, mut changes: watch::Receiver<u64>) {
    while let Some(wanted) = store.followed.wanted() {
        changes.mark_unchanged();
        match jobs_with_ids(&store, &wanted).await {
            Ok(jobs) => store.followed.tell(&wanted, jobs),
            Err(error) => tracing::warn!(%error, "jobs that are followed cannot be read; will retry"),
        }
        tokio::time::sleep(PAUSE).await;
        if changes.changed().await.is_err() {
            return;
        }
    }
}

async fn jobs_with_ids(store: &Store, ids: &[Uuid]) -> Result<Vec<JobRecord>, StoreError> {
    let mut jobs = Vec::with_capacity(ids.len());
    let mut snapshot = store.read().await?;
    for ids in ids.chunks(BATCH) {
        let places: Vec<String> = (1..=ids.len()).map(|place| format!("${place}")).collect();
        let text = format!(concat!(select_jobs!(), "WHERE j.id IN ({})"), places.join(", "));
        let mut query = snapshot.query_composed(text);
        for id in ids {
            query = query.bind(*id);
        }
        for row in query.fetch_all().await? {
            jobs.push(readable_job(&row)?);
        }
    }
    place(&mut snapshot, &mut jobs).await?;
    Ok(jobs)
}

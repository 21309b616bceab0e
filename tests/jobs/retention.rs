//! Jobs and clouds are kept as long as was asked for.

use std::time::Duration;

use chladni::jobs::{Compute, Jobs, JobsSettings, Retention};
use chladni::store::{Milliseconds, Owner, StoreError};
use uuid::Uuid;

use crate::stage::{Stage, cloud, submit, succeeded};
use crate::workers::{PATIENCE, quick, succeeding};

const DAY: Milliseconds = 24 * 60 * 60 * 1000;

#[tokio::test]
async fn only_jobs_that_ended_before_are_deleted_with_their_results() {
    let stage = Stage::new();
    let store = stage.open().await;
    let old = succeeded(&store, 50, 2).await;
    stage.advance(2 * DAY);
    let running = submit(&store, &cloud(50, 2), 2).await.id;
    store.claim(Uuid::now_v7()).await.unwrap().unwrap();
    let queued = submit(&store, &cloud(50, 3), 2).await.id;
    stage.advance(2 * DAY);
    assert!(!store.expire_job(4 * DAY).await.unwrap(), "it ended just so long ago");
    assert!(store.expire_job(3 * DAY).await.unwrap());
    assert!(!store.expire_job(0).await.unwrap(), "neither a running nor a queued job ended");
    assert!(matches!(store.job(old).await, Err(StoreError::NotFound)));
    assert_eq!(
        stage.number("SELECT (SELECT count(*) FROM bases) + (SELECT count(*) FROM basis_chunks)").await,
        0
    );
    assert!(store.job(running).await.is_ok() && store.job(queued).await.is_ok());
}

#[tokio::test]
async fn only_clouds_without_jobs_are_deleted() {
    let stage = Stage::new();
    let store = stage.open().await;
    let alone = store.submit(&cloud(20, 1), None).await.unwrap().cloud.id;
    let in_use = submit(&store, &cloud(20, 2), 2).await.cloud_id;
    stage.advance(DAY);
    let young = store.submit(&cloud(20, 3), None).await.unwrap().cloud.id;
    assert!(store.expire_cloud(DAY / 2).await.unwrap());
    assert!(!store.expire_cloud(DAY / 2).await.unwrap());
    assert!(matches!(store.cloud(alone).await, Err(StoreError::NotFound)));
    assert!(store.cloud(in_use).await.is_ok() && store.cloud(young).await.is_ok());
}

#[tokio::test]
async fn workers_delete_what_is_too_old_when_they_start() {
    let stage = Stage::new();
    let store = stage.open().await;
    succeeded(&store, 50, 2).await;
    stage.advance(2 * DAY);
    let day = Some(Duration::from_hours(24));
    let settings = JobsSettings { retention: Retention { jobs: day, clouds: day }, ..quick() };
    let mut changes = store.changes();
    let compute = Compute::new("analysis", 1).unwrap();
    let jobs = Jobs::start(store.clone(), compute, succeeding(), settings).await.unwrap();
    let wait = async {
        while !store.clouds(&Owner::nobody(), None, 10).await.unwrap().items.is_empty() {
            changes.changed().await.unwrap();
        }
    };
    tokio::time::timeout(PATIENCE, wait).await.expect("nothing was deleted");
    jobs.stop(PATIENCE).await;
    assert_eq!(stage.number("SELECT count(*) FROM jobs").await, 0);
}

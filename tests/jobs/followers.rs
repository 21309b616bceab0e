//! Whoever follows a job learns of its changes without asking the database.

use std::sync::Arc;

use chladni::store::{JobRecord, JobState, StoreError};
use uuid::Uuid;

use crate::stage::{Stage, cloud, complete, submit, vitals};

#[tokio::test]
async fn followers_are_told_of_every_end_and_of_their_place_in_the_queue() {
    let stage = Stage::new();
    let store = stage.open().await;
    let first = submit(&store, &cloud(5, 1), 2).await.id;
    let second = submit(&store, &cloud(5, 2), 2).await.id;
    let mut followers = Vec::new();
    for id in [first, second].into_iter().cycle().take(100) {
        followers.push((id, store.follow(id).await.unwrap()));
    }
    let until = async |wanted: fn(&JobRecord) -> bool, of: Uuid, followers: &mut Vec<_>| {
        for (id, follower) in followers {
            let follower: &mut tokio::sync::watch::Receiver<Arc<JobRecord>> = follower;
            if *id == of {
                follower.wait_for(|job| wanted(job)).await.unwrap();
            }
        }
    };
    until(|job| job.queue_position == Some(1), second, &mut followers).await;
    let claim = store.claim(Uuid::now_v7()).await.unwrap().unwrap();
    until(|job| job.state == JobState::Running, first, &mut followers).await;
    until(|job| job.queue_position == Some(0), second, &mut followers).await;
    store.heartbeat(&claim, &vitals()).await.unwrap();
    until(|job| job.progress > 0.9, first, &mut followers).await;
    complete(&store, &claim).await.unwrap();
    until(|job| job.state == JobState::Succeeded && job.report.is_some(), first, &mut followers).await;
    for (id, follower) in &mut followers {
        if *id == first {
            assert!(follower.changed().await.is_err(), "nothing comes after the end");
        }
    }
    store.request_cancel(second).await.unwrap();
    until(|job| job.state == JobState::Canceled, second, &mut followers).await;
}

#[tokio::test]
async fn following_ends_with_the_job_and_begins_with_what_is_known() {
    let stage = Stage::new();
    let store = stage.open().await;
    assert!(matches!(store.follow(Uuid::now_v7()).await, Err(StoreError::NotFound)));
    let job = submit(&store, &cloud(5, 1), 2).await.id;
    let mut follower = store.follow(job).await.unwrap();
    assert_eq!(follower.borrow().state, JobState::Queued);
    store.request_cancel(job).await.unwrap();
    assert!(store.delete_job(job).await.unwrap());
    while follower.changed().await.is_ok() {}
    let done = crate::stage::succeeded(&store, 20, 2).await;
    let mut late = store.follow(done).await.unwrap();
    assert_eq!(late.borrow().state, JobState::Succeeded);
    assert!(late.changed().await.is_err());
}

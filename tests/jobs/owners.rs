//! What one owner stores, no other sees.

use chladni::analysis::JobKind;
use chladni::store::Owner;
use uuid::Uuid;

use crate::stage::{Stage, cloud, parameters, store_for};

#[tokio::test]
async fn the_same_content_of_two_owners_is_two_clouds_and_two_jobs() {
    let stage = Stage::new();
    let store = stage.open().await;
    let owners = [Owner::named("alpha"), Owner::named("beta"), Owner::nobody()];
    let mut submitted = Vec::new();
    for owner in &owners {
        let job = Some((JobKind::Eigen, parameters(2)));
        let first = store_for(&store, owner, cloud(20, 1), job.clone()).await.unwrap();
        assert!(first.cloud_created && first.job_created, "nothing tells that another owner has it");
        let again = store_for(&store, owner, cloud(20, 1), job).await.unwrap();
        assert!(!again.cloud_created && !again.job_created);
        assert_eq!(again.cloud, first.cloud);
        submitted.push(first);
    }
    for (owner, own) in owners.iter().zip(&submitted) {
        let clouds = store.clouds(owner, None, 10).await.unwrap().items;
        assert_eq!(clouds, std::slice::from_ref(&own.cloud));
        let jobs = store.jobs(owner, None, None, None, 10).await.unwrap().items;
        assert_eq!(jobs.iter().map(|job| job.id).collect::<Vec<_>>(), [own.job.as_ref().unwrap().id]);
        for other in &submitted {
            let mine = other.cloud.owner == *owner;
            assert_eq!(store.owns(owner, other.cloud.id).await.unwrap(), mine);
            assert_eq!(store.owns(owner, other.job.as_ref().unwrap().id).await.unwrap(), mine);
            let listed = store.jobs(owner, None, Some(other.cloud.id), None, 10).await.unwrap();
            assert_eq!(listed.items.len(), usize::from(mine), "naming another's cloud lists nothing");
        }
        assert!(!store.owns(owner, Uuid::now_v7()).await.unwrap());
    }
}

#[tokio::test]
async fn a_further_job_belongs_to_the_owner_of_its_cloud() {
    let stage = Stage::new();
    let store = stage.open().await;
    let owner = Owner::named("alpha");
    let stored = store_for(&store, &owner, cloud(20, 1), None).await.unwrap();
    let job = store.submit_job(stored.cloud.id, JobKind::Eigen, parameters(2)).await.unwrap().job.unwrap();
    assert!(store.owns(&owner, job.id).await.unwrap());
    assert!(!store.owns(&Owner::nobody(), job.id).await.unwrap());
}

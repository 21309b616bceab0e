//! Owners are served in turn, each within its limits.

use chladni::store::{Claim, Owner, Store, StoreError};
use uuid::Uuid;

use crate::stage::{Stage, cloud, complete, store_for, submit_for};

async fn claim(store: &Store) -> Claim {
    store.claim(Uuid::now_v7()).await.unwrap().unwrap()
}

#[tokio::test]
async fn a_single_job_of_another_owner_is_next_beside_a_thousand() {
    let stage = Stage::new();
    let store = stage.open_with_queue(2000).await;
    let (many, few) = (Owner::named("many"), Owner::named("few"));
    let cloud = cloud(5, 1);
    for bases in 1..=1000 {
        let job = Some((chladni::analysis::JobKind::Eigen, crate::stage::parameters(bases)));
        store_for(&store, &many, cloud.clone(), job).await.unwrap();
    }
    claim(&store).await;
    let single = submit_for(&store, &few, crate::stage::cloud(5, 2), 2).await.unwrap();
    assert_eq!(single.queue_position, Some(0));
    assert_eq!(claim(&store).await.job.id, single.id);
    assert_eq!(claim(&store).await.job.owner, many);
}

#[tokio::test]
async fn owners_take_turns_and_positions_foretell_the_order() {
    let stage = Stage::new();
    let store = stage.open().await;
    let mut jobs = Vec::new();
    for (seed, (name, count)) in [("a", 4), ("b", 1), ("c", 3)].into_iter().enumerate() {
        for bases in 1..=count {
            let cloud = cloud(5, seed as u32);
            jobs.push(submit_for(&store, &Owner::named(name), cloud, bases).await.unwrap().id);
        }
    }
    let mut foretold = Vec::new();
    for &job in &jobs {
        foretold.push((store.job(job).await.unwrap().queue_position.unwrap(), job));
    }
    foretold.sort_unstable();
    for owner in ["a", "b", "c"] {
        for job in store.jobs(&Owner::named(owner), None, None, None, 10).await.unwrap().items {
            assert!(foretold.contains(&(job.queue_position.unwrap(), job.id)), "listings say the same");
        }
    }
    let mut order = String::new();
    for (position, (place, job)) in foretold.into_iter().enumerate() {
        let claim = claim(&store).await;
        assert_eq!((place, claim.job.id), (position as u64, job));
        order.push_str(if jobs[..4].contains(&job) {
            "a"
        } else if job == jobs[4] {
            "b"
        } else {
            "c"
        });
        complete(&store, &claim).await.unwrap();
    }
    assert_eq!(order, "abcacaca");
    // Whoever was served last waits for the others, also when these come later.
    submit_for(&store, &Owner::named("a"), cloud(5, 7), 1).await.unwrap();
    let later = submit_for(&store, &Owner::named("b"), cloud(5, 8), 1).await.unwrap();
    assert_eq!(claim(&store).await.job.id, later.id);
}

#[tokio::test]
async fn an_owner_that_has_filled_its_part_of_the_queue_or_all_of_it_keeps_no_other_out() {
    let stage = Stage::new();
    let store = stage
        .open_with(|settings| {
            settings.queue_max = 4;
            settings.queue_max_per_owner = 3;
        })
        .await;
    let (greedy, modest, last) = (Owner::named("greedy"), Owner::named("modest"), Owner::named("last"));
    for bases in 1..=3 {
        submit_for(&store, &greedy, cloud(9, 1), bases).await.unwrap();
    }
    let refused = submit_for(&store, &greedy, cloud(9, 1), 4).await;
    assert!(matches!(refused, Err(StoreError::OwnerQueueFull { limit: 3 })), "{refused:?}");
    // Two wait, so that a share is two jobs, whoever filled the queue.
    for bases in 1..=2 {
        submit_for(&store, &modest, cloud(9, 2), bases).await.unwrap();
    }
    let refused = submit_for(&store, &modest, cloud(9, 2), 3).await;
    assert!(matches!(refused, Err(StoreError::QueueFull { limit: 4 })), "{refused:?}");
    submit_for(&store, &last, cloud(9, 3), 1).await.unwrap();
}

#[tokio::test]
async fn an_owner_stores_no_more_bytes_than_it_may_and_may_again_after_deleting() {
    let stage = Stage::new();
    let bytes = 3 * 8 * 1000;
    let store = stage.open_with(|settings| settings.stored_bytes_max_per_owner = 3 * bytes).await;
    let (own, other) = (Owner::named("own"), Owner::named("other"));
    let store_cloud = async |owner: &Owner, seed| {
        store_for(&store, owner, cloud(1000, seed), None).await.map(|stored| stored.cloud.id)
    };
    let mut clouds = Vec::new();
    for seed in 0..3 {
        clouds.push(store_cloud(&own, seed).await.unwrap());
    }
    let refused = store_cloud(&own, 3).await;
    assert!(
        matches!(refused, Err(StoreError::OwnerStorageFull { stored, more, limit })
            if (stored, more, limit) == (3 * bytes, bytes, 3 * bytes)),
        "{refused:?}"
    );
    store_cloud(&other, 3).await.unwrap();
    assert!(store_cloud(&own, 0).await.is_ok(), "what is there already takes nothing");
    store.delete_cloud(clouds.pop().unwrap()).await.unwrap();
    // A result counts from the moment that it is promised: 5 bases and the mass.
    let parameters = |bases| Some((chladni::analysis::JobKind::Eigen, crate::stage::parameters(bases)));
    let again = |bases| store_for(&store, &own, cloud(1000, 0), parameters(bases));
    assert!(matches!(again(5).await, Err(StoreError::OwnerStorageFull { .. })));
    let job = again(2).await.unwrap().job.unwrap();
    let claim = claim(&store).await;
    complete(&store, &claim).await.unwrap();
    assert_eq!(stage.number("SELECT bytes FROM jobs").await, 8 * 1000 * 3);
    assert!(matches!(store_cloud(&own, 9).await, Err(StoreError::OwnerStorageFull { .. })));
    store.delete_job(job.id).await.unwrap();
    store_cloud(&own, 9).await.unwrap();
}

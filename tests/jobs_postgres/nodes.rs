//! What only nodes that share a database can show. A store of its own stands for each.

use std::collections::HashSet;
use std::time::Duration;

use chladni::analysis::JobKind;
use chladni::store::{ArrayName, JobState, NodeSettings, Numbers, Order, Store, StoreError};
use uuid::Uuid;

use crate::stage::{LEASE, Stage, basis_values, bits, cloud, complete, mass, parameters, submit, vitals};

/// Longer than anything takes, shorter than a test may.
const PATIENCE: Duration = Duration::from_secs(20);

const HOUR: i64 = 60 * 60 * 1000;

async fn node(stage: &Stage, memory_budget: u64) -> Store {
    let node = NodeSettings { threads: 1, workers: 1 };
    stage.open_with(|settings| (settings.memory_budget, settings.node) = (memory_budget, node)).await
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_job_is_submitted_to_one_followed_at_another_canceled_at_a_third_and_run_by_a_fourth() {
    let stage = Stage::new();
    let [a, b, c, d] = [stage.open().await, stage.open().await, stage.open().await, stage.open().await];
    let job = submit(&a, &cloud(20, 1), 2).await.id;
    let mut follower = b.follow(job).await.unwrap();
    let claim = d.claim(d.node()).await.unwrap().unwrap();
    let told = async |follower: &mut tokio::sync::watch::Receiver<_>, state| {
        let until = follower.wait_for(|job: &std::sync::Arc<chladni::store::JobRecord>| job.state == state);
        tokio::time::timeout(PATIENCE, until).await.expect("nobody tells").unwrap();
    };
    told(&mut follower, JobState::Running).await;
    d.heartbeat(&claim, &vitals()).await.unwrap();
    c.request_cancel(job).await.unwrap();
    assert_eq!(d.order(&claim).await.unwrap(), Order::Cancel);
    d.cancel_claimed(&claim).await.unwrap();
    told(&mut follower, JobState::Canceled).await;
    assert_eq!(a.job(job).await.unwrap(), c.job(job).await.unwrap());
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn what_one_node_queues_another_hears_of_at_once() {
    let stage = Stage::new();
    let (a, b) = (stage.open().await, stage.open().await);
    let mut arrivals = b.arrivals();
    // Its listener's own beginning.
    tokio::time::timeout(PATIENCE, arrivals.changed()).await.expect("it does not listen").unwrap();
    let submitted = std::time::Instant::now();
    submit(&a, &cloud(20, 1), 2).await;
    tokio::time::timeout(PATIENCE, arrivals.changed()).await.expect("nobody told it").unwrap();
    assert!(submitted.elapsed() < Duration::from_secs(5), "{:?}", submitted.elapsed());
}

#[tokio::test]
async fn results_are_the_same_bytes_from_every_node() {
    let stage = Stage::new();
    let (a, b) = (stage.open().await, stage.open().await);
    let job = submit(&a, &cloud(9000, 1), 3).await;
    complete(&b, &b.claim(b.node()).await.unwrap().unwrap()).await.unwrap();
    for index in 0..3 {
        assert_eq!(
            bits(&a.basis(job.id, index).await.unwrap()),
            bits(&b.basis(job.id, index).await.unwrap())
        );
    }
    assert_eq!(a.load_cloud(job.cloud_id).await.unwrap(), b.load_cloud(job.cloud_id).await.unwrap());
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn of_many_nodes_that_claim_at_once_each_job_is_one_nodes() {
    const JOBS: u32 = 120;
    let stage = Stage::new();
    let first = stage.open().await;
    let mut submitted = HashSet::new();
    for seed in 0..JOBS {
        submitted.insert(submit(&first, &cloud(4, seed), 1).await.id);
    }
    let mut claiming = Vec::new();
    for _ in 0..4 {
        let store = stage.open().await;
        claiming.push(tokio::spawn(async move {
            let mut claimed = Vec::new();
            while let Some(claim) = store.claim(store.node()).await.unwrap() {
                claimed.push(claim.job.id);
            }
            claimed
        }));
    }
    let mut all = Vec::new();
    for claimed in claiming {
        all.extend(claimed.await.unwrap());
    }
    // A node that finds every waiting job being claimed stops asking: what is left then, the next one takes.
    while let Some(claim) = first.claim(first.node()).await.unwrap() {
        all.push(claim.job.id);
    }
    assert_eq!(all.len(), JOBS as usize);
    assert_eq!(all.into_iter().collect::<HashSet<_>>(), submitted);
}

#[tokio::test]
async fn a_start_takes_nothing_from_the_living_and_leaves_their_arrays() {
    let stage = Stage::new();
    let living = stage.open().await;
    let job = submit(&living, &cloud(30, 1), 2).await.id;
    let claim = living.claim(living.node()).await.unwrap().unwrap();
    living.begin_result(&claim).await.unwrap();
    living.put_array(&claim, ArrayName::Mass, Numbers::F64(mass(30))).await.unwrap();
    living.put_bases(&claim, vec![basis_values(30, 0)]).await.unwrap();
    let starting = stage.open().await;
    assert_eq!(starting.requeue_orphans(starting.node()).await.unwrap(), 0);
    assert!(starting.claim(starting.node()).await.unwrap().is_none());
    assert_eq!(stage.number("SELECT count(*) FROM bases").await, 1);
    // Stopped for longer than its lease: the job is the other's, and what it writes when it goes on is refused.
    stage.advance(LEASE + 1);
    let taken = starting.claim(starting.node()).await.unwrap().unwrap();
    assert_eq!((taken.job.id, taken.job.attempt), (job, 2));
    let late = living.put_bases(&claim, vec![basis_values(30, 1)]).await;
    assert!(matches!(late, Err(StoreError::LostClaim)), "{late:?}");
    assert_eq!(complete(&starting, &taken).await.unwrap(), JobState::Succeeded);
}

#[tokio::test]
async fn a_small_node_leaves_large_jobs_to_larger_ones() {
    let stage = Stage::new();
    let measuring = Stage::new();
    let need = submit(&measuring.open().await, &cloud(2000, 1), 2).await.memory;
    let (small, large) = (node(&stage, need - 1).await, node(&stage, need).await);
    let big = submit(&small, &cloud(2000, 1), 2).await.id;
    let little = submit(&small, &cloud(20, 2), 2).await.id;
    assert_eq!(small.claim_within(small.node(), need - 1, true).await.unwrap().unwrap().job.id, little);
    assert!(small.claim_within(small.node(), need - 1, true).await.unwrap().is_none());
    // Among those that it could run, the first waits for room.
    let behind = submit(&small, &cloud(20, 3), 2).await.id;
    assert!(large.claim_within(large.node(), need - 1, true).await.unwrap().is_none());
    assert_eq!(large.claim_within(large.node(), need, true).await.unwrap().unwrap().job.id, big);
    assert_eq!(small.claim_within(small.node(), need - 1, true).await.unwrap().unwrap().job.id, behind);
}

#[tokio::test]
async fn a_job_fails_for_memory_only_when_no_node_of_the_last_hour_could_take_it() {
    let stage = Stage::new();
    let measuring = Stage::new();
    let need = submit(&measuring.open().await, &cloud(100, 1), 2).await.memory;
    let large = node(&stage, need).await;
    let job = submit(&large, &cloud(100, 1), 2).await.id;
    large.close().await;
    let small = node(&stage, need - 1).await;
    stage.advance(HOUR - 1000);
    assert_eq!(small.fail_over_budget().await.unwrap(), 0);
    stage.advance(2000);
    assert_eq!(small.fail_over_budget().await.unwrap(), 1);
    let ended = small.job(job).await.unwrap();
    assert_eq!((ended.state, ended.failure.unwrap().code.as_str()), (JobState::Failed, "memory"));
    let refused = small.submit(&cloud(100, 2), Some((JobKind::Eigen, parameters(2)))).await;
    assert!(matches!(refused, Err(StoreError::OverBudget { .. })), "{refused:?}");
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn the_same_content_at_once_at_many_nodes_is_one_cloud_and_one_job() {
    let stage = Stage::new();
    for round in 0..5 {
        let submissions = futures_util::future::join_all((0..4).map(|_| stage.open())).await;
        let submissions = submissions.into_iter().map(|store| {
            tokio::spawn(async move {
                store.submit(&cloud(3000, round), Some((JobKind::Eigen, parameters(2)))).await.unwrap()
            })
        });
        let submitted: Vec<_> =
            futures_util::future::join_all(submissions).await.into_iter().map(Result::unwrap).collect();
        assert_eq!(submitted.iter().filter(|submitted| submitted.cloud_created).count(), 1);
        assert_eq!(submitted.iter().filter(|submitted| submitted.job_created).count(), 1);
        let ids: HashSet<Uuid> =
            submitted.iter().map(|submitted| submitted.job.as_ref().unwrap().id).collect();
        assert_eq!(ids.len(), 1);
    }
    assert_eq!(stage.number("SELECT count(*) FROM clouds").await, 5);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_cloud_is_deleted_or_gets_its_job_but_no_acknowledged_job_goes_with_it() {
    let stage = Stage::new();
    let (a, b) = (stage.open().await, stage.open().await);
    let mut kept = 0;
    for round in 0..30 {
        let stored = a.submit(&cloud(20, round), None).await.unwrap().cloud.id;
        let deleting = {
            let a = a.clone();
            tokio::spawn(async move { a.delete_cloud(stored).await })
        };
        let queued = b.submit_job(stored, JobKind::Eigen, parameters(2)).await;
        let deleted = deleting.await.unwrap();
        match (queued, deleted) {
            (Ok(submitted), Err(StoreError::CloudInUse)) => {
                assert_eq!(a.job(submitted.job.unwrap().id).await.unwrap().state, JobState::Queued);
                kept += 1;
            }
            (Err(StoreError::NotFound), Ok(())) => {}
            other => panic!("{other:?}"),
        }
    }
    println!("{kept} of 30 jobs were first");
}

#[tokio::test]
async fn a_servers_full_disk_is_told_as_one() {
    let stage = Stage::new();
    let store = stage.open().await;
    submit(&store, &cloud(30, 1), 2).await;
    let claim = store.claim(store.node()).await.unwrap().unwrap();
    for statement in [
        "CREATE FUNCTION fill() RETURNS trigger LANGUAGE plpgsql AS $$ \
         BEGIN RAISE 'could not extend file' USING ERRCODE = '53100'; END $$",
        "CREATE TRIGGER full_disk BEFORE INSERT ON bases FOR EACH ROW EXECUTE FUNCTION fill()",
    ] {
        stage.tamper(statement).await;
    }
    store.begin_result(&claim).await.unwrap();
    let refused = store.put_bases(&claim, vec![basis_values(30, 0)]).await;
    assert!(matches!(refused, Err(StoreError::StorageFull)), "{refused:?}");
    stage.tamper("DROP TRIGGER full_disk ON bases").await;
    assert_eq!(complete(&store, &claim).await.unwrap(), JobState::Succeeded);
}

#[tokio::test]
async fn a_name_with_a_zero_character_is_stored_without_it() {
    let stage = Stage::new();
    let store = stage.open().await;
    let stored = store.submit(&cloud(20, 1), None).await.unwrap().cloud;
    let named = store.name_cloud(stored.id, "a\0b.ply".to_owned()).await.unwrap();
    assert_eq!(named.name.as_deref(), Some("a\u{fffd}b.ply"));
}

#[tokio::test]
async fn the_servers_clock_tells_the_time_of_all_nodes() {
    let stage = Stage::new();
    let store = stage.open_with(|settings| settings.clock = chladni::store::Clock::default()).await;
    let stored = store.submit(&cloud(20, 1), None).await.unwrap().cloud;
    let of_server = stage.number("SELECT (extract(epoch FROM clock_timestamp()) * 1000)::bigint").await;
    assert!((of_server - stored.created).abs() < 20_000, "{of_server} {}", stored.created);
}

#[tokio::test]
async fn a_job_that_a_node_cannot_read_is_left_to_another_version_while_there_is_one() {
    let stage = Stage::new();
    let store = node(&stage, u64::MAX >> 1).await;
    let future = submit(&store, &cloud(20, 1), 2).await.id;
    let behind = submit(&store, &cloud(20, 2), 2).await.id;
    stage
        .tamper("UPDATE jobs SET parameters = json_set(parameters, '$.future', 1) WHERE id = (SELECT id FROM jobs ORDER BY id LIMIT 1)")
        .await;
    stage
        .tamper(
            "INSERT INTO nodes (id, version, memory_budget, threads, workers, heartbeat) \
             SELECT gen_random_uuid(), '9.9.9', memory_budget, threads, workers, heartbeat FROM nodes",
        )
        .await;
    let state = "SELECT count(*) FROM jobs WHERE state = 'queued' AND attempt = 0 AND process_id IS NULL";
    assert_eq!(store.claim(store.node()).await.unwrap().unwrap().job.id, behind);
    assert_eq!(stage.number(state).await, 1, "it is not left as it was");
    assert!(store.claim(store.node()).await.unwrap().is_none(), "it is looked at again at once");
    // The other node is gone.
    stage.advance(HOUR);
    store.claim(store.node()).await.unwrap();
    let ended = store.job(future).await.unwrap();
    assert_eq!((ended.state, stage.number(state).await), (JobState::Failed, 0));
}

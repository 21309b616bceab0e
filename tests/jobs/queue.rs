//! The queue, one rule at a time. `model.rs` mixes them all.

use std::collections::HashMap;

use chladni::analysis::JobKind;
use chladni::progress::Phase;
use chladni::store::{ArrayName, JobFailure, JobState, Numbers, Order, Owner, StoreError, Vitals};
use uuid::Uuid;

use crate::stage::{
    ATTEMPTS_MAX, LEASE, Stage, basis_values, cloud, complete, mass, parameters, report, submit, succeeded,
    vitals,
};

fn failure() -> JobFailure {
    JobFailure { code: "numerical".to_owned(), detail: "made up".to_owned() }
}

#[tokio::test]
async fn jobs_are_claimed_in_the_order_of_their_submission() {
    let stage = Stage::new();
    let store = stage.open().await;
    let process = Uuid::now_v7();
    let mut submitted = Vec::new();
    for seed in 0..4 {
        submitted.push(submit(&store, &cloud(5, seed), 2).await.id);
    }
    for (position, &job) in submitted.iter().enumerate() {
        assert_eq!(store.job(job).await.unwrap().queue_position, Some(position as u64));
    }
    for &job in &submitted {
        let claim = store.claim(process).await.unwrap().unwrap();
        assert_eq!(claim.job.id, job);
        assert_eq!((claim.job.state, claim.job.attempt), (JobState::Running, 1));
        assert_eq!(claim.job.queue_position, None);
        assert_eq!(claim.job.started, Some(stage.now()));
    }
    assert!(store.claim(process).await.unwrap().is_none());
}

#[tokio::test]
async fn a_heartbeat_stores_phase_and_progress_and_progress_does_not_fall() {
    let stage = Stage::new();
    let store = stage.open().await;
    let job = submit(&store, &cloud(5, 1), 2).await;
    assert_eq!((job.phase, job.started), (None, None));
    let claim = store.claim(Uuid::now_v7()).await.unwrap().unwrap();
    let beat = |progress| Vitals {
        phase: Phase::Assembly,
        progress,
        phase_seconds: vec![(Phase::Preparation, 0.25), (Phase::Assembly, 2.0)],
        memory: 1,
    };
    for (sent, stored) in [(0.5, 0.5), (0.4, 0.5), (7.0, 1.0)] {
        assert_eq!(store.heartbeat(&claim, &beat(sent)).await.unwrap(), Order::Continue);
        let record = store.job(job.id).await.unwrap();
        assert_eq!(record.phase, Some(Phase::Assembly));
        assert!((record.progress - stored).abs() < f64::EPSILON, "{sent}");
        assert_eq!(record.phase_seconds, beat(sent).phase_seconds);
    }
}

#[tokio::test]
async fn a_lease_holds_while_it_is_renewed_and_ends_when_it_is_not() {
    let stage = Stage::new();
    let store = stage.open().await;
    let (first, second) = (Uuid::now_v7(), Uuid::now_v7());
    submit(&store, &cloud(5, 1), 2).await;
    let claim = store.claim(first).await.unwrap().unwrap();
    for _ in 0..3 {
        stage.advance(LEASE);
        assert!(store.claim(second).await.unwrap().is_none());
        assert_eq!(store.heartbeat(&claim, &vitals()).await.unwrap(), Order::Continue);
    }
    stage.advance(LEASE + 1);
    let taken = store.claim(second).await.unwrap().unwrap();
    assert_eq!((taken.job.id, taken.job.attempt), (claim.job.id, 2));
    assert!(taken.lease > claim.lease);
    assert!(taken.job.progress.abs() < f64::EPSILON, "a new attempt begins at zero");
}

#[tokio::test]
async fn whoever_lost_the_claim_can_write_nothing() {
    let stage = Stage::new();
    let store = stage.open().await;
    submit(&store, &cloud(5, 1), 2).await;
    let stale = store.claim(Uuid::now_v7()).await.unwrap().unwrap();
    stage.advance(LEASE + 1);
    let current = store.claim(Uuid::now_v7()).await.unwrap().unwrap();
    let before = store.job(current.job.id).await.unwrap();

    assert_eq!(store.heartbeat(&stale, &vitals()).await.unwrap(), Order::Lost);
    assert_eq!(store.order(&stale).await.unwrap(), Order::Lost);
    let refusals = [
        store.begin_result(&stale).await,
        store.put_bases(&stale, vec![basis_values(5, 0)]).await,
        store.put_array(&stale, ArrayName::Mass, Numbers::F64(mass(5))).await,
        store.finish(&stale, &report(5, 2), &vitals()).await.map(|_| ()),
        store.fail(&stale, failure(), None).await.map(|_| ()),
        store.fail(&stale, failure(), Some(0)).await.map(|_| ()),
        store.cancel_claimed(&stale).await,
        store.release(&stale).await.map(|_| ()),
    ];
    for (index, refusal) in refusals.into_iter().enumerate() {
        assert!(matches!(refusal, Err(StoreError::LostClaim)), "{index}: {refusal:?}");
    }
    assert_eq!(store.job(current.job.id).await.unwrap(), before);
    assert_eq!(complete(&store, &current).await.unwrap(), JobState::Succeeded);
    assert!(matches!(complete(&store, &current).await, Err(StoreError::LostClaim)));
}

#[tokio::test]
async fn an_error_of_the_input_ends_the_job_at_once_and_another_is_tried_again() {
    let stage = Stage::new();
    let store = stage.open().await;
    let process = Uuid::now_v7();
    let job = submit(&store, &cloud(5, 1), 2).await;
    let claim = store.claim(process).await.unwrap().unwrap();
    assert_eq!(store.fail(&claim, failure(), None).await.unwrap(), JobState::Failed);
    let record = store.job(job.id).await.unwrap();
    assert_eq!((record.attempt, record.failure), (1, Some(failure())));
    assert_eq!(record.finished, Some(stage.now()));

    let again = submit(&store, &cloud(5, 1), 2).await;
    assert_ne!(again.id, job.id, "a failed analysis may be asked for again");
    for attempt in 1..=ATTEMPTS_MAX {
        let claim = store.claim(process).await.unwrap().unwrap();
        assert_eq!((claim.job.id, claim.job.attempt), (again.id, attempt));
        let expected = if attempt < ATTEMPTS_MAX { JobState::Queued } else { JobState::Failed };
        assert_eq!(store.fail(&claim, failure(), Some(0)).await.unwrap(), expected);
    }
    assert!(store.claim(process).await.unwrap().is_none());
}

#[tokio::test]
async fn a_job_that_was_given_back_in_good_order_has_not_used_up_an_attempt() {
    let stage = Stage::new();
    let store = stage.open().await;
    let job = submit(&store, &cloud(5, 1), 2).await;
    submit(&store, &cloud(5, 2), 2).await;
    let mut lease = 0;
    for _ in 0..2 * ATTEMPTS_MAX {
        let claim = store.claim(Uuid::now_v7()).await.unwrap().unwrap();
        assert_eq!((claim.job.id, claim.job.attempt), (job.id, 1), "it keeps its place in the queue");
        assert!(claim.lease > lease);
        lease = claim.lease;
        assert_eq!(store.release(&claim).await.unwrap(), JobState::Queued);
    }
}

#[tokio::test]
async fn a_queued_job_is_canceled_at_once() {
    let stage = Stage::new();
    let store = stage.open().await;
    let job = submit(&store, &cloud(5, 1), 2).await;
    let canceled = store.request_cancel(job.id).await.unwrap();
    assert_eq!((canceled.state, canceled.finished), (JobState::Canceled, Some(stage.now())));
    assert!(store.claim(Uuid::now_v7()).await.unwrap().is_none());
    assert_ne!(submit(&store, &cloud(5, 1), 2).await.id, job.id);
    assert!(matches!(store.request_cancel(Uuid::now_v7()).await, Err(StoreError::NotFound)));
}

#[tokio::test]
async fn a_running_job_hears_of_its_cancellation_and_never_ends_with_a_result() {
    let stage = Stage::new();
    let store = stage.open().await;
    let job = submit(&store, &cloud(5, 1), 2).await;
    let claim = store.claim(Uuid::now_v7()).await.unwrap().unwrap();
    let asked = store.request_cancel(job.id).await.unwrap();
    assert_eq!((asked.state, asked.cancel_requested), (JobState::Running, true));
    assert_eq!(store.order(&claim).await.unwrap(), Order::Cancel);
    assert_eq!(store.heartbeat(&claim, &vitals()).await.unwrap(), Order::Cancel);
    let again = submit(&store, &cloud(5, 1), 2).await;
    assert_ne!(again.id, job.id, "what is being canceled does not stand in for a new request");

    assert_eq!(complete(&store, &claim).await.unwrap(), JobState::Canceled);
    assert!(matches!(store.basis(job.id, 0).await, Err(StoreError::NoResult)));
    assert_eq!(stage.number("SELECT count(*) FROM basis_chunks").await, 0);
    assert_eq!(store.request_cancel(job.id).await.unwrap().state, JobState::Canceled);
}

#[tokio::test]
async fn a_canceled_job_whose_worker_dies_fails_to_store_or_stops_ends_canceled() {
    let stage = Stage::new();
    let store = stage.open().await;
    for ending in 0..4 {
        let job = submit(&store, &cloud(5, ending), 2).await;
        let claim = store.claim(Uuid::now_v7()).await.unwrap().unwrap();
        store.request_cancel(job.id).await.unwrap();
        match ending {
            0 => {
                stage.outlive_the_dead();
                assert_eq!(store.requeue_orphans(Uuid::now_v7()).await.unwrap(), 1);
            }
            1 => assert_eq!(store.fail(&claim, failure(), Some(0)).await.unwrap(), JobState::Canceled),
            2 => assert_eq!(store.release(&claim).await.unwrap(), JobState::Canceled),
            _ => {
                stage.advance(LEASE + 1);
                assert!(store.claim(Uuid::now_v7()).await.unwrap().is_none());
            }
        }
        assert_eq!(store.job(job.id).await.unwrap().state, JobState::Canceled, "{ending}");
    }
}

#[tokio::test]
async fn the_same_analysis_is_computed_once_and_another_kind_or_parameter_is_another() {
    let stage = Stage::new();
    let store = stage.open().await;
    let job = succeeded(&store, 20, 2).await;
    let same = store.submit(&cloud(20, 7), Some((JobKind::Eigen, parameters(2)))).await.unwrap();
    assert!(!same.cloud_created && !same.job_created);
    let same = same.job.unwrap();
    assert_eq!((same.id, same.state), (job, JobState::Succeeded));
    let others = [(JobKind::Eigen, parameters(3)), (JobKind::Operator, parameters(2))];
    for (kind, parameters) in others {
        let other = store.submit_job(same.cloud_id, kind, parameters.clone()).await.unwrap();
        assert!(other.job_created);
        assert_eq!(other.job.as_ref().unwrap().parameters, parameters);
        assert!(!store.submit_job(same.cloud_id, kind, parameters).await.unwrap().job_created);
    }
}

#[tokio::test]
async fn the_database_itself_refuses_the_same_analysis_twice_and_a_result_after_a_cancellation() {
    let stage = Stage::new();
    let store = stage.open().await;
    submit(&store, &cloud(5, 1), 2).await;
    let twice = "INSERT INTO jobs (id, cloud_id, created, kind, parameters, state) \
         SELECT randomblob(16), cloud_id, created, kind, parameters, state FROM jobs";
    let refused = stage.place().tamper(twice.to_owned()).await.unwrap_err();
    assert!(refused.as_database_error().unwrap().is_unique_violation(), "{refused}");
    let canceled = "UPDATE jobs SET state = 'succeeded', finished = 1, report = '{}', cancel_requested = 1";
    let refused = stage.place().tamper(canceled.to_owned()).await.unwrap_err();
    assert!(refused.as_database_error().unwrap().is_check_violation(), "{refused}");
}

#[tokio::test]
async fn deleting_a_running_job_asks_it_to_end_and_it_goes_then_and_any_other_goes_at_once() {
    let stage = Stage::new();
    let store = stage.open().await;
    let done = succeeded(&store, 20, 2).await;
    let running = submit(&store, &cloud(5, 1), 2).await;
    let claim = store.claim(Uuid::now_v7()).await.unwrap().unwrap();
    let queued = submit(&store, &cloud(5, 2), 2).await;

    assert!(store.delete_job(done).await.unwrap());
    assert!(matches!(store.job(done).await, Err(StoreError::NotFound)));
    assert!(matches!(store.delete_job(done).await, Err(StoreError::NotFound)));
    assert_eq!(stage.number("SELECT count(*) FROM basis_chunks").await, 0);

    assert!(store.delete_job(queued.id).await.unwrap());
    assert!(matches!(store.job(queued.id).await, Err(StoreError::NotFound)));
    assert!(!store.delete_job(running.id).await.unwrap());
    assert_eq!(store.order(&claim).await.unwrap(), Order::Cancel);
    assert!(store.job(running.id).await.is_ok(), "until it has ended");
    store.cancel_claimed(&claim).await.unwrap();
    assert!(matches!(store.job(running.id).await, Err(StoreError::NotFound)));
}

#[tokio::test]
async fn jobs_are_listed_newest_first_by_state_and_by_cloud() {
    let stage = Stage::new();
    let store = stage.open().await;
    let first = submit(&store, &cloud(5, 1), 2).await;
    let second = submit(&store, &cloud(5, 1), 3).await;
    let third = submit(&store, &cloud(5, 2), 2).await;
    store.request_cancel(second.id).await.unwrap();
    let listed = async |state, cloud, cursor, limit| {
        let page = store.jobs(&Owner::nobody(), state, cloud, cursor, limit).await.unwrap();
        (page.items.into_iter().map(|job| job.id).collect::<Vec<_>>(), page.next)
    };
    assert_eq!(listed(None, None, None, 10).await, (vec![third.id, second.id, first.id], None));
    assert_eq!(listed(Some(JobState::Queued), None, None, 10).await, (vec![third.id, first.id], None));
    assert_eq!(listed(None, Some(first.cloud_id), None, 10).await, (vec![second.id, first.id], None));
    let only = listed(Some(JobState::Queued), Some(first.cloud_id), None, 10).await;
    assert_eq!(only, (vec![first.id], None));
    let (page, next) = listed(None, None, None, 2).await;
    assert_eq!(page, [third.id, second.id]);
    assert_eq!(listed(None, None, next, 2).await, (vec![first.id], None));
    let counted = store.jobs_by_state().await.unwrap();
    assert_eq!(counted, HashMap::from([(JobState::Queued, 2), (JobState::Canceled, 1)]));
}

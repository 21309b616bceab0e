//! What is not taken on: too much memory, too little disk; and what waits until there is room.

use std::sync::Arc;
use std::time::Duration;

use chladni::analysis::{JobKind, Parameters, memory_estimate};
use chladni::cloud::shapes::{SampleRequest, Shape, sample};
use chladni::jobs::{Compute, Jobs, JobsSettings, default_analysis};
use chladni::operator::OperatorKind;
use chladni::store::{JobState, Store, StoreError};
use uuid::Uuid;

use crate::stage::{Stage, bits, cloud, complete, parameters, submit};
use crate::workers::{PATIENCE, gated, job_when, quick, succeeding};

/// Estimated bytes of a job on a cloud of `n` points with two bases.
async fn need(n: usize) -> u64 {
    let stage = Stage::new();
    submit(&stage.open().await, &cloud(n, 1), 2).await.memory
}

#[tokio::test]
async fn a_job_over_the_budget_is_refused_with_need_and_budget_and_leaves_nothing() {
    let stage = Stage::new();
    let need = need(100).await;
    let store = stage.open_with(|settings| settings.memory_budget = need - 1).await;
    let job = Some((chladni::analysis::JobKind::Eigen, parameters(2)));
    let refused = store.submit(&cloud(100, 1), job.clone()).await;
    assert!(
        matches!(refused, Err(StoreError::OverBudget { need: told, budget }) if told == need && budget == need - 1)
    );
    assert_eq!(stage.number("SELECT count(*) FROM clouds").await, 0);
    let stored = store.submit(&cloud(100, 1), None).await.unwrap().cloud;
    let refused = store.submit_job(stored.id, chladni::analysis::JobKind::Eigen, parameters(2)).await;
    assert!(matches!(refused, Err(StoreError::OverBudget { .. })));
    assert!(store.submit(&cloud(50, 1), job).await.is_ok(), "a smaller one is taken");
}

#[tokio::test]
async fn a_job_that_does_not_fit_is_thinned_out_unless_all_points_are_to_be_solved() {
    let stage = Stage::new();
    let need = need(20_000).await;
    let store = stage.open_with(|settings| settings.memory_budget = need - 1).await;
    let job = submit(&store, &cloud(20_000, 1), 2).await;
    assert_eq!(job.parameters.solved_points, Some(20_000 / 7));
    assert!(job.memory < need);
    assert_eq!(submit(&store, &cloud(20_000, 1), 2).await.id, job.id, "the same analysis is the same job");
    let exact = Parameters { exact: true, ..parameters(2) };
    let refused = store.submit(&cloud(20_000, 1), Some((JobKind::Eigen, exact))).await;
    assert!(matches!(refused, Err(StoreError::OverBudget { .. })));
}

/// Many threads read columns of the file at once while the result is stored.
#[tokio::test(flavor = "multi_thread")]
async fn bases_that_fit_into_a_file_only_are_the_same_as_those_that_memory_had_room_for() {
    let surface = sample(&SampleRequest::new(Shape::BumpySphere, 60_000)).unwrap();
    for (operator, bases) in [(OperatorKind::Voronoi, 100), (OperatorKind::PbMhb, 200)] {
        let parameters = Parameters { operator, bases, tolerance: 1e-3, ..Parameters::default() };
        let thinned = Parameters { solved_points: Some(60_000 / 7), ..parameters.clone() };
        let in_memory = memory_estimate(60_000, 3, 0, JobKind::Eigen, &thinned);
        let mut found = Vec::new();
        for (budget, asked) in [(in_memory - 1, parameters), (1 << 30, thinned)] {
            let stage = Stage::new();
            let store = stage.open_with(|settings| settings.memory_budget = budget).await;
            let job = store.submit(&surface, Some((JobKind::Eigen, asked))).await.unwrap().job.unwrap();
            assert_eq!(job.parameters.solved_points, Some(60_000 / 7));
            assert_eq!(job.memory < in_memory, budget < in_memory, "{}", job.memory);
            let compute = Compute::new("analysis", 4).unwrap();
            let settings = JobsSettings { memory: budget, ..quick() };
            let jobs = Jobs::start(store.clone(), compute, default_analysis(), settings).await.unwrap();
            let ended = job_when(&store, job.id, |job| job.state.is_terminal()).await;
            assert_eq!(ended.state, JobState::Succeeded, "{:?}", ended.failure);
            let mut all = Vec::new();
            for basis in [1, bases - 1] {
                all.push(bits(&store.basis(job.id, basis).await.unwrap()));
            }
            found.push(all);
            jobs.stop(PATIENCE).await;
        }
        assert!(found[0] == found[1], "{operator:?}");
    }
}

#[tokio::test]
async fn a_job_is_claimed_only_when_there_is_room_and_lets_no_other_past() {
    let stage = Stage::new();
    let store = stage.open().await;
    let large = submit(&store, &cloud(2000, 1), 2).await;
    let small = submit(&store, &cloud(20, 1), 2).await;
    let process = Uuid::now_v7();
    assert!(small.memory < large.memory);
    assert!(store.claim_within(process, large.memory - 1, true).await.unwrap().is_none());
    let claim = store.claim_within(process, large.memory, true).await.unwrap().unwrap();
    assert_eq!(claim.job.id, large.id);
    assert!(store.claim_within(process, small.memory - 1, true).await.unwrap().is_none());
    assert_eq!(store.claim_within(process, small.memory, true).await.unwrap().unwrap().job.id, small.id);
}

#[tokio::test]
async fn running_jobs_never_take_more_than_the_budget_together() {
    let stage = Stage::new();
    let store = stage.open().await;
    let need = need(100).await;
    let (analyze, mut gate) = gated(false);
    let settings = JobsSettings { concurrent: 4, memory: 2 * need + need / 2, ..quick() };
    let compute = Compute::new("analysis", 4).unwrap();
    let jobs = Jobs::start(store.clone(), compute, analyze, settings).await.unwrap();
    for seed in 0..4 {
        submit(&store, &cloud(100, seed), 2).await;
        jobs.wake();
    }
    gate.begun.recv().await.unwrap();
    gate.begun.recv().await.unwrap();
    assert_eq!(jobs.memory_taken(), 2 * need);
    assert_eq!(store.jobs_by_state().await.unwrap()[&JobState::Running], 2);
    // Room for the third only when one has ended.
    gate.let_go.send(()).unwrap();
    gate.begun.recv().await.unwrap();
    assert_eq!(store.jobs_by_state().await.unwrap()[&JobState::Running], 2);
    assert_eq!(jobs.memory_taken(), 2 * need);
    jobs.stop(Duration::ZERO).await;
    assert_eq!(jobs.memory_taken(), 0);
}

#[tokio::test]
async fn queued_jobs_that_a_smaller_budget_has_no_room_for_end_at_the_next_start() {
    let stage = Stage::new();
    let job = submit(&stage.open().await, &cloud(100, 1), 2).await;
    let store = stage.open_with(|settings| settings.memory_budget = job.memory - 1).await;
    let jobs = start(&store, quick()).await;
    let ended = store.job(job.id).await.unwrap();
    assert_eq!((ended.state, ended.failure.unwrap().code.as_str()), (JobState::Failed, "memory"));
    jobs.stop(PATIENCE).await;
}

#[tokio::test]
async fn a_result_that_cannot_be_stored_is_tried_again_later_and_lets_others_past() {
    let stage = Stage::new();
    let store = stage.open().await;
    stage.refuse_bases().await;
    let backoff = Duration::from_secs(30);
    let jobs = start(&store, JobsSettings { backoff, ..quick() }).await;
    let job = submit(&store, &cloud(20, 1), 2).await.id;
    jobs.wake();
    for (attempt, wait) in [(1, 30_000), (2, 60_000)] {
        job_when(&store, job, |job| job.state == JobState::Queued && job.attempt == attempt).await;
        stage.advance(wait - 1);
        assert!(store.claim(Uuid::now_v7()).await.unwrap().is_none(), "attempt {attempt}");
        stage.advance(1);
    }
    let ended = job_when(&store, job, |job| job.state.is_terminal()).await;
    assert_eq!((ended.state, ended.attempt), (JobState::Failed, 3));
    jobs.stop(PATIENCE).await;

    stage.accept_bases().await;
    let waits = submit(&store, &cloud(20, 2), 2).await.id;
    let claim = store.claim(Uuid::now_v7()).await.unwrap().unwrap();
    store.fail(&claim, claim.job.failure.clone().unwrap_or_else(made_up), Some(1000)).await.unwrap();
    let passes = submit(&store, &cloud(20, 3), 2).await.id;
    let claim = store.claim(Uuid::now_v7()).await.unwrap().unwrap();
    assert_eq!(claim.job.id, passes);
    complete(&store, &claim).await.unwrap();
    stage.advance(1000);
    assert_eq!(store.claim(Uuid::now_v7()).await.unwrap().unwrap().job.id, waits);
}

#[tokio::test]
async fn an_idle_queue_is_not_announced_and_not_written() {
    let stage = Stage::new();
    let store = stage.open().await;
    let changes = store.changes();
    // A claim that writes would wait.
    let _blocked = stage.block_writes().await;
    for _ in 0..3 {
        assert!(store.claim(Uuid::now_v7()).await.unwrap().is_none());
    }
    // Nodes that share a database are woken every few seconds.
    assert!(crate::SHARES || !changes.has_changed().unwrap());
}

fn made_up() -> chladni::store::JobFailure {
    chladni::store::JobFailure { code: "internal".to_owned(), detail: "made up".to_owned() }
}

pub(crate) async fn start(store: &Store, settings: JobsSettings) -> Jobs {
    let compute = Compute::new("analysis", 1).unwrap();
    Jobs::start(store.clone(), compute, Arc::clone(&succeeding()), settings).await.unwrap()
}

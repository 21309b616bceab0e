//! What is out of the ordinary: rows that cannot be read, clocks that are set back, attempts that must be alone, jobs that
//! take too long.

use std::sync::Arc;
use std::time::Duration;

use chladni::analysis::AnalysisError;
use chladni::jobs::{Compute, Jobs, JobsSettings};
use chladni::store::{JobFailure, JobState, Owner};
use uuid::Uuid;

use crate::stage::{LEASE, Stage, cloud, submit, vitals};
use crate::workers::{PATIENCE, counted, gated, job_when, quick, succeeding};

const HOUR: i64 = 60 * 60 * 1000;

#[tokio::test]
async fn a_job_that_cannot_be_read_fails_alone_and_the_queue_and_the_listing_go_on() {
    let stage = Stage::new();
    let store = stage.open().await;
    let unreadable = submit(&store, &cloud(20, 1), 2).await.id;
    let behind = submit(&store, &cloud(20, 2), 2).await.id;
    // A parameter that only another version knows.
    let changed = stage
        .tamper("UPDATE jobs SET parameters = json_set(parameters, '$.future', 1) WHERE id = (SELECT min(id) FROM jobs)")
        .await;
    assert_eq!(changed, 1);
    let shown = store.job(unreadable).await.unwrap();
    assert_eq!(shown.state, JobState::Failed);
    assert!(shown.failure.unwrap().detail.contains("another version"));
    assert_eq!(store.jobs(&Owner::nobody(), None, None, None, 10).await.unwrap().items.len(), 2);

    let compute = Compute::new("analysis", 1).unwrap();
    let jobs = Jobs::start(store.clone(), compute, succeeding(), quick()).await.unwrap();
    assert_eq!(job_when(&store, behind, |job| job.state.is_terminal()).await.state, JobState::Succeeded);
    jobs.stop(PATIENCE).await;
    assert_eq!(stage.number("SELECT count(*) FROM jobs WHERE state = 'failed' AND finished > 0").await, 1);
    assert!(store.delete_job(unreadable).await.unwrap());

    stage.tamper("UPDATE jobs SET report = '{}', report_checksum = NULL").await;
    let listed = store.jobs(&Owner::nobody(), None, None, None, 10).await.unwrap().items;
    assert_eq!((listed.len(), listed[0].state), (1, JobState::Failed));
}

#[tokio::test]
async fn a_clock_that_is_set_back_holds_no_job() {
    let stage = Stage::new();
    let store = stage.open().await;
    submit(&store, &cloud(5, 1), 2).await;
    let claim = store.claim(Uuid::now_v7()).await.unwrap().unwrap();
    store.release(&claim).await.unwrap();
    stage.advance(-HOUR);
    let claim = store.claim(Uuid::now_v7()).await.unwrap().expect("a job that was given back");
    let failure = JobFailure { code: "internal".to_owned(), detail: "made up".to_owned() };
    store.fail(&claim, failure, Some(60_000)).await.unwrap();
    assert!(store.claim(Uuid::now_v7()).await.unwrap().is_none());
    stage.advance(-HOUR);
    let stale = store.claim(Uuid::now_v7()).await.unwrap().expect("a job that waited for another attempt");

    stage.advance(-HOUR);
    // Its worker beats on: it keeps its claim. Once it does not, the job goes to another after the usual time.
    assert!(store.claim(Uuid::now_v7()).await.unwrap().is_none());
    store.heartbeat(&stale, &vitals()).await.unwrap();
    stage.advance(-HOUR);
    assert!(store.claim(Uuid::now_v7()).await.unwrap().is_none());
    stage.advance(LEASE + 1);
    assert_eq!(store.claim(Uuid::now_v7()).await.unwrap().unwrap().job.id, stale.job.id);
}

#[tokio::test]
async fn a_job_at_its_second_attempt_runs_alone() {
    let stage = Stage::new();
    let store = stage.open().await;
    let dead = Uuid::now_v7();
    let (suspect, beside) =
        (submit(&store, &cloud(10, 1), 2).await.id, submit(&store, &cloud(10, 2), 2).await.id);
    // Both ran when the process died: one of them may have killed it.
    store.claim(dead).await.unwrap().unwrap();
    store.claim(dead).await.unwrap().unwrap();
    let fresh = submit(&store, &cloud(10, 3), 2).await.id;
    stage.outlive_the_dead();

    let (analyze, mut gate) = gated(false);
    let settings = JobsSettings { concurrent: 3, ..quick() };
    let compute = Compute::new("analysis", 3).unwrap();
    let jobs = Jobs::start(store.clone(), compute, analyze, settings).await.unwrap();
    for alone in [suspect, beside] {
        gate.begun.recv().await.unwrap();
        tokio::time::sleep(Duration::from_millis(50)).await;
        assert_eq!(store.jobs_by_state().await.unwrap()[&JobState::Running], 1);
        assert_eq!(store.job(alone).await.unwrap().state, JobState::Running);
        gate.let_go.send(()).unwrap();
        assert_eq!(job_when(&store, alone, |job| job.state.is_terminal()).await.state, JobState::Succeeded);
    }
    gate.begun.recv().await.unwrap();
    gate.let_go.send(()).unwrap();
    assert_eq!(job_when(&store, fresh, |job| job.state.is_terminal()).await.attempt, 1);
    jobs.stop(PATIENCE).await;
}

#[tokio::test]
async fn an_innocent_job_beside_one_that_kills_the_process_never_fails() {
    let stage = Stage::new();
    let poison = submit(&stage.open().await, &cloud(10, 1), 2).await.id;
    let innocent = submit(&stage.open().await, &cloud(10, 2), 2).await.id;
    let compute = Compute::new("analysis", 2).unwrap();
    for _ in 0..8 {
        stage.outlive_the_dead();
        // A service of two workers that dies as soon as the poisonous job runs, with whatever runs beside it.
        let store = stage.open().await;
        let (analyze, mut gate) = gated(false);
        let settings = JobsSettings { concurrent: 2, ..quick() };
        let jobs = Jobs::start(store.clone(), compute.clone(), analyze, settings).await.unwrap();
        loop {
            let states = [poison, innocent].map(|id| store.job(id));
            let [of_poison, of_innocent] = futures_util::future::join_all(states).await.try_into().unwrap();
            let (of_poison, of_innocent) = (of_poison.unwrap().state, of_innocent.unwrap().state);
            if of_poison.is_terminal() && of_innocent.is_terminal() {
                break;
            }
            if of_poison == JobState::Running {
                // Both that may run do.
                tokio::time::sleep(Duration::from_millis(30)).await;
                break;
            }
            // It may have begun since its state was read; then it must not be let go.
            if gate.begun.try_recv().is_ok() && store.job(poison).await.unwrap().state != JobState::Running {
                gate.let_go.send(()).unwrap();
            }
            tokio::time::sleep(Duration::from_millis(2)).await;
        }
        // What `kill -9` leaves: rows of a process that writes nothing more.
        stage.tamper("UPDATE jobs SET lease = lease + 1 WHERE state = 'running'").await;
        jobs.stop(Duration::ZERO).await;
    }
    let store = stage.open().await;
    assert_eq!(store.job(poison).await.unwrap().state, JobState::Failed);
    assert_eq!(store.job(innocent).await.unwrap().state, JobState::Succeeded);
}

#[tokio::test]
async fn a_job_that_takes_longer_than_it_may_fails_for_that_and_the_next_runs() {
    let stage = Stage::new();
    let store = stage.open().await;
    let (analyze, _) = counted(|turn, cloud, progress| {
        if turn == 0 {
            loop {
                progress.checkpoint()?;
                std::thread::yield_now();
            }
        }
        if turn > 1 {
            return Err(AnalysisError::Cloud("there were two jobs".to_owned()));
        }
        Ok(crate::workers::made(cloud.len(), 2))
    });
    // What the next job takes to be stored is time too, and a server that many tests share takes longer.
    let time_max = Duration::from_millis(if crate::SHARES { 3000 } else { 300 });
    let settings = JobsSettings { time_max, ..quick() };
    let compute = Compute::new("analysis", 1).unwrap();
    let jobs = Jobs::start(store.clone(), compute, Arc::clone(&analyze), settings).await.unwrap();
    let long = submit(&store, &cloud(10, 1), 2).await.id;
    let next = submit(&store, &cloud(10, 2), 2).await.id;
    let ended = job_when(&store, long, |job| job.state.is_terminal()).await;
    assert_eq!((ended.state, ended.attempt), (JobState::Failed, 1));
    assert_eq!(ended.failure.unwrap().code, "time");
    assert_eq!(job_when(&store, next, |job| job.state.is_terminal()).await.state, JobState::Succeeded);
    jobs.stop(PATIENCE).await;
}

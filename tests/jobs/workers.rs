//! Workers, with analyses that do what the test tells them.

use std::collections::HashMap;
use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::{Arc, Mutex, mpsc};
use std::time::Duration;

use chladni::analysis::{AnalysisError, JobKind, Report, SparseMatrix};
use chladni::cloud::PointCloud;
use chladni::jobs::{Analyze, Compute, Jobs, JobsSettings, Results};
use chladni::progress::{Phase, Progress};
use chladni::store::{JobRecord, JobState, Store, StoreError};
use uuid::Uuid;

use crate::stage::{ATTEMPTS_MAX, Stage, basis, bits, cloud, mass, matrix, parameters, report, submit};

/// Longer than any test takes; a test that waits this long has failed.
pub(crate) const PATIENCE: Duration = Duration::from_mins(1);

struct Made {
    report: Report,
    n: usize,
}

impl Results for Made {
    fn report(&self) -> &Report {
        &self.report
    }

    fn mass(&self) -> Vec<f64> {
        mass(self.n)
    }

    fn bases(&self) -> usize {
        self.report.spectrum.as_ref().map_or(0, |spectrum| spectrum.eigenvalues.len())
    }

    fn basis(&self, j: usize) -> Vec<f64> {
        basis(self.n, j)
    }

    fn matrix(&self) -> Option<SparseMatrix> {
        Some(matrix(self.n))
    }
}

pub(crate) fn made(n: usize, bases: usize) -> Box<dyn Results> {
    Box::new(Made { report: report(n, bases), n })
}

/// An analysis that succeeds.
pub(crate) fn succeeding() -> Arc<Analyze> {
    Arc::new(|cloud, kind, parameters, _| {
        let mut report = report(cloud.len(), parameters.bases);
        if kind == JobKind::Operator {
            report.spectrum = None;
        }
        Ok(Box::new(Made { report, n: cloud.len() }))
    })
}

/// An analysis that does `turn`, which is told how many there were before.
pub(crate) fn counted(
    turn: impl Fn(u32, &PointCloud, &Progress) -> Result<Box<dyn Results>, AnalysisError> + Send + Sync + 'static,
) -> (Arc<Analyze>, Arc<AtomicU32>) {
    let turns = Arc::new(AtomicU32::new(0));
    let counter = Arc::clone(&turns);
    let analyze = Arc::new(move |cloud: &PointCloud, _: JobKind, _: &_, progress: &Progress| {
        turn(counter.fetch_add(1, Ordering::SeqCst), cloud, progress)
    });
    (analyze, turns)
}

/// Holds every analysis in its eigensolver until the test lets it go.
pub(crate) struct Gate {
    pub(crate) begun: tokio::sync::mpsc::UnboundedReceiver<()>,
    pub(crate) let_go: mpsc::Sender<()>,
}

/// With `deaf`, the analysis notices a cancellation only when it is let go, as within a factorization.
pub(crate) fn gated(deaf: bool) -> (Arc<Analyze>, Gate) {
    let (tell, begun) = tokio::sync::mpsc::unbounded_channel();
    let (let_go, gate) = mpsc::channel::<()>();
    let gate = Mutex::new(gate);
    let (analyze, _) = counted(move |_, cloud, progress| {
        progress.enter(Phase::Eigenpairs)?;
        tell.send(()).unwrap();
        while gate.lock().unwrap().recv_timeout(Duration::from_millis(2)).is_err() {
            if !deaf {
                progress.advance(0.5)?;
            }
        }
        progress.checkpoint()?;
        Ok(made(cloud.len(), 2))
    });
    (analyze, Gate { begun, let_go })
}

pub(crate) fn quick() -> JobsSettings {
    let tick = Duration::from_millis(5);
    JobsSettings { heartbeat: tick, order_poll: tick, poll: tick, ..JobsSettings::default() }
}

async fn start(store: &Store, analyze: Arc<Analyze>) -> Jobs {
    let compute = Compute::new("analysis", 2).unwrap();
    Jobs::start(store.clone(), compute, analyze, quick()).await.unwrap()
}

/// The job once it is as wanted: looked at whenever the store says that something changed.
pub(crate) async fn job_when(store: &Store, id: Uuid, wanted: impl Fn(&JobRecord) -> bool) -> JobRecord {
    let mut changes = store.changes();
    let wait = async {
        loop {
            changes.mark_unchanged();
            let job = store.job(id).await.unwrap();
            if wanted(&job) {
                return job;
            }
            changes.changed().await.unwrap();
        }
    };
    tokio::time::timeout(PATIENCE, wait).await.expect("the job did not get there")
}

async fn ended(store: &Store, id: Uuid) -> JobRecord {
    job_when(store, id, |job| job.state.is_terminal()).await
}

#[tokio::test]
async fn a_job_is_computed_and_all_its_bases_are_stored() {
    let stage = Stage::new();
    let store = stage.open().await;
    // Idle workers do not look by themselves here: it is the call that wakes them.
    let settings = JobsSettings { poll: PATIENCE, ..quick() };
    let compute = Compute::new("analysis", 1).unwrap();
    let jobs = Jobs::start(store.clone(), compute, succeeding(), settings).await.unwrap();
    let job = submit(&store, &cloud(9000, 1), 7).await;
    jobs.wake();
    let done = ended(&store, job.id).await;
    assert_eq!((done.state, done.attempt), (JobState::Succeeded, 1));
    assert_eq!(done.report, Some(report(9000, 7)));
    for j in 0..7 {
        assert_eq!(bits(&store.basis(job.id, j).await.unwrap()), bits(&basis(9000, j)));
    }
    assert_eq!(bits(&store.mass(job.id).await.unwrap()), bits(&mass(9000)));
    assert!(matches!(store.operator_matrix(job.id).await, Err(StoreError::NoResult)));
    jobs.stop(PATIENCE).await;
    stage.assert_sound().await;
}

#[tokio::test]
async fn an_operator_job_stores_its_matrix() {
    let stage = Stage::new();
    let store = stage.open().await;
    let jobs = start(&store, succeeding()).await;
    let submitted = store.submit(&cloud(100, 1), Some((JobKind::Operator, parameters(3)))).await.unwrap();
    let job = submitted.job.unwrap().id;
    assert_eq!(ended(&store, job).await.state, JobState::Succeeded);
    assert_eq!(store.operator_matrix(job).await.unwrap(), matrix(100));
    jobs.stop(PATIENCE).await;
}

#[tokio::test]
async fn an_error_of_the_input_ends_the_job_after_one_attempt_with_its_own_words() {
    let errors = [
        (AnalysisError::Parameter { name: "t", reason: "too small".to_owned() }, "parameter"),
        (AnalysisError::Cloud("all on a line".to_owned()), "cloud"),
        (AnalysisError::Unsupported("needs faces".to_owned()), "unsupported"),
        (AnalysisError::Numerical("no convergence".to_owned()), "numerical"),
    ];
    for (error, code) in errors {
        let stage = Stage::new();
        let store = stage.open().await;
        let words = error.to_string();
        let (analyze, turns) = counted(move |_, _, _| Err(error.clone()));
        let jobs = start(&store, analyze).await;
        let job = ended(&store, submit(&store, &cloud(10, 1), 2).await.id).await;
        assert_eq!((job.state, turns.load(Ordering::SeqCst)), (JobState::Failed, 1));
        let failure = job.failure.unwrap();
        assert_eq!((failure.code.as_str(), failure.detail), (code, words));
        jobs.stop(PATIENCE).await;
    }
}

#[tokio::test]
async fn a_panic_is_tried_again_and_in_the_end_the_job_crashed_and_the_worker_goes_on() {
    let stage = Stage::new();
    let store = stage.open().await;
    let (analyze, turns) = counted(|turn, cloud, _| {
        assert!(turn >= ATTEMPTS_MAX, "a secret of the numerics");
        Ok(made(cloud.len(), 2))
    });
    let jobs = start(&store, analyze).await;
    let job = ended(&store, submit(&store, &cloud(10, 1), 2).await.id).await;
    assert_eq!((job.state, job.attempt), (JobState::Failed, ATTEMPTS_MAX));
    assert_eq!(turns.load(Ordering::SeqCst), ATTEMPTS_MAX);
    let failure = job.failure.unwrap();
    assert_eq!(failure.code, "crashed");
    assert!(!failure.detail.contains("secret"), "internal text is logged, not sent");
    let next = ended(&store, submit(&store, &cloud(10, 2), 2).await.id).await;
    assert_eq!(next.state, JobState::Succeeded);
    jobs.stop(PATIENCE).await;
}

#[tokio::test]
async fn a_panic_that_passes_costs_an_attempt_only() {
    let stage = Stage::new();
    let store = stage.open().await;
    let (analyze, _) = counted(|turn, cloud, _| {
        assert!(turn > 0, "the first time only");
        Ok(made(cloud.len(), 2))
    });
    let jobs = start(&store, analyze).await;
    let job = ended(&store, submit(&store, &cloud(10, 1), 2).await.id).await;
    assert_eq!((job.state, job.attempt, job.failure), (JobState::Succeeded, 2, None));
    jobs.stop(PATIENCE).await;
}

#[tokio::test]
async fn a_result_that_cannot_be_stored_whole_ends_the_job_as_failed() {
    let stage = Stage::new();
    let store = stage.open().await;
    let (analyze, turns) = counted(|_, cloud, _| {
        let mut report = report(cloud.len(), 2);
        report.spectrum.as_mut().unwrap().residuals[1] = f64::NAN;
        Ok(Box::new(Made { report, n: cloud.len() }))
    });
    let jobs = start(&store, analyze).await;
    let job = ended(&store, submit(&store, &cloud(10, 1), 2).await.id).await;
    assert_eq!((job.state, turns.load(Ordering::SeqCst)), (JobState::Failed, 1));
    assert_eq!(job.failure.unwrap().code, "internal");
    jobs.stop(PATIENCE).await;
    assert_eq!(stage.number("SELECT count(*) FROM bases").await, 0);
}

#[tokio::test]
async fn a_running_job_shows_its_phase_and_is_the_only_one() {
    let stage = Stage::new();
    let store = stage.open().await;
    let (analyze, mut gate) = gated(false);
    let jobs = start(&store, analyze).await;
    let first = submit(&store, &cloud(10, 1), 2).await.id;
    let second = submit(&store, &cloud(10, 2), 2).await.id;
    gate.begun.recv().await.unwrap();
    let running =
        job_when(&store, first, |job| job.phase == Some(Phase::Eigenpairs) && job.progress > 0.3).await;
    assert_eq!(running.state, JobState::Running);
    assert_eq!(running.phase_seconds.last().map(|(phase, _)| *phase), Some(Phase::Eigenpairs));
    assert_eq!(store.job(second).await.unwrap().state, JobState::Queued);
    gate.let_go.send(()).unwrap();
    gate.begun.recv().await.unwrap();
    assert_eq!(store.job(first).await.unwrap().state, JobState::Succeeded);
    gate.let_go.send(()).unwrap();
    assert_eq!(ended(&store, second).await.state, JobState::Succeeded);
    jobs.stop(PATIENCE).await;
}

#[tokio::test]
async fn as_many_jobs_run_at_once_as_was_asked_for() {
    let stage = Stage::new();
    let store = stage.open().await;
    let (analyze, mut gate) = gated(false);
    let settings = JobsSettings { concurrent: 2, ..quick() };
    let compute = Compute::new("analysis", 2).unwrap();
    let jobs = Jobs::start(store.clone(), compute, analyze, settings).await.unwrap();
    for seed in 0..3 {
        submit(&store, &cloud(10, seed), 2).await;
    }
    gate.begun.recv().await.unwrap();
    gate.begun.recv().await.unwrap();
    let counted = store.jobs_by_state().await.unwrap();
    assert_eq!(counted, HashMap::from([(JobState::Queued, 1), (JobState::Running, 2)]));
    jobs.stop(Duration::ZERO).await;
    assert_eq!(store.jobs_by_state().await.unwrap(), HashMap::from([(JobState::Queued, 3)]));
}

#[tokio::test]
async fn a_running_job_that_is_canceled_ends_canceled() {
    let stage = Stage::new();
    let store = stage.open().await;
    let (analyze, mut gate) = gated(false);
    let jobs = start(&store, analyze).await;
    let job = submit(&store, &cloud(10, 1), 2).await.id;
    gate.begun.recv().await.unwrap();
    store.request_cancel(job).await.unwrap();
    let job = ended(&store, job).await;
    assert_eq!((job.state, job.report, job.failure), (JobState::Canceled, None, None));
    jobs.stop(PATIENCE).await;
}

#[tokio::test]
async fn a_cancellation_does_not_wait_for_a_computation_that_cannot_be_interrupted_but_the_next_job_does() {
    let stage = Stage::new();
    let store = stage.open().await;
    let (analyze, mut gate) = gated(true);
    let jobs = start(&store, analyze).await;
    let first = submit(&store, &cloud(10, 1), 2).await.id;
    gate.begun.recv().await.unwrap();
    let second = submit(&store, &cloud(10, 2), 2).await.id;
    store.request_cancel(first).await.unwrap();
    assert_eq!(ended(&store, first).await.state, JobState::Canceled);
    jobs.wake();
    assert_eq!(store.job(second).await.unwrap().state, JobState::Queued);
    gate.let_go.send(()).unwrap();
    gate.begun.recv().await.unwrap();
    gate.let_go.send(()).unwrap();
    assert_eq!(ended(&store, second).await.state, JobState::Succeeded);
    assert_eq!(store.job(first).await.unwrap().state, JobState::Canceled);
    jobs.stop(PATIENCE).await;
}

#[tokio::test]
async fn a_stop_lets_a_running_job_end_within_its_grace_and_claims_no_other() {
    let stage = Stage::new();
    let store = stage.open().await;
    let (analyze, mut gate) = gated(false);
    let jobs = start(&store, analyze).await;
    let first = submit(&store, &cloud(10, 1), 2).await.id;
    gate.begun.recv().await.unwrap();
    let second = submit(&store, &cloud(10, 2), 2).await.id;
    let mut stopping = Box::pin(jobs.stop(PATIENCE));
    assert!(futures_util::poll!(&mut stopping).is_pending());
    gate.let_go.send(()).unwrap();
    stopping.await;
    assert_eq!(store.job(first).await.unwrap().state, JobState::Succeeded);
    assert_eq!(store.job(second).await.unwrap().state, JobState::Queued);
}

#[tokio::test]
async fn a_stop_without_grace_gives_the_job_back_with_its_attempt() {
    let stage = Stage::new();
    let store = stage.open().await;
    // Deaf: even a computation that does not listen cannot hold up the stop.
    let (analyze, mut gate) = gated(true);
    let jobs = start(&store, analyze).await;
    let job = submit(&store, &cloud(10, 1), 2).await.id;
    gate.begun.recv().await.unwrap();
    jobs.stop(Duration::ZERO).await;
    let released = store.job(job).await.unwrap();
    assert_eq!((released.state, released.attempt), (JobState::Queued, 0));
    gate.let_go.send(()).unwrap();

    let jobs = start(&store, succeeding()).await;
    let done = ended(&store, job).await;
    assert_eq!((done.state, done.attempt), (JobState::Succeeded, 1));
    jobs.stop(PATIENCE).await;
}

#[tokio::test]
async fn a_start_takes_up_what_a_dead_process_left() {
    let stage = Stage::new();
    let store = stage.open().await;
    let job = submit(&store, &cloud(10, 1), 2).await.id;
    store.claim(Uuid::now_v7()).await.unwrap().unwrap();
    stage.outlive_the_dead();
    let jobs = start(&store, succeeding()).await;
    let done = ended(&store, job).await;
    assert_eq!((done.state, done.attempt), (JobState::Succeeded, 2));
    jobs.stop(PATIENCE).await;
}

#[tokio::test]
async fn a_worker_that_lost_its_claim_ends_its_computation_and_writes_nothing() {
    let stage = Stage::new();
    let store = stage.open().await;
    let (tell, mut told) = tokio::sync::mpsc::unbounded_channel();
    let (analyze, _) = counted(move |_, _, progress| {
        tell.send("begun").unwrap();
        while progress.checkpoint().is_ok() {
            std::thread::yield_now();
        }
        tell.send("ended").unwrap();
        Err(AnalysisError::Numerical("nobody may hear this".to_owned()))
    });
    let jobs = start(&store, analyze).await;
    let job = submit(&store, &cloud(10, 1), 2).await.id;
    assert_eq!(told.recv().await, Some("begun"));
    assert_eq!(stage.tamper("UPDATE jobs SET lease = lease + 1").await, 1);
    assert_eq!(told.recv().await, Some("ended"));
    jobs.stop(PATIENCE).await;
    let job = store.job(job).await.unwrap();
    assert_eq!((job.state, job.failure), (JobState::Running, None));
}

//! Random histories of the queue against a state machine that is small enough to be seen to be right.

use chladni::analysis::JobKind;
use chladni::store::{Claim, JobFailure, JobState, Milliseconds, Order, Owner, Store, StoreError};
use proptest::prelude::*;
use uuid::Uuid;

use crate::stage::{ATTEMPTS_MAX, LEASE, Stage, cloud, complete, parameters, vitals};

const QUEUE_MAX: u64 = 3;

#[derive(Debug, Clone)]
enum Step {
    Submit { cloud: u32, bases: usize },
    Claim,
    Beat(usize),
    Finish(usize),
    Fail { claim: usize, retry: bool },
    Cancel(usize),
    CancelClaimed(usize),
    Release(usize),
    Delete(usize),
    Advance(Milliseconds),
    Restart,
}

fn step() -> impl Strategy<Value = Step> {
    // Indices beyond what exists wrap around, and reach stale claims as often as current ones.
    let which = 0..6_usize;
    prop_oneof![
        4 => (0..2_u32, 1..3_usize).prop_map(|(cloud, bases)| Step::Submit { cloud, bases }),
        5 => Just(Step::Claim),
        3 => which.clone().prop_map(Step::Beat),
        3 => which.clone().prop_map(Step::Finish),
        2 => (which.clone(), any::<bool>()).prop_map(|(claim, retry)| Step::Fail { claim, retry }),
        2 => which.clone().prop_map(Step::Cancel),
        1 => which.clone().prop_map(Step::CancelClaimed),
        1 => which.clone().prop_map(Step::Release),
        1 => which.prop_map(Step::Delete),
        2 => prop_oneof![Just(LEASE / 2), Just(LEASE + 1)].prop_map(Step::Advance),
        1 => Just(Step::Restart),
    ]
}

#[derive(Debug, Clone)]
struct Job {
    id: Uuid,
    analysis: (u32, usize),
    state: JobState,
    attempt: u32,
    leases: i64,
    lease_until: Milliseconds,
    cancel: bool,
    deleting: bool,
}

impl Job {
    fn give_up(&mut self) {
        self.state = match () {
            () if self.cancel => JobState::Canceled,
            () if self.attempt >= ATTEMPTS_MAX => JobState::Failed,
            () => JobState::Queued,
        };
    }
}

#[derive(Default)]
struct Model {
    jobs: Vec<Job>,
}

impl Model {
    fn queued(&self) -> usize {
        self.jobs.iter().filter(|job| job.state == JobState::Queued).count()
    }

    fn same(&self, analysis: (u32, usize)) -> Option<&Job> {
        let stands = |job: &&Job| {
            job.analysis == analysis
                && !job.cancel
                && matches!(job.state, JobState::Queued | JobState::Running | JobState::Succeeded)
        };
        self.jobs.iter().find(stands)
    }

    fn claim(&mut self, now: Milliseconds) -> Option<(Uuid, i64)> {
        for job in &mut self.jobs {
            if job.state == JobState::Running && job.lease_until < now {
                job.give_up();
            }
        }
        self.delete_ended();
        let job = self.jobs.iter_mut().find(|job| job.state == JobState::Queued)?;
        job.state = JobState::Running;
        job.attempt += 1;
        job.leases += 1;
        job.lease_until = now + LEASE;
        Some((job.id, job.leases))
    }

    fn holder(&mut self, claim: &Claim) -> Option<&mut Job> {
        let held = |job: &&mut Job| {
            job.id == claim.job.id && job.leases == claim.lease && job.state == JobState::Running
        };
        self.jobs.iter_mut().find(held)
    }

    /// What was to be deleted at its end is gone then.
    fn delete_ended(&mut self) {
        self.jobs.retain(|job| !(job.deleting && job.state.is_terminal()));
    }
}

/// The store and its model side by side.
struct Pair {
    stage: Stage,
    store: Store,
    process: Uuid,
    model: Model,
    claims: Vec<Claim>,
}

impl Pair {
    async fn take(&mut self, step: Step) {
        match step {
            Step::Submit { cloud, bases } => self.submit(cloud, bases).await,
            Step::Claim => {
                let claim = self.store.claim(self.process).await.unwrap();
                let expected = self.model.claim(self.stage.now());
                assert_eq!(claim.as_ref().map(|claim| (claim.job.id, claim.lease)), expected);
                self.claims.extend(claim);
            }
            Step::Beat(index) => self.beat(index).await,
            Step::Finish(index) => {
                let Some(claim) = pick(&self.claims, index) else { return };
                let ended = complete(&self.store, &claim).await;
                self.expect(
                    &claim,
                    ended,
                    |job| if job.cancel { JobState::Canceled } else { JobState::Succeeded },
                );
            }
            Step::Fail { claim, retry } => {
                let Some(claim) = pick(&self.claims, claim) else { return };
                let failure = JobFailure { code: "internal".to_owned(), detail: "made up".to_owned() };
                let ended = self.store.fail(&claim, failure, retry.then_some(0)).await;
                self.expect(&claim, ended, |job| match () {
                    () if !retry || job.attempt >= ATTEMPTS_MAX => JobState::Failed,
                    () if job.cancel => JobState::Canceled,
                    () => JobState::Queued,
                });
            }
            Step::CancelClaimed(index) => {
                let Some(claim) = pick(&self.claims, index) else { return };
                let ended = self.store.cancel_claimed(&claim).await.map(|()| JobState::Canceled);
                self.expect(&claim, ended, |_| JobState::Canceled);
            }
            Step::Release(index) => {
                let Some(claim) = pick(&self.claims, index) else { return };
                let ended = self.store.release(&claim).await;
                self.expect(&claim, ended, |job| {
                    if job.cancel {
                        return JobState::Canceled;
                    }
                    job.attempt -= 1;
                    JobState::Queued
                });
            }
            Step::Cancel(index) => {
                let Some(job) = pick(&self.model.jobs, index) else { return };
                self.store.request_cancel(job.id).await.unwrap();
                self.cancel(job.id);
            }
            Step::Delete(index) => {
                let Some(job) = pick(&self.model.jobs, index) else { return };
                let deleted = self.store.delete_job(job.id).await.unwrap();
                assert_eq!(deleted, job.state != JobState::Running);
                if deleted {
                    self.model.jobs.retain(|other| other.id != job.id);
                } else {
                    self.cancel(job.id);
                    let running = self.model.jobs.iter_mut().filter(|other| other.id == job.id);
                    running.for_each(|job| job.deleting = true);
                }
            }
            Step::Advance(by) => self.stage.advance(by),
            Step::Restart => {
                self.store = self.stage.open_with_queue(QUEUE_MAX).await;
                self.process = Uuid::now_v7();
                self.stage.outlive_the_dead();
                let orphans = self.store.requeue_orphans(self.process).await.unwrap();
                let mut running: Vec<&mut Job> =
                    self.model.jobs.iter_mut().filter(|job| job.state == JobState::Running).collect();
                assert_eq!(orphans, running.len() as u64);
                for job in &mut running {
                    job.give_up();
                }
            }
        }
        self.model.delete_ended();
    }

    async fn submit(&mut self, seed: u32, bases: usize) {
        let submitted = self.store.submit(&cloud(4, seed), Some((JobKind::Eigen, parameters(bases)))).await;
        if let Some(same) = self.model.same((seed, bases)) {
            let submitted = submitted.unwrap();
            assert!(!submitted.job_created && !submitted.cloud_created);
            assert_eq!(submitted.job.unwrap().id, same.id);
        } else if self.model.queued() as u64 >= QUEUE_MAX {
            assert!(matches!(submitted, Err(StoreError::QueueFull { limit: QUEUE_MAX })));
        } else {
            let submitted = submitted.unwrap();
            assert!(submitted.job_created);
            self.model.jobs.push(Job {
                id: submitted.job.unwrap().id,
                analysis: (seed, bases),
                state: JobState::Queued,
                attempt: 0,
                leases: 0,
                lease_until: 0,
                cancel: false,
                deleting: false,
            });
        }
    }

    async fn beat(&mut self, index: usize) {
        let Some(claim) = pick(&self.claims, index) else { return };
        let until = self.stage.now() + LEASE;
        let expected = match self.model.holder(&claim) {
            Some(job) => {
                job.lease_until = until;
                if job.cancel { Order::Cancel } else { Order::Continue }
            }
            None => Order::Lost,
        };
        assert_eq!(self.store.order(&claim).await.unwrap(), expected);
        assert_eq!(self.store.heartbeat(&claim, &vitals()).await.unwrap(), expected);
    }

    fn cancel(&mut self, id: Uuid) {
        let Some(job) = self.model.jobs.iter_mut().find(|job| job.id == id) else { return };
        match job.state {
            JobState::Queued => (job.state, job.cancel) = (JobState::Canceled, true),
            JobState::Running => job.cancel = true,
            JobState::Succeeded | JobState::Failed | JobState::Canceled => {}
        }
    }

    /// The end of a claim: to `end` when it holds, else refused.
    fn expect(
        &mut self,
        claim: &Claim,
        ended: Result<JobState, StoreError>,
        end: impl FnOnce(&mut Job) -> JobState,
    ) {
        match self.model.holder(claim) {
            Some(job) => {
                job.state = end(job);
                assert_eq!(ended.unwrap(), job.state);
            }
            None => assert!(matches!(ended, Err(StoreError::LostClaim)), "{ended:?}"),
        }
    }

    async fn compare(&self) {
        let page = self.store.jobs(&Owner::nobody(), None, None, None, 1000).await.unwrap();
        let mut before = 0;
        let expected = self.model.jobs.iter().map(|job| {
            let position = (job.state == JobState::Queued).then(|| {
                before += 1;
                before - 1
            });
            (job.id, job.state, job.attempt, job.cancel, position)
        });
        let stored = page
            .items
            .iter()
            .rev()
            .map(|job| (job.id, job.state, job.attempt, job.cancel_requested, job.queue_position));
        assert_eq!(stored.collect::<Vec<_>>(), expected.collect::<Vec<_>>());
        for job in &page.items {
            let readable = self.store.basis(job.id, 0).await.is_ok();
            assert_eq!(readable, job.state == JobState::Succeeded);
            assert_eq!(job.finished.is_some(), job.state.is_terminal());
        }
    }
}

fn pick<T: Clone>(items: &[T], index: usize) -> Option<T> {
    // From the newest backwards, so that small indices are the interesting ones.
    if items.is_empty() { None } else { items.iter().rev().cycle().nth(index).cloned() }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: if crate::SHARES { 12 } else { 40 }, ..ProptestConfig::default() })]

    #[test]
    fn every_history_of_the_queue_is_the_one_of_the_reference(steps in prop::collection::vec(step(), 1..60)) {
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();
        runtime.block_on(async {
            let stage = Stage::new();
            let store = stage.open_with_queue(QUEUE_MAX).await;
            let mut pair =
                Pair { stage, store, process: Uuid::now_v7(), model: Model::default(), claims: Vec::new() };
            for step in steps {
                pair.take(step).await;
                pair.compare().await;
            }
            pair.stage.assert_sound().await;
        });
    }
}

//! One attempt at a job, seen from outside: how far it is, and where its time went.

use std::fs::File;
use std::io;
use std::ops::Range;
use std::sync::{Arc, Mutex, PoisonError, Weak};
use std::time::{Duration, Instant};

use super::memory_gate::Reservation;
use crate::progress::{Phase, Progress};
use crate::store::Vitals;

/// Phases that report nothing while they run: their progress is told from the time that they are expected to take.
const SILENT: [Phase; 2] = [Phase::Factorization, Phase::Certificates];

/// Shared by the computation, which moves it on, and the thread that beats for it.
#[derive(Clone)]
pub(super) struct Task {
    pub(super) progress: Arc<Progress>,
    timeline: Arc<Mutex<Timeline>>,
    /// The worker's own, so that no thread that still has this keeps the memory taken.
    reservation: Weak<Reservation>,
}

impl Task {
    /// A computation that may take as much memory as is reserved for it or can be added to that, and the files that `scratch` makes
    /// for so many bytes.
    pub(super) fn begin(
        reservation: &Arc<Reservation>,
        scratch: impl Fn(u64) -> io::Result<File> + Send + Sync + 'static,
    ) -> Self {
        let timeline = Arc::new(Mutex::new(Timeline::new(Instant::now())));
        let observed = Arc::clone(&timeline);
        let reservation = Arc::downgrade(reservation);
        let granting = Weak::clone(&reservation);
        let progress = Progress::observed(move |phase| {
            observed.lock().unwrap_or_else(PoisonError::into_inner).enter(phase, Instant::now());
        })
        .granting(move |bytes| granting.upgrade().is_some_and(|reservation| reservation.grow_to(bytes)))
        .scratch_by(scratch);
        Self { progress: Arc::new(progress), timeline, reservation }
    }

    /// How far it is: never less than before, and never beyond the phase that it is in.
    pub(super) fn vitals(&self) -> Vitals {
        self.vitals_at(Instant::now())
    }

    fn vitals_at(&self, now: Instant) -> Vitals {
        let mut timeline = self.timeline.lock().unwrap_or_else(PoisonError::into_inner);
        let phase = self.progress.phase();
        let mut reached = self.progress.fraction();
        if SILENT.contains(&phase) {
            reached = reached.max(timeline.expected_at(now, &self.progress.span(phase)));
        }
        timeline.told = timeline.told.max(reached);
        let phase_seconds = timeline.seconds(now);
        let memory = self.reservation.upgrade().map_or(0, |reservation| reservation.bytes());
        Vitals { phase, progress: timeline.told, phase_seconds, memory }
    }
}

/// The phases that were entered, each with the time spent in it before it was last left.
struct Timeline {
    spent: Vec<(Phase, Duration)>,
    entered: Instant,
    /// The progress that was told last.
    told: f64,
}

impl Timeline {
    fn new(now: Instant) -> Self {
        Self { spent: Vec::new(), entered: now, told: 0.0 }
    }

    /// A phase may be entered again, as when an eigensolver asks for another factor: its times add up.
    fn enter(&mut self, phase: Phase, now: Instant) {
        self.leave(now);
        let earlier = self.spent.iter().position(|(known, _)| *known == phase);
        let entry = earlier.map_or((phase, Duration::ZERO), |index| self.spent.remove(index));
        self.spent.push(entry);
    }

    fn leave(&mut self, now: Instant) {
        if let Some((_, spent)) = self.spent.last_mut() {
            *spent += now - self.entered;
        }
        self.entered = now;
    }

    /// The share of the whole at which a phase should be that lies between `span`, judged by the time that everything
    /// before it took. It nears the phase's end and does not reach it.
    fn expected_at(&self, now: Instant, span: &Range<f64>) -> f64 {
        let before: Duration = self.spent.iter().rev().skip(1).map(|(_, spent)| *spent).sum();
        let width = span.end - span.start;
        let expected = before.as_secs_f64() * width / span.start.max(f64::MIN_POSITIVE);
        let inside = (now - self.entered).as_secs_f64();
        if inside <= 0.0 || before.is_zero() {
            span.start
        } else {
            span.start + width * (1.0 - (-inside / expected).exp())
        }
    }

    /// In the order of the phases.
    fn seconds(&self, now: Instant) -> Vec<(Phase, f64)> {
        let last = self.spent.len().saturating_sub(1);
        let running = |index| if index == last { now - self.entered } else { Duration::ZERO };
        let entries = self.spent.iter().enumerate();
        let mut seconds: Vec<(Phase, f64)> = entries
            .map(|(index, (phase, spent))| (*phase, (*spent + running(index)).as_secs_f64()))
            .collect();
        seconds.sort_by_key(|(phase, _)| *phase);
        seconds
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_phase_gets_the_time_until_the_next_begins() {
        let start = Instant::now();
        let at = |seconds| start + Duration::from_secs(seconds);
        let mut timeline = Timeline::new(start);
        assert_eq!(timeline.seconds(at(1)), []);
        timeline.enter(Phase::Preparation, at(1));
        timeline.enter(Phase::Cells, at(3));
        assert_eq!(timeline.seconds(at(8)), [(Phase::Preparation, 2.0), (Phase::Cells, 5.0)]);
    }

    #[test]
    fn a_phase_entered_twice_gets_both_times() {
        let start = Instant::now();
        let at = |seconds| start + Duration::from_secs(seconds);
        let mut timeline = Timeline::new(start);
        timeline.enter(Phase::Factorization, at(0));
        timeline.enter(Phase::Eigenpairs, at(1));
        timeline.enter(Phase::Factorization, at(3));
        assert_eq!(timeline.seconds(at(7)), [(Phase::Factorization, 5.0), (Phase::Eigenpairs, 2.0)]);
    }

    #[test]
    fn a_silent_phase_moves_by_the_clock_and_one_that_reports_does_not() {
        let task = Task::begin(&Arc::default(), |_| tempfile::tempfile());
        task.progress.expect([1.0, 1.0, 1.0, 1.0, 1.0, 4.0, 1.0]);
        let start = Instant::now();
        let at = |seconds| start + Duration::from_secs(seconds);
        task.progress.enter(Phase::Preparation).unwrap();
        task.progress.enter(Phase::Factorization).unwrap();
        {
            let mut timeline = task.timeline.lock().unwrap();
            timeline.spent[0].1 = Duration::from_secs(40);
            timeline.entered = start;
        }
        // four tenths took 40 s: the next tenth should take 10
        let progress = |seconds| task.vitals_at(at(seconds)).progress;
        assert!((progress(0) - 0.4).abs() < 1e-9);
        assert!((progress(10) - (0.4 + 0.1 * (1.0 - (-1.0f64).exp()))).abs() < 1e-9);
        assert!(progress(1000) <= 0.5 && progress(1000) > 0.499);

        task.progress.enter(Phase::Eigenpairs).unwrap();
        task.progress.advance(0.5).unwrap();
        assert!((progress(2000) - 0.7).abs() < 1e-9);
        assert!((progress(9000) - 0.7).abs() < 1e-9);
    }

    #[test]
    fn a_task_tells_the_phase_it_is_in() {
        let task = Task::begin(&Arc::default(), |_| tempfile::tempfile());
        task.progress.enter(Phase::Assembly).unwrap();
        let vitals = task.vitals();
        assert_eq!(vitals.phase, Phase::Assembly);
        assert!((vitals.progress - task.progress.fraction()).abs() < f64::EPSILON);
        assert_eq!(vitals.phase_seconds.len(), 1);
    }
}

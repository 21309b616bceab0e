//! The computation on its own threads, watched.

use std::io::IsTerminal;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;
use std::sync::mpsc::{self, RecvTimeoutError};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use chladni::analysis::{Analysis, JobKind, Parameters, analyze};
use chladni::cloud::PointCloud;
use chladni::progress::{Phase, Progress};
use indicatif::{HumanDuration, ProgressBar, ProgressStyle};

use super::{Failure, of_analysis};
use crate::cli::reporting::note;

/// Factorization recurses along its elimination tree.
const STACK_BYTES: usize = 16 << 20;
/// Between two looks at the progress.
const LOOK: Duration = Duration::from_millis(100);
/// Length of the bar.
const BAR_STEPS: u64 = 1000;

/// The remaining time is shown after this time, and from this part of the work on.
const ESTIMATE_AFTER: Duration = Duration::from_secs(2);
const ESTIMATE_FROM: f64 = 0.1;

/// An analysis, and the seconds that each phase took.
pub(super) struct Ran {
    pub(super) analysis: Analysis,
    pub(super) seconds: Vec<(Phase, f64)>,
    pub(super) progress: Arc<Progress>,
}

type Begun = Arc<Mutex<Vec<(Phase, Instant)>>>;

/// What notes the phases of an analysis, and cancels it.
pub(super) struct Watch {
    begun: Begun,
    pub(super) progress: Arc<Progress>,
    quiet: bool,
}

impl Watch {
    /// Of a computation that keeps within `memory` bytes where files in `folder` can take what is more.
    pub(super) fn new(quiet: bool, memory: u64, folder: &Path) -> Self {
        let begun = Begun::default();
        let progress = Arc::new(observed(&begun, quiet).within(memory).scratch_in(folder));
        Self { begun, progress, quiet }
    }
}

/// Analyzes with a progress bar on the terminal, or a line per phase elsewhere.
pub(super) fn with_progress(
    cloud: &PointCloud,
    kind: JobKind,
    parameters: &Parameters,
    threads: usize,
    watched: &Watch,
) -> Result<Ran, Failure> {
    let Watch { begun, progress, quiet } = watched;
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).stack_size(STACK_BYTES).build();
    let pool = pool.map_err(Failure::other)?;
    let (done, ended) = mpsc::channel::<()>();
    let result = std::thread::scope(|scope| {
        if !quiet {
            scope.spawn(move || watch(progress, &ended));
        }
        // A panic is a bug in a solver; it is reported in one line, like every other failure.
        std::panic::set_hook(Box::new(|_| {}));
        let result =
            catch_unwind(AssertUnwindSafe(|| pool.install(|| analyze(cloud, kind, parameters, progress))));
        let _ = std::panic::take_hook();
        drop(done);
        result
    });
    let analysis = match result {
        Ok(Ok(analysis)) => analysis,
        Ok(Err(error)) => return Err(of_analysis(&error)),
        Err(payload) => {
            let text = payload.downcast_ref::<String>().map(String::as_str);
            let text = text.or_else(|| payload.downcast_ref::<&str>().copied()).unwrap_or("unknown cause");
            return Err(Failure::Other(format!("the computation broke off: {text}")));
        }
    };
    Ok(Ran { analysis, seconds: seconds(begun), progress: Arc::clone(progress) })
}

fn observed(begun: &Begun, quiet: bool) -> Progress {
    let begun = Arc::clone(begun);
    let announces = !quiet && !std::io::stderr().is_terminal();
    Progress::observed(move |phase| {
        if announces {
            note(phase.name());
        }
        begun.lock().unwrap_or_else(PoisonError::into_inner).push((phase, Instant::now()));
    })
}

fn seconds(begun: &Begun) -> Vec<(Phase, f64)> {
    let begun = begun.lock().unwrap_or_else(PoisonError::into_inner);
    let ends = begun.iter().skip(1).map(|&(_, instant)| instant).chain([Instant::now()]);
    let mut seconds: Vec<(Phase, f64)> = Vec::new();
    for (&(phase, start), end) in begun.iter().zip(ends) {
        // a phase may be entered again
        let spent = (end - start).as_secs_f64();
        match seconds.iter_mut().find(|(known, _)| *known == phase) {
            Some((_, before)) => *before += spent,
            None => seconds.push((phase, spent)),
        }
    }
    seconds
}

/// The remaining time, once enough is done to estimate it.
fn remaining(elapsed: Duration, fraction: f64) -> String {
    if elapsed < ESTIMATE_AFTER || !(ESTIMATE_FROM..1.0).contains(&fraction) {
        return String::new();
    }
    let left = elapsed.mul_f64((1.0 - fraction) / fraction);
    format!("eta {}", HumanDuration(left))
}

/// Moves the bar until the other end is dropped. Without a terminal, indicatif draws nothing.
fn watch(progress: &Progress, done: &mpsc::Receiver<()>) {
    let bar = ProgressBar::new(BAR_STEPS);
    if let Ok(style) = ProgressStyle::with_template("{prefix:>13} [{wide_bar}] {percent:>3}% {elapsed} {msg}")
    {
        bar.set_style(style);
    }
    let started = Instant::now();
    while done.recv_timeout(LOOK) == Err(RecvTimeoutError::Timeout) {
        let fraction = progress.fraction();
        bar.set_prefix(progress.phase().name());
        bar.set_message(remaining(started.elapsed(), fraction));
        bar.set_position((fraction * BAR_STEPS as f64) as u64);
    }
    bar.finish_and_clear();
}

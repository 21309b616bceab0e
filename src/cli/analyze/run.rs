//! The computation on its own threads, watched.

use std::io::IsTerminal;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::mpsc::{self, RecvTimeoutError};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use chladni::analysis::{Analysis, JobKind, Parameters, analyze};
use chladni::cloud::PointCloud;
use chladni::progress::{Phase, Progress};
use indicatif::{ProgressBar, ProgressStyle};

use super::{Failure, of_analysis};

/// Factorization recurses along its elimination tree.
const STACK_BYTES: usize = 16 << 20;
/// Between two looks at the progress.
const LOOK: Duration = Duration::from_millis(100);
/// Length of the bar.
const BAR_STEPS: u64 = 1000;

/// An analysis, and the seconds that each phase took.
pub(super) struct Ran {
    pub(super) analysis: Analysis,
    pub(super) seconds: Vec<(Phase, f64)>,
    pub(super) progress: Arc<Progress>,
}

type Begun = Arc<Mutex<Vec<(Phase, Instant)>>>;

/// Analyses with a progress bar on the terminal, or a line per phase elsewhere. Ctrl-C and SIGTERM cancel.
pub(super) fn with_progress(
    cloud: &PointCloud,
    kind: JobKind,
    parameters: &Parameters,
    threads: usize,
) -> Result<Ran, Failure> {
    let begun = Begun::default();
    let progress = Arc::new(observed(&begun));
    cancel_when_told(Arc::clone(&progress))?;
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).stack_size(STACK_BYTES).build();
    let pool = pool.map_err(Failure::other)?;
    let (done, watched) = mpsc::channel::<()>();
    let result = std::thread::scope(|scope| {
        let progress = &progress;
        scope.spawn(move || watch(progress, &watched));
        // A panic is a bug in a solver; it is told in one line, like every other failure.
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
    Ok(Ran { analysis, seconds: seconds(&begun), progress })
}

#[allow(clippy::print_stderr)] // progress goes there, results to stdout
fn observed(begun: &Begun) -> Progress {
    let begun = Arc::clone(begun);
    let announces = !std::io::stderr().is_terminal();
    Progress::observed(move |phase| {
        if announces {
            eprintln!("{}", phase.name());
        }
        begun.lock().unwrap_or_else(PoisonError::into_inner).push((phase, Instant::now()));
    })
}

fn seconds(begun: &Begun) -> Vec<(Phase, f64)> {
    let begun = begun.lock().unwrap_or_else(PoisonError::into_inner);
    let ends = begun.iter().skip(1).map(|&(_, instant)| instant).chain([Instant::now()]);
    begun.iter().zip(ends).map(|(&(phase, start), end)| (phase, (end - start).as_secs_f64())).collect()
}

/// Moves the bar until the other end is dropped. Without a terminal, indicatif draws nothing.
fn watch(progress: &Progress, done: &mpsc::Receiver<()>) {
    let bar = ProgressBar::new(BAR_STEPS);
    if let Ok(style) = ProgressStyle::with_template("{msg:>14} [{bar:40}] {percent:>3}%  {elapsed}") {
        bar.set_style(style);
    }
    while done.recv_timeout(LOOK) == Err(RecvTimeoutError::Timeout) {
        bar.set_message(progress.phase().name());
        bar.set_position((progress.fraction() * BAR_STEPS as f64) as u64);
    }
    bar.finish_and_clear();
}

/// The first signal cancels in order; a second one finds the default behaviour replaced and ends at once.
fn cancel_when_told(progress: Arc<Progress>) -> Result<(), Failure> {
    let runtime =
        tokio::runtime::Builder::new_current_thread().enable_all().build().map_err(Failure::other)?;
    std::thread::spawn(move || {
        runtime.block_on(async {
            if told_to_stop().await.is_ok() {
                progress.cancel();
            }
            if told_to_stop().await.is_ok() {
                std::process::exit(1);
            }
        });
    });
    Ok(())
}

#[cfg(unix)]
async fn told_to_stop() -> std::io::Result<()> {
    use tokio::signal::unix::{SignalKind, signal};
    let mut terminate = signal(SignalKind::terminate())?;
    tokio::select! {
        told = tokio::signal::ctrl_c() => told,
        _ = terminate.recv() => Ok(()),
    }
}

#[cfg(not(unix))]
async fn told_to_stop() -> std::io::Result<()> {
    tokio::signal::ctrl_c().await
}

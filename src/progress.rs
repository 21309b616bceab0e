//! Progress and cancellation of a computation, passed into the library by whoever runs it.
//!
//! The library knows no clock: an observer that wants seconds per phase takes the time in its callback.

use std::fs::File;
use std::io;
use std::ops::Range;
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, AtomicU8, AtomicU64, Ordering};
use std::sync::{Mutex, PoisonError};

use crate::arguments::words;

words! {
    /// What an analysis is doing, in the order in which the phases follow each other.
    #[derive(PartialOrd, Ord)]
    #[non_exhaustive]
    pub enum Phase {
        /// Merging duplicates, recentering, ordering the points along a space-filling curve.
        Preparation,
        /// Nearest neighbors and tangent frames.
        Neighborhoods,
        /// Voronoi cells in the tangent planes.
        Cells,
        /// Entries of stiffness and mass.
        Assembly,
        /// Fill-reducing order; the Cholesky factor too where it does not depend on what the slices find.
        Factorization,
        /// Block iterations of the eigensolver.
        Eigenpairs,
        /// Residuals, orthogonality, missed-eigenvalue check.
        Certificates,
    }
}

/// The caller canceled the computation.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("canceled")]
pub struct Canceled;

/// Relative times that the phases are expected to take, in their order. Before more is known: from measured times of scans of
/// 100,000 points with 100 bases.
pub type Durations = [f64; Phase::ALL.len()];

const EXPECTED: Durations = [2.0, 4.0, 6.0, 6.0, 7.0, 70.0, 5.0];

/// Called at the beginning of every phase.
type Observer = Box<dyn Fn(Phase) + Send + Sync>;

/// Asked for bytes of memory; false when they cannot be had.
type Grant = Box<dyn Fn(u64) -> bool + Send + Sync>;

/// Makes a file for so many bytes.
type Scratch = Box<dyn Fn(u64) -> io::Result<File> + Send + Sync>;

/// The way out of [`Progress::leaving`].
#[derive(Clone, Copy)]
pub struct Leave<'a>(&'a Progress);

impl Leave<'_> {
    /// Does not return once somebody called [`Progress::cancel`].
    #[inline]
    pub fn if_canceled(self) {
        if self.0.is_canceled() {
            // not a panic: no hook tells of it
            resume_unwind(Box::new(Canceled));
        }
    }
}

/// Shared between the computation, which moves it on, and an observer, which reads it and may cancel.
pub struct Progress {
    phase: AtomicU8,
    expected: Mutex<Durations>,
    /// Bits of an `f64` in `0..=1`: bit patterns of non-negative floats order as the floats do.
    fraction: AtomicU64,
    canceled: AtomicBool,
    /// Bytes that were asked for and refused; 0 when none were.
    denied: AtomicU64,
    /// Bytes in use that need not be asked for again.
    held: AtomicU64,
    observer: Option<Observer>,
    grant: Option<Grant>,
    /// Bytes that are not exceeded where a file can take what is more.
    most: u64,
    scratch: Option<Scratch>,
    /// Looks until it cancels itself.
    #[cfg(test)]
    looks: Option<AtomicU64>,
}

impl Default for Progress {
    fn default() -> Self {
        Self {
            phase: AtomicU8::default(),
            expected: Mutex::new(EXPECTED),
            fraction: AtomicU64::default(),
            canceled: AtomicBool::default(),
            denied: AtomicU64::default(),
            held: AtomicU64::default(),
            observer: None,
            grant: None,
            most: u64::MAX,
            scratch: None,
            #[cfg(test)]
            looks: None,
        }
    }
}

impl Progress {
    /// A progress at zero, not canceled.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// Calls `observer` at the beginning of every phase, on the thread that computes.
    #[must_use]
    pub fn observed(observer: impl Fn(Phase) + Send + Sync + 'static) -> Self {
        Self { observer: Some(Box::new(observer)), ..Self::default() }
    }

    /// Asks `grant` whether the computation may take a number of bytes of memory in all, wherever it finds out that it needs
    /// more than could be told before it began. Without a grant it takes what it needs.
    #[must_use]
    pub fn granting(self, grant: impl Fn(u64) -> bool + Send + Sync + 'static) -> Self {
        Self { grant: Some(Box::new(grant)), ..self }
    }

    /// Keeps within `most` bytes of memory wherever a file can take what is more.
    #[must_use]
    pub fn within(self, most: u64) -> Self {
        Self { most, ..self }
    }

    /// Makes such files in `folder`, and not where the system has its temporary ones, which may be memory itself.
    #[must_use]
    pub fn scratch_in(self, folder: impl Into<PathBuf>) -> Self {
        let folder = folder.into();
        self.scratch_by(move |_| tempfile::tempfile_in(&folder))
    }

    /// Makes such files by `make`, which is told how many bytes they will have.
    #[must_use]
    pub fn scratch_by(self, make: impl Fn(u64) -> io::Result<File> + Send + Sync + 'static) -> Self {
        Self { scratch: Some(Box::new(make)), ..self }
    }

    /// A new file without a name for `bytes` bytes, which is gone when it is dropped or the process ends.
    ///
    /// # Errors
    /// Those of the file system.
    pub fn scratch_file(&self, bytes: u64) -> io::Result<File> {
        self.scratch.as_ref().map_or_else(tempfile::tempfile, |make| make(bytes))
    }

    /// Whether there is memory for bytes beside those that are in use; they are then taken. Unlike [`Self::afford_beside`] a
    /// refusal cancels nothing.
    #[must_use]
    pub fn has_room_beside(&self, bytes: u64) -> bool {
        let all = bytes.saturating_add(self.held.load(Ordering::Relaxed));
        all <= self.most && self.grant.as_ref().is_none_or(|grant| grant(all))
    }

    /// Called before `bytes` bytes in all are in use; a refusal cancels the computation, and [`Self::denied`] tells it from
    /// other cancellations.
    ///
    /// # Errors
    /// [`Canceled`] when they are refused, and as [`Self::checkpoint`].
    pub fn afford(&self, bytes: u64) -> Result<(), Canceled> {
        if self.grant.as_ref().is_some_and(|grant| !grant(bytes)) {
            self.denied.store(bytes, Ordering::Relaxed);
            self.cancel();
        }
        self.checkpoint()
    }

    /// Tells that about so many bytes are in use, to which [`Self::afford_beside`] adds.
    pub fn hold(&self, bytes: u64) {
        self.held.store(bytes, Ordering::Relaxed);
    }

    /// As [`Self::afford`], of bytes beside those that are in use.
    ///
    /// # Errors
    /// The same.
    pub fn afford_beside(&self, bytes: u64) -> Result<(), Canceled> {
        self.afford(bytes.saturating_add(self.held.load(Ordering::Relaxed)))
    }

    /// The bytes that the computation was refused, if that is why it ended.
    #[must_use]
    pub fn denied(&self) -> Option<u64> {
        Some(self.denied.load(Ordering::Relaxed)).filter(|&bytes| bytes > 0)
    }

    /// Asks the computation to end at its next [`Self::checkpoint`].
    pub fn cancel(&self) {
        self.canceled.store(true, Ordering::Relaxed);
    }

    /// A progress that is canceled once it was looked at so many times.
    #[cfg(test)]
    #[must_use]
    pub(crate) fn canceled_after(looks: u64) -> Self {
        Self { looks: Some(AtomicU64::new(looks)), ..Self::default() }
    }

    /// Whether somebody called [`Self::cancel`].
    #[must_use]
    pub fn is_canceled(&self) -> bool {
        #[cfg(test)]
        if self.looks.as_ref().is_some_and(|left| left.fetch_sub(1, Ordering::Relaxed) == 1) {
            self.cancel();
        }
        self.canceled.load(Ordering::Relaxed)
    }

    /// Called in every loop of the computation.
    ///
    /// # Errors
    /// [`Canceled`] once somebody called [`Self::cancel`].
    pub fn checkpoint(&self) -> Result<(), Canceled> {
        if self.is_canceled() { Err(Canceled) } else { Ok(()) }
    }

    /// Runs `work` that ends nowhere but at its end, such as a sort or what another crate builds: [`Leave::if_canceled`],
    /// called where it compares or asks for coordinates, ends it by unwinding.
    ///
    /// # Errors
    /// [`Canceled`], as [`Self::checkpoint`].
    pub fn leaving<T>(&self, work: impl FnOnce(Leave<'_>) -> T) -> Result<T, Canceled> {
        self.checkpoint()?;
        catch_unwind(AssertUnwindSafe(|| work(Leave(self)))).map_err(|unwound| match unwound.downcast() {
            Ok(canceled) => *canceled,
            Err(panic) => resume_unwind(panic),
        })
    }

    /// Begins a phase.
    ///
    /// # Errors
    /// [`Canceled`], as [`Self::checkpoint`].
    pub fn enter(&self, phase: Phase) -> Result<(), Canceled> {
        self.phase.store(phase as u8, Ordering::Relaxed);
        self.advance(0.0)?;
        if let Some(observer) = &self.observer {
            observer(phase);
        }
        Ok(())
    }

    /// Tells what part of the time each phase is expected to take, as soon as that is known. The total never moves backwards.
    pub fn expect(&self, durations: Durations) {
        *self.expected.lock().unwrap_or_else(PoisonError::into_inner) = durations;
    }

    /// The shares of the whole between which a phase lies.
    #[must_use]
    pub fn span(&self, phase: Phase) -> Range<f64> {
        let expected = self.expected.lock().unwrap_or_else(PoisonError::into_inner);
        let until = |count: usize| expected[..count].iter().sum::<f64>() / expected.iter().sum::<f64>();
        until(phase as usize)..until(phase as usize + 1)
    }

    /// Reports the share of the current phase that is done, `0..=1`. The total never moves backwards.
    ///
    /// # Errors
    /// [`Canceled`], as [`Self::checkpoint`].
    pub fn advance(&self, share: f64) -> Result<(), Canceled> {
        let span = self.span(self.phase());
        let total = span.start + share.clamp(0.0, 1.0) * (span.end - span.start);
        self.fraction.fetch_max(total.to_bits(), Ordering::Relaxed);
        self.checkpoint()
    }

    /// The current phase.
    #[must_use]
    pub fn phase(&self) -> Phase {
        Phase::ALL[self.phase.load(Ordering::Relaxed) as usize]
    }

    /// Share of the whole that is done, `0..=1`, never decreasing.
    #[must_use]
    pub fn fraction(&self) -> f64 {
        f64::from_bits(self.fraction.load(Ordering::Relaxed))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_fraction_never_moves_backwards() {
        let progress = Progress::new();
        progress.enter(Phase::Eigenpairs).unwrap();
        progress.advance(0.5).unwrap();
        let half = progress.fraction();
        progress.advance(0.2).unwrap();
        assert!((progress.fraction() - half).abs() < f64::EPSILON);
        progress.enter(Phase::Certificates).unwrap();
        assert!(progress.fraction() > half);
    }

    #[test]
    fn phases_take_the_shares_that_are_expected_of_them() {
        let progress = Progress::new();
        progress.expect([1.0, 1.0, 0.0, 0.0, 0.0, 8.0, 0.0]);
        progress.enter(Phase::Eigenpairs).unwrap();
        assert!((progress.fraction() - 0.2).abs() < 1e-12);
        progress.advance(0.5).unwrap();
        assert!((progress.fraction() - 0.6).abs() < 1e-12);
        progress.expect([9.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0]);
        assert!((progress.fraction() - 0.6).abs() < 1e-12, "what was told is not taken back");
    }

    #[test]
    fn memory_that_is_refused_ends_the_computation_and_is_told() {
        let progress = Progress::new().granting(|bytes| bytes <= 100);
        assert_eq!(progress.afford(100), Ok(()));
        assert_eq!(progress.denied(), None);
        assert_eq!(progress.afford(101), Err(Canceled));
        assert_eq!((progress.denied(), progress.checkpoint()), (Some(101), Err(Canceled)));
        assert_eq!(Progress::new().afford(u64::MAX), Ok(()), "without a grant nothing is refused");
    }

    #[test]
    fn what_has_no_room_is_told_without_an_end_and_may_go_to_a_file() {
        let progress = Progress::new().granting(|bytes| bytes <= 100);
        progress.hold(40);
        assert!(progress.has_room_beside(60) && !progress.has_room_beside(61));
        assert_eq!((progress.denied(), progress.checkpoint()), (None, Ok(())));
        let progress = Progress::new().within(100);
        assert!(progress.has_room_beside(100) && !progress.has_room_beside(101));
        assert_eq!(progress.afford(1_000), Ok(()), "what no file can take is not refused");
        let folder = tempfile::tempdir().unwrap();
        progress.scratch_in(folder.path()).scratch_file(5).unwrap();
        assert!(Progress::new().scratch_in(folder.path().join("none")).scratch_file(5).is_err());
    }

    #[test]
    fn work_without_checkpoints_is_left_when_it_is_canceled_and_panics_stay_panics() {
        let progress = Progress::new();
        assert_eq!(progress.leaving(|leave| (leave.if_canceled(), 5).1), Ok(5));
        let mut numbers: Vec<u32> = (0..1_000).rev().collect();
        let sorted = progress.leaving(|leave| {
            numbers.sort_unstable_by(|a, b| {
                progress.cancel();
                leave.if_canceled();
                a.cmp(b)
            });
        });
        assert_eq!(sorted, Err(Canceled));
        assert_eq!(progress.leaving(|_| 5), Err(Canceled), "it does not begin");
        let panicked = catch_unwind(|| Progress::new().leaving::<()>(|_| resume_unwind(Box::new("sand"))));
        assert_eq!(panicked.unwrap_err().downcast_ref(), Some(&"sand"));
    }

    #[test]
    fn a_canceled_computation_ends_at_the_next_checkpoint() {
        let progress = Progress::new();
        assert_eq!(progress.checkpoint(), Ok(()));
        progress.cancel();
        assert_eq!(progress.advance(0.1), Err(Canceled));
    }
}

//! Signals that end a command: the work is canceled in order, then the process dies of the signal.
//!
//! A shell goes on with a loop's next file when a program exits by itself, and stops when it died of SIGINT
//! (<https://www.cons.org/cracauer/sigint.html>).

use std::sync::Arc;
use std::sync::atomic::{AtomicI32, Ordering};

use chladni::progress::Progress;
use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};
use signal_hook::iterator::Signals;
use signal_hook::low_level::emulate_default_handler;

use super::Failure;

/// Cancels the work at a signal, and remembers which it was.
pub(super) struct Interrupt(Arc<AtomicI32>);

impl Interrupt {
    /// Cancels `progress` at the first Ctrl-C, SIGTERM or SIGHUP; a second one ends the process at once. Signals that the
    /// process was started to ignore, as `nohup` does with SIGHUP, stay ignored.
    pub(super) fn cancels(progress: Arc<Progress>) -> Result<Self, Failure> {
        let ignored = ignored();
        let heeded = [SIGINT, SIGTERM, SIGHUP].into_iter().filter(|signal| ignored >> (signal - 1) & 1 == 0);
        let mut signals = Signals::new(heeded).map_err(Failure::other)?;
        let received = Arc::new(AtomicI32::new(0));
        let noted = Arc::clone(&received);
        std::thread::spawn(move || {
            for signal in signals.forever() {
                if noted.swap(signal, Ordering::SeqCst) != 0 {
                    die_of(signal);
                }
                progress.cancel();
            }
        });
        Ok(Self(received))
    }

    /// The outcome of the work; that of the signal, if one broke it off.
    pub(super) fn outcome<T>(&self, result: Result<T, Failure>) -> Result<T, Failure> {
        match (result, self.0.load(Ordering::SeqCst)) {
            (Err(_), signal) if signal != 0 => Err(Failure::Signal(signal)),
            (result, _) => result,
        }
    }
}

/// Ends the process as the signal does by itself. Comes back only if the system does not know the signal.
pub(super) fn die_of(signal: i32) {
    let _ = emulate_default_handler(signal);
}

/// The signals that the process ignores, a bit for each from the first on (proc(5), `SigIgn`).
fn ignored() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let mask = status.lines().find_map(|line| line.strip_prefix("SigIgn:"));
    mask.and_then(|mask| u64::from_str_radix(mask.trim(), 16).ok()).unwrap_or(0)
}

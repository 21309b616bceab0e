//! How long a client may keep the service waiting for its body.

use std::time::Duration;

/// A least rate over a window of time: waiting uses credit up, bytes bring it back.
#[derive(Debug, Clone)]
pub(crate) struct Pace {
    window: Duration,
    /// Bytes per second; 0 for none.
    rate: u64,
    credit: Duration,
    waited: Duration,
}

impl Pace {
    /// At least `rate` bytes per second on average over any `window`; 0 asks for no rate.
    pub(crate) fn new(window: Duration, rate: u64) -> Self {
        Self { window, rate, credit: window, waited: Duration::ZERO }
    }

    /// How long it may wait from now on if nothing comes.
    pub(crate) fn left(&self) -> Duration {
        if self.rate == 0 { Duration::MAX } else { self.credit }
    }

    /// How long the client was waited for in all.
    pub(crate) fn waited(&self) -> Duration {
        self.waited
    }

    /// The client was waited for.
    pub(crate) fn wait(&mut self, time: Duration) {
        self.waited = self.waited.saturating_add(time);
        self.credit = self.credit.saturating_sub(time);
    }

    /// Bytes came.
    pub(crate) fn arrive(&mut self, bytes: usize) {
        if self.rate > 0 {
            let earned = Duration::from_secs_f64(bytes as f64 / self.rate as f64);
            self.credit = self.credit.saturating_add(earned).min(self.window);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SECOND: Duration = Duration::from_secs(1);

    fn after(bytes_per_second: usize, seconds: u32) -> Duration {
        let mut pace = Pace::new(30 * SECOND, 1000);
        for _ in 0..seconds {
            pace.arrive(bytes_per_second);
            pace.wait(SECOND);
        }
        pace.left()
    }

    #[test]
    fn the_rate_is_enough_for_ever_and_half_of_it_for_twice_the_window() {
        assert_eq!(after(1000, 3600), 29 * SECOND);
        assert_eq!(after(500, 58), Duration::from_millis(500));
        assert_eq!(after(500, 59), Duration::ZERO);
        assert_eq!(after(0, 30), Duration::ZERO);
    }

    #[test]
    fn a_fast_beginning_buys_no_more_than_a_window() {
        let mut pace = Pace::new(30 * SECOND, 1000);
        pace.arrive(1 << 30);
        assert_eq!(pace.left(), 30 * SECOND);
        pace.wait(31 * SECOND);
        assert_eq!((pace.left(), pace.waited()), (Duration::ZERO, 31 * SECOND));
    }

    #[test]
    fn without_a_rate_nothing_is_used_up() {
        let mut pace = Pace::new(SECOND, 0);
        pace.wait(100 * SECOND);
        pace.arrive(1);
        assert_eq!(pace.left(), Duration::MAX);
    }
}

//! [`Threaded`]: one loop of [`Threads`](super::Threads): its grid and its counts.

use super::time::NANOSECONDS;
use crate::error::RateError;
use crate::process::Overrun;
use crate::rate::Rate;
use crate::schedule::Grid;
use crate::single::Single;
use crate::statistics::Statistics;

/// What a loop's thread and its callers share, under a lock.
#[derive(Debug)]
pub(super) struct Threaded {
    pub(super) rate: Rate,
    grid: Grid,
    servo_loop: Single<u64>,
    /// When it is due next.
    due: u64,
    started: bool,
    assigned: bool,
    /// The thread is to end.
    pub(super) quit: bool,
    /// The thread's number and priority, while it runs.
    pub(super) thread: Option<u32>,
    pub(super) priority: Option<i32>,
}

impl Threaded {
    pub(super) fn new(rate: Rate) -> Self {
        Self {
            rate,
            grid: Self::grid(rate).unwrap_or(Grid::NONE),
            servo_loop: Single::NEW,
            due: 0,
            started: false,
            assigned: false,
            quit: false,
            thread: None,
            priority: None,
        }
    }

    pub(super) fn grid(rate: Rate) -> Result<Grid, RateError> {
        let frequency = NANOSECONDS;
        Grid::new(rate, frequency).ok_or(RateError::TooFast { rate, frequency })
    }

    /// `None` if it is assigned already.
    pub(super) fn assign(&mut self, overrun: Overrun) -> Option<()> {
        if self.assigned {
            return None;
        }
        self.assigned = true;
        self.quit = false;
        self.servo_loop.set_overrun(overrun);
        self.servo_loop.enable(true);
        Some(())
    }

    /// All instants begin now.
    pub(super) fn begin(&mut self, now: u64) {
        self.grid.restart();
        self.due = now;
        self.started = true;
    }

    pub(super) fn stop(&mut self) {
        self.started = false;
        self.servo_loop.forget();
    }

    /// The loop is released at all instants until `now`.
    #[inline]
    pub(super) fn advance(&mut self, now: u64) {
        while self.started && self.due <= now {
            self.servo_loop.release(self.due);
            self.due = self.due.saturating_add(self.grid.step());
        }
    }

    /// Starts the oldest release, if there is one; gives the instant at which it was due.
    #[inline]
    pub(super) fn start(&mut self, now: u64) -> Option<u64> {
        self.servo_loop.begin(now).map(|(_, due)| due)
    }

    /// The run that was started has taken `ticks`.
    #[inline]
    pub(super) fn finish(&mut self, now: u64, ticks: u32) {
        // What has become due meanwhile finds the loop unfinished.
        self.advance(now);
        self.servo_loop.end(ticks);
    }

    pub(super) fn fault(&mut self) {
        self.servo_loop.fault();
    }

    /// When its thread has to wake, if ever.
    pub(super) fn next_due(&self) -> Option<u64> {
        (self.started && self.servo_loop.is_enabled()).then_some(self.due)
    }

    pub(super) fn set_rate(&mut self, rate: Rate, grid: Grid, now: u64) {
        self.advance(now);
        self.servo_loop.change();
        self.rate = rate;
        self.grid = grid;
    }

    /// `None` if there is nothing to run.
    pub(super) fn set_enabled(&mut self, enabled: bool, now: u64) -> Option<()> {
        if !self.assigned {
            return None;
        }
        self.advance(now);
        self.servo_loop.enable(enabled);
        Some(())
    }

    pub(super) fn reset(&mut self) {
        self.servo_loop.reset();
    }

    /// The thread has ended.
    pub(super) fn end(&mut self) {
        self.servo_loop.enable(false);
        self.assigned = false;
        self.thread = None;
    }

    pub(super) fn statistics(&self) -> Statistics {
        Statistics::of(&self.servo_loop.snapshot(), self.rate, NANOSECONDS)
    }
}

#[cfg(test)]
mod tests {
    use super::Threaded;
    use crate::process::Overrun;
    use crate::rate::Rate;

    #[test]
    fn a_million_instants_end_within_a_tick() {
        let mut state = Threaded::new(Rate::hz(3));
        state.begin(0);
        for _ in 0..1_000_000 {
            state.advance(state.due);
        }
        assert_eq!(state.due, 333_333_333_333_333);
    }

    #[test]
    fn a_release_during_a_run_is_skipped_and_a_run_after_it_is_on_the_grid() {
        let mut state = Threaded::new(Rate::hz(1000));
        state.assign(Overrun::Skip);
        state.begin(0);
        state.advance(0);
        assert_eq!(state.start(0), Some(0));
        state.finish(2_500_000, 2_500_000);
        assert_eq!(state.start(2_500_000), None);
        assert_eq!(state.next_due(), Some(3_000_000));
        let statistics = state.statistics();
        assert_eq!((statistics.released, statistics.skipped), (3, 2));
    }

    #[test]
    fn a_new_rate_begins_at_the_next_instant() {
        let mut state = Threaded::new(Rate::hz(1000));
        state.assign(Overrun::Skip);
        state.begin(0);
        let rate = Rate::hz(500);
        state.set_rate(rate, Threaded::grid(rate).unwrap(), 1_500_000);
        assert_eq!(state.next_due(), Some(2_000_000));
        state.advance(2_000_000);
        assert_eq!(state.next_due(), Some(4_000_000));
    }
}

//! [`Statistics`]: the counts and times of a loop.

use core::fmt;

use crate::rate::Rate;

/// The counts and times of a loop at one moment, from
/// [`Loops::statistics`](crate::Loops::statistics). The counts satisfy `released = run + skipped +
/// running + pending`.
///
/// They count from the beginning of the loop, or since they were last reset.
///
/// ```
/// # use condor_mos::sim::SimPlatform;
/// use condor_mos::{LoopId, Loops, Rate, Scheduler};
///
/// # let processor = SimPlatform::new(Rate::hz(1_000_000));
/// let scheduler = Scheduler::<_, 1, 1>::with_rates(processor, &[Rate::hz(400)])?;
/// let servo = scheduler.statistics(LoopId(0))?;
/// println!("{servo}: uses {:.1} % of the processor's time", 100.0 * servo.utilisation());
/// assert_eq!(servo.released, 0);
/// # Ok::<_, Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Statistics {
    /// The rate of the loop.
    pub rate: Rate,
    /// The frequency of the clock, in ticks per second. The times below are in its ticks.
    pub frequency: Rate,
    /// Whether the loop is enabled, that is, released when it is due.
    pub enabled: bool,
    /// Whether the loop was disabled by an overrun or, in a thread, by a panic.
    pub faulted: bool,
    /// Whether each instant is computed when it is due, because the event table has no room for the
    /// rates of the loops; see [`EventTable::or_scan`](crate::EventTable::or_scan).
    pub computed: bool,
    /// The number of releases of the loop.
    pub released: u64,
    /// The number of finished runs.
    pub run: u64,
    /// The number of releases that never ran, because of an overrun or because the loop was
    /// disabled.
    pub skipped: u64,
    /// 1 while a run is in progress, else 0.
    pub running: u64,
    /// The number of releases that have not started.
    pub pending: u64,
    /// The longest time from a release to the start of its run, in ticks.
    pub worst_lateness: u32,
    /// The longest run, in ticks, without the loops that interrupted it.
    pub worst_run: u32,
    /// The sum of all run times, in ticks, without the loops that interrupted the runs.
    pub total_run: u64,
    /// The part of `released` from before the loop's rate was last changed.
    pub released_before: u64,
    /// The part of `total_run` from before the loop's rate was last changed, in ticks.
    pub total_before: u64,
}

impl Statistics {
    /// Returns the mean time of a run in ticks, without the loops that interrupted it; 0 before the
    /// first run has finished.
    #[must_use]
    pub fn mean_run(&self) -> u32 {
        let mean = self.total_run.checked_div(self.run);
        u32::try_from(mean.unwrap_or(0)).unwrap_or(u32::MAX)
    }

    /// Returns the fraction of the processor's time that the loop has taken at its present rate: 1
    /// is all of the time. Returns 0 before the first release at this rate.
    #[must_use]
    pub fn utilisation(&self) -> f64 {
        let released = self.released.saturating_sub(self.released_before);
        if released == 0 {
            return 0.0;
        }
        let period = self.frequency.as_hz() / self.rate.as_hz();
        let ticks = self.total_run.saturating_sub(self.total_before);
        // Below 2^53 ticks, months of nanoseconds, nothing is lost.
        #[allow(clippy::cast_precision_loss)]
        let share = ticks as f64 / (released as f64 * period);
        share
    }

    /// Converts `ticks`, such as `worst_run`, to microseconds by
    /// [`frequency`](Statistics::frequency).
    #[must_use]
    pub fn microseconds(&self, ticks: u32) -> f64 {
        f64::from(ticks) * 1e6 / self.frequency.as_hz()
    }
}

/// Prints one line of a table; `{:#}` prints its heading.
impl fmt::Display for Statistics {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if f.alternate() {
            return write!(
                f,
                "{:>14} {:>9} {:>9} {:>8} {:>10} {:>10} {:>10} {:>6}",
                "rate", "released", "run", "skipped", "late µs", "worst µs", "mean µs", "util %"
            );
        }
        write!(
            f,
            "{:>14} {:>9} {:>9} {:>8} {:>10.1} {:>10.1} {:>10.1} {:>6.2}{}",
            self.rate,
            self.released,
            self.run,
            self.skipped,
            self.microseconds(self.worst_lateness),
            self.microseconds(self.worst_run),
            self.microseconds(self.mean_run()),
            100.0 * self.utilisation(),
            if self.faulted { "  FAULT" } else { "" },
        )
    }
}

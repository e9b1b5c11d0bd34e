//! [`Statistics`]: what a loop has done so far.

use core::fmt;

use crate::instant::Instant;
use crate::rate::Rate;
use crate::state::Snapshot;

/// The counts of a loop at one moment: `released = run + skipped + running + pending`.
///
/// Counts wrap after 2^32 releases: 124 days at 400 Hz.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Statistics {
    /// Its rate.
    pub rate: Rate,
    /// Ticks per second of the times below.
    pub frequency: Rate,
    /// Whether it is released when it is due.
    pub enabled: bool,
    /// Whether an overrun has disabled it.
    pub faulted: bool,
    /// How often it was due.
    pub released: u32,
    /// How often it has finished.
    pub run: u32,
    /// Releases that never ran, because of an overrun or because it was disabled.
    pub skipped: u32,
    /// 1 while it is in progress, else 0.
    pub running: u32,
    /// Releases that have not started.
    pub pending: u32,
    /// The longest time from a release to its start, in ticks.
    pub worst_lateness: u32,
    /// The longest run, in ticks, without the loops that interrupted it.
    pub worst_run: u32,
    /// All runs together, in ticks, without the loops that interrupted them.
    pub total_run: u64,
}

impl Statistics {
    pub(crate) fn of<I: Instant>(snapshot: &Snapshot<I>, rate: Rate, frequency: Rate) -> Self {
        let Snapshot {
            process,
            enabled,
            running,
            pending,
        } = snapshot;
        let running = u32::from(*running);
        let released = [process.run, process.skipped, running, *pending];
        Self {
            rate,
            frequency,
            enabled: *enabled,
            faulted: process.faulted,
            released: released.into_iter().fold(0, u32::wrapping_add),
            run: process.run,
            skipped: process.skipped,
            running,
            pending: *pending,
            worst_lateness: process.worst_lateness,
            worst_run: process.worst_run,
            total_run: process.total_run,
        }
    }

    /// The mean time of a run, in ticks; 0 before the first one has finished.
    #[must_use]
    pub fn mean_run(&self) -> u32 {
        let mean = self.total_run.checked_div(u64::from(self.run));
        u32::try_from(mean.unwrap_or(0)).unwrap_or(u32::MAX)
    }

    /// The part of the processor that the loop has taken since it was enabled first: 1 is all of it.
    #[must_use]
    pub fn utilisation(&self) -> f64 {
        if self.released == 0 {
            return 0.0;
        }
        let period = self.frequency.as_hz() / self.rate.as_hz();
        // Below 2^53 ticks, months of nanoseconds, nothing is lost.
        #[allow(clippy::cast_precision_loss)]
        let total = self.total_run as f64;
        total / (f64::from(self.released) * period)
    }

    /// `ticks` in microseconds.
    #[must_use]
    pub fn microseconds(&self, ticks: u32) -> f64 {
        f64::from(ticks) * 1e6 / self.frequency.as_hz()
    }
}

/// One line of a table; `{:#}` gives its heading.
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

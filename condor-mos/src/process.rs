//! One servo loop's entry of the process table: what it runs, its counts, and what an overrun does.

use crate::body::Body;
use crate::instant::Instant;

/// What happens when a loop is due again before it has finished.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Overrun {
    /// The release is skipped and counted: the loop runs again at the next one.
    #[default]
    Skip,
    /// Up to this many releases wait and run as soon as the loop has finished; others are
    /// skipped. For loops that count their runs.
    CatchUp(u8),
    /// The release is skipped and the loop disabled;
    /// [`Statistics::faulted`](crate::Statistics::faulted) says so until it is enabled again.
    Fault,
}

/// One loop. Times are in ticks; counts wrap.
///
/// Releases are not counted: each is counted where it ends up, as run or as skipped, or still
/// waits or runs.
#[derive(Clone, Copy)]
pub(crate) struct Process<I> {
    pub(crate) body: Body,
    /// When the release that runs, or runs next, was due.
    pub(crate) due: I,
    pub(crate) worst_lateness: u32,
    pub(crate) worst_run: u32,
    pub(crate) run: u32,
    pub(crate) total_run: u64,
    /// Releases that wait for the loop to finish an earlier one, and when the latest was due.
    pub(crate) queued: u32,
    latest: I,
    pub(crate) skipped: u32,
    pub(crate) overrun: Overrun,
    pub(crate) faulted: bool,
}

impl<I: Instant> Process<I> {
    pub(crate) const NEW: Self = Self {
        body: Body::NOTHING,
        due: I::ZERO,
        worst_lateness: 0,
        worst_run: 0,
        run: 0,
        total_run: 0,
        queued: 0,
        latest: I::ZERO,
        skipped: 0,
        overrun: Overrun::Skip,
        faulted: false,
    };

    /// The loop is due before it has finished; says whether it stays enabled.
    #[cold]
    pub(crate) fn overrun(&mut self, due: I) -> bool {
        match self.overrun {
            Overrun::CatchUp(most) if self.queued < u32::from(most) => {
                self.queued += 1;
                self.latest = due;
            }
            Overrun::Skip | Overrun::CatchUp(_) => self.skip(1),
            Overrun::Fault => {
                self.skip(1);
                self.faulted = true;
                return false;
            }
        }
        true
    }

    /// Counts releases that will not run.
    pub(crate) fn skip(&mut self, releases: u32) {
        self.skipped = self.skipped.wrapping_add(releases);
    }

    /// The next of the releases that wait takes the place of the one that has finished.
    #[cold]
    pub(crate) fn take_queued(&mut self) {
        // So many periods lie between the release that has finished and the latest.
        let period = self.latest.since(self.due) / self.queued.max(1);
        self.due = self.due.after(period);
        self.queued -= 1;
    }

    /// The loop starts.
    #[inline(always)]
    pub(crate) fn start(&mut self, now: I) {
        let lateness = now.since(self.due);
        if lateness > self.worst_lateness {
            self.worst_lateness = lateness;
        }
    }

    /// The loop has finished, after `ticks` of its own.
    #[inline(always)]
    pub(crate) fn finish(&mut self, ticks: u32) {
        self.run = self.run.wrapping_add(1);
        self.total_run = self.total_run.wrapping_add(u64::from(ticks));
        if ticks > self.worst_run {
            self.worst_run = ticks;
        }
    }
}

//! One servo loop's entry of the process table: its counts, and what an overrun does.

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

impl Overrun {
    /// How many unfinished releases there may be when another one comes.
    const fn backlog(self) -> u32 {
        match self {
            Self::Skip | Self::Fault => 0,
            Self::CatchUp(releases) => releases as u32,
        }
    }
}

/// The counts of one loop. Times are in ticks; counts wrap.
#[derive(Clone, Copy)]
pub(crate) struct Process<I> {
    pub(crate) body: Option<Body>,
    pub(crate) enabled: bool,
    pub(crate) faulted: bool,
    pub(crate) overrun: Overrun,
    pub(crate) released: u32,
    pub(crate) skipped: u32,
    pub(crate) started: u32,
    pub(crate) run: u32,
    pub(crate) worst_lateness: u32,
    pub(crate) worst_run: u32,
    pub(crate) total_run: u64,
    /// When the oldest release that has not started was due, and the latest.
    oldest: I,
    latest: I,
}

impl<I: Instant> Process<I> {
    pub(crate) const NEW: Self = Self {
        body: None,
        enabled: false,
        faulted: false,
        overrun: Overrun::Skip,
        released: 0,
        skipped: 0,
        started: 0,
        run: 0,
        worst_lateness: 0,
        worst_run: 0,
        total_run: 0,
        oldest: I::ZERO,
        latest: I::ZERO,
    };

    /// Releases that have not started.
    #[inline]
    pub(crate) const fn pending(&self) -> u32 {
        self.released
            .wrapping_sub(self.skipped)
            .wrapping_sub(self.started)
    }

    /// Whether the loop is in progress, perhaps interrupted.
    #[inline]
    pub(crate) const fn is_running(&self) -> bool {
        self.started != self.run
    }

    /// The loop is due; says whether it will run.
    #[inline]
    pub(crate) fn release(&mut self, due: I) -> bool {
        if !self.enabled {
            return false;
        }
        let unfinished = self
            .released
            .wrapping_sub(self.skipped)
            .wrapping_sub(self.run);
        self.released = self.released.wrapping_add(1);
        if unfinished == 0 {
            // Nearly always, so nothing else is looked at.
            self.oldest = due;
            self.latest = due;
            return true;
        }
        if unfinished > self.overrun.backlog() {
            self.skip();
            return false;
        }
        if self.pending() == 1 {
            self.oldest = due;
        }
        self.latest = due;
        true
    }

    #[cold]
    fn skip(&mut self) {
        self.skipped = self.skipped.wrapping_add(1);
        if self.overrun == Overrun::Fault {
            self.faulted = true;
            self.enabled = false;
        }
    }

    /// Skips what has not started.
    pub(crate) fn forget(&mut self) {
        self.skipped = self.skipped.wrapping_add(self.pending());
    }

    /// The oldest release starts; says whether others wait.
    #[inline]
    pub(crate) fn start(&mut self, now: I) -> bool {
        self.started = self.started.wrapping_add(1);
        let lateness = now.since(self.oldest);
        if lateness > self.worst_lateness {
            self.worst_lateness = lateness;
        }
        let waiting = self.pending();
        if waiting == 0 {
            return false;
        }
        // So many periods lie between the release that starts and the latest.
        self.oldest = self.oldest.after(self.latest.since(self.oldest) / waiting);
        true
    }

    /// The loop has finished, after `ticks` of its own.
    #[inline]
    pub(crate) fn finish(&mut self, ticks: u32) {
        self.run = self.run.wrapping_add(1);
        self.total_run = self.total_run.wrapping_add(u64::from(ticks));
        if ticks > self.worst_run {
            self.worst_run = ticks;
        }
    }
}

//! [`Single`]: a loop that shares its processor's time with no other loop of its scheduler.

use crate::body::Body;
use crate::instant::Instant;
use crate::process::{Overrun, Process};
use crate::record::{Counts, Record};
use crate::state::Snapshot;

/// A process, and what a scheduler of several keeps of it in its sets of loops.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Single<I> {
    process: Process<I, Counts>,
    enabled: bool,
    /// Released, and not finished.
    unfinished: bool,
    /// Released, and not started.
    runnable: bool,
}

impl<I: Instant> Single<I> {
    pub(crate) const NEW: Self = Self {
        process: Process::NEW,
        enabled: false,
        unfinished: false,
        runnable: false,
    };

    /// Gives the loop what it runs and enables it, if it has nothing yet; says whether it had not.
    pub(crate) fn assign(&mut self, overrun: Overrun, body: Body<I>) -> bool {
        if self.is_assigned() {
            return false;
        }
        self.process.body = body;
        self.set_overrun(overrun);
        self.enable(true);
        true
    }

    pub(crate) fn set_overrun(&mut self, overrun: Overrun) {
        self.process.overrun = overrun;
    }

    /// Whether it was given something to run.
    pub(crate) fn is_assigned(&self) -> bool {
        !self.process.body.is_nothing()
    }

    #[cfg(all(feature = "linux", target_os = "linux", not(condor_loom)))]
    pub(crate) fn is_enabled(&self) -> bool {
        self.enabled
    }

    /// Has the loop released, or not any more.
    pub(crate) fn enable(&mut self, enabled: bool) {
        self.enabled = enabled;
        if enabled {
            self.process.faulted = false;
        } else {
            self.forget();
        }
    }

    /// The loop is not to run any more, because of what it did.
    #[cfg(all(feature = "linux", target_os = "linux", not(condor_loom)))]
    pub(crate) fn fault(&mut self) {
        self.enable(false);
        self.process.faulted = true;
    }

    /// Disables it and takes away what it runs, unless it is in progress; says whether it is not.
    pub(crate) fn withdraw(&mut self) -> bool {
        self.enable(false);
        if self.unfinished {
            return false;
        }
        self.process.body = Body::NOTHING;
        true
    }

    /// The loop is due.
    #[inline]
    pub(crate) fn release(&mut self, due: I) {
        if !self.enabled {
            return;
        }
        if self.unfinished {
            self.enabled = self.process.overrun(due);
            return;
        }
        self.process.due = due;
        self.unfinished = true;
        self.runnable = true;
    }

    /// Starts the loop if it is released; gives what it runs.
    #[inline]
    pub(crate) fn begin(&mut self, now: I) -> Option<(Body<I>, I)> {
        if !self.runnable {
            return None;
        }
        self.runnable = false;
        self.process.start(now);
        Some((self.process.body, self.process.due))
    }

    /// The loop has finished, after `ticks`.
    #[inline]
    pub(crate) fn end(&mut self, ticks: u32) {
        self.process.record.finish(ticks);
        self.unfinished = self.process.queued > 0;
        if self.unfinished {
            self.process.take_queued();
            self.runnable = true;
        }
    }

    /// Skips what has not started.
    pub(crate) fn forget(&mut self) {
        let forgotten = self.process.queued + u32::from(self.runnable);
        self.process.record.skip(forgotten);
        self.process.queued = 0;
        self.unfinished &= !self.runnable;
        self.runnable = false;
    }

    /// The loop has another rate from here on.
    pub(crate) fn change(&mut self) {
        let released = self.snapshot().released();
        self.process.record.change(released);
    }

    /// Counts begin anew.
    pub(crate) fn reset(&mut self) {
        self.process.record = Counts::NEW;
    }

    pub(crate) fn snapshot(&self) -> Snapshot {
        Snapshot {
            counts: self.process.record,
            enabled: self.enabled,
            faulted: self.process.faulted,
            running: self.unfinished && !self.runnable,
            pending: self.process.queued + u32::from(self.runnable),
        }
    }
}

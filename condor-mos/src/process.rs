//! One servo loop's entry of the process table: what it runs, its counts, and what an overrun does.

use crate::body::LoopBody;
use crate::instant::CounterReading;
use crate::record::Record;

/// The number of a loop: the index of its rate in the list of rates that the schedule was made
/// from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct LoopId(pub u8);

/// The reaction to an overrun, which happens when a loop is due again before its previous run has
/// finished.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Overrun {
    /// Skips the release and counts it as skipped. The loop runs again at the first release after
    /// it has finished.
    #[default]
    Skip,
    /// Lets up to this many releases wait, and runs them as soon as the loop has finished; skips
    /// others. It is for loops that count their runs.
    CatchUp(u8),
    /// Skips the release and disables the loop. [`Statistics::faulted`](crate::Statistics::faulted)
    /// is true until it is enabled again.
    Fault,
}

/// One loop.
///
/// Releases are not counted: each is counted where it ends up, as run or as skipped, or still
/// waits or runs.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Process<I, K> {
    pub(crate) body: LoopBody<I>,
    /// When the release that runs, or runs next, was due.
    pub(crate) due: I,
    pub(crate) record: K,
    /// Releases that wait for the loop to finish an earlier one, and when the latest was due.
    pub(crate) queued: u32,
    latest: I,
    pub(crate) overrun: Overrun,
    pub(crate) faulted: bool,
}

impl<I: CounterReading, K: Record> Process<I, K> {
    pub(crate) const NEW: Self = Self {
        body: LoopBody::NOTHING,
        due: I::ZERO,
        record: K::NEW,
        queued: 0,
        latest: I::ZERO,
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
            Overrun::Skip | Overrun::CatchUp(_) => self.record.skip(1),
            Overrun::Fault => {
                self.record.skip(1);
                self.faulted = true;
                return false;
            }
        }
        true
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
        if K::MEASURES {
            self.record.start(now.since(self.due));
        }
    }
}

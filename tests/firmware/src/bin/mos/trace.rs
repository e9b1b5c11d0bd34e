//! [`Trace`]: who began and who ended, in their order.

use core::sync::atomic::{AtomicU8, AtomicUsize, Ordering::Relaxed};

use crate::LOOPS;

/// The number of entries and exits that are kept of a run.
const LENGTH: usize = 1024;
const EXIT: u8 = 0x80;

/// The entries and exits of loops. One core: all of its contexts see what was stored.
pub(crate) struct Trace {
    entries: [AtomicU8; LENGTH],
    len: AtomicUsize,
}

/// The findings of a trace.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Told {
    /// Each exit is that of the latest entry, and each entry that of a faster loop than what it
    /// interrupts.
    pub(crate) strict: bool,
    /// The most loops in progress at once.
    pub(crate) deepest: usize,
    /// True if no loop is in progress at the end.
    pub(crate) closed: bool,
}

impl Trace {
    pub(crate) const fn new() -> Self {
        Self {
            entries: [const { AtomicU8::new(0) }; LENGTH],
            len: AtomicUsize::new(0),
        }
    }

    /// Runs a loop's body, of this rank.
    pub(crate) fn around(&self, rank: u8, body: impl FnOnce()) {
        self.add(rank);
        body();
        self.add(rank | EXIT);
    }

    fn add(&self, entry: u8) {
        critical_section::with(|_| {
            let len = self.len.load(Relaxed);
            if let Some(place) = self.entries.get(len) {
                place.store(entry, Relaxed);
                self.len.store(len + 1, Relaxed);
            }
        });
    }

    /// Returns the findings; if the trace is full, up to the last time that no loop was in progress.
    pub(crate) fn told(&self) -> Told {
        let mut stack = [0; LOOPS];
        let mut told = Told {
            strict: true,
            deepest: 0,
            closed: true,
        };
        let mut depth = 0_usize;
        for entry in self.entries.iter().take(self.len.load(Relaxed)) {
            let entry = entry.load(Relaxed);
            let rank = entry & !EXIT;
            let outer = stack.get(depth.wrapping_sub(1)).copied();
            if entry & EXIT != 0 {
                told.strict &= outer == Some(rank);
                depth = depth.saturating_sub(1);
            } else {
                told.strict &= outer.is_none_or(|outer| rank < outer);
                if let Some(place) = stack.get_mut(depth) {
                    *place = rank;
                }
                depth += 1;
                told.deepest = told.deepest.max(depth);
            }
        }
        told.closed = depth == 0 || self.len.load(Relaxed) == LENGTH;
        told
    }
}

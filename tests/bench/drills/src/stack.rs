//! The bytes of stack that the levels of a hart's program have taken, each alone and all together.
//!
//! The program is in `tests/bench/drills/hart`, since it paints the stack of a hart.

use condor_mbox::Call;
use zerocopy::{FromBytes, Immutable, IntoBytes};

/// The name under which [`Depths`] are published.
pub const NAME: &str = "stack";

/// The depth to which the handlers of the drill nest.
pub const NESTED: usize = 6;
const _: () = assert!(NESTED <= Call::MAX_DEPTH as usize);

/// Bytes of a stack.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, FromBytes, IntoBytes, Immutable)]
#[repr(C)]
pub struct Depths {
    /// The size of the stack.
    pub stack: u32,
    /// The depth of the background from the end of the stack to its deepest frame, with interrupts masked.
    pub background: u32,
    /// The mailbox interrupt above an idle background, with one handler, with two that are nested, and
    /// so on.
    pub mailbox: [u32; NESTED],
    /// The slow loop above an idle background, with a ring while it runs.
    pub slow: u32,
    /// The fast loop above an idle background, with a ring while it runs.
    pub fast: u32,
    /// The depth from the end of the stack to the deepest frame when all levels run.
    pub deepest: u32,
    /// The number of runs of the fast loop above the slow one, above the innermost handler.
    pub at_once: u32,
    /// Releases that were skipped: a timer's interrupt while the same loop runs is a level that was not
    /// measured.
    pub skipped: u32,
}

impl Depths {
    /// Returns the greatest depth that is possible: that of the background, and of each level once. The
    /// timer's interrupt lets only faster loops in, the mailbox interrupt masks itself, and loops only note
    /// rings.
    #[must_use]
    pub fn bound(&self) -> u32 {
        [self.background, self.mailbox_bound(), self.slow, self.fast]
            .into_iter()
            .fold(0, u32::saturating_add)
    }

    /// Returns the depth of the mailbox interrupt with as many nested handlers as the drill has.
    #[must_use]
    pub fn mailbox_bound(&self) -> u32 {
        self.mailbox.into_iter().max().unwrap_or(0)
    }

    /// Returns the most bytes that one more nested handler takes.
    #[must_use]
    pub fn nested(&self) -> u32 {
        let (shallower, deeper) = (self.mailbox.iter(), self.mailbox.iter().skip(1));
        let steps = shallower
            .zip(deeper)
            .map(|(less, more)| more.saturating_sub(*less));
        steps.max().unwrap_or(0)
    }
}

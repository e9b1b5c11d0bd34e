//! [`Timer`]: a counter and one compare; [`Alarm`]: one whose interrupt can be pended.

use crate::instant::Instant;
use crate::rate::Rate;

/// A monotonic counter that raises one interrupt at one instant.
///
/// # For users
/// A [`Scheduler`](crate::Scheduler) owns its timer and calls it; a program calls [`now`](Self::now)
/// at most.
///
/// # For implementers
/// * Arming replaces what was armed before. The hardware must not lose a compare that has just
///   passed: store it, then read the counter again, and answer [`Armed::Past`] if it is there.
///   An interrupt may come all the same; the scheduler finds nothing due and ignores it.
/// * An interrupt may come late or without cause, never early by more than the scheduler can see:
///   a handler that finds that its instant has not come arms the timer again.
/// * The interrupt stays pending while it is masked.
///
/// The suite of [`conformance`](crate::conformance) checks all of this.
pub trait Timer {
    /// What the counter's readings are: `u64`, or [`Wrapping`](crate::Wrapping) for a counter that
    /// begins anew.
    type Instant: Instant;

    /// Ticks per second.
    fn frequency(&self) -> Rate;

    /// The counter.
    fn now(&self) -> Self::Instant;

    /// Asks for an interrupt at `at`, which is at most half of the counter's range ahead.
    #[must_use]
    fn arm(&self, at: Self::Instant) -> Armed;

    /// Asks for no interrupt any more; one may already be pending.
    fn disarm(&self);
}

/// A timer whose interrupt a program can pend: its handler then runs, whether or not something is due.
///
/// # For users
/// A [`Platform`](crate::Platform) with a vector for each rank pends the fastest one by it, for that is
/// the timer's: so does the one for Cortex-M, over any `Alarm`.
///
/// # For implementers
/// * The handler runs once after one or more pends, as soon as nothing masks it: where a handler of its
///   own priority runs, after that one.
/// * It is an interrupt without cause: what was armed may be so no more, and the handler arms it anew.
pub trait Alarm: Timer {
    /// How many interrupt priorities the timer takes, from the highest on. The last of them is that of
    /// the handler that calls [`Scheduler::on_timer`](crate::Scheduler::on_timer); a first of two is for
    /// one that counts, and must not wait for the fastest loop.
    const LEVELS: u8 = 1;

    /// Has that handler run.
    fn pend(&self);
}

/// Whether a compare was in time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Armed {
    /// The interrupt will come.
    Ahead,
    /// The instant has passed; the interrupt may not come.
    Past,
}

impl<T: Timer + ?Sized> Timer for &T {
    type Instant = T::Instant;

    #[inline]
    fn frequency(&self) -> Rate {
        T::frequency(self)
    }

    #[inline]
    fn now(&self) -> Self::Instant {
        T::now(self)
    }

    #[inline]
    fn arm(&self, at: Self::Instant) -> Armed {
        T::arm(self, at)
    }

    #[inline]
    fn disarm(&self) {
        T::disarm(self);
    }
}

impl<T: Alarm + ?Sized> Alarm for &T {
    const LEVELS: u8 = T::LEVELS;

    #[inline]
    fn pend(&self) {
        T::pend(self);
    }
}

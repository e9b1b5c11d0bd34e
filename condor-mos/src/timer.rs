//! [`Timer`]: a counter with one compare; [`Alarm`]: a timer whose interrupt can be pended.

use crate::instant::CounterReading;
use crate::rate::Rate;

/// A timer: a monotonic counter that can raise an interrupt at one given instant.
///
/// # For users
/// A [`Scheduler`](crate::Scheduler) owns its timer and calls it; programs call only
/// [`now`](Self::now), if at all.
///
/// # For implementers
/// * Arming replaces the instant that was armed before. The hardware must not lose a compare that
///   has just passed: store it, then read the counter again, and return [`Armed::Past`] if the
///   instant has passed. If an interrupt comes all the same, the scheduler finds nothing due and
///   ignores it.
/// * An interrupt may come late or without cause. If it comes early, the handler sees that its
///   instant has not come, and arms the timer again.
/// * The interrupt must stay pending while it is masked.
///
/// The suite in [`conformance`](crate::conformance) checks these rules.
pub trait Timer {
    /// The type of the counter's readings: `u64`, or [`Wrapping`](crate::Wrapping) for a counter
    /// that wraps.
    type Instant: CounterReading;

    /// Returns the ticks per second.
    fn frequency(&self) -> Rate;

    /// Returns the present reading of the counter.
    fn now(&self) -> Self::Instant;

    /// Asks for an interrupt at the instant `at`, which is at most half of the counter's range
    /// ahead. Returns [`Armed::Ahead`] if the interrupt will come, or [`Armed::Past`] if `at` has
    /// passed.
    #[must_use]
    fn arm(&self, at: Self::Instant) -> Armed;

    /// Cancels the interrupt that was armed. If it is already pending, it may still come.
    fn disarm(&self);
}

/// A timer whose interrupt a program can pend: its handler then runs, whether or not a loop is due.
///
/// # For users
/// Programs do not call [`pend`](Self::pend). The platform for Cortex-M, which works with any
/// `Alarm`, uses it to run the fastest loop, since that loop runs in the timer's handler.
///
/// # For implementers
/// * The handler must run once after one or more pends, as soon as nothing masks it. If a handler
///   of the same priority runs, it must run after that one.
/// * A pend is an interrupt without a cause: the armed instant may be lost, since the handler arms
///   the timer anew.
pub trait Alarm: Timer {
    /// The number of interrupt priorities that the timer takes, from the highest on. The last of
    /// them is that of the handler that calls [`Scheduler::on_timer`](crate::Scheduler::on_timer).
    /// If there are two, the first is for an interrupt that counts and must not wait for the
    /// fastest loop.
    const LEVELS: u8 = 1;

    /// Pends the interrupt whose handler calls [`Scheduler::on_timer`](crate::Scheduler::on_timer).
    fn pend(&self);
}

/// The result of [`Timer::arm`].
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

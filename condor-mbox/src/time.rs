//! Monotonic time in nanoseconds, from the clock of the platform.

use core::ops::Deref;
use core::time::Duration;

/// A point on a [`Clock`], in nanoseconds since an arbitrary origin.
///
/// Instants of different clocks must not be compared.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Instant(u64);

impl Instant {
    /// The greatest instant. A wait until then has no deadline of its own.
    pub const FOREVER: Self = Self(u64::MAX);

    /// Returns the instant `ns` nanoseconds after the clock's origin.
    #[must_use]
    #[inline]
    pub const fn from_ns(ns: u64) -> Self {
        Self(ns)
    }

    /// Returns the nanoseconds since the clock's origin.
    #[must_use]
    #[inline]
    pub const fn as_ns(self) -> u64 {
        self.0
    }

    /// Returns the instant that is `span` later than this one, at most [`FOREVER`](Self::FOREVER).
    #[must_use]
    #[inline]
    pub const fn after(self, span: Duration) -> Self {
        Self(self.0.saturating_add(whole_ns(span)))
    }

    /// Returns the nanoseconds from `earlier` until this instant; zero if `earlier` is later.
    #[must_use]
    #[inline]
    pub const fn ns_since(self, earlier: Self) -> u64 {
        self.0.saturating_sub(earlier.0)
    }
}

/// `span` in nanoseconds, at most `u64::MAX`.
#[inline]
pub(crate) const fn whole_ns(span: Duration) -> u64 {
    let ns = span.as_nanos();
    if ns > u64::MAX as u128 {
        u64::MAX
    } else {
        ns as u64
    }
}

/// A monotonic clock, by which a mailbox measures its timeouts.
///
/// # For implementers
///
/// `now` is called once per look of a spinning wait, so it should cost tens of nanoseconds.
/// The clock must never run backwards as seen by one processor.
pub trait Clock {
    /// Returns the present instant.
    fn now(&self) -> Instant;
}

impl<T: Deref<Target: Clock>> Clock for T {
    #[inline]
    fn now(&self) -> Instant {
        (**self).now()
    }
}

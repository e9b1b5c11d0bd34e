//! [`Instant`]: points in time as a counter gives them, also one that begins anew.

/// Instants are computed with inside critical sections, where nothing may call back.
pub trait Sealed {}

impl Sealed for u64 {}
impl<const BITS: u32> Sealed for Wrapping<BITS> {}

/// A reading of a [`Timer`](crate::Timer)'s counter.
///
/// Implemented by `u64`, for counters that never come to their end, and by [`Wrapping`], for those
/// that begin anew. Distances are in ticks.
pub trait Instant: Sealed + Copy + Send + Sync + 'static {
    /// The counter's bits: what lies half of its range ahead is taken for the past.
    const BITS: u32;

    /// A counter that has not begun to count.
    const ZERO: Self;

    /// The instant `ticks` later.
    #[must_use]
    fn after(self, ticks: u32) -> Self;

    /// Ticks since `earlier`, or `u32::MAX` if there were more.
    #[must_use]
    fn since(self, earlier: Self) -> u32;

    /// Whether this instant is `due` or later.
    #[must_use]
    fn has_reached(self, due: Self) -> bool;
}

impl Instant for u64 {
    const BITS: u32 = 64;
    const ZERO: Self = 0;

    #[inline]
    fn after(self, ticks: u32) -> Self {
        self.wrapping_add(Self::from(ticks))
    }

    #[inline]
    fn since(self, earlier: Self) -> u32 {
        match u32::try_from(self.wrapping_sub(earlier)) {
            Ok(ticks) => ticks,
            Err(_) if self < earlier => 0,
            Err(_) => u32::MAX,
        }
    }

    #[inline]
    fn has_reached(self, due: Self) -> bool {
        self >= due
    }
}

/// A counter of `BITS` bits (2 to 32) that begins anew after its last value.
///
/// An instant is told from another one within half of the counter's range: a scheduler sets its
/// timer at least that often, and a handler that is kept waiting for longer takes late for early.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Wrapping<const BITS: u32>(u32);

impl<const BITS: u32> Wrapping<BITS> {
    const MASK: u32 = {
        assert!(BITS >= 2 && BITS <= 32, "a counter has 2 to 32 bits");
        u32::MAX >> (32 - BITS)
    };

    /// What the hardware counts; bits that the counter does not have are left out.
    #[inline]
    #[must_use]
    pub const fn new(count: u32) -> Self {
        Self(count & Self::MASK)
    }

    /// The count, less than 2^`BITS`.
    #[inline]
    #[must_use]
    pub const fn count(self) -> u32 {
        self.0
    }
}

impl<const BITS: u32> Instant for Wrapping<BITS> {
    const BITS: u32 = BITS;
    const ZERO: Self = Self(0);

    #[inline]
    fn after(self, ticks: u32) -> Self {
        Self::new(self.0.wrapping_add(ticks))
    }

    #[inline]
    fn since(self, earlier: Self) -> u32 {
        self.0.wrapping_sub(earlier.0) & Self::MASK
    }

    #[inline]
    fn has_reached(self, due: Self) -> bool {
        self.since(due) <= Self::MASK / 2
    }
}

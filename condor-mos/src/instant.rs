//! [`CounterReading`]: readings of a counter, which may wrap.

/// Keeps other crates from implementing [`CounterReading`]: its methods run in critical sections,
/// where only code of this crate may run.
pub trait Sealed {}

impl Sealed for u64 {}
impl<const BITS: u32> Sealed for Wrapping<BITS> {}

/// A reading of the counter of a [`Timer`](crate::Timer): an instant, in ticks.
///
/// It is implemented for `u64`, for counters that never wrap in practice, and for [`Wrapping`], for
/// counters that do.
pub trait CounterReading: Sealed + Copy + Send + Sync + 'static {
    /// The number of the counter's bits. An instant more than half of the range ahead counts as
    /// past.
    const BITS: u32;

    /// The reading of a counter that has not begun to count.
    const ZERO: Self;

    /// Returns the instant `ticks` later.
    #[must_use]
    fn after(self, ticks: u32) -> Self;

    /// Returns the ticks since `earlier`: 0 if `earlier` is later, `u32::MAX` if there were more.
    #[must_use]
    fn since(self, earlier: Self) -> u32;

    /// Returns true if this instant is `due` or later.
    #[must_use]
    fn has_reached(self, due: Self) -> bool;
}

impl CounterReading for u64 {
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

/// A reading of a counter of `BITS` bits (2 to 32) that wraps after its last value.
///
/// Two instants can be ordered only if they are less than half of the counter's range apart. A
/// scheduler sets its timer often enough for that. A timer handler that is delayed for more than
/// half of the range cannot tell a late interrupt from an early one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Wrapping<const BITS: u32>(u32);

impl<const BITS: u32> Wrapping<BITS> {
    const MASK: u32 = {
        assert!(BITS >= 2 && BITS <= 32, "a counter has 2 to 32 bits");
        u32::MAX >> (32 - BITS)
    };

    /// Makes a reading from the value of the hardware's counter; bits above the lowest `BITS` bits
    /// are ignored.
    #[inline]
    #[must_use]
    pub const fn new(count: u32) -> Self {
        Self(count & Self::MASK)
    }

    /// Returns the value of the counter, less than 2^`BITS`.
    #[inline]
    #[must_use]
    pub const fn count(self) -> u32 {
        self.0
    }
}

impl<const BITS: u32> CounterReading for Wrapping<BITS> {
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

//! [`ClockSpec`]: the properties of a timer on which a schedule depends.

use core::fmt;

use crate::instant::CounterReading;
use crate::rate::Rate;

/// The properties of a timer that a schedule depends on: its frequency, and the number of bits of
/// its counter.
///
/// ```
/// use condor_mos::{ClockSpec, Rate, Wrapping};
///
/// const SYSTEM_TICK: ClockSpec = ClockSpec::of::<Wrapping<24>>(Rate::hz(16_000_000));
/// assert_eq!(SYSTEM_TICK.longest_gap(), (1 << 23) - 1);
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ClockSpec {
    frequency: Rate,
    bits: u32,
}

impl ClockSpec {
    /// Makes the properties of a timer with `frequency` ticks per second and readings of type `I`.
    #[must_use]
    pub const fn of<I: CounterReading>(frequency: Rate) -> Self {
        Self {
            frequency,
            bits: I::BITS,
        }
    }

    /// Returns the number of ticks per second.
    #[must_use]
    pub const fn frequency(self) -> Rate {
        self.frequency
    }

    /// Returns the number of bits after which the counter wraps.
    #[must_use]
    pub const fn bits(self) -> u32 {
        self.bits
    }

    /// Returns the longest time between two events that a schedule may have for this timer, in
    /// ticks. It is less than half of the counter's range, and less than `u32::MAX`, since rounding
    /// may add one tick to the time.
    #[must_use]
    pub const fn longest_gap(self) -> u32 {
        if self.bits > 32 {
            u32::MAX - 1
        } else {
            u32::MAX >> (33 - self.bits)
        }
    }
}

impl fmt::Display for ClockSpec {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} with {} bits", self.frequency, self.bits)
    }
}

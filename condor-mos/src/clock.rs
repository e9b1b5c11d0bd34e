//! [`Clock`]: what a schedule needs to know of a timer.

use core::fmt;

use crate::instant::Instant;
use crate::rate::Rate;

/// How fast a timer counts, and with how many bits.
///
/// ```
/// use condor_mos::{Clock, Rate, Wrapping};
///
/// const SYSTEM_TICK: Clock = Clock::of::<Wrapping<24>>(Rate::hz(16_000_000));
/// assert_eq!(SYSTEM_TICK.longest_gap(), (1 << 23) - 1);
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Clock {
    frequency: Rate,
    bits: u32,
}

impl Clock {
    /// A clock of `frequency` ticks per second whose readings are `I`.
    #[must_use]
    pub const fn of<I: Instant>(frequency: Rate) -> Self {
        Self {
            frequency,
            bits: I::BITS,
        }
    }

    /// Ticks per second.
    #[must_use]
    pub const fn frequency(self) -> Rate {
        self.frequency
    }

    /// Bits of the counter.
    #[must_use]
    pub const fn bits(self) -> u32 {
        self.bits
    }

    /// The longest time, in ticks, between two events: less than half of the counter's range, and a
    /// tick less than a `u32` holds, as a hyperperiod may carry one.
    #[must_use]
    pub const fn longest_gap(self) -> u32 {
        if self.bits > 32 {
            u32::MAX - 1
        } else {
            u32::MAX >> (33 - self.bits)
        }
    }
}

impl fmt::Display for Clock {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} with {} bits", self.frequency, self.bits)
    }
}

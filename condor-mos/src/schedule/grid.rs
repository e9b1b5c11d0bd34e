//! [`Grid`]: the instants of one rate, counted in ticks that it does not divide.

use crate::rate::{Rate, greatest_common_divisor};

/// Multiples of a period, each rounded to the nearest tick: the remainder is carried, so the
/// error never grows.
///
/// Equal instants of different grids are rounded to the same tick.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Grid {
    /// Whole ticks of a period.
    whole: u64,
    /// The part of a period beyond the whole ticks, in `parts` of a tick.
    remainder: u64,
    parts: u64,
    /// Carried from the instants before, less than `parts`.
    carried: u64,
}

impl Grid {
    /// A grid of no rate, for places in an array that are not used.
    pub(crate) const NONE: Self = Self {
        whole: u64::MAX,
        remainder: 0,
        parts: 1,
        carried: 0,
    };

    /// The grid of `rate` in ticks of `frequency`; `None` if its period is less than a tick, or its
    /// fractions of a tick are finer than can be counted.
    pub(crate) const fn new(rate: Rate, frequency: Rate) -> Option<Self> {
        Self::of_fraction(
            rate.denominator() as u64 * frequency.numerator() as u64,
            rate.numerator() as u64 * frequency.denominator() as u64,
        )
    }

    /// The grid whose period is `ticks` / `parts`.
    pub(crate) const fn of_fraction(ticks: u64, parts: u64) -> Option<Self> {
        let divisor = greatest_common_divisor(ticks, parts);
        if ticks < parts || divisor == 0 {
            return None;
        }
        let (ticks, parts) = (ticks / divisor, parts / divisor);
        if parts == 0 || parts > u64::MAX / 2 {
            return None;
        }
        Some(Self {
            whole: ticks / parts,
            remainder: ticks % parts,
            parts,
            carried: parts / 2,
        })
    }

    /// Whole ticks of a period.
    pub(super) const fn whole(&self) -> u64 {
        self.whole
    }

    /// Goes back to the instant 0.
    pub(crate) const fn restart(&mut self) {
        self.carried = self.parts / 2;
    }

    /// Ticks until the next instant.
    pub(crate) const fn step(&mut self) -> u64 {
        self.whole + self.carry()
    }

    /// Returns true if no tick is ever carried.
    #[inline]
    pub(super) const fn is_whole(&self) -> bool {
        self.remainder == 0
    }

    /// The tick, if any, that the next period has beyond the whole ones.
    #[inline]
    pub(crate) const fn carry(&mut self) -> u64 {
        self.carried += self.remainder;
        if self.carried < self.parts {
            return 0;
        }
        self.carried -= self.parts;
        1
    }
}

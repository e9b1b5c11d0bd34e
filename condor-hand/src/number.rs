use core::fmt;

use thiserror::Error;

use crate::decimal::Decimal;
use crate::math::{Real, abs, is_finite, sqrt};

/// The error that a number has a value which its use does not permit.
#[derive(Clone, Copy, Debug, PartialEq, Error)]
#[error("{what} is {}; it must be {must}", Decimal(*.value))]
pub struct NumberError {
    /// The quantity, with its unit.
    pub what: &'static str,
    /// The number.
    pub value: f64,
    /// The requirement that the number does not meet.
    pub must: Requirement,
}

/// A requirement on a number, which must also be finite.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Requirement {
    /// The number may be any finite one.
    Finite,
    /// The number must be above this.
    Above(f64),
    /// The number must be below this.
    Below(f64),
    /// The number must be this or more.
    AtLeast(f64),
    /// The number must be this or less.
    AtMost(f64),
}

impl Requirement {
    /// Returns whether `value` is finite and meets the requirement.
    #[must_use]
    pub fn holds(self, value: f64) -> bool {
        is_finite(value)
            && match self {
                Self::Finite => true,
                Self::Above(bound) => value > bound,
                Self::Below(bound) => value < bound,
                Self::AtLeast(bound) => value >= bound,
                Self::AtMost(bound) => value <= bound,
            }
    }

    /// The requirement with a bound that is farther off.
    fn loosened(self, by: f64) -> Self {
        match self {
            Self::Finite => self,
            Self::Above(bound) => Self::Above(bound - by),
            Self::Below(bound) => Self::Below(bound + by),
            Self::AtLeast(bound) => Self::AtLeast(bound - by),
            Self::AtMost(bound) => Self::AtMost(bound + by),
        }
    }
}

impl fmt::Display for Requirement {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Self::Finite => f.write_str("finite"),
            Self::Above(bound) => write!(f, "above {}", Decimal(bound)),
            Self::Below(bound) => write!(f, "below {}", Decimal(bound)),
            Self::AtLeast(bound) => write!(f, "at least {}", Decimal(bound)),
            Self::AtMost(bound) => write!(f, "at most {}", Decimal(bound)),
        }
    }
}

pub(crate) fn check<T: Real>(
    what: &'static str,
    value: T,
    must: Requirement,
) -> Result<(), NumberError> {
    let value = value.to_f64();
    if must.holds(value) {
        Ok(())
    } else {
        Err(NumberError { what, value, must })
    }
}

/// Returns the tolerance of all checks of motions: how far a number may be beyond a limit of the size
/// `scale`.
///
/// It is half of the digits: 1.5e-8 of the scale in `f64`. Numbers that are at a limit on paper are
/// rounded, and the short time between two points makes a large acceleration of a rounded position:
/// at 1 kHz, of 1 rad, 1e-9 rad/s². No robot can tell the difference, and what is refused differs
/// from its limit in the digits that an error shows.
pub(crate) fn tolerance<T: Real>(scale: T) -> T {
    abs(scale) * sqrt(T::default_epsilon())
}

/// Checks a number of a motion, which may be beyond its limit by the [`tolerance`].
pub(crate) fn check_motion<T: Real>(
    what: &'static str,
    value: T,
    must: Requirement,
    scale: T,
) -> Result<(), NumberError> {
    check(what, value, must.loosened(tolerance(scale).to_f64()))
        .map_err(|error| NumberError { must, ..error })
}

/// Returns whether a position is in a range, or beyond it by no more than the [`tolerance`].
pub(crate) fn is_within<T: Real>(position: T, low: T, high: T) -> bool {
    let room = tolerance(high - low);
    low - room <= position && position <= high + room
}

pub(crate) fn finite<T: Real>(what: &'static str, value: T) -> Result<(), NumberError> {
    check(what, value, Requirement::Finite)
}

pub(crate) fn positive<T: Real>(what: &'static str, value: T) -> Result<(), NumberError> {
    check(what, value, Requirement::Above(0.0))
}

pub(crate) fn not_negative<T: Real>(what: &'static str, value: T) -> Result<(), NumberError> {
    check(what, value, Requirement::AtLeast(0.0))
}

/// The time between samples, s.
pub(crate) fn period<T: Real>(sample_hz: T) -> Result<T, NumberError> {
    let period = T::one() / sample_hz;
    positive("the sample rate, Hz,", sample_hz)?;
    positive("the time between samples, s,", period).map(|()| period)
}

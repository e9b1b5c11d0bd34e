use crate::math::{Real, clamp, is_finite};
use crate::number::{NumberError, not_negative};

/// The integral term of a servo law whose output is limited.
///
/// The term stays within its own limit, and does not move while the output is at a limit that it
/// pushes against: conditional integration, Åström and Hägglund, Advanced PID Control, 3.5.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Integrator<T: Real = f64> {
    term: T,
    limit: T,
}

impl<T: Real> Integrator<T> {
    /// Makes a term of zero that stays within `-limit..=limit`.
    ///
    /// # Errors
    /// [`NumberError`] if the limit is negative or not finite.
    pub fn new(limit: T) -> Result<Self, NumberError> {
        not_negative("the limit of the integral", limit)?;
        let term = T::zero();
        Ok(Self { term, limit })
    }

    /// A term that is within its limit.
    pub(crate) const fn at(term: T, limit: T) -> Self {
        Self { term, limit }
    }

    /// Moves the term by `increment`, and returns `rest` plus the term within `low..=high`. If
    /// their sum is not finite, it returns `None` and does not change the term.
    #[inline]
    pub fn update(&mut self, rest: T, increment: T, low: T, high: T) -> Option<T> {
        let term = clamp(self.term + increment, -self.limit, self.limit);
        let output = rest + term;
        if !is_finite(increment) || !is_finite(output) {
            return None;
        }
        let winds_up = (output > high && term > self.term) || (output < low && term < self.term);
        if !winds_up {
            self.term = term;
        }
        Some(clamp(output, low, high))
    }

    /// Sets the term, limited to its own limit.
    pub fn set(&mut self, term: T) {
        if is_finite(term) {
            self.term = clamp(term, -self.limit, self.limit);
        }
    }

    /// Returns the present term, in the unit of the output.
    #[must_use]
    pub fn term(&self) -> T {
        self.term
    }
}

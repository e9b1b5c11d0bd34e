use crate::math::{clamp, is_finite};
use crate::number::{NumberError, not_negative};

/// The integral term of a control law whose output is limited, with protection against wind-up.
///
/// The term stays within its own limit. While the output is at a limit, the term does not grow in
/// the direction of that limit: conditional integration, Åström and Hägglund, Advanced PID Control,
/// 3.5.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Integrator {
    term: f64,
    limit: f64,
}

impl Integrator {
    /// Makes an integral term that is zero now, and always stays within `-limit..=limit` (in the
    /// unit of the output).
    ///
    /// # Errors
    /// [`NumberError`] if the limit is negative or not finite.
    pub fn new(limit: f64) -> Result<Self, NumberError> {
        not_negative("the limit of the integral", limit)?;
        let term = 0.0;
        Ok(Self { term, limit })
    }

    /// Adds `increment` to the integral term, and returns the output of the law: `rest` (the other
    /// terms of the law) plus the integral term, limited to `low..=high`.
    ///
    /// The term does not change if it would push the output further beyond `low` or `high`. Returns
    /// `None`, and does not change the term, if `increment` or the output is not finite.
    #[inline]
    pub fn update(&mut self, rest: f64, increment: f64, low: f64, high: f64) -> Option<f64> {
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

    /// Sets the integral term, for example to zero, limited to `-limit..=limit`. A value that is
    /// not finite is ignored.
    pub fn set(&mut self, term: f64) {
        if is_finite(term) {
            self.term = clamp(term, -self.limit, self.limit);
        }
    }

    /// Returns the present integral term, in the unit of the output.
    #[must_use]
    pub fn term(&self) -> f64 {
        self.term
    }
}

use crate::math::{Real, clamp, is_finite};
use crate::number::{NumberError, Requirement, check, finite, not_negative, period};

/// The gains of a [`Pid`]: output per unit of the error, per unit-second and per unit per second.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct PidGains<T> {
    /// The gain of the error.
    pub kp: T,
    /// The gain of the error's integral over seconds.
    pub ki: T,
    /// The gain of the rate, per second.
    pub kd: T,
}

/// The limits of a [`Pid`].
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct PidLimits<T> {
    /// The lowest and the highest output.
    pub output: (T, T),
    /// The greatest part of the output, to either side, that comes from the integral.
    pub integral: T,
}

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

    /// Returns the term.
    #[must_use]
    pub fn term(&self) -> T {
        self.term
    }
}

/// A servo law of an error, its integral and a measured rate:
/// `u = kp e + ki ∫ e dt - kd rate`, within limits.
///
/// An error or a rate that is not finite, or that overflows, does not change the law: the output is
/// the last one again.
#[derive(Clone, Copy, Debug)]
pub struct Pid<T: Real = f64> {
    gains: PidGains<T>,
    output: (T, T),
    integrator: Integrator<T>,
    period: T,
    last: T,
    rejected: u32,
}

impl<T: Real> Pid<T> {
    /// Makes a law with an empty integral, which is updated `sample_hz` times a second.
    ///
    /// # Errors
    /// [`NumberError`] for the first value that is negative, not finite, or out of order.
    pub fn new(
        gains: PidGains<T>,
        limits: PidLimits<T>,
        sample_hz: T,
    ) -> Result<Self, NumberError> {
        let (low, high) = limits.output;
        finite("the lower limit of the output", low)?;
        let above = Requirement::AtLeast(low.to_f64());
        check("the upper limit of the output", high, above)?;
        let mut pid = Self {
            gains,
            output: limits.output,
            integrator: Integrator::new(limits.integral)?,
            period: period(sample_hz)?,
            last: clamp(T::zero(), low, high),
            rejected: 0,
        };
        pid.set_gains(gains)?;
        Ok(pid)
    }

    /// Changes the gains; the integral's part of the output stays.
    ///
    /// # Errors
    /// [`NumberError`] for the first gain that is negative or not finite; all gains stay then.
    pub fn set_gains(&mut self, gains: PidGains<T>) -> Result<(), NumberError> {
        let PidGains { kp, ki, kd } = gains;
        not_negative("the gain kp", kp)?;
        not_negative("the gain ki", ki)?;
        not_negative("the gain kd", kd)?;
        self.gains = gains;
        Ok(())
    }

    /// Returns the output for an error (desired less measured) and the rate of the measured value,
    /// per second.
    ///
    /// If the desired value moves, too, `rate` is the measured rate less the desired one.
    #[inline]
    pub fn update(&mut self, error: T, rate: T) -> T {
        let PidGains { kp, ki, kd } = self.gains;
        let (low, high) = self.output;
        let rest = kp * error - kd * rate;
        let increment = ki * error * self.period;
        match self.integrator.update(rest, increment, low, high) {
            Some(output) => self.last = output,
            None => self.rejected = self.rejected.saturating_add(1),
        }
        self.last
    }

    /// Empties the integral.
    pub fn reset(&mut self) {
        self.integrator.set(T::zero());
    }

    /// Sets the integral so that this error and rate lead to `output`. Call it while another law
    /// commands; this law can then take over without a step.
    pub fn track(&mut self, output: T, error: T, rate: T) {
        let PidGains { kp, kd, .. } = self.gains;
        self.integrator.set(output - kp * error + kd * rate);
        if is_finite(output) {
            self.last = clamp(output, self.output.0, self.output.1);
        }
    }

    /// Returns how many updates were not finite.
    #[must_use]
    pub fn rejected(&self) -> u32 {
        self.rejected
    }
}

use thiserror::Error;

use crate::math::{Real, abs, clamp, is_finite, max, min, real, round, sqrt};

/// The reason for which a limiter cannot be made.
#[derive(Clone, Copy, Debug, PartialEq, Error)]
#[non_exhaustive]
pub enum LimiterError {
    /// A limit is not positive and finite.
    #[error("the limit of the {what} is {value}; it must be positive")]
    Limit {
        /// The limited quantity.
        what: &'static str,
        /// The limit, per second or per second squared.
        value: f64,
    },
    /// The sample rate is not positive and finite.
    #[error("the sample rate is {sample_hz} Hz; it must be positive")]
    SampleRate {
        /// The sample rate, Hz.
        sample_hz: f64,
    },
}

impl LimiterError {
    fn check<T: Real>(what: &'static str, value: T) -> Result<T, Self> {
        if is_finite(value) && value > T::zero() {
            Ok(value)
        } else {
            let value = value.to_f64();
            Err(Self::Limit { what, value })
        }
    }

    fn check_period<T: Real>(sample_hz: T) -> Result<T, Self> {
        let period = T::one() / sample_hz;
        if is_finite(sample_hz) && period > T::zero() && is_finite(period) {
            Ok(period)
        } else {
            let sample_hz = sample_hz.to_f64();
            Err(Self::SampleRate { sample_hz })
        }
    }
}

/// Follows a target with a limited rate.
///
/// The first target is taken without limit. A target that is not finite changes nothing.
#[derive(Clone, Copy, Debug)]
pub struct RateLimiter<T: Real = f64> {
    step: T,
    value: T,
    primed: bool,
    rejected: u32,
}

impl<T: Real> RateLimiter<T> {
    /// Makes a limiter with this rate, units per second.
    ///
    /// # Errors
    /// [`LimiterError`] if a rate or sample rate is not positive and finite.
    pub fn new(max_per_second: T, sample_hz: T) -> Result<Self, LimiterError> {
        let rate = LimiterError::check("rate", max_per_second)?;
        let period = LimiterError::check_period(sample_hz)?;
        Ok(Self {
            step: LimiterError::check("rate", rate * period)?,
            value: T::zero(),
            primed: false,
            rejected: 0,
        })
    }

    /// Returns the value at the next sample; exactly the target once that is within reach.
    #[inline]
    pub fn update(&mut self, target: T) -> T {
        if !is_finite(target) {
            self.rejected = self.rejected.saturating_add(1);
        } else if !self.primed || abs(target - self.value) <= self.step {
            self.reset_to(target);
        } else if target > self.value {
            self.value += self.step;
        } else {
            self.value -= self.step;
        }
        self.value
    }

    /// Sets the value to `x` at once; ignored if it is not finite.
    pub fn reset_to(&mut self, x: T) {
        if is_finite(x) {
            self.value = x;
            self.primed = true;
        }
    }

    /// Returns how many targets were not finite.
    #[must_use]
    pub fn rejected(&self) -> u32 {
        self.rejected
    }
}

/// Follows a target with limited velocity and acceleration, without going past a target that stands
/// still.
///
/// The first target is taken without limit. After a target that is not finite, the last one stays
/// in force.
#[derive(Clone, Copy, Debug)]
pub struct MotionLimiter<T: Real = f64> {
    max_velocity: T,
    max_acceleration: T,
    period: T,
    target: T,
    position: T,
    velocity: T,
    primed: bool,
    rejected: u32,
}

impl<T: Real> MotionLimiter<T> {
    /// Makes a limiter with this velocity, units per second, and this acceleration, units per
    /// second squared.
    ///
    /// # Errors
    /// [`LimiterError`] if a limit or sample rate is not positive and finite.
    pub fn new(max_velocity: T, max_acceleration: T, sample_hz: T) -> Result<Self, LimiterError> {
        Ok(Self {
            max_velocity: LimiterError::check("velocity", max_velocity)?,
            max_acceleration: LimiterError::check("acceleration", max_acceleration)?,
            period: LimiterError::check_period(sample_hz)?,
            target: T::zero(),
            position: T::zero(),
            velocity: T::zero(),
            primed: false,
            rejected: 0,
        })
    }

    /// Returns the position at the next sample.
    ///
    /// Braking by `c` of velocity in each of n periods `h`, to `v - (n - 1) c <= c` in the last, goes
    /// `n h (v - c (n - 1) / 2)`: the velocity of this sample is the one that uses up the distance
    /// with the least n.
    #[inline]
    pub fn update(&mut self, target: T) -> T {
        if is_finite(target) {
            self.target = target;
        } else {
            self.rejected = self.rejected.saturating_add(1);
        }
        if !self.primed {
            self.reset_to(target);
            return self.position;
        }
        let change = self.max_acceleration * self.period;
        let distance = self.target - self.position;
        let length = abs(distance);
        let arrival = length / self.period;
        let (one, half) = (T::one(), real::<T>(0.5));
        // The root of n (n + 1) / 2 = distance / (c h), rounded up.
        let root = (sqrt(one + real::<T>(8.0) * arrival / change) - one) * half;
        let periods = max(round(root + half), one);
        let braking = arrival / periods + change * (periods - one) * half;
        let speed = min(braking, self.max_velocity);
        let wanted = if distance < T::zero() { -speed } else { speed };
        let velocity = clamp(wanted, self.velocity - change, self.velocity + change);
        // What has been reached is reached: a rounded step would leave a rest to run after.
        let arrives = velocity == wanted && speed == arrival;
        self.velocity = max(min(velocity, self.max_velocity), -self.max_velocity);
        self.position = if arrives {
            self.target
        } else {
            self.position + self.velocity * self.period
        };
        self.position
    }

    /// Sets the position to `x` at once, at rest; ignored if it is not finite.
    pub fn reset_to(&mut self, x: T) {
        if is_finite(x) {
            self.target = x;
            self.position = x;
            self.velocity = T::zero();
            self.primed = true;
        }
    }

    /// Returns the velocity that led to the last position, units per second.
    #[must_use]
    pub fn velocity(&self) -> T {
        self.velocity
    }

    /// Returns how many targets were not finite.
    #[must_use]
    pub fn rejected(&self) -> u32 {
        self.rejected
    }
}

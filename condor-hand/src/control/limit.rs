use crate::math::{Real, abs, clamp, is_finite, max, min, real, round, sqrt};
use crate::number::{NumberError, period, positive};

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
    /// [`NumberError`] if a rate or sample rate is not positive and finite.
    pub fn new(max_per_second: T, sample_hz: T) -> Result<Self, NumberError> {
        positive("the limit of the rate", max_per_second)?;
        let step = max_per_second * period(sample_hz)?;
        positive("the limit of the rate in a sample", step)?;
        Ok(Self {
            step,
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
    /// [`NumberError`] if a limit or sample rate is not positive and finite.
    pub fn new(max_velocity: T, max_acceleration: T, sample_hz: T) -> Result<Self, NumberError> {
        positive("the limit of the velocity", max_velocity)?;
        positive("the limit of the acceleration", max_acceleration)?;
        Ok(Self {
            max_velocity,
            max_acceleration,
            period: period(sample_hz)?,
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

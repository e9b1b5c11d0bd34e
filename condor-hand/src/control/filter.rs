//! Low-pass filters, and the rate of a sampled signal.
//!
//! A filter begins with its first sample as its output, as if that had lasted for ever. A sample
//! that is not finite, or that would overflow the filter, does not change the filter: the output is
//! the last one again (zero if there is none). States below 1e-30 become zero, because some
//! processors take a hundred times longer for denormal numbers.

use crate::math::{Real, abs, exp, is_finite, min, real};
use crate::number::{NumberError, Requirement, check, positive};

/// The cutoff as a part of the sample rate, below one half.
fn relative<T: Real>(cutoff_hz: T, sample_hz: T) -> Result<f64, NumberError> {
    let (cutoff_hz, sample_hz) = (cutoff_hz.to_f64(), sample_hz.to_f64());
    positive("the sample rate, Hz,", sample_hz)?;
    let what = "the cutoff, Hz,";
    check(what, cutoff_hz, Requirement::Below(sample_hz / 2.0))?;
    positive(what, cutoff_hz)?;
    let relative = cutoff_hz / sample_hz;
    positive("the cutoff in sample rates", relative).map(|()| relative)
}

/// Zero instead of a number that is denormal or soon will be.
#[inline(always)]
pub(super) fn flush<T: Real>(x: T) -> T {
    if abs(x) < real(1e-30) { T::zero() } else { x }
}

/// The part of the way to a new input that a first-order lag goes in one sample, if the input
/// stays: `1 - exp(-2 pi fc / fs)`.
fn lag<T: Real>(relative: f64) -> T {
    real(1.0 - exp(-core::f64::consts::TAU * relative))
}

/// A first-order low-pass filter: `y += alpha (x - y)`.
#[derive(Clone, Copy, Debug)]
pub struct OnePole<T: Real = f64> {
    alpha: T,
    output: T,
    primed: bool,
}

impl<T: Real> OnePole<T> {
    /// Makes the filter whose step response at the samples is that of the analog filter with this
    /// cutoff.
    ///
    /// # Errors
    /// [`NumberError`] if the cutoff is outside of 0..`sample_hz / 2`, or the sample rate is not
    /// positive.
    pub fn low_pass(cutoff_hz: T, sample_hz: T) -> Result<Self, NumberError> {
        Ok(Self {
            alpha: lag(relative(cutoff_hz, sample_hz)?),
            output: T::zero(),
            primed: false,
        })
    }

    /// The part of the way to a new input that one sample goes.
    pub(super) fn alpha(&self) -> T {
        self.alpha
    }

    /// Returns the output for the next sample.
    #[inline]
    pub fn update(&mut self, x: T) -> T {
        let output = if self.primed {
            self.output + self.alpha * (x - self.output)
        } else {
            x
        };
        if is_finite(output) {
            self.output = flush(output);
            self.primed = true;
        }
        self.output
    }
}

/// The rate of a sampled signal, per second, through a first-order low-pass filter: a "dirty"
/// derivative.
///
/// The rate of a ramp is exact once the filter has settled. The first sample gives zero. After
/// samples that were not finite, the difference is taken over the time that has passed.
#[derive(Clone, Copy, Debug)]
pub struct Derivative<T: Real = f64> {
    alpha: T,
    sample_hz: T,
    last: T,
    /// Samples since `last`, with the next.
    intervals: T,
    rate: T,
    primed: bool,
}

impl<T: Real> Derivative<T> {
    /// Makes the derivative, which suppresses changes faster than the cutoff.
    ///
    /// # Errors
    /// [`NumberError`] if the cutoff is outside of 0..`sample_hz / 2`, or the sample rate is not
    /// positive.
    pub fn new(cutoff_hz: T, sample_hz: T) -> Result<Self, NumberError> {
        Ok(Self {
            alpha: lag(relative(cutoff_hz, sample_hz)?),
            sample_hz,
            last: T::zero(),
            intervals: T::one(),
            rate: T::zero(),
            primed: false,
        })
    }

    /// The part of the way to a new slope that one sample goes.
    pub(super) fn alpha(&self) -> T {
        self.alpha
    }

    /// The last sample, if the next is one period after it, and the rate.
    pub(super) fn state(&self) -> (Option<T>, T) {
        let next = self.primed && self.intervals == T::one();
        (next.then_some(self.last), self.rate)
    }

    /// Makes this the state, with the next sample, if it is in time, so many periods after it.
    pub(super) fn go_on_from(&mut self, last: T, rate: T, intervals: T) {
        (self.last, self.rate) = (last, rate);
        self.intervals = intervals;
        self.primed = true;
    }

    /// Returns the rate at the next sample, in units of `x` per second.
    #[inline]
    pub fn update(&mut self, x: T) -> T {
        self.update_after(x, T::one())
    }

    /// Returns the rate at a sample that comes `periods` periods after the last one; more than one
    /// if it is late.
    #[inline]
    pub fn update_after(&mut self, x: T, periods: T) -> T {
        if !self.primed {
            if is_finite(x) {
                self.go_on_from(x, T::zero(), T::one());
            }
            return self.rate;
        }
        self.intervals += periods - T::one();
        let slope = (x - self.last) * (self.sample_hz / self.intervals);
        // One that comes early says less.
        let weight = min(self.intervals, T::one());
        let rate = self.rate + self.alpha * weight * (slope - self.rate);
        if is_finite(rate) {
            self.rate = flush(rate);
            self.last = x;
            self.intervals = T::one();
        } else {
            self.intervals += T::one();
        }
        self.rate
    }

    /// Begins anew with the next sample.
    pub(super) fn forget(&mut self) {
        self.primed = false;
        self.rate = T::zero();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn states_never_become_denormal() {
        let mut one_pole = OnePole::<f32>::low_pass(5.0, 400.0).unwrap();
        let mut derivative = Derivative::<f32>::new(5.0, 400.0).unwrap();
        one_pole.update(1.0);
        derivative.update(1.0);
        derivative.update(2.0);
        for _ in 0..5000 {
            one_pole.update(0.0);
            derivative.update(2.0);
            assert!(!one_pole.output.is_subnormal() && !derivative.rate.is_subnormal());
        }
        assert_eq!(one_pole.output, 0.0);
        assert_eq!(derivative.rate, 0.0);
    }
}

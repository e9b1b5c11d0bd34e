use thiserror::Error;

use crate::decimal::Decimal;
use crate::math::{Real, is_finite, real, round};
use crate::tendon::{Pair, Pairs};

/// A ramp that brings all tensions to their final values in equal steps.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SafeRamp<T: Real, const N: usize> {
    from: Pairs<T, N>,
    to: Pairs<T, N>,
    samples: u32,
    left: u32,
}

/// The reason for which a ramp cannot be made.
#[derive(Clone, Copy, Debug, PartialEq, Error)]
#[non_exhaustive]
pub enum RampError {
    /// The time is less than two samples, or more than can be counted.
    #[error(
        "a ramp of {seconds} s at {sample_hz} Hz; it must take 2 to {max} samples", max = u32::MAX,
        seconds = Decimal(*.seconds),
        sample_hz = Decimal(*.sample_hz),
    )]
    Time {
        /// The time, s.
        seconds: f64,
        /// The sample rate, Hz.
        sample_hz: f64,
    },
    /// A tension is not finite.
    #[error(
        "a ramp from {from} N to {to} N at joint {joint}",
        from = Decimal(*.from),
        to = Decimal(*.to),
    )]
    Tension {
        /// The joint, from 0.
        joint: usize,
        /// The first tension, N.
        from: f64,
        /// The last tension, N.
        to: f64,
    },
}

impl<T: Real, const N: usize> SafeRamp<T, N> {
    /// Makes a ramp from the present commands to the least tensions, N, in a time of at least two
    /// samples.
    ///
    /// # Errors
    /// [`RampError`] if a tension is not finite, or the time is not possible.
    pub fn new(
        from: Pairs<T, N>,
        to: Pairs<T, N>,
        seconds: T,
        sample_hz: T,
    ) -> Result<Self, RampError> {
        let (seconds, sample_hz) = (seconds.to_f64(), sample_hz.to_f64());
        let samples = round(seconds * sample_hz);
        let countable = (2.0..=f64::from(u32::MAX)).contains(&samples);
        if !(countable && seconds > 0.0) {
            return Err(RampError::Time { seconds, sample_hz });
        }
        for (joint, (from, to)) in from.iter().zip(&to).enumerate() {
            for (from, to) in [(from.flexor, to.flexor), (from.extensor, to.extensor)] {
                if !is_finite(to - from) {
                    let (from, to) = (from.to_f64(), to.to_f64());
                    return Err(RampError::Tension { joint, from, to });
                }
            }
        }
        #[allow(clippy::cast_sign_loss, reason = "at least 2")]
        let samples = samples as u32;
        Ok(Self {
            from,
            to,
            samples,
            left: samples,
        })
    }

    /// Returns the tensions of the next sample: one step nearer to the final ones, which are
    /// reached exactly.
    pub fn update(&mut self) -> Pairs<T, N> {
        self.left = self.left.saturating_sub(1);
        let left = real::<T>(f64::from(self.left) / f64::from(self.samples));
        let way = |from: T, to: T| to + (from - to) * left;
        let mut tensions = self.to;
        for (tension, from) in tensions.iter_mut().zip(&self.from) {
            *tension = Pair {
                flexor: way(from.flexor, tension.flexor),
                extensor: way(from.extensor, tension.extensor),
            };
        }
        tensions
    }

    /// Returns whether the tensions have reached their final values.
    #[must_use]
    pub fn is_done(&self) -> bool {
        self.left == 0
    }
}

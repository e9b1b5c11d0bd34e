use thiserror::Error;

use crate::math::{Real, abs, clamp, is_finite, max, min, round};

/// What the counts of a converter mean: `value = gain counts + offset`, in SI units.
///
/// A tendon's sign and its sensor's gain are both in `gain`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Calibration<T: Real = f64> {
    gain: T,
    offset: T,
}

/// A calibration or a converter that cannot be.
#[derive(Clone, Copy, Debug, PartialEq, Error)]
#[non_exhaustive]
pub enum CalibrationError {
    /// A gain of zero, or one that is not finite, also as its reciprocal.
    #[error("the gain is {gain} per count; it must be finite and not zero")]
    Gain {
        /// The gain, SI units per count.
        gain: f64,
    },
    /// An offset that is not finite.
    #[error("the offset is {offset}; it must be finite")]
    Offset {
        /// The value at zero counts, SI units.
        offset: f64,
    },
    /// A converter that has no or too many bits.
    #[error("a converter of {bits} bits; it must have 1 to 24")]
    Bits {
        /// Its number of bits.
        bits: u8,
    },
}

impl<T: Real> Calibration<T> {
    /// So many SI units per count, and at zero counts.
    ///
    /// # Errors
    /// A gain of zero, or a number that is not finite.
    pub fn new(gain: T, offset: T) -> Result<Self, CalibrationError> {
        if !(is_finite(gain) && is_finite(T::one() / gain)) {
            let gain = gain.to_f64();
            return Err(CalibrationError::Gain { gain });
        }
        if !is_finite(offset) {
            let offset = offset.to_f64();
            return Err(CalibrationError::Offset { offset });
        }
        Ok(Self { gain, offset })
    }

    /// The value of counts as an A/D converter gives them, in SI units.
    #[inline]
    #[must_use]
    pub fn value(&self, counts: i32) -> T {
        self.gain * T::of(f64::from(counts)) + self.offset
    }

    /// The counts of a value, with their fraction.
    #[inline]
    #[must_use]
    pub fn counts(&self, value: T) -> T {
        (value - self.offset) / self.gain
    }
}

/// A D/A converter: values in SI units to counts from zero to all bits set.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Output<T: Real = f64> {
    calibration: Calibration<T>,
    full: T,
}

impl<T: Real> Output<T> {
    /// A converter of 1 to 24 bits, which numbers of 32 bits still count.
    ///
    /// # Errors
    /// Another number of bits.
    pub fn new(calibration: Calibration<T>, bits: u8) -> Result<Self, CalibrationError> {
        Ok(Self {
            calibration,
            full: Self::full(bits)?,
        })
    }

    /// A converter whose counts are zero at 0 and have all bits set at `full_scale`:
    /// `counts = round(value / full_scale (2ⁿ - 1))`.
    ///
    /// # Errors
    /// A full scale of zero, or another number of bits.
    pub fn of_full_scale(full_scale: T, bits: u8) -> Result<Self, CalibrationError> {
        let full = Self::full(bits)?;
        let calibration = Calibration::new(full_scale / full, T::zero())?;
        Ok(Self { calibration, full })
    }

    fn full(bits: u8) -> Result<T, CalibrationError> {
        if (1..=24).contains(&bits) {
            Ok(T::of(f64::from((1_u32 << bits) - 1)))
        } else {
            Err(CalibrationError::Bits { bits })
        }
    }

    /// The nearest counts to a value, those of the nearest end for one beyond the ends; a value
    /// that is not finite gives the lowest end.
    #[inline]
    #[must_use]
    pub fn counts(&self, value: T) -> u32 {
        let (low, high) = self.range();
        let value = if is_finite(value) {
            clamp(value, low, high)
        } else {
            low
        };
        let counts = clamp(round(self.calibration.counts(value)), T::zero(), self.full);
        // Whole and within 0..=2^24.
        #[allow(clippy::cast_sign_loss, reason = "clamped to 0 and above")]
        let counts = counts.to_f64() as u32;
        counts
    }

    /// The lowest and the highest value, SI units.
    #[must_use]
    pub fn range(&self) -> (T, T) {
        let Calibration { gain, offset } = self.calibration;
        let other = gain * self.full + offset;
        (min(offset, other), max(offset, other))
    }

    /// The size of one count, SI units.
    #[must_use]
    pub fn resolution(&self) -> T {
        abs(self.calibration.gain)
    }
}

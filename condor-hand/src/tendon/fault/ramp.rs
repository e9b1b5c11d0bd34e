use crate::math::round;
use crate::number::{NumberError, Requirement, check, finite, positive};
use crate::tendon::{Pair, TendonPairs};

/// A ramp that brings the tensions of a finger to final values in equal steps, such as to the least
/// tensions after a fault.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SafeRamp<const N: usize> {
    from: TendonPairs<f64, N>,
    to: TendonPairs<f64, N>,
    samples: u32,
    left: u32,
}

impl<const N: usize> SafeRamp<N> {
    /// Makes a ramp that goes from the tensions `from` to `to` (N) in `seconds`, with `sample_hz`
    /// steps per second. It must have at least two steps.
    ///
    /// # Errors
    /// [`NumberError`] if a tension is not finite, or the time is not possible.
    pub fn new(
        from: TendonPairs<f64, N>,
        to: TendonPairs<f64, N>,
        seconds: f64,
        sample_hz: f64,
    ) -> Result<Self, NumberError> {
        let samples = round(seconds * sample_hz);
        positive("the time of a ramp, s,", seconds)?;
        check("the samples of a ramp", samples, Requirement::AtLeast(2.0))?;
        let most = Requirement::AtMost(u32::MAX.into());
        check("the samples of a ramp", samples, most)?;
        for (from, to) in from.iter().zip(&to) {
            finite("the way of a flexor's tension, N,", to.flexor - from.flexor)?;
            finite(
                "the way of an extensor's tension, N,",
                to.extensor - from.extensor,
            )?;
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

    /// Returns the tensions of the next sample, N: one step nearer to the final ones. The last step
    /// reaches them exactly, and later calls return them again.
    pub fn update(&mut self) -> TendonPairs<f64, N> {
        self.left = self.left.saturating_sub(1);
        let left = f64::from(self.left) / f64::from(self.samples);
        let way = |from: f64, to: f64| to + (from - to) * left;
        let mut tensions = self.to;
        for (tension, from) in tensions.iter_mut().zip(&self.from) {
            *tension = Pair {
                flexor: way(from.flexor, tension.flexor),
                extensor: way(from.extensor, tension.extensor),
            };
        }
        tensions
    }

    /// Returns true if the tensions have reached their final values.
    #[must_use]
    pub fn is_done(&self) -> bool {
        self.left == 0
    }
}

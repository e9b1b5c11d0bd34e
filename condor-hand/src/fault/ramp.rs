use crate::math::round;
use crate::number::{NumberError, Requirement, check, finite, positive};

/// A ramp that brings the efforts of a finger to final values in equal steps, such as to rest after a
/// fault.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SafeRamp<const A: usize> {
    from: [f64; A],
    to: [f64; A],
    samples: u32,
    left: u32,
}

impl<const A: usize> SafeRamp<A> {
    /// Makes a ramp that goes from the efforts `from` to `to` (N, or N m) in `seconds`, with `sample_hz`
    /// steps per second. It must have at least two steps.
    ///
    /// # Errors
    /// [`NumberError`] if an effort is not finite, or the time is not possible.
    pub fn new(
        from: [f64; A],
        to: [f64; A],
        seconds: f64,
        sample_hz: f64,
    ) -> Result<Self, NumberError> {
        let samples = round(seconds * sample_hz);
        positive("the time of a ramp, s,", seconds)?;
        check("the samples of a ramp", samples, Requirement::AtLeast(2.0))?;
        let most = Requirement::AtMost(u32::MAX.into());
        check("the samples of a ramp", samples, most)?;
        for (from, to) in from.iter().zip(&to) {
            finite("the way of an effort", to - from)?;
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

    /// Returns the efforts of the next sample, N or N m: one step nearer to the final ones. The last step
    /// reaches them exactly, and later calls return them again.
    pub fn update(&mut self) -> [f64; A] {
        self.left = self.left.saturating_sub(1);
        let left = f64::from(self.left) / f64::from(self.samples);
        let mut efforts = self.to;
        for (effort, from) in efforts.iter_mut().zip(&self.from) {
            *effort += (from - *effort) * left;
        }
        efforts
    }

    /// Returns true if the efforts have reached their final values.
    #[must_use]
    pub fn is_done(&self) -> bool {
        self.left == 0
    }
}

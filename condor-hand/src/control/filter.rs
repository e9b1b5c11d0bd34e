//! Low-pass filters and rates of several sampled signals side by side.
//!
//! A filter begins with its first sample as its output, as if that had lasted for ever. A sample
//! that is not finite, or that would overflow the filter, does not change the filter: the output is
//! the last one again (zero if there is none). States below 1e-30 become zero, because some
//! processors take a hundred times longer for denormal numbers.

use super::elapsed::Elapsed;
use crate::math::{abs, exp, is_finite, min};
use crate::number::{NumberError, Requirement, check, positive};

/// The cutoff as a part of the sample rate, below one half.
fn relative(cutoff_hz: f64, sample_hz: f64) -> Result<f64, NumberError> {
    positive("the sample rate, Hz,", sample_hz)?;
    let what = "the cutoff, Hz,";
    check(what, cutoff_hz, Requirement::Below(sample_hz / 2.0))?;
    positive(what, cutoff_hz)?;
    let relative = cutoff_hz / sample_hz;
    positive("the cutoff in sample rates", relative).map(|()| relative)
}

/// Zero instead of a number that is denormal or soon will be.
#[inline(always)]
fn flush(x: f64) -> f64 {
    if abs(x) < 1e-30 { 0.0 } else { x }
}

/// The part of the way to a new input that a first-order lag goes in one sample, if the input
/// stays: `1 - exp(-2 pi fc / fs)`.
fn lag(relative: f64) -> f64 {
    1.0 - exp(-core::f64::consts::TAU * relative)
}

/// First-order low-pass filters for `L` signals side by side: `y += alpha (x - y)` in every sample,
/// with the sample x and the output y. A signal whose cutoff is `None` is not filtered.
#[derive(Clone, Copy, Debug)]
pub struct LowPass<const L: usize> {
    alpha: [Option<f64>; L],
    /// The last outputs; `None` before the first samples.
    output: [Option<f64>; L],
}

impl<const L: usize> LowPass<L> {
    /// Makes one filter for each signal, with its cutoff in Hz, or `None` to pass the signal
    /// unchanged. `sample_hz` is the number of calls of [`update`](Self::update) per second.
    ///
    /// After a step of the input, the output has at every sample the value that an analog
    /// first-order filter would have.
    ///
    /// # Errors
    /// [`NumberError`] if a cutoff is outside of 0..`sample_hz / 2`, or the sample rate is not
    /// positive.
    pub fn new(cutoff_hz: [Option<f64>; L], sample_hz: f64) -> Result<Self, NumberError> {
        let mut alpha = [None; L];
        for (alpha, cutoff_hz) in alpha.iter_mut().zip(cutoff_hz) {
            if let Some(cutoff_hz) = cutoff_hz {
                *alpha = Some(lag(relative(cutoff_hz, sample_hz)?));
            }
        }
        let output = [None; L];
        Ok(Self { alpha, output })
    }

    /// Changes the cutoff of the filter of a signal, as in [`new`](Self::new); its output goes on from the
    /// last one.
    pub(crate) fn set_cutoff(
        &mut self,
        lane: usize,
        cutoff_hz: Option<f64>,
        sample_hz: f64,
    ) -> Result<(), NumberError> {
        let relative = cutoff_hz.map(|cutoff_hz| relative(cutoff_hz, sample_hz));
        let alpha = relative.transpose()?.map(lag);
        if let Some(place) = self.alpha.get_mut(lane) {
            *place = alpha;
        }
        Ok(())
    }

    /// Takes the next sample of each signal, and returns the filtered signals. A sample that is not
    /// finite is ignored: the last output of its filter is repeated.
    pub fn update(&mut self, samples: &[f64; L]) -> [f64; L] {
        self.update_seen(samples, &[true; L])
    }

    /// The same for signals that have a sample; the others answer with what was given for them.
    #[inline(always)]
    pub(crate) fn update_seen(&mut self, samples: &[f64; L], sampled: &[bool]) -> [f64; L] {
        let mut outputs = *samples;
        let filters = self.alpha.iter().zip(&mut self.output);
        for ((output, (alpha, last)), sampled) in outputs.iter_mut().zip(filters).zip(sampled) {
            let (true, Some(alpha)) = (*sampled, alpha) else {
                continue;
            };
            let next = match *last {
                Some(last) => last + alpha * (*output - last),
                None => *output,
            };
            if is_finite(next) {
                *last = Some(flush(next));
            }
            *output = last.unwrap_or(0.0);
        }
        outputs
    }

    /// Begins anew with the next samples.
    pub(crate) fn forget(&mut self) {
        self.output = [None; L];
    }
}

/// The rates of change of `L` sampled signals, per second. Each rate is smoothed by a first-order low-pass filter (a
/// "dirty derivative").
///
/// For a ramp the rate is exact once the filter has settled. The first sample yields zero. Samples that are not finite
/// leave the rate as it is; the next finite sample is compared with the last finite one, over the time between the two.
#[derive(Clone, Copy, Debug)]
pub struct Derivative<const L: usize> {
    alpha: [f64; L],
    sample_hz: f64,
    last: [f64; L],
    /// Periods since `last` in which no sample was finite.
    waited: [f64; L],
    rate: [f64; L],
    primed: [bool; L],
}

impl<const L: usize> Derivative<L> {
    /// Makes the derivatives of `L` signals. `cutoff_hz` are the cutoffs of the smoothing filters,
    /// Hz, and `sample_hz` is the number of calls of [`update`](Self::update) per second.
    ///
    /// # Errors
    /// [`NumberError`] if a cutoff is outside of 0..`sample_hz / 2`, or the sample rate is not
    /// positive.
    pub fn new(cutoff_hz: [f64; L], sample_hz: f64) -> Result<Self, NumberError> {
        let mut alpha = [0.0; L];
        for (alpha, cutoff_hz) in alpha.iter_mut().zip(cutoff_hz) {
            *alpha = lag(relative(cutoff_hz, sample_hz)?);
        }
        Ok(Self {
            alpha,
            sample_hz,
            last: [0.0; L],
            waited: [0.0; L],
            rate: [0.0; L],
            primed: [false; L],
        })
    }

    /// Changes the cutoff of the filter of a signal, as in [`new`](Self::new); its rate goes on from the
    /// last one.
    pub(crate) fn set_cutoff(&mut self, lane: usize, cutoff_hz: f64) -> Result<(), NumberError> {
        let alpha = lag(relative(cutoff_hz, self.sample_hz)?);
        if let Some(place) = self.alpha.get_mut(lane) {
            *place = alpha;
        }
        Ok(())
    }

    /// The last rates.
    #[inline(always)]
    pub(crate) fn rates(&self) -> &[f64; L] {
        &self.rate
    }

    /// Puts right the rates of signals whose last samples were none: each went on at a rate, for so many
    /// seconds, and is where `samples` says.
    pub(crate) fn go_on_unseen(
        &mut self,
        unseen: &[Option<(f64, f64)>; L],
        samples: &[f64; L],
        elapsed: Elapsed,
    ) {
        for lane in 0..L {
            if let Some((rate, seconds)) = unseen[lane] {
                self.begin(lane, samples[lane] - rate * seconds, rate);
                self.waited[lane] = (seconds - elapsed.seconds) * self.sample_hz;
            }
        }
    }

    /// Begins with a sample and a rate.
    fn begin(&mut self, lane: usize, last: f64, rate: f64) {
        self.last[lane] = last;
        self.rate[lane] = rate;
        self.waited[lane] = 0.0;
        self.primed[lane] = true;
    }

    /// Takes the next sample of each signal, and returns the rates of change: units of the signal
    /// per second.
    pub fn update(&mut self, samples: &[f64; L]) -> [f64; L] {
        self.update_after(samples, &[true; L], Elapsed::period(self.sample_hz))
    }

    /// The same at samples so long after the last ones, for signals that have a sample; the others have no
    /// rate. A sample that is not finite leaves the rate as it is.
    #[inline(always)]
    pub(crate) fn update_after(
        &mut self,
        samples: &[f64; L],
        sampled: &[bool; L],
        elapsed: Elapsed,
    ) -> [f64; L] {
        let mut rates = [0.0; L];
        for lane in 0..L {
            if !sampled[lane] {
                continue;
            }
            let sample = samples[lane];
            if self.primed[lane] {
                let periods = self.waited[lane] + elapsed.periods;
                // One that comes early says less.
                let (hz, weight) = if self.waited[lane] > 0.0 {
                    (self.sample_hz / periods, min(periods, 1.0))
                } else {
                    (elapsed.hz, elapsed.weight)
                };
                let before = self.rate[lane];
                let slope = (sample - self.last[lane]) * hz;
                let rate = before + self.alpha[lane] * weight * (slope - before);
                if is_finite(rate) {
                    self.begin(lane, sample, flush(rate));
                } else {
                    self.waited[lane] = periods;
                }
            } else if is_finite(sample) {
                self.begin(lane, sample, 0.0);
            }
            rates[lane] = self.rate[lane];
        }
        rates
    }

    /// Begins anew with the next samples.
    pub(crate) fn forget(&mut self) {
        self.rate = [0.0; L];
        self.primed = [false; L];
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const HZ: f64 = 400.0;

    #[test]
    fn a_lane_without_a_sample_stays_as_it_is() {
        let mut filters = LowPass::new([Some(20.0); 2], HZ).unwrap();
        assert_eq!(filters.update_seen(&[1.0, 2.0], &[true, false]), [1.0, 2.0]);
        // The second has its first sample now, and begins with it.
        assert_eq!(filters.update(&[1.0, 5.0]), [1.0, 5.0]);
        let mut derivatives = Derivative::new([20.0; 2], HZ).unwrap();
        let period = Elapsed::period(HZ);
        let first = derivatives.update_after(&[1.0, 2.0], &[true, false], period);
        assert_eq!(first, [0.0; 2]);
        let rates = derivatives.update(&[2.0, 5.0]);
        assert!(rates[0] > 0.0);
        assert_eq!(rates[1], 0.0);
    }

    #[test]
    fn the_rate_of_a_ramp_is_that_of_the_ramp_however_late_its_samples_come() {
        let mut derivative = Derivative::new([20.0], HZ).unwrap();
        let mut time = 0.0;
        derivative.update(&[0.0]);
        for tick in 0..200 {
            let period = [1.0, 0.7, 1.2, 80.0][tick % 4] / HZ;
            time += period;
            let [rate] = derivative.update_after(&[3.0 * time], &[true], Elapsed::new(period, HZ));
            assert!(rate <= 3.0 + 1e-9, "tick {tick}: {rate}");
            assert!(tick < 100 || rate > 3.0 - 1e-9, "tick {tick}: {rate}");
        }
    }
}

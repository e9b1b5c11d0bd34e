//! The filters of several signals side by side, which answer as each by itself would.
//!
//! Nearly always all of them run, and all samples are finite: then one test serves for all, and the
//! arithmetic is that of vectors.

use super::filter::flush;
use super::{Derivative, OnePole};
use crate::math::{Real, is_finite, min};

/// The time since the last samples.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Elapsed<T> {
    pub(crate) seconds: T,
    /// One over it.
    pub(crate) hz: T,
    /// In nominal periods.
    pub(crate) periods: T,
    /// The same, but one at most: what a sample that comes early counts for.
    pub(crate) weight: T,
}

impl<T: Real> Elapsed<T> {
    /// So many seconds; what is not finite or not above zero counts as a nominal period.
    #[inline(always)]
    pub(crate) fn new(seconds: T, sample_hz: T) -> Self {
        let periods = seconds * sample_hz;
        let hz = sample_hz / periods;
        if seconds > T::zero() && is_finite(periods) && is_finite(hz) && hz > T::zero() {
            Self {
                seconds,
                hz,
                periods,
                weight: min(periods, T::one()),
            }
        } else {
            Self {
                seconds: T::one() / sample_hz,
                hz: sample_hz,
                periods: T::one(),
                weight: T::one(),
            }
        }
    }
}

/// Whether all are finite; false also where their sum overflows.
#[inline(always)]
pub(crate) fn sum_is_finite<T: Real, const L: usize>(values: &[T; L]) -> bool {
    is_finite(values.iter().fold(T::zero(), |sum, &value| sum + value))
}

/// Low-pass filters of L signals; where there is none, the signal passes as it is.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Poles<T: Real, const L: usize> {
    alpha: [T; L],
    output: [T; L],
    exists: [bool; L],
    primed: [bool; L],
    /// How many there are, and whether all L have had a sample.
    count: usize,
    running: bool,
}

impl<T: Real, const L: usize> Poles<T, L> {
    pub(crate) fn new(filters: [Option<OnePole<T>>; L]) -> Self {
        let exists = filters.map(|filter| filter.is_some());
        Self {
            alpha: filters.map(|filter| filter.map_or(T::zero(), |filter| filter.alpha())),
            output: [T::zero(); L],
            exists,
            primed: [false; L],
            count: exists.into_iter().filter(|&exists| exists).count(),
            running: false,
        }
    }

    /// The outputs for the next samples.
    #[inline(always)]
    pub(crate) fn update(&mut self, samples: &[T; L]) -> [T; L] {
        if self.count == 0 {
            return *samples;
        }
        if self.running {
            let mut outputs = self.output;
            for lane in 0..L {
                outputs[lane] += self.alpha[lane] * (samples[lane] - outputs[lane]);
            }
            if sum_is_finite(&outputs) {
                self.output = outputs.map(flush);
                return self.output;
            }
        }
        self.update_each(samples, &[true; L])
    }

    /// The same for those that have a sample; the others answer with what was given for them.
    #[cold]
    #[inline(never)]
    pub(crate) fn update_each(&mut self, samples: &[T; L], sampled: &[bool; L]) -> [T; L] {
        let mut outputs = *samples;
        for (lane, output) in outputs.iter_mut().enumerate() {
            if !(self.exists[lane] && sampled[lane]) {
                continue;
            }
            let last = self.output[lane];
            let next = if self.primed[lane] {
                last + self.alpha[lane] * (*output - last)
            } else {
                *output
            };
            if is_finite(next) {
                self.output[lane] = flush(next);
                self.primed[lane] = true;
            }
            *output = self.output[lane];
        }
        self.running = self.count == L && self.primed.iter().all(|&primed| primed);
        outputs
    }

    /// Begins anew with the next samples.
    pub(crate) fn forget(&mut self) {
        self.primed = [false; L];
        self.running = false;
    }
}

/// The rates of L signals.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Rates<T: Real, const L: usize> {
    alpha: [T; L],
    last: [T; L],
    rate: [T; L],
    sample_hz: T,
    /// What each is by itself, while not all of them run: [`Self::running`].
    each: [Derivative<T>; L],
    /// All have a rate for one period.
    running: bool,
}

impl<T: Real, const L: usize> Rates<T, L> {
    pub(crate) fn new(each: [Derivative<T>; L], sample_hz: T) -> Self {
        Self {
            alpha: each.map(|each| each.alpha()),
            last: [T::zero(); L],
            rate: [T::zero(); L],
            sample_hz,
            each,
            running: false,
        }
    }

    /// The last rates.
    #[inline(always)]
    pub(crate) fn rates(&self) -> &[T; L] {
        &self.rate
    }

    /// Puts right the rates of signals whose last samples were none: each went on at a rate, for so many
    /// seconds, and is where `samples` says.
    pub(crate) fn go_on_unseen(
        &mut self,
        unseen: &[Option<(T, T)>; L],
        samples: &[T; L],
        elapsed: Elapsed<T>,
    ) {
        if self.running && unseen.iter().any(Option::is_some) {
            for lane in 0..L {
                self.each[lane].go_on_from(self.last[lane], self.rate[lane], T::one());
            }
            self.running = false;
        }
        for lane in 0..L {
            let Some((rate, seconds)) = unseen[lane] else {
                continue;
            };
            let before = (seconds - elapsed.seconds) * self.sample_hz;
            let last = samples[lane] - rate * seconds;
            self.each[lane].go_on_from(last, rate, before + T::one());
            (self.last[lane], self.rate[lane]) = (last, rate);
        }
    }

    /// The rates at the next samples.
    #[inline(always)]
    pub(crate) fn update(&mut self, samples: &[T; L], elapsed: Elapsed<T>) -> [T; L] {
        if self.running {
            let mut rates = self.rate;
            for lane in 0..L {
                let slope = (samples[lane] - self.last[lane]) * elapsed.hz;
                rates[lane] += self.alpha[lane] * elapsed.weight * (slope - rates[lane]);
            }
            if sum_is_finite(&rates) {
                self.rate = rates.map(flush);
                self.last = *samples;
                return self.rate;
            }
        }
        self.update_each(samples, &[true; L], elapsed)
    }

    /// The same for those that have a sample; the others have no rate. One that is not finite leaves
    /// the rate as it is.
    #[cold]
    #[inline(never)]
    pub(crate) fn update_each(
        &mut self,
        samples: &[T; L],
        sampled: &[bool; L],
        elapsed: Elapsed<T>,
    ) -> [T; L] {
        let mut rates = [T::zero(); L];
        for lane in 0..L {
            let each = &mut self.each[lane];
            if self.running {
                each.go_on_from(self.last[lane], self.rate[lane], T::one());
            }
            if sampled[lane] {
                rates[lane] = each.update_after(samples[lane], elapsed.periods);
            }
        }
        let states = self.each.map(|each| each.state());
        self.last = states.map(|(last, _)| last.unwrap_or(T::zero()));
        self.rate = states.map(|(_, rate)| rate);
        self.running = states.iter().all(|(last, _)| last.is_some());
        rates
    }

    /// Begins anew with the next samples.
    pub(crate) fn forget(&mut self) {
        self.rate = [T::zero(); L];
        self.each.iter_mut().for_each(Derivative::forget);
        self.running = false;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const HZ: f64 = 400.0;

    /// Samples with what sensors can say amiss.
    fn sample(tick: usize, lane: usize) -> f64 {
        match (tick, lane) {
            (5, 0) => f64::NAN,
            (9, 1) => f64::INFINITY,
            (12, 2) => -0.0,
            (20 | 22, 0) => f64::MAX,
            (21, 0) => f64::MIN,
            (30..=60, 1) => 1e-29,
            _ => f64::from(((tick * (3 + lane)) % 17) as u32) - 8.0,
        }
    }

    #[test]
    fn poles_side_by_side_answer_as_each_by_itself() {
        let pole = OnePole::low_pass(20.0, HZ).unwrap();
        for exists in [[true; 3], [false; 3], [true, false, true]] {
            let mut alone = exists.map(|exists| exists.then_some(pole));
            let mut bank = Poles::new(alone);
            for tick in 0..200 {
                let samples = [0, 1, 2].map(|lane| sample(tick, lane));
                let outputs = bank.update(&samples);
                for ((alone, &sample), output) in alone.iter_mut().zip(&samples).zip(outputs) {
                    let expected = alone.as_mut().map_or(sample, |pole| pole.update(sample));
                    assert_eq!(output.to_bits(), expected.to_bits(), "tick {tick}");
                }
            }
            assert_eq!(bank.running, exists == [true; 3]);
        }
    }

    #[test]
    fn rates_side_by_side_answer_as_each_by_itself() {
        let mut alone = [20.0, 30.0, 40.0].map(|hz| Derivative::new(hz, HZ).unwrap());
        let mut bank = Rates::new(alone, HZ);
        for tick in 0..200 {
            let samples = [0, 1, 2].map(|lane| sample(tick, lane));
            // Late now and then, and early.
            let elapsed = Elapsed::new([1.0, 1.0, 0.9, 1.3, 7.0][tick % 5] / HZ, HZ);
            let rates = bank.update(&samples, elapsed);
            for ((alone, &sample), rate) in alone.iter_mut().zip(&samples).zip(rates) {
                let expected = alone.update_after(sample, elapsed.periods);
                assert_eq!(rate.to_bits(), expected.to_bits(), "tick {tick}");
            }
        }
        assert!(bank.running);
    }

    #[test]
    fn a_lane_without_a_sample_stays_as_it_is() {
        let pole = OnePole::low_pass(20.0, HZ).unwrap();
        let mut bank = Poles::new([Some(pole); 2]);
        assert_eq!(bank.update_each(&[1.0, 2.0], &[true, false]), [1.0, 2.0]);
        // The second has its first sample now, and begins with it.
        assert_eq!(bank.update(&[1.0, 5.0]), [1.0, 5.0]);
        let rate = Derivative::new(20.0, HZ).unwrap();
        let mut bank = Rates::new([rate; 2], HZ);
        let period = Elapsed::new(1.0 / HZ, HZ);
        let first = bank.update_each(&[1.0, 2.0], &[true, false], period);
        assert_eq!(first, [0.0; 2]);
        let rates = bank.update(&[2.0, 5.0], period);
        assert!(rates[0] > 0.0);
        assert_eq!(rates[1], 0.0);
    }

    #[test]
    fn the_rate_of_a_ramp_is_that_of_the_ramp_however_late_its_samples_come() {
        let mut bank = Rates::new([Derivative::new(20.0, HZ).unwrap(); 1], HZ);
        let mut time = 0.0;
        bank.update(&[0.0], Elapsed::new(1.0 / HZ, HZ));
        for tick in 0..200 {
            let period = [1.0, 0.7, 1.2, 80.0][tick % 4] / HZ;
            time += period;
            let [rate] = bank.update(&[3.0 * time], Elapsed::new(period, HZ));
            assert!(rate <= 3.0 + 1e-9, "tick {tick}: {rate}");
            assert!(tick < 100 || rate > 3.0 - 1e-9, "tick {tick}: {rate}");
        }
    }

    #[test]
    fn a_time_that_cannot_be_is_a_period() {
        for seconds in [0.0, -1.0, f64::NAN, f64::INFINITY, f64::MAX, 1e-320] {
            assert_eq!(Elapsed::new(seconds, HZ).periods, 1.0, "{seconds}");
        }
        assert_eq!(Elapsed::new(0.5, HZ).periods, 200.0);
    }
}

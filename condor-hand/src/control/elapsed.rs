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
    /// Makes the time from `seconds`; a time that is not finite or not above zero counts as a nominal period.
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
            Self::period(sample_hz)
        }
    }

    /// A nominal period.
    #[inline(always)]
    pub(crate) fn period(sample_hz: T) -> Self {
        Self {
            seconds: T::one() / sample_hz,
            hz: sample_hz,
            periods: T::one(),
            weight: T::one(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::Elapsed;

    const HZ: f64 = 400.0;

    #[test]
    fn a_time_that_cannot_be_is_a_period() {
        for seconds in [0.0, -1.0, f64::NAN, f64::INFINITY, f64::MAX, 1e-320] {
            assert_eq!(Elapsed::new(seconds, HZ).periods, 1.0, "{seconds}");
        }
        assert_eq!(Elapsed::new(0.5, HZ).periods, 200.0);
    }
}

use crate::math::{is_finite, min};

/// The time since the last samples.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Elapsed {
    pub(crate) seconds: f64,
    /// One over it.
    pub(crate) hz: f64,
    /// In nominal periods.
    pub(crate) periods: f64,
    /// The same, but one at most: what a sample that comes early counts for.
    pub(crate) weight: f64,
}

impl Elapsed {
    /// Makes the time from `seconds`; a time that is not finite or not above zero counts as a nominal period.
    #[inline(always)]
    pub(crate) fn new(seconds: f64, sample_hz: f64) -> Self {
        let periods = seconds * sample_hz;
        let hz = sample_hz / periods;
        if seconds > 0.0 && is_finite(periods) && is_finite(hz) && hz > 0.0 {
            Self {
                seconds,
                hz,
                periods,
                weight: min(periods, 1.0),
            }
        } else {
            Self::period(sample_hz)
        }
    }

    /// A nominal period.
    #[inline(always)]
    pub(crate) fn period(sample_hz: f64) -> Self {
        Self {
            seconds: 1.0 / sample_hz,
            hz: sample_hz,
            periods: 1.0,
            weight: 1.0,
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

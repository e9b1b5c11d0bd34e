use super::{
    FaultCode, FaultRange, FaultSite, FingerFault, JointFaultLimits, SensorFaultLimits, Stuck,
    TendonFaultLimits, Threshold,
};
use crate::math::{Real, abs, is_finite};

/// Samples in a row.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Run(u16);

impl Run {
    /// Returns true if `bad` has been true for this many samples in a row; never for none.
    #[inline(always)]
    pub(super) fn reaches(&mut self, samples: u16, bad: bool) -> bool {
        self.adds(samples, u16::from(bad))
    }

    /// Returns true if this many deadlines in a row were missed, with `seconds` between two ticks, of which
    /// `longest` is the longest that is in time. A gap several times as long misses several deadlines.
    pub(crate) fn misses<T: Real>(&mut self, deadlines: u16, seconds: T, longest: T) -> bool {
        // NaN is not a time that has passed.
        let in_time = seconds > T::zero() && seconds <= longest;
        #[allow(
            clippy::cast_sign_loss,
            clippy::cast_possible_truncation,
            reason = "what is too large is the most, and what is no number none"
        )]
        let times = (seconds / longest).to_f64() as u16;
        self.adds(deadlines, if in_time { 0 } else { times.max(1) })
    }

    /// Counts this sample as so many bad ones in a row; none end the row. Whether `samples` are reached.
    #[inline(always)]
    fn adds(&mut self, samples: u16, bad: u16) -> bool {
        self.0 = if bad > 0 && samples > 0 {
            self.0.saturating_add(bad)
        } else {
            0
        };
        samples > 0 && self.0 >= samples
    }

    /// Returns true if the last sample that counts was good.
    pub(super) const fn is_over(self) -> bool {
        self.0 == 0
    }
}

impl<T: Real> Threshold<T> {
    pub(super) fn is_below(&self, value: T) -> bool {
        self.value < value
    }
}

impl<T: Real> FaultRange<T> {
    fn excludes(&self, value: T) -> bool {
        value < self.low || value > self.high
    }
}

/// The site that is checked, and the first fault of all sites, which stays.
pub(super) struct Latch<'a> {
    pub(super) first: &'a mut Option<FingerFault>,
    pub(super) site: FaultSite,
}

impl Latch<'_> {
    pub(super) fn report<T: Real>(&mut self, code: FaultCode, is_fault: bool, value: T) {
        if is_fault && self.first.is_none() {
            let (site, value) = (self.site, value.to_f64());
            *self.first = Some(FingerFault { code, site, value });
        }
    }
}

/// The state of the checks of one sensor.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Sensor {
    lost: Run,
    range: Run,
    stuck: Run,
    tracking: Run,
}

impl Sensor {
    /// Judges a sample, which may be known not to be possible; false if it tells nothing else.
    fn update<T: Real>(
        &mut self,
        limits: &SensorFaultLimits<T>,
        moved: &mut SensorMotion<T>,
        desired: Option<T>,
        (measured, is_possible): (T, bool),
        latch: &mut Latch<'_>,
    ) -> bool {
        let broken = if is_finite(measured) {
            desired.filter(|&desired| !is_finite(desired))
        } else {
            Some(measured)
        };
        let is_lost = broken.is_some() || !is_possible;
        let fault = self.lost.reaches(limits.lost_samples, is_lost);
        if is_lost {
            let code = match broken {
                Some(_) => FaultCode::NotFinite,
                None if abs(measured - moved.there) <= limits.stuck.band => FaultCode::Stuck,
                None => FaultCode::Jump,
            };
            latch.report(code, fault, broken.unwrap_or(measured));
            return false;
        }
        let outside = limits.range.excludes(measured);
        let fault = self.range.reaches(limits.range.samples, outside);
        latch.report(FaultCode::OutOfRange, fault, measured);

        let stays = moved.stays(&limits.stuck, desired, measured);
        let fault = self.stuck.reaches(limits.stuck.samples, stays);
        latch.report(FaultCode::Stuck, fault, measured);

        let error = desired.map_or_else(T::zero, |desired| desired - measured);
        let far = limits.tracking.is_below(abs(error));
        let fault = self.tracking.reaches(limits.tracking.samples, far);
        latch.report(FaultCode::Tracking, fault, error);
        true
    }

    fn is_quiet(self) -> bool {
        let runs = [self.lost, self.range, self.stuck, self.tracking];
        runs.into_iter().all(Run::is_over)
    }
}

/// The measured and the desired value when a sensor moved last.
#[derive(Clone, Copy, Debug)]
pub(super) struct SensorMotion<T> {
    /// NaN if it has never been seen, so that nothing is near it.
    pub(super) there: T,
    pub(super) wanted: T,
}

impl<T: Real> SensorMotion<T> {
    pub(super) fn never() -> Self {
        Self {
            there: T::zero() / T::zero(),
            wanted: T::zero(),
        }
    }

    /// Returns true if the sensor stays while its set-point has gone.
    fn stays(&mut self, stuck: &Stuck<T>, desired: Option<T>, measured: T) -> bool {
        let Some(desired) = desired else {
            *self = Self::never();
            return false;
        };
        if abs(measured - self.there) <= stuck.band {
            return abs(desired - self.wanted) > stuck.travel;
        }
        *self = Self {
            there: measured,
            wanted: desired,
        };
        false
    }
}

/// The state of the checks of one tendon.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Tendon {
    sensor: Sensor,
    slack: Run,
    over_tension: Run,
}

impl Tendon {
    pub(super) fn update<T: Real>(
        &mut self,
        limits: &TendonFaultLimits<T>,
        moved: &mut SensorMotion<T>,
        desired: T,
        measured: T,
        latch: &mut Latch<'_>,
    ) {
        if !self.sensor.update(
            &limits.sensor,
            moved,
            Some(desired),
            (measured, true),
            latch,
        ) {
            return;
        }
        let slack = measured < limits.slack.value;
        let fault = self.slack.reaches(limits.slack.samples, slack);
        latch.report(FaultCode::Slack, fault, measured);
        let over = limits.over_tension.is_below(measured);
        let fault = self.over_tension.reaches(limits.over_tension.samples, over);
        latch.report(FaultCode::OverTension, fault, measured);
    }

    /// Returns true if all checks have passed in the last sample.
    pub(super) fn is_quiet(&self) -> bool {
        self.sensor.is_quiet() && self.slack.is_over() && self.over_tension.is_over()
    }
}

/// The state of the checks of one joint.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Joint {
    sensor: Sensor,
    limit: Run,
}

impl Joint {
    pub(super) fn update<T: Real>(
        &mut self,
        limits: &JointFaultLimits<T>,
        moved: &mut SensorMotion<T>,
        desired: Option<T>,
        (measured, is_possible): (T, bool),
        latch: &mut Latch<'_>,
    ) {
        let (sensor, sample) = (&mut self.sensor, (measured, is_possible));
        if sensor.update(&limits.sensor, moved, desired, sample, latch) {
            let past = limits.limit.excludes(measured);
            let fault = self.limit.reaches(limits.limit.samples, past);
            latch.report(FaultCode::JointLimit, fault, measured);
        }
    }

    /// Returns true if all checks have passed in the last sample.
    pub(super) fn is_quiet(&self) -> bool {
        self.sensor.is_quiet() && self.limit.is_over()
    }
}

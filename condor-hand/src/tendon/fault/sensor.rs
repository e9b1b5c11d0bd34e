use super::{
    FaultCode, FaultSet, JointFaultLimits, Range, SensorFaultLimits, TendonFaultLimits, Threshold,
};
use crate::math::{Real, abs, is_finite};

/// Samples in a row.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Run(u16);

impl Run {
    /// Whether `bad` has been true for so many samples in a row; never for none.
    #[inline(always)]
    pub(super) fn reaches(&mut self, samples: u16, bad: bool) -> bool {
        self.0 = if bad { self.0.saturating_add(1) } else { 0 };
        samples > 0 && self.0 >= samples
    }
}

impl<T: Real> Threshold<T> {
    pub(super) fn is_below(&self, value: T) -> bool {
        self.value < value
    }
}

impl<T: Real> Range<T> {
    fn excludes(&self, value: T) -> bool {
        value < self.low || value > self.high
    }
}

/// The codes that one site has latched, and where new ones go.
pub(super) struct Latch<'a> {
    pub(super) latched: &'a mut FaultSet,
    /// The first that is new.
    pub(super) first: Option<(FaultCode, f64)>,
}

impl Latch<'_> {
    #[inline(always)]
    pub(super) fn report<T: Real>(&mut self, code: FaultCode, is_fault: bool, value: T) {
        if is_fault {
            self.latch(code, value.to_f64());
        }
    }

    #[cold]
    fn latch(&mut self, code: FaultCode, value: f64) {
        if self.latched.insert(code) && self.first.is_none() {
            self.first = Some((code, value));
        }
    }
}

/// The state of the checks of one sensor.
#[derive(Clone, Copy, Debug)]
pub(super) struct Sensor<T> {
    not_finite: Run,
    range: Run,
    stuck: Run,
    tracking: Run,
    /// What was measured when the sensor moved last, and desired.
    moved: Option<(T, T)>,
}

impl<T> Default for Sensor<T> {
    fn default() -> Self {
        Self {
            not_finite: Run::default(),
            range: Run::default(),
            stuck: Run::default(),
            tracking: Run::default(),
            moved: None,
        }
    }
}

impl<T: Real> Sensor<T> {
    /// Judges a sample; false if it is not finite, and tells nothing else.
    #[inline(always)]
    fn update(
        &mut self,
        limits: &SensorFaultLimits<T>,
        desired: Option<T>,
        measured: T,
        latch: &mut Latch<'_>,
    ) -> bool {
        let broken = if is_finite(measured) {
            desired.filter(|&desired| !is_finite(desired))
        } else {
            Some(measured)
        };
        let fault = self
            .not_finite
            .reaches(limits.not_finite_samples, broken.is_some());
        latch.report(FaultCode::NotFinite, fault, broken.unwrap_or(measured));
        if broken.is_some() {
            return false;
        }
        let outside = limits.range.excludes(measured);
        let fault = self.range.reaches(limits.range.samples, outside);
        latch.report(FaultCode::OutOfRange, fault, measured);

        let stays = self.stays(limits, desired, measured);
        let fault = self.stuck.reaches(limits.stuck.samples, stays);
        latch.report(FaultCode::Stuck, fault, measured);

        let error = desired.map_or_else(T::zero, |desired| desired - measured);
        let far = limits.tracking.is_below(abs(error));
        let fault = self.tracking.reaches(limits.tracking.samples, far);
        latch.report(FaultCode::Tracking, fault, error);
        true
    }

    /// Whether the sensor stays while its set-point has gone.
    #[inline(always)]
    fn stays(&mut self, limits: &SensorFaultLimits<T>, desired: Option<T>, measured: T) -> bool {
        let Some(desired) = desired else {
            self.moved = None;
            return false;
        };
        match self.moved {
            Some((there, wanted)) if abs(measured - there) <= limits.stuck.band => {
                abs(desired - wanted) > limits.stuck.travel
            }
            _ => {
                self.moved = Some((measured, desired));
                false
            }
        }
    }
}

/// The state of the checks of one tendon.
#[derive(Clone, Copy, Debug)]
pub(super) struct Tendon<T> {
    sensor: Sensor<T>,
    slack: Run,
    over_tension: Run,
}

impl<T> Default for Tendon<T> {
    fn default() -> Self {
        Self {
            sensor: Sensor::default(),
            slack: Run::default(),
            over_tension: Run::default(),
        }
    }
}

impl<T: Real> Tendon<T> {
    #[inline(always)]
    pub(super) fn update(
        &mut self,
        limits: &TendonFaultLimits<T>,
        desired: T,
        measured: T,
        latch: &mut Latch<'_>,
    ) {
        if !self
            .sensor
            .update(&limits.sensor, Some(desired), measured, latch)
        {
            return;
        }
        let slack = measured < limits.slack.value;
        let fault = self.slack.reaches(limits.slack.samples, slack);
        latch.report(FaultCode::Slack, fault, measured);
        let over = limits.over_tension.is_below(measured);
        let fault = self.over_tension.reaches(limits.over_tension.samples, over);
        latch.report(FaultCode::OverTension, fault, measured);
    }
}

/// The state of the checks of one joint.
#[derive(Clone, Copy, Debug)]
pub(super) struct Joint<T> {
    sensor: Sensor<T>,
    limit: Run,
}

impl<T> Default for Joint<T> {
    fn default() -> Self {
        Self {
            sensor: Sensor::default(),
            limit: Run::default(),
        }
    }
}

impl<T: Real> Joint<T> {
    #[inline(always)]
    pub(super) fn update(
        &mut self,
        limits: &JointFaultLimits<T>,
        desired: Option<T>,
        measured: T,
        latch: &mut Latch<'_>,
    ) {
        if self.sensor.update(&limits.sensor, desired, measured, latch) {
            let past = limits.limit.excludes(measured);
            let fault = self.limit.reaches(limits.limit.samples, past);
            latch.report(FaultCode::JointLimit, fault, measured);
        }
    }
}

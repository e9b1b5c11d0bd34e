use super::encoder::Encoders;
use super::sensor::{Latch, Limits, Run, Sample, Sensor};
use super::{
    ActuatorFaultLimits, Fault, FaultCode, FaultLimits, FaultPlace, FaultQuantity, FaultRange,
    JointFaultLimits, Observation, SensorFaultLimits,
};
use crate::NumberError;
use crate::math::is_finite;
use crate::number::Requirement;

/// A monitor that detects faults of one finger: it checks the actuators, the joints and the timing in
/// every tick, and latches the first fault.
///
/// The sensor of an actuator's position is checked before the joints whose positions are computed from it. While one of
/// its checks fails, these joints have no fault: what they show follows from the sensor.
///
/// A check that fails in as many samples in a row as its limit says is a fault. An effort or
/// position that is not finite does not count for the other checks of that actuator or joint; those
/// continue with the next sample. A time that is not finite counts as too long.
#[derive(Clone, Copy, Debug)]
pub struct FingerMonitor<const N: usize, const A: usize> {
    limits: FaultLimits<N, A>,
    has_encoders: bool,
    state: FingerState<N, A>,
}

/// All that `clear` forgets.
#[derive(Clone, Copy, Debug)]
struct FingerState<const N: usize, const A: usize> {
    actuators: [Sensor<2>; A],
    encoders: Encoders<A>,
    joints: [Sensor<1>; N],
    period: Run,
    set_point: Run,
    first: Option<Fault>,
}

impl<const N: usize, const A: usize> FingerState<N, A> {
    fn new() -> Self {
        Self {
            actuators: [Sensor::new(); A],
            encoders: Encoders::new(),
            joints: [Sensor::new(); N],
            period: Run::default(),
            set_point: Run::default(),
            first: None,
        }
    }
}

impl<const N: usize, const A: usize> FingerMonitor<N, A> {
    /// Makes a monitor with these limits, in which no fault has occurred yet.
    ///
    /// # Errors
    /// [`NumberError`] for the first limit that is wrong.
    pub fn new(limits: FaultLimits<N, A>) -> Result<Self, NumberError> {
        limits.check()?;
        Ok(Self {
            limits,
            has_encoders: limits.encoders.iter().any(Option::is_some),
            state: FingerState::new(),
        })
    }

    /// Returns the limits.
    pub(crate) const fn limits(&self) -> &FaultLimits<N, A> {
        &self.limits
    }

    /// Changes the limits, from the next tick on. The counts of samples go on.
    ///
    /// # Errors
    /// [`NumberError`] for the first limit that is wrong; all limits stay then.
    pub fn set_limits(&mut self, limits: FaultLimits<N, A>) -> Result<(), NumberError> {
        limits.check()?;
        self.has_encoders = limits.encoders.iter().any(Option::is_some);
        self.limits = limits;
        Ok(())
    }

    /// Checks the values of one tick. Returns the first fault since the last
    /// [`clear`](Self::clear), which may be an earlier one; `None` if there was none.
    pub fn update(&mut self, observation: &Observation<'_, N, A>) -> Option<Fault> {
        let Self { limits, state, .. } = self;
        let (period_s, longest) = (observation.period_s, &limits.period_s);
        let seconds = if period_s > 0.0 && is_finite(period_s) {
            period_s
        } else {
            longest.value
        };
        let first = &mut state.first;
        let samples = observation.desired_efforts.iter().zip(observation.efforts);
        let actuators = state.actuators.iter_mut().zip(&limits.actuators);
        for (actuator, ((checks, limits), (&desired, &measured))) in
            actuators.zip(samples).enumerate()
        {
            let latch = &mut Latch {
                first,
                place: FaultPlace::Actuator(actuator),
                quantity: FaultQuantity::Effort,
                seconds,
                is_excused: false,
            };
            let sample = Sample {
                measured,
                desired: Some(desired),
                instead: None,
            };
            checks.update(limits, sample, latch);
        }
        let excused = if self.has_encoders {
            let encoders = &mut state.encoders;
            encoders.update(&limits.encoders, observation, seconds, first)
        } else {
            0
        };
        let desired = observation.desired_positions.iter();
        let samples = desired.zip(observation.positions.as_slice());
        let joints = state.joints.iter_mut().zip(&limits.joints);
        let joints = joints.zip(samples).zip(observation.believed.as_slice());
        for (joint, (((checks, limits), (&desired, &measured)), &believed)) in joints.enumerate() {
            let latch = &mut Latch {
                first,
                place: FaultPlace::Joint(joint),
                quantity: FaultQuantity::Position,
                seconds,
                is_excused: excused & 1 << joint != 0,
            };
            let is_lost = observation.lost & 1 << joint != 0;
            let sample = Sample {
                measured,
                desired,
                instead: is_lost.then_some(believed),
            };
            checks.update(limits, sample, latch);
        }
        self.check_times(period_s, observation.set_point_age_s);
        self.state.first
    }

    /// Checks the time between two ticks and the age of the set-point, s.
    #[inline(always)]
    fn check_times(&mut self, period_s: f64, age_s: f64) {
        let Self { limits, state, .. } = self;
        let mut latch = Latch {
            first: &mut state.first,
            place: FaultPlace::Finger,
            quantity: FaultQuantity::Time,
            seconds: 0.0,
            is_excused: false,
        };
        let (longest, oldest) = (&limits.period_s, &limits.set_point_age_s);
        let is_late = state
            .period
            .misses(longest.samples, period_s, longest.value);
        let in_time = if period_s <= 0.0 {
            Requirement::Above(0.0)
        } else {
            Requirement::AtMost(longest.value)
        };
        latch.report(FaultCode::MissedDeadline, is_late, period_s, in_time);
        let is_old = !is_finite(age_s) || oldest.is_below(age_s);
        let is_stale = state.set_point.reaches(oldest.samples, is_old);
        let new = Requirement::AtMost(oldest.value);
        latch.report(FaultCode::StaleSetPoint, is_stale, age_s, new);
    }

    /// Returns the first fault since the last [`clear`](Self::clear); `None` if there was none.
    #[must_use]
    pub fn first(&self) -> Option<Fault> {
        self.state.first
    }

    /// Clears the latched fault, and all counts of samples; the monitor is then as it was when new.
    pub fn clear(&mut self) {
        self.state = FingerState::new();
    }
}

impl Limits<2> for ActuatorFaultLimits {
    fn sensor(&self) -> &SensorFaultLimits {
        &self.sensor
    }

    fn own(&self) -> [(FaultCode, u16, Requirement); 2] {
        let FaultRange { low, high, samples } = self.effort;
        [
            (FaultCode::LowEffort, samples, Requirement::AtLeast(low)),
            (FaultCode::HighEffort, samples, Requirement::AtMost(high)),
        ]
    }

    #[inline]
    fn fails(&self, measured: f64) -> [bool; 2] {
        [measured < self.effort.low, measured > self.effort.high]
    }
}

impl Limits<1> for JointFaultLimits {
    fn sensor(&self) -> &SensorFaultLimits {
        &self.sensor
    }

    fn own(&self) -> [(FaultCode, u16, Requirement); 1] {
        let FaultRange { low, high, samples } = self.limit;
        let allowed = Requirement::Within(low, high);
        [(FaultCode::JointLimit, samples, allowed)]
    }

    #[inline]
    fn fails(&self, measured: f64) -> [bool; 1] {
        [self.limit.excludes(measured)]
    }
}

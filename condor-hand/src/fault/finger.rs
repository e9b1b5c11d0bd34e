use nalgebra::SVector;

use super::sensor::{Latch, Limits, Run, Sensor};
use super::{
    ActuatorFaultLimits, FaultCode, FaultLimits, FaultSite, FingerFault, JointFaultLimits,
    SensorFaultLimits,
};
use crate::NumberError;
use crate::math::is_finite;

/// The desired and measured values of a finger in one tick, which a [`FingerMonitor`] checks.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Observation<'a, const N: usize, const A: usize> {
    /// The desired efforts, N or N m.
    pub desired_efforts: &'a [f64; A],
    /// The measured efforts, N or N m.
    pub efforts: &'a [f64; A],
    /// The desired positions, rad; `None` for joints whose position is not controlled.
    pub desired_positions: &'a [Option<f64>; N],
    /// The measured positions, rad.
    pub positions: &'a SVector<f64, N>,
    /// A bit for each joint whose reading is implausible:
    /// [`ServoOutput::lost`](crate::servo::ServoOutput::lost).
    pub lost: u32,
    /// The time since the last tick, s.
    pub period_s: f64,
    /// The time since the last set-point came, s.
    pub set_point_age_s: f64,
}

/// A monitor that detects faults of one finger: it checks the actuators, the joints and the timing in
/// every tick, and latches the first fault.
///
/// A check that fails in as many samples in a row as its limit says is a fault. An effort or
/// position that is not finite does not count for the other checks of that actuator or joint; those
/// continue with the next sample. A time that is not finite counts as too long.
#[derive(Clone, Copy, Debug)]
pub struct FingerMonitor<const N: usize, const A: usize> {
    limits: FaultLimits<N, A>,
    state: FingerState<N, A>,
}

/// All that `clear` forgets.
#[derive(Clone, Copy, Debug)]
struct FingerState<const N: usize, const A: usize> {
    actuators: [Sensor<2>; A],
    joints: [Sensor<1>; N],
    period: Run,
    set_point: Run,
    first: Option<FingerFault>,
}

impl<const N: usize, const A: usize> FingerState<N, A> {
    fn new() -> Self {
        Self {
            actuators: [Sensor::new(); A],
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
        self.limits = limits;
        Ok(())
    }

    /// Checks the values of one tick. Returns the first fault since the last
    /// [`clear`](Self::clear), which may be an earlier one; `None` if there was none.
    pub fn update(&mut self, observation: &Observation<'_, N, A>) -> Option<FingerFault> {
        let Self { limits, state } = self;
        let first = &mut state.first;
        let samples = observation.desired_efforts.iter().zip(observation.efforts);
        let actuators = state.actuators.iter_mut().zip(&limits.actuators);
        for (actuator, ((checks, limits), (&desired, &measured))) in
            actuators.zip(samples).enumerate()
        {
            let site = FaultSite::Actuator(actuator);
            let latch = &mut Latch { first, site };
            checks.update(limits, Some(desired), (measured, true), latch);
        }
        let samples = observation
            .desired_positions
            .iter()
            .zip(observation.positions.as_slice());
        let joints = state.joints.iter_mut().zip(&limits.joints);
        for (joint, ((checks, limits), (&desired, &measured))) in joints.zip(samples).enumerate() {
            let site = FaultSite::Joint(joint);
            let sample = (measured, observation.lost & 1 << joint == 0);
            checks.update(limits, desired, sample, &mut Latch { first, site });
        }
        let site = FaultSite::Finger;
        let mut latch = Latch { first, site };
        let (period_s, age_s) = (observation.period_s, observation.set_point_age_s);
        let (longest, oldest) = (&limits.period_s, &limits.set_point_age_s);
        let is_late = state
            .period
            .misses(longest.samples, period_s, longest.value);
        latch.report(FaultCode::MissedDeadline, is_late, period_s);
        let is_old = !is_finite(age_s) || oldest.is_below(age_s);
        let is_stale = state.set_point.reaches(oldest.samples, is_old);
        latch.report(FaultCode::StaleSetPoint, is_stale, age_s);
        state.first
    }

    /// Returns the first fault since the last [`clear`](Self::clear); `None` if there was none.
    #[must_use]
    pub fn first(&self) -> Option<FingerFault> {
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

    fn own(&self) -> [(FaultCode, u16); 2] {
        let samples = self.effort.samples;
        [
            (FaultCode::LowEffort, samples),
            (FaultCode::HighEffort, samples),
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

    fn own(&self) -> [(FaultCode, u16); 1] {
        [(FaultCode::JointLimit, self.limit.samples)]
    }

    #[inline]
    fn fails(&self, measured: f64) -> [bool; 1] {
        [self.limit.excludes(measured)]
    }
}

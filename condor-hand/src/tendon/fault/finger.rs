use nalgebra::SVector;

use super::sensor::{Latch, Limits, Run, Sensor};
use super::{
    FaultCode, FaultLimits, FaultSite, FingerFault, JointFaultLimits, SensorFaultLimits,
    TendonFaultLimits,
};
use crate::NumberError;
use crate::math::is_finite;
use crate::tendon::{Pair, TendonPairs};

/// The desired and measured values of a finger in one tick, which a [`FingerMonitor`] checks.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Observation<'a, const N: usize> {
    /// The desired tensions, N.
    pub desired_tensions: &'a TendonPairs<f64, N>,
    /// The measured tensions, N.
    pub tensions: &'a TendonPairs<f64, N>,
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

/// A monitor that detects faults of one finger: it checks the tendons, the joints and the timing in
/// every tick, and latches the first fault.
///
/// A check that fails in as many samples in a row as its limit says is a fault. A tension or
/// position that is not finite does not count for the other checks of that tendon or joint; those
/// continue with the next sample. A time that is not finite counts as too long.
#[derive(Clone, Copy, Debug)]
pub struct FingerMonitor<const N: usize> {
    limits: FaultLimits<N>,
    state: FingerState<N>,
}

/// All that `clear` forgets.
#[derive(Clone, Copy, Debug)]
struct FingerState<const N: usize> {
    tendons: [Pair<Sensor<2>>; N],
    joints: [Sensor<1>; N],
    period: Run,
    set_point: Run,
    first: Option<FingerFault>,
}

impl<const N: usize> FingerState<N> {
    fn new() -> Self {
        Self {
            tendons: [Pair::both(Sensor::new()); N],
            joints: [Sensor::new(); N],
            period: Run::default(),
            set_point: Run::default(),
            first: None,
        }
    }
}

impl<const N: usize> FingerMonitor<N> {
    /// Makes a monitor with these limits, in which no fault has occurred yet.
    ///
    /// # Errors
    /// [`NumberError`] for the first limit that is wrong.
    pub fn new(limits: FaultLimits<N>) -> Result<Self, NumberError> {
        limits.check()?;
        Ok(Self {
            limits,
            state: FingerState::new(),
        })
    }

    /// Returns the limits.
    pub(crate) const fn limits(&self) -> &FaultLimits<N> {
        &self.limits
    }

    /// Changes the limits, from the next tick on. The counts of samples go on.
    ///
    /// # Errors
    /// [`NumberError`] for the first limit that is wrong; all limits stay then.
    pub fn set_limits(&mut self, limits: FaultLimits<N>) -> Result<(), NumberError> {
        limits.check()?;
        self.limits = limits;
        Ok(())
    }

    /// Checks the values of one tick. Returns the first fault since the last
    /// [`clear`](Self::clear), which may be an earlier one; `None` if there was none.
    pub fn update(&mut self, observation: &Observation<'_, N>) -> Option<FingerFault> {
        let Self { limits, state } = self;
        let first = &mut state.first;
        let samples = observation
            .desired_tensions
            .iter()
            .zip(observation.tensions);
        let tendons = state.tendons.iter_mut().zip(&limits.tendons);
        for (joint, ((checks, limits), (desired, measured))) in tendons.zip(samples).enumerate() {
            let sites = FaultSite::tendons(joint);
            let (site, desired_n, sample) = (sites.flexor, desired.flexor, (measured.flexor, true));
            let latch = &mut Latch { first, site };
            checks
                .flexor
                .update(&limits.flexor, Some(desired_n), sample, latch);
            let (site, desired_n, sample) =
                (sites.extensor, desired.extensor, (measured.extensor, true));
            let latch = &mut Latch { first, site };
            checks
                .extensor
                .update(&limits.extensor, Some(desired_n), sample, latch);
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

impl Limits<2> for TendonFaultLimits {
    fn sensor(&self) -> &SensorFaultLimits {
        &self.sensor
    }

    fn own(&self) -> [(FaultCode, u16); 2] {
        let over = (FaultCode::OverTension, self.over_tension.samples);
        [(FaultCode::Slack, self.slack.samples), over]
    }

    #[inline]
    fn fails(&self, measured: f64) -> [bool; 2] {
        let over = self.over_tension.is_below(measured);
        [measured < self.slack.value, over]
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

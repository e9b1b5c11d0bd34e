use nalgebra::SVector;

use super::sensor::{Joint, Latch, Run, Tendon};
use super::usual::{SensorLanes, Usual, threshold};
use super::{FaultCode, FaultLimits, FaultSite, FingerFault};
use crate::NumberError;
use crate::math::{Real, is_finite};
use crate::tendon::{Pair, TendonPairs};

/// The desired and measured values of a finger in one tick, which a [`FingerMonitor`] checks.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Observation<'a, T: Real, const N: usize> {
    /// The desired tensions, N.
    pub desired_tensions: &'a TendonPairs<T, N>,
    /// The measured tensions, N.
    pub tensions: &'a TendonPairs<T, N>,
    /// The desired positions, rad; `None` for joints whose position is not controlled.
    pub desired_positions: &'a [Option<T>; N],
    /// The measured positions, rad.
    pub positions: &'a SVector<T, N>,
    /// A bit for each joint whose reading is implausible:
    /// [`ServoOutput::lost`](crate::servo::ServoOutput::lost).
    pub lost: u32,
    /// The time since the last tick, s.
    pub period_s: T,
    /// The time since the last set-point came, s.
    pub set_point_age_s: T,
}

/// A monitor that detects faults of one finger: it checks the tendons, the joints and the timing in
/// every tick, and latches the first fault.
///
/// A check that fails in as many samples in a row as its limit says is a fault. A tension or
/// position that is not finite does not count for the other checks of that tendon or joint; those
/// continue with the next sample. A time that is not finite counts as too long.
#[derive(Clone, Copy, Debug)]
pub struct FingerMonitor<T: Real, const N: usize> {
    limits: FaultLimits<T, N>,
    usual: AllUsual<T, N>,
    state: FingerState<T, N>,
}

/// The bounds within which a tick passes all checks.
#[derive(Clone, Copy, Debug)]
struct AllUsual<T, const N: usize> {
    tendons: [Usual<T, 2>; N],
    joints: Usual<T, N>,
    period_s: T,
    set_point_age_s: T,
}

/// All that `clear` forgets.
#[derive(Clone, Copy, Debug)]
struct FingerState<T, const N: usize> {
    tendons: [Pair<Tendon>; N],
    joints: [Joint; N],
    tendon_places: [SensorLanes<T, 2>; N],
    joint_places: SensorLanes<T, N>,
    /// No check has failed in the last tick: nothing is being counted.
    quiet: bool,
    period: Run,
    set_point: Run,
    first: Option<FingerFault>,
}

impl<T: Real, const N: usize> FingerState<T, N> {
    fn new() -> Self {
        Self {
            tendons: [Pair::both(Tendon::default()); N],
            joints: [Joint::default(); N],
            tendon_places: [SensorLanes::never(); N],
            joint_places: SensorLanes::never(),
            quiet: true,
            period: Run::default(),
            set_point: Run::default(),
            first: None,
        }
    }
}

impl<T: Real, const N: usize> FingerMonitor<T, N> {
    /// Makes a monitor with these limits, in which no fault has occurred yet.
    ///
    /// # Errors
    /// [`NumberError`] for the first limit that is wrong.
    pub fn new(limits: FaultLimits<T, N>) -> Result<Self, NumberError> {
        limits.check()?;
        Ok(Self {
            usual: AllUsual {
                tendons: limits.tendons.each_ref().map(Usual::of_tendons),
                joints: Usual::of_joints(&limits.joints),
                period_s: threshold(&limits.period_s),
                set_point_age_s: threshold(&limits.set_point_age_s),
            },
            limits,
            state: FingerState::new(),
        })
    }

    /// Checks the values of one tick. Returns the first fault since the last
    /// [`clear`](Self::clear), which may be an earlier one; `None` if there was none.
    #[inline(always)]
    pub fn update(&mut self, observation: &Observation<'_, T, N>) -> Option<FingerFault> {
        if observation.lost != 0 || !self.passes(observation) {
            self.examine(observation);
        }
        self.state.first
    }

    /// Returns true if nothing is wrong in a tick after one in which nothing was.
    #[inline(always)]
    fn passes(&mut self, observation: &Observation<'_, T, N>) -> bool {
        let (period_s, age_s) = (observation.period_s, observation.set_point_age_s);
        let Self { usual, state, .. } = self;
        let mut pass = state.quiet
            && is_finite(period_s)
            && period_s > T::zero()
            && period_s <= usual.period_s
            && is_finite(age_s)
            && age_s <= usual.set_point_age_s;
        for (((usual, places), desired), measured) in usual
            .tendons
            .iter()
            .zip(&mut state.tendon_places)
            .zip(observation.desired_tensions)
            .zip(observation.tensions)
        {
            pass &= usual.pass(places, &desired.lanes(), &measured.lanes());
        }
        let desired = observation.desired_positions;
        let [measured] = observation.positions.data.0;
        let mut wanted = measured;
        for (wanted, &desired) in wanted.iter_mut().zip(desired) {
            *wanted = desired.unwrap_or(*wanted);
        }
        pass &= usual
            .joints
            .pass(&mut state.joint_places, &wanted, &measured);
        // A joint without a set-point is not compared with its former position.
        for (lane, desired) in desired.iter().enumerate() {
            if pass && desired.is_none() {
                state.joint_places.forget(lane);
            }
        }
        pass
    }

    /// Makes the checks one by one.
    #[cold]
    #[inline(never)]
    fn examine(&mut self, observation: &Observation<'_, T, N>) {
        let Self { limits, state, .. } = self;
        let first = &mut state.first;
        let sites = state.tendons.iter_mut().zip(&mut state.tendon_places);
        let samples = observation
            .desired_tensions
            .iter()
            .zip(observation.tensions);
        for (joint, (((tendons, places), limits), (desired, measured))) in
            sites.zip(&limits.tendons).zip(samples).enumerate()
        {
            let Pair { flexor, extensor } = FaultSite::tendons(joint);
            let both = [
                (
                    flexor,
                    &mut tendons.flexor,
                    &limits.flexor,
                    desired.flexor,
                    measured.flexor,
                ),
                (
                    extensor,
                    &mut tendons.extensor,
                    &limits.extensor,
                    desired.extensor,
                    measured.extensor,
                ),
            ];
            for (lane, (site, tendon, limits, desired, measured)) in both.into_iter().enumerate() {
                let mut moved = places.of(lane);
                let latch = &mut Latch { first, site };
                tendon.update(limits, &mut moved, desired, measured, latch);
                places.set(lane, moved);
            }
        }
        let samples = observation
            .desired_positions
            .iter()
            .zip(observation.positions);
        for (joint, ((checks, limits), (&desired, &measured))) in state
            .joints
            .iter_mut()
            .zip(&limits.joints)
            .zip(samples)
            .enumerate()
        {
            let mut moved = state.joint_places.of(joint);
            let site = FaultSite::Joint(joint);
            let sample = (measured, observation.lost & 1 << joint == 0);
            checks.update(
                limits,
                &mut moved,
                desired,
                sample,
                &mut Latch { first, site },
            );
            state.joint_places.set(joint, moved);
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
        state.quiet = state.period.is_over()
            && state.set_point.is_over()
            && state.joints.iter().all(Joint::is_quiet)
            && (state.tendons.iter())
                .all(|pair| pair.flexor.is_quiet() && pair.extensor.is_quiet());
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

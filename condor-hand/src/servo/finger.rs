use heapless::Vec;
use nalgebra::{SVector, Vector3};

use super::impedance::least_inertias;
use super::joint::{Felt, JointServo};
use super::readings::Readings;
use super::transition::{Mean, Transition};
use super::{
    EffortGains, EffortServos, FingerSettings, JointCutoffs, JointGains, JointTarget, PositionLaw,
    ServoMode, ServoRefusal, SoftStop,
};
use crate::Subject;
use crate::control::elapsed::Elapsed;
use crate::control::{Derivative, LowPass};
use crate::dynamics::{DriveDynamics, Dynamics};
use crate::list::list;
use crate::math::is_finite;
use crate::number::{NumberError, positive};
use crate::trajectory::SetPoint;
use crate::transmission::{EffortLimits, Linear, Transmission};

/// The readings of all sensors of a finger in one tick.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FingerReadings<const N: usize, const A: usize> {
    /// Positions of the joints, rad.
    pub position: SVector<f64, N>,
    /// Positions of the actuators, rad or m; anything for one without a sensor of its position. Those of joints follow
    /// from them by a [`PositionSensing`](crate::transmission::PositionSensing); here they are checked for faults.
    pub actuator_position: [f64; A],
    /// Efforts of the actuators, N or N m; anything for one without a sensor.
    pub effort: [f64; A],
    /// The force along the normal at the fingertip, N; zero without a tactile sensor.
    pub touch: f64,
}

/// The result of one tick of a [`FingerServo`]: the commands for the actuators, and the values from
/// which they were computed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ServoOutput<const N: usize, const A: usize> {
    /// The commands of the actuators, N or N m.
    pub command: [f64; A],
    /// The desired efforts, N or N m.
    pub effort: [f64; A],
    /// The torques of those efforts, N m.
    pub torque: SVector<f64, N>,
    /// The positions that the laws have used, rad.
    pub position: SVector<f64, N>,
    /// The rates of the joints that the laws have used, rad/s.
    pub velocity: SVector<f64, N>,
    /// A bit for each joint whose actuators cannot give the torque that it needs.
    pub saturated: u32,
    /// A bit for each joint whose reading was invalid or implausible. The laws have used the
    /// position to which its last rate led.
    pub lost: u32,
}

/// The servos of the joints and actuators of one finger.
///
/// Call [`tick`](Self::tick) once per period with the sensor readings; it returns the actuator
/// commands. An effort reading that is not finite is replaced by the last finite one, or by the
/// effort at rest if there was none. If the position of a joint is not finite, or implausibly far
/// from where its rate leads, the joint continues at that rate; this is acceptable for some ticks,
/// after which the caller must give up. A joint whose position was never read does not hold or
/// follow positions.
#[derive(Clone, Debug)]
pub struct FingerServo<M, T, const N: usize, const A: usize> {
    mechanism: M,
    transmission: T,
    /// The joint to which each actuator belongs; `None` for one that moves nothing.
    owners: [Option<usize>; A],
    drive: DriveDynamics<N>,
    joints: Vec<JointServo, N>,
    actuators: EffortServos<A>,
    effort_filters: LowPass<A>,
    /// Whether a sensor measures the effort of each actuator that the finger has.
    sensed: Vec<bool, A>,
    position_filters: LowPass<N>,
    velocities: Derivative<N>,
    sample_hz: f64,
    readings: Readings<N>,
    /// A change of modes or gains that the next tick smooths.
    changed: bool,
    /// Joints that hold what they have in another mode from the next tick on.
    holds: [Option<ServoMode>; N],
    /// The efforts of the actuators of joints in [`ServoMode::Effort`], N or N m.
    given: [f64; A],
    /// The efforts of the last tick, N or N m.
    desired: [f64; A],
    /// The means of the desired efforts in the present modes.
    means: [Mean; A],
    transition: Transition<A>,
    /// The last readings of efforts that were finite, N or N m.
    last: [f64; A],
}

impl<M, T, const N: usize, const A: usize> FingerServo<M, T, N, A>
where
    M: Dynamics<N>,
    T: Transmission<N, A>,
{
    /// Makes the servos of a finger whose joints are all off. `mechanism` is the model of the
    /// finger's links, and `transmission` has its actuators.
    ///
    /// # Errors
    /// [`NumberError`] for the first setting that no finger can have.
    pub fn new(
        mechanism: M,
        transmission: T,
        settings: &FingerSettings<N, A>,
    ) -> Result<Self, NumberError> {
        const { assert!(N > 0 && N <= 32, "a finger has 1 to 32 joints") };
        positive("the number of ticks in a second", settings.sample_hz)?;
        positive("the time of a transition, s,", settings.transition_s)?;
        let sample_hz = settings.sample_hz;
        let mut joints = Vec::new();
        let inertias = least_inertias(&mechanism, settings);
        let linear = transmission.linear();
        let all = settings.joints.iter().zip(inertias);
        for (joint, (of_joint, inertia)) in all.enumerate() {
            let torque = linear.torque_range(joint);
            let wrong = |error: NumberError| error.at(Subject::Joint(joint as u16));
            let servo = JointServo::new(of_joint, torque, inertia).map_err(wrong)?;
            LowPass::new([of_joint.position_cutoff_hz], sample_hz).map_err(wrong)?;
            Derivative::new([of_joint.velocity_cutoff_hz], sample_hz).map_err(wrong)?;
            // There is room for N.
            let _ = joints.push(servo);
        }
        let (mut position_cutoffs_hz, mut velocity_cutoffs_hz) = ([None; N], [sample_hz / 4.0; N]);
        let cutoffs_hz = position_cutoffs_hz.iter_mut().zip(&mut velocity_cutoffs_hz);
        for ((position, velocity), joint) in cutoffs_hz.zip(&settings.joints) {
            (*position, *velocity) = (joint.position_cutoff_hz, joint.velocity_cutoff_hz);
        }
        for (actuator, settings) in settings.actuators.iter().enumerate() {
            LowPass::new([settings.cutoff_hz], sample_hz)
                .map_err(|error| error.at(Subject::Actuator(actuator as u16)))?;
        }
        let (mut gains, mut effort_cutoffs_hz) = ([EffortGains::default(); A], [None; A]);
        let all = gains.iter_mut().zip(&mut effort_cutoffs_hz);
        for ((gains, cutoff_hz), actuator) in all.zip(&settings.actuators) {
            (*gains, *cutoff_hz) = (actuator.gains, actuator.cutoff_hz);
        }
        let actuators = EffortServos::new(gains, linear.limits(), sample_hz)?;
        let desired = linear.at_rest();
        let owners = core::array::from_fn(|actuator| linear.joint_of(actuator));
        Ok(Self {
            mechanism,
            transmission,
            owners,
            drive: settings.drive,
            joints,
            actuators,
            effort_filters: LowPass::new(effort_cutoffs_hz, sample_hz)?,
            sensed: list(settings.actuators.iter().map(|actuator| actuator.is_sensed)),
            position_filters: LowPass::new(position_cutoffs_hz, sample_hz)?,
            velocities: Derivative::new(velocity_cutoffs_hz, sample_hz)?,
            sample_hz,
            readings: Readings::new(&settings.joints),
            changed: false,
            holds: [None; N],
            given: desired,
            desired,
            means: [Mean::new(); A],
            transition: Transition::new(settings.transition_s * settings.sample_hz),
            last: desired,
        })
    }

    /// Returns the model of the finger's links that was passed to [`new`](Self::new).
    #[must_use]
    pub fn mechanism(&self) -> &M {
        &self.mechanism
    }

    /// Returns the arms of the finger's actuators at the present posture, and the limits of their efforts.
    #[inline(always)]
    #[must_use]
    pub fn linear(&self) -> &Linear<N, A> {
        self.transmission.linear()
    }

    /// Returns the joint to which an actuator [belongs](Linear::joint_of); `None` if it moves nothing, or if the finger
    /// does not have it.
    #[must_use]
    pub fn joint_of(&self, actuator: usize) -> Option<usize> {
        self.owners.get(actuator).copied().flatten()
    }

    /// Returns, for each actuator that the finger has, whether a sensor measures its effort.
    pub(crate) fn sensed(&self) -> &[bool] {
        &self.sensed
    }

    /// Returns the present target of a joint; `None` for a joint that the finger does not have.
    #[must_use]
    pub fn target(&self, joint: usize) -> Option<JointTarget> {
        self.joints.get(joint).map(|servo| servo.target)
    }

    /// Returns the present mode of a joint; `None` for a joint that the finger does not have.
    #[must_use]
    pub fn mode(&self, joint: usize) -> Option<ServoMode> {
        let held = self.holds.get(joint).copied().flatten();
        held.or_else(|| Some(self.joints.get(joint)?.target.mode()))
    }

    /// Sets the target of a joint, and switches the joint to the mode of that target, from the next tick on. A position
    /// in the zone of a soft stop, where no joint rests, becomes the inner end of the zone.
    ///
    /// # Errors
    /// After an error the joint keeps its target. Returns [`ServoRefusal::NoJoint`] if the finger does not have
    /// the joint; [`ServoRefusal::Target`] if the target exceeds the limits of the joint or its actuators;
    /// [`ServoRefusal::Rate`] if its velocity or acceleration is not finite.
    pub fn set_target(&mut self, joint: usize, target: JointTarget) -> Result<(), ServoRefusal> {
        let servo = self
            .joints
            .get_mut(joint)
            .ok_or(ServoRefusal::no_joint(joint, N))?;
        servo.check(joint, &target)?;
        let is_new = target.mode() != servo.target.mode();
        self.changed |= is_new;
        let target = servo.between_stops(target);
        if is_new && target == JointTarget::Effort {
            let kept = self.kept();
            self.give(joint, &kept);
        }
        self.take(joint, target);
        if let Some(hold) = self.holds.get_mut(joint) {
            *hold = None;
        }
        Ok(())
    }

    /// Sets the effort of an actuator (N, or N m), and switches its joint to [`ServoMode::Effort`], from the next tick
    /// on. The other actuators of the joint keep the efforts that they have.
    ///
    /// # Errors
    /// Returns [`ServoRefusal::NoActuator`] if the finger does not have the actuator; [`ServoRefusal::Effort`] if the
    /// effort is beyond its limits.
    pub fn set_effort(&mut self, actuator: usize, effort: f64) -> Result<(), ServoRefusal> {
        let joint = (self.joint_of(actuator))
            .ok_or(ServoRefusal::no_actuator(actuator, self.actuators()))?;
        if let Some(&EffortLimits { low, high, .. }) = self.linear().limits().get(actuator)
            && !(low <= effort && effort <= high)
        {
            return Err(ServoRefusal::Effort {
                actuator: actuator as u32,
                value: effort,
                low,
                high,
            });
        }
        self.set_target(joint, JointTarget::Effort)?;
        if let Some(given) = self.given.get_mut(actuator) {
            *given = effort;
        }
        Ok(())
    }

    /// Returns the number of actuators: all but those at the end that move nothing.
    fn actuators(&self) -> usize {
        let moves = |actuator: &usize| self.joint_of(*actuator).is_some();
        (0..A).rev().find(moves).map_or(0, |last| last + 1)
    }

    /// A joint takes a target that was checked.
    fn take(&mut self, joint: usize, target: JointTarget) {
        let Some(servo) = self.joints.get_mut(joint) else {
            return;
        };
        if !servo.take(target) {
            return;
        }
        for (mean, owner) in self.means.iter_mut().zip(&self.owners) {
            if *owner == Some(joint) {
                *mean = Mean::new();
            }
        }
    }

    /// Sets the efforts that the actuators of a joint keep in [`ServoMode::Effort`].
    fn give(&mut self, joint: usize, kept: &[f64; A]) {
        let linear = self.transmission.linear();
        let all = self.given.iter_mut().zip(kept).zip(linear.limits());
        for (((given, kept), limits), owner) in all.zip(&self.owners) {
            if *owner == Some(joint) {
                *given = limits.clamp(*kept);
            }
        }
    }

    /// The efforts that actuators keep when the mode of their joint changes: the mean where a law of the joint asks for
    /// a torque, or else the last one, N or N m.
    fn kept(&self) -> [f64; A] {
        let mut kept = self.desired;
        let all = kept.iter_mut().zip(&self.means).zip(&self.owners);
        for ((effort, mean), owner) in all {
            let servo = owner.and_then(|joint| self.joints.get(joint));
            if servo.is_some_and(JointServo::is_active) {
                *effort = mean.effort().unwrap_or(*effort);
            }
        }
        kept
    }

    /// The next set-point of a joint that follows positions; one that it cannot have is refused.
    #[inline]
    pub(crate) fn follow(&mut self, joint: usize, point: &SetPoint) {
        let held = self.holds.get(joint).copied().flatten();
        let follows = |servo: &&mut JointServo| held.is_none() && servo.may_go_on(point);
        if let Some(servo) = self.joints.get_mut(joint).filter(follows) {
            servo.target = JointTarget::Position(*point);
        } else {
            // Refused, it leaves the joint at the last one.
            let _ = self.set_target(joint, JointTarget::Position(*point));
        }
    }

    /// Switches a joint to another mode, from the next tick on. In it the joint first keeps its present position, or
    /// its [mean](crate::servo#changes-of-mode) torque or efforts. If the joint is in that mode already, it keeps its
    /// target.
    ///
    /// # Errors
    /// Returns [`ServoRefusal::NoJoint`] if the finger does not have the joint.
    pub fn set_mode(&mut self, joint: usize, mode: ServoMode) -> Result<(), ServoRefusal> {
        let same = self.mode(joint).ok_or(ServoRefusal::no_joint(joint, N))? == mode;
        if let (false, Some(hold)) = (same, self.holds.get_mut(joint)) {
            *hold = Some(mode);
        }
        Ok(())
    }

    /// Switches all joints off at once, as in a new finger, but keeps their gains. The next tick
    /// commands the efforts at rest, without a transition. Use this only after the actuators have
    /// been brought to rest in another way.
    pub fn rest(&mut self) {
        for servo in &mut self.joints {
            servo.rest();
        }
        self.actuators.reset();
        self.means = [Mean::new(); A];
        self.holds = [None; N];
        self.changed = false;
        self.transition.end();
        self.desired = self.linear().at_rest();
    }

    /// The efforts with which joints that go by positions get these torques (N m), and all others keep the torques of
    /// the efforts that they have (N, or N m).
    pub(crate) fn still(&self, has: &[f64; A], torque: &SVector<f64, N>) -> [f64; A] {
        let linear = self.linear();
        let follows = |joint: usize| {
            let target = self.joints.get(joint).map(|servo| servo.target);
            let (goes, springs) = (ServoMode::Position, ServoMode::Impedance);
            target.is_some_and(|target| target.mode() == goes || target.mode() == springs)
        };
        let mut wanted = linear.torque(has);
        for (joint, (wanted, torque)) in wanted.iter_mut().zip(torque).enumerate() {
            if follows(joint) {
                *wanted = *torque;
            }
        }
        let mut limits = *linear.limits();
        for ((limits, has), owner) in limits.iter_mut().zip(has).zip(&self.owners) {
            if !owner.is_some_and(follows) {
                limits.bias = limits.clamp(*has);
            }
        }
        linear.efforts_within(&wanted, u32::MAX, &limits).effort
    }

    /// The positions, rad, that the next tick would go by, so many seconds after the last one, if no sensor
    /// stands and none is filtered.
    pub(crate) fn plausible(&self, sensed: &SVector<f64, N>, period_s: f64) -> SVector<f64, N> {
        let elapsed = Elapsed::new(period_s, self.sample_hz);
        let mut positions = *sensed;
        let lanes = positions
            .iter_mut()
            .zip(&self.joints)
            .zip(self.velocities.rates());
        for (lane, ((position, servo), &rate)) in lanes.enumerate() {
            if servo.seen
                && let Some(plausible) = self.readings.plausible(lane, *position, rate, elapsed)
            {
                *position = plausible;
            }
        }
        positions
    }

    /// Forgets the earlier positions of the joints, so that the next readings count as plausible,
    /// wherever they are.
    pub fn forget_positions(&mut self) {
        for servo in &mut self.joints {
            servo.seen = false;
        }
        self.readings.forget();
        self.position_filters.forget();
        self.velocities.forget();
    }

    /// Returns the present gains of a joint; `None` for a joint that the finger does not have.
    #[must_use]
    pub fn gains(&self, joint: usize) -> Option<&JointGains> {
        self.joints.get(joint).map(|servo| &servo.gains)
    }

    /// Returns the present gains of an actuator; `None` for an actuator that the finger does not have.
    #[must_use]
    pub fn effort_gains(&self, actuator: usize) -> Option<&EffortGains> {
        self.joint_of(actuator)?;
        self.actuators.gains().get(actuator)
    }

    /// Changes all gains of an actuator at once, from the next tick on.
    ///
    /// # Errors
    /// [`ServoRefusal::NoActuator`] if the finger does not have the actuator; [`ServoRefusal::Gain`] if no actuator can
    /// have these gains. The actuator keeps its gains then.
    pub fn set_effort_gains(
        &mut self,
        actuator: usize,
        gains: &EffortGains,
    ) -> Result<(), ServoRefusal> {
        if self.effort_gains(actuator).is_none() {
            return Err(ServoRefusal::no_actuator(actuator, self.actuators()));
        }
        let mut all = *self.actuators.gains();
        if let Some(place) = all.get_mut(actuator) {
            *place = *gains;
        }
        self.actuators
            .set_gains(all)
            .map_err(|error| error.at(Subject::Actuator(actuator as u16)))?;
        self.changed = true;
        Ok(())
    }

    /// Changes the filter of the measured effort of an actuator, Hz, from the next tick on.
    pub(crate) fn set_effort_cutoff(
        &mut self,
        actuator: usize,
        cutoff_hz: Option<f64>,
    ) -> Result<(), NumberError> {
        self.effort_filters
            .set_cutoff(actuator, cutoff_hz, self.sample_hz)?;
        self.changed = true;
        Ok(())
    }

    /// Changes all gains of a joint at once, from the next tick on.
    ///
    /// # Errors
    /// [`ServoRefusal::NoJoint`] if the finger does not have the joint; [`ServoRefusal::Gain`] if no joint can
    /// have these gains. The joint keeps its gains then.
    pub fn set_gains(&mut self, joint: usize, gains: &JointGains) -> Result<(), ServoRefusal> {
        let servo = self
            .joints
            .get_mut(joint)
            .ok_or(ServoRefusal::no_joint(joint, N))?;
        servo
            .set_gains(gains)
            .map_err(|error| error.at(Subject::Joint(joint as u16)))?;
        self.changed = true;
        Ok(())
    }

    /// Changes the limits and the soft stop of a joint, except for its damping, and the filters of its sensors, from
    /// the next tick on.
    pub(crate) fn set_stop_and_filters(
        &mut self,
        joint: usize,
        stop: &SoftStop,
        cutoffs_hz: &JointCutoffs,
    ) -> Result<(), NumberError> {
        let Some(servo) = self.joints.get_mut(joint) else {
            return Ok(());
        };
        let sample_hz = self.sample_hz;
        let (mut positions, mut velocities) = (self.position_filters, self.velocities);
        positions.set_cutoff(joint, cutoffs_hz.position, sample_hz)?;
        velocities.set_cutoff(joint, cutoffs_hz.velocity)?;
        servo.set_stop(stop)?;
        (self.position_filters, self.velocities) = (positions, velocities);
        self.changed = true;
        Ok(())
    }

    /// Runs one tick of all servos: takes the sensor readings, and returns the commands for the
    /// actuators.
    ///
    /// `gravity` is the gravity in the axes of the palm less the acceleration of the palm, m/s².
    /// `period_s` is the time since the last tick, s; a value that is not finite or not above zero
    /// counts as one period.
    #[inline]
    pub fn tick(
        &mut self,
        sensed: &FingerReadings<N, A>,
        gravity: &Vector3<f64>,
        period_s: f64,
    ) -> ServoOutput<N, A> {
        self.tick_after(sensed, gravity, Elapsed::new(period_s, self.sample_hz))
    }

    /// Runs one tick, like [`tick`](Self::tick), `elapsed` after the last one.
    #[inline(always)]
    pub(crate) fn tick_after(
        &mut self,
        sensed: &FingerReadings<N, A>,
        gravity: &Vector3<f64>,
        elapsed: Elapsed,
    ) -> ServoOutput<N, A> {
        let (position, velocity) = self.sense_positions(&sensed.position, elapsed);
        self.transmission.set_position(&position);
        if self.transmission.changes() {
            let linear = self.transmission.linear();
            for (joint, servo) in self.joints.iter_mut().enumerate() {
                servo.set_torque_range(linear.torque_range(joint));
            }
        }
        let measured = self.sense_efforts(&sensed.effort);
        let kept = self.take_holds(&position, &velocity, gravity);
        let part = self.transition.part();
        for servo in &mut self.joints {
            servo.go_on(part * elapsed.periods);
        }

        let torque = self.torques(&position, &velocity, &measured, gravity, elapsed.seconds);
        let (joints, limits) = self.asked();
        let linear = self.transmission.linear();
        let allocated = linear.efforts_within(&torque, joints, &limits);
        let before = core::mem::replace(&mut self.desired, allocated.effort);
        if core::mem::take(&mut self.changed) {
            let kept = kept.as_ref().unwrap_or(&before);
            self.transition.begin(&before, kept, &self.desired);
        }
        self.transition
            .smooth(&mut self.desired, linear.limits(), elapsed.periods);

        let rates = linear.actuators(&velocity);
        let mut felt = measured;
        let all = self.means.iter_mut().zip(&self.desired).zip(&mut felt);
        for (((mean, desired), felt), is_sensed) in all.zip(&self.sensed) {
            mean.add(*desired, part);
            if !is_sensed {
                *felt = f64::NAN;
            }
        }
        let count = self.sensed.len();
        let command = (self.actuators).update_after(&self.desired, &felt, &rates, elapsed, count);
        ServoOutput {
            command,
            effort: self.desired,
            torque: linear.torque(&self.desired),
            position,
            velocity,
            saturated: allocated.saturated & self.active(),
            lost: self.readings.lost,
        }
    }

    /// The joints whose laws ask for torques, a bit each.
    #[inline(always)]
    fn active(&self) -> u32 {
        let mut active = 0;
        for (joint, servo) in self.joints.iter().enumerate() {
            active |= u32::from(servo.is_active()) << joint;
        }
        active
    }

    /// The joints whose torques count in this tick, a bit each, and the limits of the efforts in their modes.
    ///
    /// The actuators of joints in [`ServoMode::Effort`] have the efforts that are given. Those of a joint that is off are
    /// at rest if all are, and otherwise prefer that.
    #[inline(always)]
    fn asked(&self) -> (u32, [EffortLimits; A]) {
        let (mut asked, active) = (u32::MAX, self.active());
        let linear = self.transmission.linear();
        let mut limits = *linear.limits();
        if active.count_ones() as usize == self.joints.len() {
            return (asked, limits);
        }
        for (joint, servo) in self.joints.iter().enumerate() {
            if servo.target == JointTarget::Effort || active == 0 {
                asked &= !(1 << joint);
            }
        }
        let all = limits.iter_mut().zip(&self.given).zip(&self.owners);
        for ((limits, &given), owner) in all {
            let servo = owner.and_then(|joint| self.joints.get(joint));
            match servo.map(|servo| servo.target) {
                Some(JointTarget::Effort) => *limits = EffortLimits::fixed(given),
                Some(JointTarget::Off) if active == 0 => {
                    *limits = EffortLimits::fixed(limits.at_rest());
                }
                Some(JointTarget::Off) => limits.bias = limits.at_rest(),
                _ => {}
            }
        }
        (asked, limits)
    }

    /// Returns the filtered positions that the sensors measure, and their rates.
    fn sense_positions(
        &mut self,
        sensed: &SVector<f64, N>,
        elapsed: Elapsed,
    ) -> (SVector<f64, N>, SVector<f64, N>) {
        let [mut positions] = sensed.data.0;
        for absent in positions.iter_mut().skip(self.joints.len()) {
            *absent = 0.0;
        }
        let (mut targets, mut seen) = (positions, [false; N]);
        for ((target, seen), servo) in targets.iter_mut().zip(&mut seen).zip(&self.joints) {
            (*target, *seen) = (servo.target_position(), servo.seen);
        }
        let rates = *self.velocities.rates();
        let readings = &mut self.readings;
        let unseen = readings.take(&mut positions, &mut seen, &rates, &targets, elapsed);
        let lost = readings.lost;
        for (servo, &seen) in self.joints.iter_mut().zip(&seen) {
            self.changed |= seen != servo.seen;
            servo.seen = seen;
        }
        let positions = self.position_filters.update_seen(&positions, &seen);
        self.velocities.go_on_unseen(&unseen, &positions, elapsed);
        let mut rated = positions;
        for (lane, position) in rated.iter_mut().enumerate() {
            if lost & 1 << lane != 0 {
                *position = f64::NAN;
            }
        }
        let velocities = self.velocities.update_after(&rated, &seen, elapsed);
        (positions.into(), velocities.into())
    }

    /// The efforts that the sensors say, filtered. Without a sensor it is the desired one.
    fn sense_efforts(&mut self, sensed: &[f64; A]) -> [f64; A] {
        let inputs = sensed.iter().zip(&self.desired).zip(&self.sensed);
        for (last, ((&sensed, &desired), &is_sensed)) in self.last.iter_mut().zip(inputs) {
            if !is_sensed {
                *last = desired;
            } else if is_finite(sensed) {
                *last = sensed;
            }
        }
        self.effort_filters.update_seen(&self.last, &self.sensed)
    }

    /// Joints that change their mode take over what they have. Returns the efforts, N or N m, from which the finger goes
    /// on then: the last ones, or the means where a joint keeps its efforts or torque; `None` if no joint does.
    fn take_holds(
        &mut self,
        position: &SVector<f64, N>,
        velocity: &SVector<f64, N>,
        gravity: &Vector3<f64>,
    ) -> Option<[f64; A]> {
        if self.holds.iter().all(Option::is_none) {
            return None;
        }
        let means = self.kept();
        let torque = self.linear().torque(&means);
        let loads =
            self.mechanism.gravity_torque(position, gravity) + self.stops(position, velocity);
        let mut keeps = 0_u32;
        for joint in 0..N {
            let (Some(servo), Some(hold)) = (self.joints.get(joint), self.holds.get_mut(joint))
            else {
                continue;
            };
            // There is no position to hold yet.
            if matches!(hold, Some(ServoMode::Position | ServoMode::Impedance)) && !servo.seen {
                continue;
            }
            if let Some(mode) = hold.take() {
                let target = servo.hold(mode, position[joint], torque[joint], loads[joint]);
                if target == JointTarget::Effort {
                    self.give(joint, &means);
                }
                self.take(joint, target);
                self.changed = true;
                let keeps_it = !matches!(mode, ServoMode::Off | ServoMode::Position);
                keeps |= u32::from(keeps_it) << joint;
            }
        }
        let mut kept = self.desired;
        for ((kept, mean), owner) in kept.iter_mut().zip(&means).zip(&self.owners) {
            if owner.is_some_and(|joint| keeps >> joint & 1 == 1) {
                *kept = *mean;
            }
        }
        Some(kept)
    }

    /// The torques of the laws of all joints, N m.
    #[inline(always)]
    fn torques(
        &mut self,
        position: &SVector<f64, N>,
        velocity: &SVector<f64, N>,
        effort: &[f64; A],
        gravity: &Vector3<f64>,
        period: f64,
    ) -> SVector<f64, N> {
        // Terms that no law asks for are not computed.
        let (mut computed, mut falls, mut moves, mut turns) = (false, false, false, false);
        let (mut acceleration, mut asked) = ([0.0; N], [0.0; N]);
        let places = asked.iter_mut().zip(&mut acceleration);
        let felt = position.as_slice().iter().zip(velocity.as_slice());
        for (servo, ((asked, acceleration), (&position, &velocity))) in
            self.joints.iter().zip(places.zip(felt))
        {
            match (servo.target, servo.gains.law) {
                (JointTarget::Position(point), law) => {
                    moves = true;
                    *asked = point.velocity;
                    *acceleration = servo.acceleration(position, velocity);
                    match law {
                        PositionLaw::ComputedTorque { .. } => computed = true,
                        PositionLaw::Pd { .. } => falls = true,
                    }
                }
                (JointTarget::Torque(_) | JointTarget::Grasp(_), _) => turns = true,
                (JointTarget::Impedance { .. }, _) => falls = true,
                (JointTarget::Off | JointTarget::Effort, _) => {}
            }
        }
        let (acceleration, asked) = (SVector::from(acceleration), SVector::from(asked));
        let zero = SVector::zeros();
        let inverse = if computed {
            self.mechanism
                .inverse_dynamics(position, velocity, &acceleration, gravity)
                + self.drive.armature.component_mul(&acceleration)
        } else {
            zero
        };
        let weight = if falls {
            self.mechanism.gravity_torque(position, gravity)
        } else {
            zero
        };
        let friction = if moves {
            self.drive.torque(&asked)
        } else {
            zero
        };
        let mut measured = if turns {
            self.linear().torque(effort)
        } else {
            zero
        };
        if turns && self.sensed.contains(&false) {
            let arms = self.transmission.linear().arms();
            for (arms, _) in arms
                .iter()
                .zip(&self.sensed)
                .filter(|(_, sensed)| !**sensed)
            {
                for (measured, arm) in measured.iter_mut().zip(arms) {
                    if *arm != 0.0 {
                        *measured = f64::NAN;
                    }
                }
            }
        }

        let stop = self.stops(position, velocity);

        let mut torque = zero;
        let ([positions], [rates], [measured]) =
            (&position.data.0, &velocity.data.0, &measured.data.0);
        let ([inverse], [weight], [friction], [stop]) = (
            &inverse.data.0,
            &weight.data.0,
            &friction.data.0,
            &stop.data.0,
        );
        let [torques] = &mut torque.data.0;
        for joint in 0..self.joints.len().min(N) {
            if let Some(servo) = self.joints.get_mut(joint) {
                torques[joint] = servo.torque(&Felt {
                    position: positions[joint],
                    rate: rates[joint],
                    torque: measured[joint],
                    inverse: inverse[joint],
                    gravity: weight[joint],
                    friction: friction[joint],
                    stop: stop[joint],
                    period,
                });
            }
        }
        torque
    }

    /// The torques that keep joints from their limits and accelerate no others, N m.
    #[inline(always)]
    fn stops(&self, position: &SVector<f64, N>, velocity: &SVector<f64, N>) -> SVector<f64, N> {
        let mut inwards = SVector::<f64, N>::zeros();
        let felt = position.as_slice().iter().zip(velocity.as_slice());
        for (servo, (inwards, (&position, &velocity))) in self
            .joints
            .iter()
            .zip(inwards.as_mut_slice().iter_mut().zip(felt))
        {
            *inwards = servo.stop(position, velocity);
        }
        let zero = SVector::zeros();
        if inwards == zero {
            return zero;
        }
        let weightless = Vector3::zeros();
        self.mechanism
            .inverse_dynamics(position, &zero, &inwards, &weightless)
            + self.drive.armature.component_mul(&inwards)
    }
}

use nalgebra::{SVector, Vector3};

use super::impedance::least_inertias;
use super::joint::{Felt, JointServo};
use super::readings::Readings;
use super::transition::Transition;
use super::{
    FingerSettings, JointCutoffs, JointGains, JointTarget, PositionLaw, ServoMode, ServoRefusal,
    SoftStop,
};
use crate::Subject;
use crate::control::elapsed::Elapsed;
use crate::control::{Derivative, LowPass};
use crate::dynamics::{DriveDynamics, Dynamics};
use crate::math::is_finite;
use crate::number::{NumberError, Requirement, count, positive};
use crate::tendon::{MomentArms, Pair, TendonPairs};
use crate::trajectory::SetPoint;

/// The readings of all sensors of a finger in one tick.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FingerReadings<const N: usize> {
    /// Positions of the joints, rad.
    pub position: SVector<f64, N>,
    /// Tensions of the tendons, N.
    pub tension: TendonPairs<f64, N>,
    /// The force along the normal at the fingertip, N; zero without a tactile sensor.
    pub touch: f64,
}

/// The result of one tick of a [`FingerServo`]: the commands for the actuators, and the values from
/// which they were computed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ServoOutput<const N: usize> {
    /// The commands of the actuators, N, from 0 to the greatest tension of each tendon.
    pub command: TendonPairs<f64, N>,
    /// The desired tensions, N.
    pub tension: TendonPairs<f64, N>,
    /// The torques of those tensions, N m.
    pub torque: SVector<f64, N>,
    /// The positions that the laws have used, rad.
    pub position: SVector<f64, N>,
    /// The rates of the joints that the laws have used, rad/s.
    pub velocity: SVector<f64, N>,
    /// A bit for each joint whose tendons cannot give the torque that it needs.
    pub saturated: u32,
    /// A bit for each joint whose reading was invalid or implausible. The laws have used the
    /// position to which its last rate led.
    pub lost: u32,
}

/// The servos of the joints and tendons of one finger.
///
/// Call [`tick`](Self::tick) once per period with the sensor readings; it returns the actuator
/// commands. A tension reading that is not finite is replaced by the last finite one, or by the
/// least tension if there was none. If the position of a joint is not finite, or implausibly far
/// from where its rate leads, the joint continues at that rate; this is acceptable for some ticks,
/// after which the caller must give up. A joint whose position was never read does not hold or
/// follow positions.
#[derive(Clone, Debug)]
pub struct FingerServo<M, const N: usize> {
    mechanism: M,
    arms: MomentArms<N>,
    drive: DriveDynamics<N>,
    joints: [JointServo; N],
    position_filters: LowPass<N>,
    velocities: Derivative<N>,
    sample_hz: f64,
    readings: Readings<N>,
    /// A change of modes or gains that the next tick smooths.
    changed: bool,
    /// Joints that hold what they have in another mode from the next tick on.
    holds: [Option<ServoMode>; N],
    /// The tensions of the last tick, N.
    desired: TendonPairs<f64, N>,
    transition: Transition<N>,
    /// The last tensions that were finite, N.
    last: TendonPairs<f64, N>,
}

impl<M: Dynamics<N>, const N: usize> FingerServo<M, N> {
    /// Makes the servos of a finger whose joints are all off. `mechanism` is the model of the
    /// finger's links, and `arms` are the moment arms of its tendons.
    ///
    /// # Errors
    /// [`NumberError`] for the first setting that no finger can have.
    pub fn new(
        mechanism: M,
        arms: MomentArms<N>,
        settings: &FingerSettings<N>,
    ) -> Result<Self, NumberError> {
        const { assert!(N > 0 && N <= 32, "a finger has 1 to 32 joints") };
        positive("the number of ticks in a second", settings.sample_hz)?;
        positive("the time of a transition, s,", settings.transition_s)?;
        let sample_hz = settings.sample_hz;
        let mut joints = heapless::Vec::<_, N>::new();
        let inertias = least_inertias(&mechanism, settings);
        let all = settings.joints.iter().zip(arms.limits()).zip(inertias);
        for (joint, ((of_joint, limits), inertia)) in all.enumerate() {
            let torque = arms.torque_range(joint);
            let wrong = |error: NumberError| error.at(Subject::Joint(joint as u16));
            let servo =
                JointServo::new(of_joint, torque, &limits, inertia, sample_hz).map_err(wrong)?;
            LowPass::new([of_joint.position_cutoff_hz], sample_hz).map_err(wrong)?;
            Derivative::new([of_joint.velocity_cutoff_hz], sample_hz).map_err(wrong)?;
            // There is room for N.
            let _ = joints.push(servo);
        }
        let value = count(joints.len());
        let Ok(joints) = joints.into_array() else {
            return Err(NumberError {
                at: Subject::Whole,
                what: "the number of joints",
                value,
                must: Requirement::Equal(count(N)),
            });
        };
        let position_cutoffs_hz = settings.joints.map(|joint| joint.position_cutoff_hz);
        let velocity_cutoffs_hz = settings.joints.map(|joint| joint.velocity_cutoff_hz);
        let desired = arms.at_rest();
        Ok(Self {
            mechanism,
            arms,
            drive: settings.drive,
            joints,
            position_filters: LowPass::new(position_cutoffs_hz, sample_hz)?,
            velocities: Derivative::new(velocity_cutoffs_hz, sample_hz)?,
            sample_hz,
            readings: Readings::new(&settings.joints),
            changed: false,
            holds: [None; N],
            desired,
            transition: Transition::new(settings.transition_s * settings.sample_hz),
            last: desired,
        })
    }

    /// Returns the model of the finger's links that was passed to [`new`](Self::new).
    #[must_use]
    pub fn mechanism(&self) -> &M {
        &self.mechanism
    }

    /// Returns the moment arms of the finger's tendons.
    #[must_use]
    pub fn arms(&self) -> &MomentArms<N> {
        &self.arms
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
    /// the joint; [`ServoRefusal::Target`] if the target exceeds the limits of the joint or its tendons;
    /// [`ServoRefusal::Rate`] if its velocity or acceleration is not finite.
    pub fn set_target(&mut self, joint: usize, target: JointTarget) -> Result<(), ServoRefusal> {
        let servo = self
            .joints
            .get_mut(joint)
            .ok_or(ServoRefusal::no_joint(joint, N))?;
        servo.check(joint, &target)?;
        self.changed |= target.mode() != servo.target.mode();
        servo.take(servo.between_stops(target));
        if let Some(hold) = self.holds.get_mut(joint) {
            *hold = None;
        }
        Ok(())
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
    /// its [mean](crate::servo#changes-of-mode) torque or tensions. If the joint is in that mode already, it keeps its
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
    /// commands the least tensions, without a transition. Use this only after the actuators have
    /// been brought to the least tensions in another way.
    pub fn rest(&mut self) {
        for servo in &mut self.joints {
            servo.rest();
        }
        self.holds = [None; N];
        self.changed = false;
        self.transition.end();
        self.desired = self.arms.at_rest();
    }

    /// The tensions with which joints that go by positions get these torques (N m), and all others what
    /// they have.
    pub(crate) fn still(
        &self,
        has: &TendonPairs<f64, N>,
        torque: &SVector<f64, N>,
    ) -> TendonPairs<f64, N> {
        let given = core::array::from_fn(|joint| match self.target(joint)? {
            JointTarget::Position(_) | JointTarget::Impedance { .. } => None,
            _ => has.get(joint).copied(),
        });
        self.arms.allocate_around(torque, &given).tensions
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
        let mut tensions = servo.tension_filter;
        tensions.set_cutoff(0, cutoffs_hz.tension.flexor, sample_hz)?;
        tensions.set_cutoff(1, cutoffs_hz.tension.extensor, sample_hz)?;
        let (mut positions, mut velocities) = (self.position_filters, self.velocities);
        positions.set_cutoff(joint, cutoffs_hz.position, sample_hz)?;
        velocities.set_cutoff(joint, cutoffs_hz.velocity)?;
        servo.set_stop(stop)?;
        servo.tension_filter = tensions;
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
        sensed: &FingerReadings<N>,
        gravity: &Vector3<f64>,
        period_s: f64,
    ) -> ServoOutput<N> {
        self.tick_after(sensed, gravity, Elapsed::new(period_s, self.sample_hz))
    }

    /// Runs one tick, like [`tick`](Self::tick), `elapsed` after the last one.
    #[inline(always)]
    pub(crate) fn tick_after(
        &mut self,
        sensed: &FingerReadings<N>,
        gravity: &Vector3<f64>,
        elapsed: Elapsed,
    ) -> ServoOutput<N> {
        let (position, velocity) = self.sense_positions(&sensed.position, elapsed);
        let tension = self.sense_tensions(&sensed.tension);
        let kept = self.take_holds(&position, &velocity, gravity);
        let part = self.transition.part();
        for servo in &mut self.joints {
            servo.go_on(part * elapsed.periods);
        }

        let torque = self.torques(&position, &velocity, &tension, gravity, elapsed.seconds);
        let given = core::array::from_fn(|joint| self.joints.get(joint)?.given_tensions());
        let allocated = self.arms.allocate_around(&torque, &given);
        let before = core::mem::replace(&mut self.desired, allocated.tensions);
        if core::mem::take(&mut self.changed) {
            let kept = kept.as_ref().unwrap_or(&before);
            self.transition.begin(&before, kept, &self.desired);
        }
        self.transition
            .smooth(&mut self.desired, &self.arms, elapsed.periods);

        let rates = self.arms.length_rates(&velocity);
        let mut command = self.desired;
        for (((command, servo), measured), rate) in command
            .iter_mut()
            .zip(&mut self.joints)
            .zip(&tension)
            .zip(&rates)
        {
            servo.mean.add(*command, part);
            let (desired, measured, rate) = (command.lanes(), measured.lanes(), rate.lanes());
            let tendons = &mut servo.tendons;
            let [flexor, extensor] = tendons.update_after(&desired, &measured, &rate, elapsed);
            *command = Pair { flexor, extensor };
        }
        ServoOutput {
            command,
            tension: self.desired,
            torque: self.arms.torque(&self.desired),
            position,
            velocity,
            saturated: allocated.saturated,
            lost: self.readings.lost,
        }
    }

    /// Returns the filtered positions that the sensors measure, and their rates.
    fn sense_positions(
        &mut self,
        sensed: &SVector<f64, N>,
        elapsed: Elapsed,
    ) -> (SVector<f64, N>, SVector<f64, N>) {
        let [mut positions] = sensed.data.0;
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

    /// The tensions that the sensors say, filtered.
    fn sense_tensions(&mut self, sensed: &TendonPairs<f64, N>) -> TendonPairs<f64, N> {
        let mut tensions = *sensed;
        for ((servo, tension), last) in self
            .joints
            .iter_mut()
            .zip(&mut tensions)
            .zip(&mut self.last)
        {
            keep(tension.flexor, &mut last.flexor);
            keep(tension.extensor, &mut last.extensor);
            let [flexor, extensor] = servo.tension_filter.update(&last.lanes());
            *tension = Pair { flexor, extensor };
        }
        tensions
    }

    /// Joints that change their mode take over what they have. Returns the tensions, N, from which the finger goes
    /// on then: the last ones, or the means where a joint keeps its tensions or torque; `None` if no joint does.
    fn take_holds(
        &mut self,
        position: &SVector<f64, N>,
        velocity: &SVector<f64, N>,
        gravity: &Vector3<f64>,
    ) -> Option<TendonPairs<f64, N>> {
        if self.holds.iter().all(Option::is_none) {
            return None;
        }
        let mut means = self.desired;
        for (mean, servo) in means.iter_mut().zip(&self.joints) {
            if servo.given_tensions().is_none() {
                *mean = servo.mean.tension().unwrap_or(*mean);
            }
        }
        let torque = self.arms.torque(&means);
        let loads =
            self.mechanism.gravity_torque(position, gravity) + self.stops(position, velocity);
        let mut kept = self.desired;
        for ((((((servo, hold), &position), &mean), kept), &torque), &loads) in self
            .joints
            .iter_mut()
            .zip(&mut self.holds)
            .zip(position)
            .zip(&means)
            .zip(&mut kept)
            .zip(&torque)
            .zip(&loads)
        {
            // There is no position to hold yet.
            if matches!(hold, Some(ServoMode::Position | ServoMode::Impedance)) && !servo.seen {
                continue;
            }
            if let Some(mode) = hold.take() {
                servo.take(servo.hold(mode, position, mean, torque, loads));
                self.changed = true;
                if !matches!(mode, ServoMode::Off | ServoMode::Position) {
                    *kept = mean;
                }
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
        tension: &TendonPairs<f64, N>,
        gravity: &Vector3<f64>,
        period: f64,
    ) -> SVector<f64, N> {
        // Terms that no law asks for are not computed.
        let (mut computed, mut falls, mut moves, mut turns) = (false, false, false, false);
        let (mut acceleration, mut asked) = ([0.0; N], [0.0; N]);
        for (joint, servo) in self.joints.iter().enumerate() {
            match (servo.target, servo.gains.law) {
                (JointTarget::Position(point), law) => {
                    moves = true;
                    asked[joint] = point.velocity;
                    acceleration[joint] = servo.acceleration(position[joint], velocity[joint]);
                    match law {
                        PositionLaw::ComputedTorque { .. } => computed = true,
                        PositionLaw::Pd { .. } => falls = true,
                    }
                }
                (JointTarget::Torque(_) | JointTarget::Grasp(_), _) => turns = true,
                (JointTarget::Impedance { .. }, _) => falls = true,
                (JointTarget::Off | JointTarget::Tension(_), _) => {}
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
        let measured = if turns {
            self.arms.torque(tension)
        } else {
            zero
        };

        let stop = self.stops(position, velocity);

        let mut torque = zero;
        for (joint, servo) in self.joints.iter_mut().enumerate() {
            torque[joint] = servo.torque(&Felt {
                position: position[joint],
                rate: velocity[joint],
                torque: measured[joint],
                inverse: inverse[joint],
                gravity: weight[joint],
                friction: friction[joint],
                stop: stop[joint],
                period,
            });
        }
        torque
    }

    /// The torques that keep joints from their limits and accelerate no others, N m.
    #[inline(always)]
    fn stops(&self, position: &SVector<f64, N>, velocity: &SVector<f64, N>) -> SVector<f64, N> {
        let mut inwards = SVector::<f64, N>::zeros();
        for (joint, servo) in self.joints.iter().enumerate() {
            inwards[joint] = servo.stop(position[joint], velocity[joint]);
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

/// Takes a value that is finite in place of the last one.
fn keep(value: f64, last: &mut f64) {
    if is_finite(value) {
        *last = value;
    }
}

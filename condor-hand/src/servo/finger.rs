use nalgebra::{SVector, Vector3};

use super::joint::{Felt, JointServo};
use super::{FingerSettings, JointGains, JointTarget, Mode, PositionLaw, SettingError};
use crate::control::OnePole;
use crate::dynamics::{Drive, Dynamics};
use crate::math::{Real, clamp, is_finite, max};
use crate::tendon::{Allocation, MomentArms, Pair, Pairs};
use crate::trajectory::SetPoint;

/// What the sensors of a finger say.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sensed<T: Real, const N: usize> {
    /// Positions of the joints, rad.
    pub position: SVector<T, N>,
    /// Tensions of the tendons, N.
    pub tension: Pairs<T, N>,
}

/// What a finger does with one tick.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ServoOutput<T: Real, const N: usize> {
    /// What the actuators get, N, from 0 to the most of each tendon.
    pub command: Pairs<T, N>,
    /// The tensions that it is to reach, N.
    pub tension: Pairs<T, N>,
    /// The torques of those tensions, N m.
    pub torque: SVector<T, N>,
    /// The positions that the laws have used, rad.
    pub position: SVector<T, N>,
    /// Their rates, rad/s.
    pub velocity: SVector<T, N>,
    /// A bit for each joint whose tendons cannot give the torque that it needs.
    pub saturated: u32,
}

/// The servos of one finger: its joints and their tendons.
///
/// It is called once in every tick, with what its sensors say, and gives what its actuators get. A
/// value of a sensor that is not finite counts as the last one that was. Before there was one, a
/// tension counts as the least; a joint whose position was never seen does not hold or follow
/// positions.
#[derive(Clone, Debug)]
pub struct FingerServo<M, T: Real, const N: usize> {
    mechanism: M,
    arms: MomentArms<T, N>,
    drive: Drive<T, N>,
    allocation: [Allocation<T>; N],
    joints: [JointServo<T>; N],
    /// A change of modes or gains that the next tick smooths.
    changed: bool,
    /// Joints that hold what they have in another mode from the next tick on.
    holds: [Option<Mode>; N],
    /// The tensions of the last tick, N.
    desired: Pairs<T, N>,
    /// What the last change would have added to the tensions at once, and how much of it is left.
    step: Pairs<T, N>,
    left: T,
    /// How much of a step a tick works off.
    work_off: T,
    /// The last values of the sensors that were finite.
    last: Sensed<T, N>,
}

impl<M: Dynamics<T, N>, T: Real, const N: usize> FingerServo<M, T, N> {
    /// A finger all of whose joints are off.
    ///
    /// # Errors
    ///
    /// The first setting that no finger can have.
    pub fn new(
        mechanism: M,
        arms: MomentArms<T, N>,
        settings: &FingerSettings<T, N>,
    ) -> Result<Self, SettingError> {
        const { assert!(N > 0 && N <= 32, "a finger has 1 to 32 joints") };
        for (what, value) in [
            ("ticks in a second", settings.sample_hz),
            ("time of a transition, s", settings.transition_s),
        ] {
            if !is_finite(value) || value <= T::zero() {
                let value = value.to_f64();
                return Err(SettingError::Finger { what, value });
            }
        }
        let mut joints = heapless::Vec::<_, N>::new();
        for (joint, (of_joint, row)) in settings.joints.iter().zip(arms.rows()).enumerate() {
            let own = row.get(joint).copied().unwrap_or(Pair::both(T::zero()));
            let servo = JointServo::new(joint, of_joint, own, settings.sample_hz)?;
            // As many as there is room for: both have N.
            let _ = joints.push(servo);
        }
        let count = joints.len();
        let Ok(joints) = joints.into_array() else {
            return Err(SettingError::NoJoint {
                joint: N,
                joints: count,
            });
        };
        let allocation = settings.joints.map(|joint| joint.allocation);
        let desired = allocation.map(|joint| Pair::both(joint.min_n));
        Ok(Self {
            mechanism,
            arms,
            drive: settings.drive,
            allocation,
            joints,
            changed: false,
            holds: [None; N],
            desired,
            step: [Pair::both(T::zero()); N],
            left: T::zero(),
            work_off: T::one() / max(settings.transition_s * settings.sample_hz, T::one()),
            last: Sensed {
                position: SVector::zeros(),
                tension: desired,
            },
        })
    }

    /// The mechanism that the servos have in mind.
    #[must_use]
    pub fn mechanism(&self) -> &M {
        &self.mechanism
    }

    /// The moment arms of its tendons.
    #[must_use]
    pub fn arms(&self) -> &MomentArms<T, N> {
        &self.arms
    }

    /// The target of a joint; `None` for a joint that the finger does not have.
    #[must_use]
    pub fn target(&self, joint: usize) -> Option<JointTarget<T>> {
        self.joints.get(joint).map(|servo| servo.target)
    }

    /// The mode of a joint; `None` for a joint that the finger does not have.
    #[must_use]
    pub fn mode(&self, joint: usize) -> Option<Mode> {
        let held = self.holds.get(joint).copied().flatten();
        held.or_else(|| Some(self.joints.get(joint)?.target.mode()))
    }

    /// Gives a joint a target, from the next tick on, and the mode of that target.
    ///
    /// # Errors
    ///
    /// A target that the joint cannot have; it keeps the one that it has.
    pub fn set_target(&mut self, joint: usize, target: JointTarget<T>) -> Result<(), SettingError> {
        let servo = self
            .joints
            .get_mut(joint)
            .ok_or(SettingError::NoJoint { joint, joints: N })?;
        servo.check(joint, &target)?;
        self.changed |= target.mode() != servo.target.mode();
        servo.take(target);
        if let Some(hold) = self.holds.get_mut(joint) {
            *hold = None;
        }
        Ok(())
    }

    /// The next set-point of a joint that follows positions; one that it cannot have is refused.
    #[inline]
    pub(crate) fn follow(&mut self, joint: usize, point: &SetPoint<T>) {
        let held = self.holds.get(joint).copied().flatten();
        let follows = |servo: &&mut JointServo<T>| held.is_none() && servo.may_go_on(point);
        if let Some(servo) = self.joints.get_mut(joint).filter(follows) {
            servo.target = JointTarget::Position(*point);
        } else {
            // Refused, it leaves the joint at the last one.
            let _ = self.set_target(joint, JointTarget::Position(*point));
        }
    }

    /// Gives a joint another mode, from the next tick on, in which it keeps the position, torque
    /// or tensions that it then has. A joint that is in that mode keeps its target.
    ///
    /// # Errors
    ///
    /// A joint that the finger does not have.
    pub fn set_mode(&mut self, joint: usize, mode: Mode) -> Result<(), SettingError> {
        let there_is_none = SettingError::NoJoint { joint, joints: N };
        let same = self.mode(joint).ok_or(there_is_none)? == mode;
        if let (false, Some(hold)) = (same, self.holds.get_mut(joint)) {
            *hold = Some(mode);
        }
        Ok(())
    }

    /// Switches all joints off at once, as a finger is when it is new, but for its gains: the next
    /// tick wants the least tensions, without a transition. For whoever has taken the actuators
    /// there by other means.
    pub fn rest(&mut self) {
        for servo in &mut self.joints {
            servo.rest();
        }
        self.holds = [None; N];
        self.changed = false;
        self.left = T::zero();
        self.desired = self.allocation.map(|joint| Pair::both(joint.min_n));
    }

    /// The gains of a joint; `None` for a joint that the finger does not have.
    #[must_use]
    pub fn gains(&self, joint: usize) -> Option<&JointGains<T>> {
        self.joints.get(joint).map(|servo| &servo.gains)
    }

    /// Gives a joint other gains, all at once from the next tick on.
    ///
    /// # Errors
    ///
    /// Gains that no joint can have; it keeps the ones that it has.
    pub fn set_gains(&mut self, joint: usize, gains: &JointGains<T>) -> Result<(), SettingError> {
        let servo = self
            .joints
            .get_mut(joint)
            .ok_or(SettingError::NoJoint { joint, joints: N })?;
        servo.set_gains(joint, gains)?;
        self.changed = true;
        Ok(())
    }

    /// One tick: from sensors to commands, in a gravity in the axes of the palm, m/s²; for a palm
    /// that is accelerated, less its acceleration.
    pub fn tick(&mut self, sensed: &Sensed<T, N>, gravity: &Vector3<T>) -> ServoOutput<T, N> {
        let (position, velocity, tension) = self.sense(sensed);
        self.take_holds(&position);

        let torque = self.torques(&position, &velocity, &tension, gravity);
        let given = core::array::from_fn(|joint| self.joints.get(joint)?.given_tensions());
        let allocated = self.arms.allocate_around(&torque, &self.allocation, &given);
        let desired = self.smooth(allocated.tensions);
        self.desired = desired;

        let rates = self.arms.length_rates(&velocity);
        let mut command = desired;
        for (((command, servo), measured), rate) in command
            .iter_mut()
            .zip(&mut self.joints)
            .zip(&tension)
            .zip(&rates)
        {
            let Pair { flexor, extensor } = &mut servo.tendons;
            command.flexor = flexor.update(command.flexor, measured.flexor, rate.flexor);
            command.extensor = extensor.update(command.extensor, measured.extensor, rate.extensor);
        }
        ServoOutput {
            command,
            tension: desired,
            torque: self.arms.torque(&desired),
            position,
            velocity,
            saturated: allocated.saturated,
        }
    }

    /// What the sensors say, filtered, and the rates of the joints.
    fn sense(&mut self, sensed: &Sensed<T, N>) -> (SVector<T, N>, SVector<T, N>, Pairs<T, N>) {
        fn kept<T: Real>(value: T, last: &mut T) -> T {
            if is_finite(value) {
                *last = value;
            }
            *last
        }
        fn filtered<T: Real>(filter: &mut Option<OnePole<T>>, value: T) -> T {
            match filter {
                Some(filter) => filter.update(value),
                None => value,
            }
        }
        let mut position = sensed.position;
        let mut velocity = SVector::<T, N>::zeros();
        let mut tension = sensed.tension;
        let mut changed = false;
        for (((servo, position), velocity), last) in self
            .joints
            .iter_mut()
            .zip(position.iter_mut())
            .zip(velocity.iter_mut())
            .zip(self.last.position.iter_mut())
        {
            // A filter that began with a position that never was would show a rate.
            let seen = servo.seen || is_finite(*position);
            *position = kept(*position, last);
            if seen {
                *position = filtered(&mut servo.position_filter, *position);
                *velocity = servo.velocity.update(*position);
            }
            changed |= seen != servo.seen;
            servo.seen = seen;
        }
        self.changed |= changed;
        for ((servo, tension), last) in self
            .joints
            .iter_mut()
            .zip(&mut tension)
            .zip(&mut self.last.tension)
        {
            let Pair { flexor, extensor } = &mut servo.tension_filter;
            tension.flexor = filtered(flexor, kept(tension.flexor, &mut last.flexor));
            tension.extensor = filtered(extensor, kept(tension.extensor, &mut last.extensor));
        }
        (position, velocity, tension)
    }

    /// Joints that change their mode take over what they have.
    fn take_holds(&mut self, position: &SVector<T, N>) {
        if self.holds.iter().all(Option::is_none) {
            return;
        }
        let torque = self.arms.torque(&self.desired);
        for ((((servo, hold), &position), &tension), &torque) in self
            .joints
            .iter_mut()
            .zip(&mut self.holds)
            .zip(position)
            .zip(&self.desired)
            .zip(&torque)
        {
            // There is no position to hold yet.
            if *hold == Some(Mode::Position) && !servo.seen {
                continue;
            }
            if let Some(mode) = hold.take() {
                servo.take(servo.hold(mode, position, tension, torque));
                self.changed = true;
            }
        }
    }

    /// The torques of the laws of all joints, N m.
    fn torques(
        &mut self,
        position: &SVector<T, N>,
        velocity: &SVector<T, N>,
        tension: &Pairs<T, N>,
        gravity: &Vector3<T>,
    ) -> SVector<T, N> {
        let follows = |servo: &JointServo<T>, pd: bool| {
            servo.target.mode() == Mode::Position
                && matches!(servo.gains.law, PositionLaw::Pd { .. }) == pd
        };
        let inverse = if self.joints.iter().any(|servo| follows(servo, false)) {
            let acceleration = SVector::from_fn(|joint, _| {
                let of_joint = (
                    self.joints.get(joint),
                    position.get(joint),
                    velocity.get(joint),
                );
                match of_joint {
                    (Some(servo), Some(&position), Some(&velocity)) => {
                        servo.acceleration(position, velocity)
                    }
                    _ => T::zero(),
                }
            });
            self.mechanism
                .inverse_dynamics(position, velocity, &acceleration, gravity)
                + self.drive.armature.component_mul(&acceleration)
        } else {
            SVector::zeros()
        };
        let weight = if self.joints.iter().any(|servo| follows(servo, true)) {
            self.mechanism.gravity_torque(position, gravity)
        } else {
            SVector::zeros()
        };
        let asked = SVector::from_fn(|joint, _| {
            self.joints
                .get(joint)
                .map_or(T::zero(), JointServo::asked_rate)
        });
        let friction = self.drive.torque(&asked);
        let measured = self.arms.torque(tension);

        let mut torque = SVector::<T, N>::zeros();
        for (joint, (torque, servo)) in torque.iter_mut().zip(&mut self.joints).enumerate() {
            let of = |vector: &SVector<T, N>| vector.get(joint).map_or(T::zero(), |&value| value);
            *torque = servo.torque(&Felt {
                position: of(position),
                rate: of(velocity),
                torque: of(&measured),
                inverse: of(&inverse),
                gravity: of(&weight),
                friction: of(&friction),
            });
        }
        torque
    }

    /// The tensions of the laws, without the step that a change would make at once.
    fn smooth(&mut self, mut tensions: Pairs<T, N>) -> Pairs<T, N> {
        if self.changed {
            self.changed = false;
            self.left = T::one();
            for ((step, last), new) in self.step.iter_mut().zip(&self.desired).zip(&tensions) {
                step.flexor = last.flexor - new.flexor;
                step.extensor = last.extensor - new.extensor;
            }
        }
        if self.left > T::zero() {
            for ((tension, step), allocation) in
                tensions.iter_mut().zip(&self.step).zip(&self.allocation)
            {
                let within = |tension| clamp(tension, allocation.min_n, allocation.max_n);
                tension.flexor = within(tension.flexor + self.left * step.flexor);
                tension.extensor = within(tension.extensor + self.left * step.extensor);
            }
            self.left = max(self.left - self.work_off, T::zero());
        }
        tensions
    }
}

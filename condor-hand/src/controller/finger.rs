use nalgebra::{SVector, Vector3};

use super::settings::{judge, stop_and_filters};
use super::watch::{GuardStop, Watch};
use crate::Subject;
use crate::config::{
    ActuatorNumber, ActuatorNumbers, FaultNumber, FaultPolicy, Finger, Hand, JointNumber,
    JointNumbers, Limits,
};
use crate::control::elapsed::Elapsed;
use crate::dynamics::Dynamics;
use crate::fault::{Fault, FingerMonitor, Observation, SafeRamp};
use crate::math::{clamp, max, round};
use crate::number::{NumberError, Requirement, check, finite};
use crate::servo::{
    EffortGains, FingerReadings, FingerServo, JointGains, JointTarget, ServoMode, ServoOutput,
    ServoRefusal,
};
use crate::trajectory::{Bounds, Interpolator, SetPoint, StopGuard};
use crate::transmission::{Linear, Transmission};

/// Within so many ticks after a fault joints have the efforts with which they stand still.
const SETTLING_TICKS: u32 = 4;

/// The controller of one finger of a configuration: it runs the servos of the joints and actuators,
/// follows the set-points of a master (the program that computes trajectories), and detects faults.
///
/// Call [`tick`](Self::tick) in every tick of the servo loop. After a fault the controller switches
/// all joints off, brings all efforts to rest, and keeps them there until [`clear`](Self::clear).
///
/// ```
/// # use condor_hand::config::Hand;
/// use condor_hand::controller::FingerController;
/// use condor_hand::servo::{FingerReadings, ServoMode};
///
/// # let text = std::fs::read_to_string("hands/utah-mit.toml")?;
/// # let hand = Hand::<4, 4, 8>::from_toml(&text, "utah-mit.toml")?;
/// let index = &hand.fingers[0];
/// let mut controller = FingerController::new(&hand, index, index.chain(), index.transmission()?)?;
/// controller.set_mode(0, ServoMode::Position)?;
/// let sensed = FingerReadings {
///     position: [0.0, 0.3, 0.4, 0.4].into(), // rad
///     actuator_position: [0.0; 8],
///     effort: index.efforts_at_rest(), // N
///     touch: 0.0,
/// };
/// let tick = controller.tick(&sensed, &hand.gravity.into(), 1.0 / 400.0);
/// assert_eq!(tick.fault, None);
/// println!("{:?} N", tick.output.command[0]);
/// # Ok::<_, Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug)]
pub struct FingerController<M, T, const N: usize, const A: usize> {
    servo: FingerServo<M, T, N, A>,
    interpolator: Interpolator<N>,
    /// The number of joints, and of actuators; the places after them are empty.
    joints: usize,
    actuators: usize,
    /// Joints that follow the master's set-points, or would if a guard had not stopped them, a bit each.
    following: u32,
    watch: Watch<N>,
    /// The time since the last of them came, s.
    age_s: f64,
    /// The fraction of a period that has passed since the set-points were moved on.
    over: f64,
    monitor: FingerMonitor<N, A>,
    ramp: Option<SafeRamp<A>>,
    /// The differences of the efforts at the fault from those with which the ramp begins, N or N m; and the number of
    /// ticks until they have vanished.
    beside: ([f64; A], u32),
    at_rest: [f64; A],
    low: [f64; N],
    high: [f64; N],
    faults: FaultPolicy,
    /// The numbers of the joints and the actuators that can change, beside their gains.
    numbers: [Option<JointNumbers>; N],
    actuator_numbers: [Option<ActuatorNumbers>; A],
    sample_hz: f64,
    /// Of the last tick.
    desired: [f64; A],
    command: [f64; A],
}

/// The result of one tick of a [`FingerController`]: the commands for the actuators, and the fault
/// if there is one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FingerTick<const N: usize, const A: usize> {
    /// The commands of the actuators, with their reasons; after a fault, on the way to rest.
    pub output: ServoOutput<N, A>,
    /// The efforts that count as measured, N or N m: the desired ones of actuators without a sensor.
    pub effort: [f64; A],
    /// The desired positions of the joints, rad; `None` for joints whose position is not
    /// controlled.
    pub target: [Option<f64>; N],
    /// The first fault since the last [`clear`](FingerController::clear); `None` if there was none.
    pub fault: Option<Fault>,
}

impl<M, T, const N: usize, const A: usize> FingerController<M, T, N, A>
where
    M: Dynamics<N>,
    T: Transmission<N, A>,
{
    /// Makes the controller of `finger`, one of the fingers of `hand`, with all joints off.
    /// `mechanism` is the model of the finger that the servos use: [`Finger::chain`], or
    /// [`Finger::planar`] if the finger has that form. `transmission` has its actuators:
    /// [`Finger::transmission`], or one whose arms change with the posture.
    ///
    /// # Errors
    /// [`NumberError`] for settings that [`Hand::check`] would have refused.
    pub fn new<const F: usize>(
        hand: &Hand<F, N, A>,
        finger: &Finger<N, A>,
        mechanism: M,
        transmission: T,
    ) -> Result<Self, NumberError> {
        let (servo_hz, trajectory_hz) = (hand.servo_rate_hz(finger), hand.trajectory_hz);
        let (sample_hz, master_hz) = (f64::from(servo_hz), f64::from(trajectory_hz));
        let multiple = Requirement::MultipleOf(master_hz);
        check("the rate of the servos, Hz,", sample_hz, multiple)?;
        let substeps = servo_hz.checked_div(trajectory_hz).unwrap_or(0);
        let what = "the number of servo ticks in a tick of the trajectories";
        let fits = Requirement::Within(1.0, f64::from(u16::MAX));
        check(what, f64::from(substeps), fits)?;
        let settings = finger.settings(sample_hz, hand.transition_s);
        let limits: [Option<&Limits>; N] =
            core::array::from_fn(|joint| Some(&finger.joints.get(joint)?.limits));
        // Those with which a joint moves to set-points that it begins to follow.
        let bounds = limits.map(|limits| Bounds {
            velocity: limits.map_or(1.0, |limits| limits.velocity),
            acceleration: limits.map_or(1.0, |limits| limits.acceleration),
            jerk: None,
        });
        let mut interpolator =
            Interpolator::new(substeps as u16, 1.0 / master_hz, [0.0; N], bounds)?;
        // The first tick of the master comes after a time without any.
        interpolator.step();
        let at_rest = transmission.linear().at_rest();
        let safe_s = hand.faults.safe_s;
        // So that it cannot fail when it is needed.
        SafeRamp::new(at_rest, at_rest, safe_s, sample_hz)?;
        Ok(Self {
            servo: FingerServo::new(mechanism, transmission, &settings)?,
            interpolator,
            joints: finger.joints.len(),
            actuators: finger.actuators.len(),
            following: 0,
            watch: Watch::new(finger.touch.map_or(f64::INFINITY, |touch| touch.contact_n)),
            age_s: 0.0,
            over: 0.0,
            monitor: FingerMonitor::new(finger.fault_limits(&hand.faults, sample_hz))?,
            ramp: None,
            beside: ([0.0; A], 0),
            at_rest,
            low: limits.map(|limits| limits.map_or(0.0, |limits| limits.low)),
            high: limits.map(|limits| limits.map_or(0.0, |limits| limits.high)),
            faults: hand.faults,
            numbers: finger.numbers(),
            actuator_numbers: finger.actuator_numbers(),
            sample_hz,
            desired: at_rest,
            command: at_rest,
        })
    }

    /// Returns the model of the finger's mechanism that was passed to [`new`](Self::new).
    #[must_use]
    pub fn mechanism(&self) -> &M {
        self.servo.mechanism()
    }

    /// Returns the number of actuators that the finger has, at most `A`.
    #[must_use]
    pub const fn actuators(&self) -> usize {
        self.actuators
    }

    /// Returns the number of joints that the finger has, at most `N`.
    #[must_use]
    pub const fn joints(&self) -> usize {
        self.joints
    }

    /// Returns the present mode of joint number `joint` (from 0); `None` for a joint that the
    /// finger does not have.
    #[must_use]
    pub fn mode(&self, joint: usize) -> Option<ServoMode> {
        self.check_joint(joint).ok()?;
        self.servo.mode(joint)
    }

    /// Returns the first fault since the last [`clear`](Self::clear); `None` if there was none.
    #[must_use]
    pub fn fault(&self) -> Option<Fault> {
        self.monitor.first()
    }

    /// Returns true after a fault, while the efforts go to rest or are kept there.
    /// The joints are off, and can have no other mode until this returns false.
    #[must_use]
    pub const fn is_resting(&self) -> bool {
        self.ramp.is_some()
    }

    /// Returns the stop of a joint that a guard has stopped: the guard, the measured value, and the
    /// position at which the joint rests since then. Returns `None` if no guard has stopped the
    /// joint, or if it follows its master again.
    #[must_use]
    pub fn stop(&self, joint: usize) -> Option<&GuardStop> {
        self.watch.stop(joint)
    }

    /// Returns the arms of the finger's actuators at the present posture, which convert efforts into joint torques.
    #[must_use]
    pub fn linear(&self) -> &Linear<N, A> {
        self.servo.linear()
    }

    /// Returns the joint to which an actuator [belongs](Linear::joint_of); `None` if it moves nothing, or if the finger
    /// does not have it.
    #[must_use]
    pub fn joint_of(&self, actuator: usize) -> Option<usize> {
        self.servo.joint_of(actuator)
    }

    /// Switches a joint to another mode, in which it first keeps its present position, torque or efforts. If the joint
    /// is in that mode already, nothing changes, even if it follows the master.
    ///
    /// # Errors
    /// Returns [`ServoRefusal::NoJoint`] if the finger does not have the joint; [`ServoRefusal::AfterFault`] if
    /// the finger has a fault or rests after one.
    pub fn set_mode(&mut self, joint: usize, mode: ServoMode) -> Result<(), ServoRefusal> {
        self.refuse_after_fault()?;
        self.check_joint(joint)?;
        if self.servo.mode(joint) != Some(mode) {
            self.leave(joint);
        }
        self.servo.set_mode(joint, mode)
    }

    /// Sets a constant target of a joint, and switches the joint to the mode of that target.
    ///
    /// The velocity and acceleration of a position target are feed-forward as long as the target lasts, so set them to
    /// zero to hold a position. A position in the zone of a soft stop, where no joint rests, becomes the inner end of
    /// the zone.
    ///
    /// # Errors
    /// After an error the joint keeps its target. Returns [`ServoRefusal::AfterFault`] if the finger has a
    /// fault or rests after one; [`ServoRefusal::NoJoint`] if it does not have the joint;
    /// [`ServoRefusal::Target`] if the target exceeds the limits of the joint or its actuators;
    /// [`ServoRefusal::Rate`] if its velocity or acceleration is not finite.
    pub fn set_target(&mut self, joint: usize, target: JointTarget) -> Result<(), ServoRefusal> {
        self.refuse_after_fault()?;
        self.check_joint(joint)?;
        self.servo.set_target(joint, target)?;
        self.leave(joint);
        Ok(())
    }

    /// Sets the effort of an actuator (N, or N m), and switches its joint to [`ServoMode::Effort`]. The other actuators
    /// of the joint keep the efforts that they have.
    ///
    /// # Errors
    /// Returns [`ServoRefusal::AfterFault`] if the finger has a fault or rests after one; [`ServoRefusal::NoActuator`]
    /// if it does not have the actuator; [`ServoRefusal::Effort`] if the effort is beyond its limits.
    pub fn set_effort(&mut self, actuator: usize, effort: f64) -> Result<(), ServoRefusal> {
        self.refuse_after_fault()?;
        self.servo.set_effort(actuator, effort)?;
        if let Some(joint) = self.servo.joint_of(actuator) {
            self.leave(joint);
        }
        Ok(())
    }

    /// Returns the present gains of an actuator; `None` for an actuator that the finger does not have.
    #[must_use]
    pub fn effort_gains(&self, actuator: usize) -> Option<&EffortGains> {
        self.servo.effort_gains(actuator)
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
        self.servo.set_effort_gains(actuator, gains)
    }

    /// Returns the present gains of a joint; `None` for a joint that the finger does not have.
    #[must_use]
    pub fn gains(&self, joint: usize) -> Option<&JointGains> {
        self.check_joint(joint).ok()?;
        self.servo.gains(joint)
    }

    /// Changes all gains of a joint at once, from the next tick on.
    ///
    /// # Errors
    /// [`ServoRefusal::NoJoint`] if the finger does not have the joint; [`ServoRefusal::Gain`] if no joint can
    /// have these gains. The joint keeps its gains then.
    pub fn set_gains(&mut self, joint: usize, gains: &JointGains) -> Result<(), ServoRefusal> {
        self.check_joint(joint)?;
        self.servo.set_gains(joint, gains)
    }

    /// Returns the present value of a number of a joint; `None` for a joint that the finger does not have.
    #[must_use]
    pub fn number(&self, joint: usize, number: JointNumber) -> Option<f64> {
        self.check_joint(joint).ok()?;
        let numbers = self.numbers.get(joint)?.as_ref()?;
        numbers.get(number as usize).copied()
    }

    /// Changes a number of a joint, from the next tick on: a limit, its soft stop, or a filter. Take it from its
    /// [range](Finger::ranges); 0 means no filter. What it changes of the efforts is spread over [`Hand::transition_s`], like a change of gains. A joint that is past a limit that comes nearer has
    /// a fault, as if it had gone there.
    ///
    /// # Errors
    /// [`ServoRefusal::NoJoint`] if the finger does not have the joint; [`ServoRefusal::Gain`] if no joint can
    /// have the number. The joint keeps its number then.
    pub fn set_number(
        &mut self,
        joint: usize,
        number: JointNumber,
        value: f64,
    ) -> Result<(), ServoRefusal> {
        self.check_joint(joint)?;
        let wrong = |error: NumberError| error.at(Subject::Joint(joint as u16));
        finite(number.name().0, value).map_err(wrong)?;
        let mut numbers = self.numbers;
        let Some(Some(of_joint)) = numbers.get_mut(joint) else {
            return Ok(());
        };
        if let Some(place) = of_joint.get_mut(number as usize) {
            *place = value;
        }
        let (stop, cutoffs_hz) = stop_and_filters(of_joint);
        let mut limits = *self.monitor.limits();
        judge(&mut limits, &self.faults, &numbers, &self.actuator_numbers);
        limits.check()?;
        (self.servo.set_stop_and_filters(joint, &stop, &cutoffs_hz)).map_err(wrong)?;
        self.monitor.set_limits(limits)?;
        if let (Some(low), Some(high)) = (self.low.get_mut(joint), self.high.get_mut(joint)) {
            (*low, *high) = (stop.low, stop.high);
        }
        self.numbers = numbers;
        Ok(())
    }

    /// Returns the present value of a number of an actuator; `None` for a threshold or a filter that it does not have,
    /// or an actuator that the finger does not have.
    #[must_use]
    pub fn actuator_number(&self, actuator: usize, number: ActuatorNumber) -> Option<f64> {
        let numbers = self.actuator_numbers.get(actuator)?.as_ref()?;
        numbers.get(number as usize).copied()?
    }

    /// Changes a number of an actuator, from the next tick on: a threshold of its faults, or its filter. Take it from
    /// its [range](crate::config::Actuator::ranges).
    ///
    /// # Errors
    /// [`ServoRefusal::NoActuator`] if the finger does not have the actuator, or the actuator has no such number;
    /// [`ServoRefusal::Gain`] if no actuator can have the number. The actuator keeps its number then.
    pub fn set_actuator_number(
        &mut self,
        actuator: usize,
        number: ActuatorNumber,
        value: f64,
    ) -> Result<(), ServoRefusal> {
        let mut numbers = self.actuator_numbers;
        let of_actuator = numbers.get_mut(actuator).and_then(Option::as_mut);
        let place = of_actuator.and_then(|numbers| numbers.get_mut(number as usize));
        let Some(Some(place)) = place else {
            return Err(ServoRefusal::no_actuator(actuator, self.actuators));
        };
        let wrong = |error: NumberError| error.at(Subject::Actuator(actuator as u16));
        finite(number.name().0, value).map_err(wrong)?;
        *place = value;
        let mut limits = *self.monitor.limits();
        judge(&mut limits, &self.faults, &self.numbers, &numbers);
        limits.check()?;
        if number == ActuatorNumber::Cutoff {
            let cutoff_hz = Some(value);
            (self.servo.set_effort_cutoff(actuator, cutoff_hz)).map_err(wrong)?;
        }
        self.monitor.set_limits(limits)?;
        self.actuator_numbers = numbers;
        Ok(())
    }

    /// Returns the present conditions of faults.
    #[must_use]
    pub const fn faults(&self) -> &FaultPolicy {
        &self.faults
    }

    /// Changes a condition of faults, from the next tick on. Take it from its [range](FaultPolicy::range).
    ///
    /// # Errors
    /// [`ServoRefusal::Gain`] if no finger can have the number. The condition stays then.
    pub fn set_fault_number(
        &mut self,
        number: FaultNumber,
        value: f64,
    ) -> Result<(), ServoRefusal> {
        let faults = self.faults.with(number, value);
        // So that it cannot fail when it is needed.
        SafeRamp::new(self.at_rest, self.at_rest, faults.safe_s, self.sample_hz)?;
        let mut limits = *self.monitor.limits();
        judge(&mut limits, &faults, &self.numbers, &self.actuator_numbers);
        self.monitor.set_limits(limits)?;
        self.faults = faults;
        Ok(())
    }

    /// Passes the set-points of one tick of the master, which computes the trajectories: the states
    /// that the joints must have one such tick from now. Call it once per tick of the master.
    /// Joints in [`ServoMode::Position`] follow the set-points.
    ///
    /// A joint that begins to follow moves from its present position to the set-points within its
    /// own limits of velocity and acceleration.
    ///
    /// `guards` name, for each joint, its present motion and the conditions that stop that motion;
    /// every [`tick`](Self::tick) checks the conditions. A joint that was [stopped](Self::stop)
    /// begins to follow again when its guard names another motion.
    ///
    /// # Errors
    /// [`NumberError`] for the first set-point that is not finite or too far away; all set-points
    /// and guards are ignored then.
    pub fn follow(
        &mut self,
        points: &[SetPoint; N],
        guards: &[StopGuard; N],
    ) -> Result<(), NumberError> {
        let released = self.watch.released(guards);
        let following = self.following & !released;
        let joins = |joint: usize| {
            following & 1 << joint == 0 && self.servo.mode(joint) == Some(ServoMode::Position)
        };
        if (0..N).any(joins) {
            self.follow_anew(points, following)?;
        } else {
            self.interpolator.tick(points)?;
        }
        self.watch.release(released);
        self.watch.guard(guards);
        self.age_s = 0.0;
        Ok(())
    }

    /// Takes the set-points, of which some are for joints that begin to follow now or follow again.
    #[cold]
    fn follow_anew(
        &mut self,
        points: &[SetPoint; N],
        mut following: u32,
    ) -> Result<(), NumberError> {
        let mut interpolator = self.interpolator.clone();
        interpolator.tick(points)?;
        for joint in 0..N {
            let bit = 1 << joint;
            if following & bit != 0 || self.servo.mode(joint) != Some(ServoMode::Position) {
                continue;
            }
            // A mode that begins with the next tick holds a position only then.
            if let Some(JointTarget::Position(held)) = self.servo.target(joint) {
                interpolator.join(joint, &held)?;
                following |= bit;
            }
        }
        self.interpolator = interpolator;
        self.following = following;
        Ok(())
    }

    /// Clears the latched faults. Once all efforts have gone to rest, the joints, which are still off, can be switched to another mode.
    pub fn clear(&mut self) {
        self.monitor.clear();
    }

    /// Runs one tick of the servo loop: takes the sensor readings, and returns the commands for the
    /// actuators.
    ///
    /// `gravity` is the gravity in the axes of the palm less the acceleration of the palm, m/s².
    /// `period_s` is the measured time since the last tick, s; for the first tick, one period.
    /// Rates, ages and set-points depend on it. If it is not finite or not above zero, the laws use
    /// one period of [`Hand::servo_rate_hz`] instead; if that lasts for some ticks, it is a fault.
    pub fn tick(
        &mut self,
        sensed: &FingerReadings<N, A>,
        gravity: &Vector3<f64>,
        period_s: f64,
    ) -> FingerTick<N, A> {
        let elapsed = Elapsed::new(period_s, self.sample_hz);
        let mut sensed = *sensed;
        let efforts = sensed.effort.iter_mut().zip(self.servo.sensed());
        for ((effort, is_sensed), desired) in efforts.zip(&self.desired) {
            if !is_sensed {
                *effort = *desired;
            }
        }
        let sensed = &sensed;
        if self.watch.watches(self.following) {
            self.check_guards(sensed);
        }
        let target = self.aim(elapsed.periods);
        self.age_s += elapsed.seconds;
        let age_s = if self.following == 0 { 0.0 } else { self.age_s };
        let mut output = self.servo.tick_after(sensed, gravity, elapsed);
        let fault = self.monitor.update(&Observation {
            desired_efforts: &self.desired,
            efforts: &sensed.effort,
            desired_positions: &target,
            positions: &sensed.position,
            actuator_positions: &sensed.actuator_position,
            arms: self.servo.linear().arms(),
            lost: output.lost,
            believed: &output.position,
            rates: &output.velocity,
            period_s,
            set_point_age_s: age_s,
        });
        if fault.is_some() && self.ramp.is_none() {
            self.give_up(&output.position, gravity);
        }
        if fault.is_none() && self.ramp.is_some_and(|ramp| ramp.is_done()) {
            self.ramp = None;
        }
        if let Some(ramp) = &mut self.ramp {
            let mut efforts = ramp.update();
            let (beside, left) = &mut self.beside;
            *left = left.saturating_sub(1);
            let part = f64::from(*left) / f64::from(SETTLING_TICKS);
            let linear = self.servo.linear();
            let all = efforts.iter_mut().zip(beside).zip(linear.limits());
            for ((effort, beside), limits) in all {
                let (low, high) = limits.command_range();
                *effort = clamp(*effort + part * *beside, low, high);
            }
            output.command = efforts;
            output.effort = efforts;
            output.torque = linear.torque(&efforts);
            output.saturated = 0;
            // Nothing of the way down is left in the servos when they command again.
            self.servo.rest();
            self.servo.forget_positions();
        }
        self.desired = output.effort;
        self.command = output.command;
        FingerTick {
            output,
            effort: sensed.effort,
            target,
            fault,
        }
    }

    /// Returns the positions of the joints (rad) without implausible readings, for control laws
    /// outside of this controller.
    ///
    /// `position` are the sensor readings for the next tick, which is `period_s` seconds after the
    /// last one. A reading that is not finite, or that jumps, is replaced by the position to which
    /// the rate of the joint leads.
    #[must_use]
    pub fn plausible(&self, position: &SVector<f64, N>, period_s: f64) -> SVector<f64, N> {
        self.servo.plausible(position, period_s)
    }

    /// The set-points of this tick, given to the joints that follow.
    fn aim(&mut self, periods: f64) -> [Option<f64>; N] {
        // A period for each tick, unless ticks and periods have come apart.
        self.over += periods;
        let whole = if self.over > 0.0 && self.over < 2.0 {
            1.0
        } else {
            max(round(self.over), 0.0)
        };
        self.over -= whole;
        #[allow(
            clippy::cast_sign_loss,
            clippy::cast_possible_truncation,
            reason = "not below 0, and what is too large is the most"
        )]
        self.interpolator.advance(whole as u32);
        let led = self.following & !self.watch.stopped();
        if led != 0 {
            self.lead(led);
        }
        core::array::from_fn(|joint| match self.servo.target(joint) {
            Some(JointTarget::Position(point)) => Some(point.position),
            _ => None,
        })
    }

    /// Stops the joints of the motions whose guards do not permit what is measured, where their
    /// set-points are.
    #[cold]
    fn check_guards(&mut self, sensed: &FingerReadings<N, A>) {
        let before = self.watch.stopped();
        let servo = &self.servo;
        self.watch.check(
            self.following,
            sensed,
            servo.linear(),
            |joint| match servo.target(joint) {
                Some(JointTarget::Position(point)) => Some(point.position),
                _ => None,
            },
        );
        let after = self.watch.stopped() & !before;
        for joint in (0..N).filter(|joint| after >> joint & 1 == 1) {
            if let Some(stop) = self.watch.stop(joint) {
                self.servo.follow(joint, &SetPoint::rest(stop.position));
            }
        }
    }

    /// Applies their set-points to these joints, which follow.
    #[inline(always)]
    fn lead(&mut self, led: u32) {
        let points = self.interpolator.set_points();
        let limits = self.low.iter().zip(&self.high);
        for (joint, (point, (&low, &high))) in points.iter().zip(limits).enumerate() {
            if led & (1 << joint) == 0 {
                continue;
            }
            let position = clamp(point.position, low, high);
            if position == point.position {
                self.servo.follow(joint, point);
            } else {
                self.servo.follow(joint, &SetPoint::rest(position));
            }
        }
    }

    /// On a fault: all joints off, and all efforts on their way to rest.
    ///
    /// The last efforts of a joint that follows positions may be wrong, and would move it until all are at rest. So the
    /// actuators of such a joint begin with the efforts that hold it still; all others begin with their last ones.
    #[cold]
    fn give_up(&mut self, position: &SVector<f64, N>, gravity: &Vector3<f64>) {
        let weight = self.servo.mechanism().gravity_torque(position, gravity);
        let still = self.servo.still(&self.command, &weight);
        self.servo.rest();
        self.following = 0;
        self.watch.release(u32::MAX);
        // The last commands are finite: those of the first tick are at rest.
        let ramp = |from| SafeRamp::new(from, self.at_rest, self.faults.safe_s, self.sample_hz);
        let (begin, ramp) = match ramp(still) {
            Ok(ramp) => (still, Some(ramp)),
            Err(_) => (self.command, ramp(self.command).ok()),
        };
        let mut beside = self.command;
        for (beside, begin) in beside.iter_mut().zip(&begin) {
            *beside -= begin;
        }
        self.beside = (beside, SETTLING_TICKS);
        self.ramp = ramp;
    }

    fn refuse_after_fault(&self) -> Result<(), ServoRefusal> {
        match (self.monitor.first(), self.ramp) {
            (None, None) => Ok(()),
            _ => Err(ServoRefusal::AfterFault),
        }
    }

    fn check_joint(&self, joint: usize) -> Result<(), ServoRefusal> {
        let joints = self.joints;
        if joint < joints {
            Ok(())
        } else {
            Err(ServoRefusal::no_joint(joint, joints))
        }
    }

    /// A joint that is told what to do by itself does not follow until the master's next tick.
    fn leave(&mut self, joint: usize) {
        self.following &= !(1 << joint);
        self.watch.release(1 << joint);
    }
}

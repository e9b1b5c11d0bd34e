use heapless::Vec;
use nalgebra::{SVector, Vector3};

use super::{GraspOrder, GraspReason, GraspReport, GraspState, HandJoints, MOST_FINGERS};
use crate::config::Finger;
use crate::controller::FingerController;
use crate::dynamics::Dynamics;
use crate::grasp::{FingerState, GraspStiffness, TorqueLimits};
use crate::kinematics::Kinematics;
use crate::math::clamp;
use crate::servo::{JointTarget, ServoMode, ServoRefusal};
use crate::transmission::Transmission;

/// The time within which all fingers are to have the order, s.
const PATIENCE_S: f64 = 0.25;

/// The parts of the controller of a finger with N joints that a [`DistributedGrasp`] uses; [`FingerController`] has the
/// documentation of each.
pub trait GraspedFinger<const N: usize> {
    /// Returns the number of joints.
    fn joints(&self) -> usize;
    /// Returns the mode of a joint.
    fn mode(&self, joint: usize) -> Option<ServoMode>;
    /// Returns true if the finger has a fault.
    fn has_fault(&self) -> bool;
    /// Returns the positions of the joints, rad, without implausible readings.
    fn plausible(&self, position: &SVector<f64, N>, period_s: f64) -> SVector<f64, N>;
    /// Switches a joint to another mode.
    ///
    /// # Errors
    /// A [`ServoRefusal`] if the finger refuses the mode.
    fn set_mode(&mut self, joint: usize, mode: ServoMode) -> Result<(), ServoRefusal>;
    /// Sets the target of a joint.
    ///
    /// # Errors
    /// A [`ServoRefusal`] if the finger refuses the target.
    fn set_target(&mut self, joint: usize, target: JointTarget) -> Result<(), ServoRefusal>;
}

impl<M, T, const N: usize, const A: usize> GraspedFinger<N> for FingerController<M, T, N, A>
where
    M: Dynamics<N>,
    T: Transmission<N, A>,
{
    fn joints(&self) -> usize {
        self.joints()
    }

    fn mode(&self, joint: usize) -> Option<ServoMode> {
        self.mode(joint)
    }

    fn has_fault(&self) -> bool {
        self.fault().is_some()
    }

    fn plausible(&self, position: &SVector<f64, N>, period_s: f64) -> SVector<f64, N> {
        self.plausible(position, period_s)
    }

    fn set_mode(&mut self, joint: usize, mode: ServoMode) -> Result<(), ServoRefusal> {
        self.set_mode(joint, mode)
    }

    fn set_target(&mut self, joint: usize, target: JointTarget) -> Result<(), ServoRefusal> {
        self.set_target(joint, target)
    }
}

/// Access to the controllers of the fingers that a processor serves, for a [`DistributedGrasp`].
///
/// An array `[Option<FingerController>; F]` implements this trait, and so does the `HandLoop` of
/// condor-robot.
pub trait FingerControllers<const N: usize> {
    /// The controller of a finger.
    type Controller: GraspedFinger<N>;
    /// Returns the controller of a finger of the hand; `None` if the processor does not serve it.
    fn of_finger(&mut self, finger: usize) -> Option<&mut Self::Controller>;
}

impl<C: GraspedFinger<N>, const F: usize, const N: usize> FingerControllers<N> for [Option<C>; F] {
    type Controller = C;

    fn of_finger(&mut self, finger: usize) -> Option<&mut C> {
        self.get_mut(finger)?.as_mut()
    }
}

/// The data from other processors that a [`DistributedGrasp`] needs in one tick: a new order of the
/// master, and the joints of the fingers that this processor does not serve.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct GraspInputs<const F: usize, const N: usize> {
    /// The order that has come since the last tick, with its number, which is not 0; `None` if none
    /// has come.
    pub order: Option<(u64, GraspOrder)>,
    /// The joints of the fingers on other processors, as of the tick before; fingers whose
    /// processor sends nothing are left out. `None` if there are no other processors.
    pub others: Option<HandJoints<F, N>>,
}

/// The part of a grasp that runs in the servo loop of one processor: the grasp law for each finger
/// that the processor serves. The hand has `F` fingers of `N` joints.
///
/// In every tick call [`joints`](Self::joints), pass the result to the other processors, and then
/// call [`step`](Self::step).
#[derive(Debug)]
pub struct DistributedGrasp<M, const F: usize, const N: usize> {
    members: [(M, TorqueLimits<N>); F],
    holders: [Option<Holder<F, N>>; F],
    /// The joints of the tick before.
    former: HandJoints<F, N>,
    report: GraspReport,
}

/// The law for one finger.
#[derive(Debug)]
struct Holder<const F: usize, const N: usize> {
    /// Its number in the hand.
    finger: usize,
    /// The order in force, and what was in force when it came.
    order: GraspOrder,
    from: GraspOrder,
    since_s: f64,
    /// 0 without one.
    number: u64,
    law: Option<Law<N>>,
    waited_s: f64,
    has_joined: bool,
    report: GraspReport,
}

/// A step of the law: what it is computed from, and the controllers that get its torques.
struct Step<'s, M, C, const F: usize, const N: usize> {
    members: &'s [(M, TorqueLimits<N>); F],
    /// The fingers of this processor, as they are now.
    own: &'s HandJoints<F, N>,
    /// All fingers that are known, as they were in the tick before.
    former: HandJoints<F, N>,
    gravity: &'s Vector3<f64>,
    period_s: f64,
    controllers: &'s mut C,
}

/// The law, for as many fingers as hold.
#[derive(Clone, Copy, Debug)]
#[allow(
    clippy::large_enum_variant,
    reason = "nothing is allocated, and five fingers need the room"
)]
enum Law<const N: usize> {
    Three(Grip<3, N>),
    Four(Grip<4, N>),
    Five(Grip<5, N>),
}

/// The law for `H` fingers that hold.
#[derive(Clone, Copy, Debug)]
struct Grip<const H: usize, const N: usize> {
    /// Their numbers in the hand.
    fingers: [usize; H],
    law: GraspStiffness<H, N>,
}

impl<M, const F: usize, const N: usize> DistributedGrasp<M, F, N>
where
    M: Kinematics<N> + Dynamics<N>,
{
    /// Makes the part of a grasp for one processor. `fingers` are the configurations and mechanisms
    /// of all fingers of the hand, at most [`MOST_FINGERS`]; `served[i]` is true if this processor
    /// serves finger *i*.
    pub fn new<const A: usize>(fingers: [(&Finger<N, A>, M); F], served: [bool; F]) -> Self {
        const { assert!(F <= MOST_FINGERS) };
        let mut holders = [const { None }; F];
        for (finger, (holder, served)) in holders.iter_mut().zip(served).enumerate() {
            *holder = served.then(|| Holder::new(finger));
        }
        Self {
            members: fingers.map(|(finger, mechanism)| {
                let limits = TorqueLimits::symmetric(&finger.own_torques());
                (mechanism, limits)
            }),
            holders,
            former: HandJoints::NONE,
            report: GraspReport::NOTHING,
        }
    }

    /// Returns the joints of this processor's fingers in this tick, to pass to [`step`](Self::step)
    /// and to the other processors.
    ///
    /// `position` are the measured positions of this tick (rad), and `velocity` the filtered rates
    /// that the servos returned in the tick before (rad/s). `period_s` is the time between the two
    /// ticks, s. A position that is not plausible is replaced by the one from which the servo
    /// continues, so a lost reading does not end a grasp.
    #[must_use]
    pub fn joints(
        &self,
        mut position: [[f64; N]; F],
        velocity: [[f64; N]; F],
        period_s: f64,
        controllers: &mut impl FingerControllers<N>,
    ) -> HandJoints<F, N> {
        for (finger, position) in position.iter_mut().enumerate() {
            if let Some(finger) = controllers.of_finger(finger) {
                *position = finger.plausible(&(*position).into(), period_s).into();
            }
        }
        let served = (0..).zip(&self.holders);
        HandJoints {
            position,
            velocity,
            order: (self.holders.each_ref()).map(|it| it.as_ref().map_or(0, |it| it.number)),
            served: served.fold(0, |bits, (finger, it)| {
                bits | u64::from(it.is_some()) << finger
            }),
        }
    }

    /// Returns the report of the last [`step`](Self::step): the state of the grasp on this
    /// processor.
    #[must_use]
    pub const fn report(&self) -> &GraspReport {
        &self.report
    }

    /// Runs one tick of the grasp; call it before the tick of the servos. It sets the torques of
    /// the fingers that hold as targets of `controllers`.
    ///
    /// `own` is the result of [`joints`](Self::joints) for this tick. `gravity` is in the axes of
    /// the palm, m/s², and `period_s` is the time since the last tick, s. Without a grasp in force
    /// and without an order, the call only stores the joints for the next tick.
    pub fn step(
        &mut self,
        own: &HandJoints<F, N>,
        inputs: &GraspInputs<F, N>,
        gravity: &Vector3<f64>,
        period_s: f64,
        controllers: &mut impl FingerControllers<N>,
    ) {
        let mut former = core::mem::replace(&mut self.former, *own);
        if let Some(others) = &inputs.others {
            former.add(others);
        }
        let mut step = Step {
            members: &self.members,
            own,
            former,
            gravity,
            period_s,
            controllers,
        };
        for holder in self.holders.iter_mut().flatten() {
            holder.report = step.advance(holder, inputs.order.as_ref());
        }
        // Of equal ones the first.
        let reports = self.holders.iter().flatten().rev();
        let report = reports.map(|holder| holder.report);
        self.report = report
            .max_by_key(GraspReport::weight)
            .unwrap_or(GraspReport::NOTHING);
    }
}

impl<const F: usize, const N: usize> Holder<F, N> {
    const fn new(finger: usize) -> Self {
        Self {
            finger,
            order: GraspOrder::RELEASE,
            from: GraspOrder::RELEASE,
            since_s: 0.0,
            number: 0,
            law: None,
            waited_s: 0.0,
            has_joined: false,
            report: GraspReport::NOTHING,
        }
    }

    /// The order as far as it has been ramped up.
    fn now(&self) -> GraspOrder {
        let part = if self.order.ramp_s > 0.0 {
            clamp(self.since_s / self.order.ramp_s, 0.0, 1.0)
        } else {
            1.0
        };
        self.order.after(&self.from, part)
    }

    /// Returns true if the joints of all fingers that hold are known.
    fn hears(&mut self, others: &HandJoints<F, N>, period_s: f64) -> Result<bool, GraspReason> {
        let is_patient = self.waited_s < PATIENCE_S;
        self.waited_s += period_s;
        let mut partners = self.order.holding().filter(|&finger| finger != self.finger);
        let all = partners.clone().all(|finger| others.serves(finger));
        let has_order = |finger: usize| others.order.get(finger).is_some_and(|&it| it != 0);
        if all && partners.all(has_order) {
            self.has_joined = true;
            return Ok(true);
        }
        // Until they have seen the order their joints may be known all the same.
        if !self.has_joined && is_patient && (all || self.law.is_none()) {
            return Ok(all);
        }
        Err(GraspReason::Partner)
    }
}

impl<M, C, const F: usize, const N: usize> Step<'_, M, C, F, N>
where
    M: Kinematics<N> + Dynamics<N>,
    C: FingerControllers<N>,
{
    fn advance(
        &mut self,
        holder: &mut Holder<F, N>,
        order: Option<&(u64, GraspOrder)>,
    ) -> GraspReport {
        if let Some(&(number, ref order)) = order {
            if order.fingers != 0
                && let Err(reason) = order.check(F)
            {
                return GraspReport::new(number, GraspState::Refused, reason);
            }
            if order.fingers >> holder.finger & 1 == 0 {
                self.let_go(holder);
                return GraspReport::new(number, GraspState::Idle, GraspReason::None);
            }
            self.take(holder, number, order);
        }
        if holder.number == 0 {
            return holder.report;
        }
        self.hold(holder).unwrap_or_else(|reason| {
            let number = holder.number;
            self.let_go(holder);
            GraspReport::new(number, GraspState::Left, reason)
        })
    }

    /// Puts an order into force.
    fn take(&mut self, holder: &mut Holder<F, N>, number: u64, order: &GraspOrder) {
        if holder.law.is_some() && order.fingers == holder.order.fingers {
            holder.from = holder.now();
        } else {
            self.let_go(holder);
            holder.waited_s = 0.0;
            holder.has_joined = false;
            holder.from = GraspOrder {
                tips: order.tips,
                ..GraspOrder::RELEASE
            };
        }
        holder.order = *order;
        holder.since_s = 0.0;
        holder.number = number;
    }

    fn hold(&mut self, holder: &mut Holder<F, N>) -> Result<GraspReport, GraspReason> {
        let mut report = GraspReport::new(holder.number, GraspState::Waiting, GraspReason::None);
        if !holder.hears(&self.former, self.period_s)? {
            return Ok(report);
        }
        report.state = GraspState::Holding;
        if holder.law.is_none() {
            holder.law = Some(self.engage(holder)?);
        } else {
            self.check_modes(holder.finger)?;
        }
        let now = holder.now();
        holder.since_s += self.period_s;
        let torques = match &mut holder.law {
            Some(Law::Three(grip)) => self.update(grip, holder.finger, &now, &mut report),
            Some(Law::Four(grip)) => self.update(grip, holder.finger, &now, &mut report),
            Some(Law::Five(grip)) => self.update(grip, holder.finger, &now, &mut report),
            None => None,
        };
        let torques = torques.ok_or(GraspReason::Law)?;
        let finger = self.controllers.of_finger(holder.finger);
        let finger = finger.ok_or(GraspReason::Fault)?;
        for (joint, &torque) in torques.iter().enumerate().take(finger.joints()) {
            let set = finger.set_target(joint, JointTarget::Grasp(torque));
            set.map_err(|_| GraspReason::Fault)?;
        }
        Ok(report)
    }

    /// Checks that all joints are in the mode that the law gave them.
    fn check_modes(&mut self, finger: usize) -> Result<(), GraspReason> {
        let finger = self.controllers.of_finger(finger);
        let finger = finger.ok_or(GraspReason::Fault)?;
        if (0..finger.joints()).all(|joint| finger.mode(joint) == Some(ServoMode::Grasp)) {
            return Ok(());
        }
        Err(if finger.has_fault() {
            GraspReason::Fault
        } else {
            GraspReason::Switched
        })
    }

    /// Takes the present tips as the desired ones.
    fn engage(&self, holder: &mut Holder<F, N>) -> Result<Law<N>, GraspReason> {
        let mut holding = Vec::<_, F>::new();
        for finger in holder.order.holding() {
            // As many as there are.
            let _ = holding.push(finger);
        }
        let law = match *holding.as_slice() {
            [a, b, c] => self.grip([a, b, c], holder).map(Law::Three),
            [a, b, c, d] => self.grip([a, b, c, d], holder).map(Law::Four),
            [a, b, c, d, e] => self.grip([a, b, c, d, e], holder).map(Law::Five),
            _ => return Err(GraspReason::Fingers),
        };
        law.ok_or(GraspReason::Law)
    }

    fn grip<const H: usize>(
        &self,
        fingers: [usize; H],
        holder: &mut Holder<F, N>,
    ) -> Option<Grip<H, N>> {
        let states = self.states(holder.finger, &fingers)?;
        let order = GraspOrder {
            force: [0.0; 3],
            moment: [0.0; 3],
            squeeze_n: 0.0,
            ..holder.order
        };
        let tuning = order.tuning(self.limits(&fingers)?).ok()?;
        let law = GraspStiffness::engage(&states, tuning).ok()?;
        for (&finger, state) in fingers.iter().zip(&states) {
            if let Some(tip) = holder.from.tips.get_mut(finger) {
                *tip = state.tip.into();
            }
        }
        Some(Grip { fingers, law })
    }

    /// One step of the law: the torques of finger `own`. The rest goes into the report.
    fn update<const H: usize>(
        &self,
        grip: &mut Grip<H, N>,
        own: usize,
        now: &GraspOrder,
        report: &mut GraspReport,
    ) -> Option<SVector<f64, N>> {
        let Grip { fingers, law } = grip;
        law.set_tuning(now.tuning(self.limits(fingers)?).ok()?)
            .ok()?;
        let tip = |finger: usize| now.tips.get(finger).copied().unwrap_or_default();
        law.set_desired(&fingers.map(|finger| Vector3::from(tip(finger))))
            .ok()?;
        let output = law.update(&self.states(own, fingers)?).ok()?;
        report.squeeze_share = output.squeeze_share;
        let deviation = output.deviation;
        let deviation = deviation.linear.iter().chain(&deviation.angular);
        for (place, part) in report.deviation.iter_mut().zip(deviation) {
            *place = *part;
        }
        for (&finger, margin) in fingers.iter().zip(output.margins) {
            *report.margins.get_mut(finger)? = margin;
        }
        let mut torques = fingers.iter().zip(output.torques);
        torques.find_map(|(&finger, torques)| (finger == own).then_some(torques))
    }

    fn limits<const H: usize>(&self, fingers: &[usize; H]) -> Option<[TorqueLimits<N>; H]> {
        let mut limits = [TorqueLimits::none(); H];
        for (limits, &finger) in limits.iter_mut().zip(fingers) {
            *limits = self.members.get(finger)?.1;
        }
        Some(limits)
    }

    /// The fingers as the law of finger `own` sees them: it as it is now, the others as they were.
    fn states<const H: usize>(
        &self,
        own: usize,
        fingers: &[usize; H],
    ) -> Option<[FingerState<N>; H]> {
        let mut states = Vec::<_, H>::new();
        for &finger in fingers {
            let joints = if finger == own {
                self.own
            } else {
                &self.former
            };
            let q = (*joints.position.get(finger)?).into();
            let qd = (*joints.velocity.get(finger)?).into();
            let (mechanism, _) = self.members.get(finger)?;
            let weight = mechanism.gravity_torque(&q, self.gravity);
            // As many as there are.
            let _ = states.push(FingerState::new(mechanism, &q, &qd, &weight));
        }
        states.into_array().ok()
    }

    /// Ends the grasp; joints that held stay where they are.
    fn let_go(&mut self, holder: &mut Holder<F, N>) {
        if holder.law.is_some()
            && let Some(finger) = self.controllers.of_finger(holder.finger)
        {
            for joint in 0..N {
                if finger.mode(joint) == Some(ServoMode::Grasp) {
                    // After a fault the finger has its own way to rest.
                    let _ = finger.set_mode(joint, ServoMode::Position);
                }
            }
        }
        holder.law = None;
        holder.number = 0;
        holder.order = GraspOrder::RELEASE;
    }
}

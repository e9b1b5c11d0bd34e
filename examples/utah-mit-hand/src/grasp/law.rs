//! [`Grasp`]: the grasp in the servo loop of one processor.

use condor_hand::config::{Finger, Joint};
use condor_hand::controller::FingerController;
use condor_hand::dynamics::Dynamics;
use condor_hand::grasp::{FingerState, GraspError, GraspOutput, GraspStiffness, TorqueLimits};
use condor_hand::kinematics::PlanarFinger;
use condor_hand::math::{clamp, min};
use condor_hand::message::ServoLoop;
use condor_hand::servo::{JointTarget, Mode};
use condor_mbox::MemoryWindow;
use nalgebra::{Vector3, Vector4};

use super::{GraspState, Joints, LEAST_FINGERS, Order, Reason, Report, Told};
use crate::{FINGERS, JOINTS};

/// The time within which all fingers are to have the order, s.
const PATIENCE_S: f64 = 0.25;

/// The controllers of the fingers that this processor serves.
pub(crate) trait Own {
    /// That of a finger of the hand.
    fn finger(&mut self, finger: usize) -> Option<&mut FingerController<PlanarFinger, JOINTS>>;
}

impl<W: MemoryWindow> Own for ServoLoop<'_, PlanarFinger, W, FINGERS, JOINTS> {
    fn finger(&mut self, finger: usize) -> Option<&mut FingerController<PlanarFinger, JOINTS>> {
        self.controller_mut(finger)
    }
}

/// What this processor measures of its fingers; NaN of all others.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Felt {
    pub(crate) position: [Vector4<f64>; FINGERS],
    pub(crate) velocity: [Vector4<f64>; FINGERS],
}

impl Felt {
    /// Puts in the place of a position that cannot be, the one that the servos will go on from: a law
    /// of the whole hand outlives a lost reading.
    pub(crate) fn believe(&mut self, period_s: f64, own: &mut impl Own) {
        for (finger, position) in self.position.iter_mut().enumerate() {
            if let Some(finger) = own.finger(finger) {
                *position = finger.plausible(position, period_s);
            }
        }
    }
}

/// A finger of the hand.
#[derive(Clone, Copy, Debug)]
struct Member {
    mechanism: PlanarFinger,
    limits: TorqueLimits<f64, JOINTS>,
}

/// The grasp of one servo processor: the law for each finger that it serves.
pub(crate) struct Grasp {
    members: [Member; FINGERS],
    holders: [Option<Holder>; FINGERS],
    report: Report,
}

/// The law for one finger.
struct Holder {
    /// Its number in the hand.
    finger: usize,
    /// The order in force, and what was in force when it came.
    order: Order,
    from: Order,
    since_s: f64,
    /// 0 without one.
    number: u64,
    law: Option<Law>,
    waited_s: f64,
    has_joined: bool,
    report: Report,
}

/// What a law is computed from in a tick.
struct Scene<'s> {
    members: &'s [Member; FINGERS],
    felt: &'s Felt,
    /// All fingers that are known, as they were in the tick before.
    others: &'s Joints,
    gravity: &'s Vector3<f64>,
}

/// The law, for as many fingers as hold.
#[derive(Clone, Copy)]
#[allow(
    clippy::large_enum_variant,
    reason = "nothing is allocated, and four fingers need the room"
)]
enum Law {
    Three([usize; 3], GraspStiffness<f64, 3, JOINTS>),
    Four([usize; 4], GraspStiffness<f64, 4, JOINTS>),
}

/// One step of the law.
struct Step {
    /// Of each finger of the hand, whether or not it holds.
    torques: [Vector4<f64>; FINGERS],
    squeeze_share: f64,
    deviation: [f64; 6],
    margins: [f64; FINGERS],
}

impl Grasp {
    /// No grasp yet, of a hand of these fingers, on a processor that serves some of them.
    pub(crate) fn new(
        fingers: &[(&Finger<JOINTS>, PlanarFinger); FINGERS],
        served: [bool; FINGERS],
    ) -> Self {
        let torque = |joint: &Joint<JOINTS>| {
            min(
                joint.flexor.arm_m * (joint.flexor.max_n - joint.flexor.min_n),
                -joint.extensor.arm_m * (joint.extensor.max_n - joint.extensor.min_n),
            )
        };
        let mut holders = [const { None }; FINGERS];
        for (finger, (holder, served)) in holders.iter_mut().zip(served).enumerate() {
            *holder = served.then(|| Holder::new(finger));
        }
        Self {
            members: fingers.map(|(finger, mechanism)| Member {
                mechanism,
                limits: TorqueLimits::symmetric(&finger.each(torque)),
            }),
            holders,
            report: Report::NOTHING,
        }
    }

    /// The number of the order in force for each finger; 0 for none.
    pub(crate) fn orders(&self) -> [u64; FINGERS] {
        let mut orders = [0; FINGERS];
        for (order, holder) in orders.iter_mut().zip(&self.holders) {
            *order = holder.as_ref().map_or(0, |holder| holder.number);
        }
        orders
    }

    /// The last report.
    pub(crate) const fn report(&self) -> &Report {
        &self.report
    }

    /// One tick, before that of the servos. Without a grasp in force and without an order it looks at
    /// nothing that it is told.
    pub(crate) fn step(
        &mut self,
        felt: &Felt,
        others: &Joints,
        gravity: &Vector3<f64>,
        told: &Told,
        period_s: f64,
        own: &mut impl Own,
    ) {
        let scene = Scene {
            members: &self.members,
            felt,
            others,
            gravity,
        };
        let mut report: Option<Report> = None;
        for holder in self.holders.iter_mut().flatten() {
            holder.report = holder.advance(&scene, told, period_s, own);
            report = Some(report.map_or(holder.report, |report| report.or(holder.report)));
        }
        self.report = report.unwrap_or(Report::NOTHING);
    }
}

impl Holder {
    const fn new(finger: usize) -> Self {
        Self {
            finger,
            order: Order::RELEASE,
            from: Order::RELEASE,
            since_s: 0.0,
            number: 0,
            law: None,
            waited_s: 0.0,
            has_joined: false,
            report: Report::NOTHING,
        }
    }

    fn advance(
        &mut self,
        scene: &Scene<'_>,
        told: &Told,
        period_s: f64,
        own: &mut impl Own,
    ) -> Report {
        if let Some((number, order)) = told.order {
            if order.fingers == 0 {
                self.let_go(own);
                return Report::new(number, GraspState::Idle, Reason::None);
            }
            if let Err(reason) = check(scene, &order) {
                return Report::new(number, GraspState::Refused, reason);
            }
            if order.fingers >> self.finger & 1 == 0 {
                self.let_go(own);
                return Report::new(number, GraspState::Idle, Reason::None);
            }
            self.take(number, &order, own);
        }
        if self.number == 0 {
            return self.report;
        }
        match self.hold(scene, period_s, own) {
            Ok(report) => report,
            Err(reason) => {
                let number = self.number;
                self.let_go(own);
                Report::new(number, GraspState::Left, reason)
            }
        }
    }

    /// Puts an order into force.
    fn take(&mut self, number: u64, order: &Order, own: &mut impl Own) {
        if self.law.is_some() && order.fingers == self.order.fingers {
            self.from = self.now();
        } else {
            self.let_go(own);
            self.waited_s = 0.0;
            self.has_joined = false;
            self.from = Order {
                tips: order.tips,
                ..Order::RELEASE
            };
        }
        self.order = *order;
        self.since_s = 0.0;
        self.number = number;
    }

    /// The order as far as it has been ramped up.
    fn now(&self) -> Order {
        let part = if self.order.ramp_s > 0.0 {
            clamp(self.since_s / self.order.ramp_s, 0.0, 1.0)
        } else {
            1.0
        };
        self.order.after(&self.from, part)
    }

    fn hold(
        &mut self,
        scene: &Scene<'_>,
        period_s: f64,
        own: &mut impl Own,
    ) -> Result<Report, Reason> {
        if !self.hears(scene.others, period_s)? {
            return Ok(Report::new(self.number, GraspState::Waiting, Reason::None));
        }
        if self.law.is_none() {
            self.law = Some(self.engage(scene)?);
        } else {
            self.check_modes(own)?;
        }
        let now = self.now();
        self.since_s += period_s;
        let step = match &mut self.law {
            Some(Law::Three(fingers, law)) => update(self.finger, fingers, law, &now, scene),
            Some(Law::Four(fingers, law)) => update(self.finger, fingers, law, &now, scene),
            None => return Err(Reason::Law),
        };
        let step = step.map_err(|_| Reason::Law)?;
        let torques = step.torques.get(self.finger).ok_or(Reason::Fingers)?;
        let finger = own.finger(self.finger).ok_or(Reason::Fault)?;
        for (joint, &torque) in torques.iter().enumerate() {
            let target = JointTarget::Grasp(torque);
            finger
                .set_target(joint, target)
                .map_err(|_| Reason::Fault)?;
        }
        Ok(Report {
            squeeze_share: step.squeeze_share,
            deviation: step.deviation,
            margins: step.margins,
            ..Report::new(self.number, GraspState::Holding, Reason::None)
        })
    }

    /// The other fingers of the hand that hold.
    fn partners(&self) -> impl Iterator<Item = usize> + Clone + use<> {
        let (own, fingers) = (self.finger, self.order.fingers);
        (0..FINGERS).filter(move |&finger| finger != own && fingers >> finger & 1 != 0)
    }

    /// Whether the joints of all fingers that hold are known.
    fn hears(&mut self, others: &Joints, period_s: f64) -> Result<bool, Reason> {
        let is_patient = self.waited_s < PATIENCE_S;
        self.waited_s += period_s;
        let mut partners = self.partners();
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
        Err(Reason::Partner)
    }

    /// Whether all joints are in the mode that the law gave them.
    fn check_modes(&self, own: &mut impl Own) -> Result<(), Reason> {
        let finger = own.finger(self.finger).ok_or(Reason::Fault)?;
        if (0..JOINTS).all(|joint| finger.mode(joint) == Some(Mode::Grasp)) {
            return Ok(());
        }
        Err(if finger.fault().is_some() {
            Reason::Fault
        } else {
            Reason::Switched
        })
    }

    /// Takes the present tips as the desired ones.
    fn engage(&mut self, scene: &Scene<'_>) -> Result<Law, Reason> {
        let mut numbers = heapless::Vec::<usize, FINGERS>::new();
        for finger in (0..FINGERS).filter(|finger| self.order.fingers >> finger & 1 != 0) {
            // As many as there are.
            let _ = numbers.push(finger);
        }
        let three = <[usize; 3]>::try_from(numbers.as_slice());
        let four = <[usize; 4]>::try_from(numbers.as_slice());
        let law = match (three, four) {
            (Ok(fingers), _) => self
                .engaged(&fingers, scene)
                .map(|law| Law::Three(fingers, law)),
            (_, Ok(fingers)) => self
                .engaged(&fingers, scene)
                .map(|law| Law::Four(fingers, law)),
            _ => return Err(Reason::Fingers),
        };
        law.map_err(|_| Reason::Law)
    }

    fn engaged<const M: usize>(
        &mut self,
        fingers: &[usize; M],
        scene: &Scene<'_>,
    ) -> Result<GraspStiffness<f64, M, JOINTS>, GraspError> {
        let states = scene.states(self.finger, fingers);
        let order = Order {
            force: [0.0; 3],
            moment: [0.0; 3],
            squeeze_n: 0.0,
            ..self.order
        };
        let law = GraspStiffness::engage(&states, order.tuning(scene.limits(fingers))?)?;
        for (&finger, state) in fingers.iter().zip(&states) {
            if let Some(tip) = self.from.tips.get_mut(finger) {
                *tip = state.tip.into();
            }
        }
        Ok(law)
    }

    /// Ends the grasp; joints that held stay where they are.
    fn let_go(&mut self, own: &mut impl Own) {
        if self.law.is_some()
            && let Some(finger) = own.finger(self.finger)
        {
            for joint in 0..JOINTS {
                if finger.mode(joint) == Some(Mode::Grasp) {
                    // After a fault the finger has its own way to rest.
                    let _ = finger.set_mode(joint, Mode::Position);
                }
            }
        }
        self.law = None;
        self.number = 0;
        self.order = Order::RELEASE;
    }
}

/// Whether an order can be.
fn check(scene: &Scene<'_>, order: &Order) -> Result<(), Reason> {
    let count = order.fingers.count_ones();
    if order.fingers >> FINGERS != 0 || count < LEAST_FINGERS {
        return Err(Reason::Fingers);
    }
    let [first, ..] = scene.members;
    let mut numbers = order.tips.as_flattened().iter().chain([&order.ramp_s]);
    if order.tuning([first.limits; 3]).is_err() || numbers.any(|number| !number.is_finite()) {
        return Err(Reason::Tuning);
    }
    Ok(())
}

/// One step of the law for finger `own`.
fn update<const M: usize>(
    own: usize,
    fingers: &[usize; M],
    law: &mut GraspStiffness<f64, M, JOINTS>,
    now: &Order,
    scene: &Scene<'_>,
) -> Result<Step, GraspError> {
    law.set_tuning(now.tuning(scene.limits(fingers))?)?;
    let tip = |finger: usize| now.tips.get(finger).copied().unwrap_or_default();
    law.set_desired(&fingers.map(|finger| Vector3::from(tip(finger))))?;
    let output = law.update(&scene.states(own, fingers))?;
    Ok(Step::of(fingers, &output))
}

impl Scene<'_> {
    fn limits<const M: usize>(&self, fingers: &[usize; M]) -> [TorqueLimits<f64, JOINTS>; M] {
        fingers.map(|finger| {
            let member = self.members.get(finger);
            member.map_or(TorqueLimits::none(), |member| member.limits)
        })
    }

    /// The fingers as the law of finger `own` sees them: it as it is now, the others as they were.
    fn states<const M: usize>(
        &self,
        own: usize,
        fingers: &[usize; M],
    ) -> [FingerState<f64, JOINTS>; M] {
        fingers.map(|finger| {
            let [first, ..] = self.members;
            let mechanism = self.members.get(finger).unwrap_or(first).mechanism;
            let (q, qd) = if finger == own {
                let (q, qd) = (&self.felt.position, &self.felt.velocity);
                (q.get(finger).copied(), qd.get(finger).copied())
            } else {
                let (q, qd) = (&self.others.position, &self.others.velocity);
                let vector = |joints: &[f64; JOINTS]| Vector4::from(*joints);
                (q.get(finger).map(vector), qd.get(finger).map(vector))
            };
            // All of them are fingers of the hand.
            let (q, qd) = (q.unwrap_or_default(), qd.unwrap_or_default());
            let weight = mechanism.gravity_torque(&q, self.gravity);
            FingerState::new(&mechanism, &q, &qd, &weight)
        })
    }
}

impl Step {
    fn of<const M: usize>(fingers: &[usize; M], output: &GraspOutput<f64, M, JOINTS>) -> Self {
        let mut step = Self {
            torques: [Vector4::zeros(); FINGERS],
            squeeze_share: output.squeeze_share,
            deviation: [0.0; 6],
            margins: [0.0; FINGERS],
        };
        let deviation = output.deviation.linear.iter();
        let deviation = deviation.chain(output.deviation.angular.iter());
        for (place, part) in step.deviation.iter_mut().zip(deviation) {
            *place = *part;
        }
        for (&finger, (torques, margin)) in fingers
            .iter()
            .zip(output.torques.iter().zip(&output.margins))
        {
            if let Some(place) = step.torques.get_mut(finger) {
                *place = *torques;
            }
            if let Some(place) = step.margins.get_mut(finger) {
                *place = *margin;
            }
        }
        step
    }
}

#[cfg(test)]
mod tests {
    use condor_hand::servo::Sensed;
    use condor_hand::tendon::Pair;

    use super::super::tips;
    use super::*;
    use crate::{UtahMit, start};

    const HAND: &str = include_str!("../../../../condor-hand/hands/utah-mit.toml");
    const PERIOD_S: f64 = 1.0 / 400.0;
    const POSTURE: [[f64; JOINTS]; FINGERS] = [[0.0, 0.9, 0.8, 0.7]; FINGERS];

    struct Fingers(Vec<FingerController<PlanarFinger, JOINTS>>);

    impl Own for Fingers {
        fn finger(&mut self, place: usize) -> Option<&mut FingerController<PlanarFinger, JOINTS>> {
            self.0.get_mut(place)
        }
    }

    /// A tick of a processor whose sensors say the posture, but for one of a joint.
    fn tick(
        law: &mut Grasp,
        others: &Joints,
        fingers: &mut Fingers,
        gravity: &Vector3<f64>,
        told: &Told,
        said: f64,
    ) -> GraspState {
        let mut felt = Felt {
            position: POSTURE.map(Vector4::from),
            velocity: [Vector4::zeros(); FINGERS],
        };
        felt.position[1][2] = said;
        let sensed = felt.position.map(|position| Sensed {
            position,
            tension: [Pair::both(20.0); JOINTS],
        });
        felt.believe(PERIOD_S, fingers);
        law.step(&felt, others, gravity, told, PERIOD_S, fingers);
        for (finger, sensed) in fingers.0.iter_mut().zip(&sensed) {
            assert_eq!(finger.tick(sensed, gravity, PERIOD_S).fault, None);
        }
        law.report().state()
    }

    #[test]
    fn a_reading_that_is_none_does_not_end_a_grasp() {
        let hand = UtahMit::from_toml(HAND, "utah-mit.toml").unwrap();
        let gravity = Vector3::from(hand.gravity);
        let own = hand.fingers[0].processor().unwrap();
        let served = hand.fingers_on(own).map(|(_, finger)| {
            FingerController::new(&hand, finger, finger.planar().unwrap()).unwrap()
        });
        let mut fingers = Fingers(served.collect());
        let mut law = Grasp::new(&start::fingers(&hand).unwrap(), [true, true, false, false]);
        let [stiffness, damping] = [150.0, 1.0].map(|n| [n, n, n, n * 1e-3, n * 1e-3, n * 1e-3]);
        let mut order = Order::hold(0b1111, tips(&hand, &POSTURE).unwrap(), stiffness, damping);
        order.squeeze_n = 1.0;
        let others = Joints {
            position: POSTURE,
            order: [1; FINGERS],
            served: 0b1111,
            ..Joints::default()
        };
        let mut told = Told::default();
        let good = POSTURE[1][2];
        for _ in 0..5 {
            assert_eq!(
                tick(&mut law, &others, &mut fingers, &gravity, &told, good),
                GraspState::Idle
            );
        }
        told.order = Some((1, order));
        assert_eq!(
            tick(&mut law, &others, &mut fingers, &gravity, &told, good),
            GraspState::Holding
        );
        told.order = None;
        for said in [f64::NAN, f64::INFINITY, good + 0.3] {
            for said in [said, good, good] {
                let state = tick(&mut law, &others, &mut fingers, &gravity, &told, said);
                assert_eq!(state, GraspState::Holding, "{said}");
            }
        }
    }
}

//! [`GraspLaw`]: the grasp in the servo loop of one processor.

use condor_hand::controller::FingerController;
use condor_hand::dynamics::Dynamics;
use condor_hand::grasp::{FingerState, GraspError, GraspOutput, GraspStiffness, TorqueLimits};
use condor_hand::kinematics::PlanarFinger;
use condor_hand::math::{clamp, min};
use condor_hand::message::ServoLoop;
use condor_hand::servo::{JointTarget, Mode};
use condor_mbox::MemoryWindow;
use nalgebra::{Vector3, Vector4};

use super::{GraspState, Joints, LEAST_FINGERS, Order, Reason, Report};
use crate::servo::Given;
use crate::{FINGERS, Failure, JOINTS, SERVED, UtahMit};

/// The time within which the partner is to have the order, too, s.
const PATIENCE_S: f64 = 0.25;

/// The controllers of the fingers that this processor serves.
pub(crate) trait Own {
    fn finger(&mut self, place: usize) -> Option<&mut FingerController<PlanarFinger, JOINTS>>;
}

impl<W: MemoryWindow> Own for ServoLoop<'_, PlanarFinger, W, SERVED, JOINTS> {
    fn finger(&mut self, place: usize) -> Option<&mut FingerController<PlanarFinger, JOINTS>> {
        self.controller_mut(place)
    }
}

/// What this processor measures of its fingers.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Felt {
    pub(crate) position: [Vector4<f64>; SERVED],
    pub(crate) velocity: [Vector4<f64>; SERVED],
}

impl Felt {
    /// Puts in the place of a position that cannot be, the one that the servos will go on from: a law
    /// of the whole hand outlives a lost reading.
    pub(crate) fn believe(&mut self, period_s: f64, own: &mut impl Own) {
        for (place, position) in self.position.iter_mut().enumerate() {
            if let Some(finger) = own.finger(place) {
                *position = finger.plausible(position, period_s);
            }
        }
    }
}

/// A finger of the hand, and where it is measured.
#[derive(Clone, Copy, Debug)]
struct Member {
    mechanism: PlanarFinger,
    limits: TorqueLimits<f64, JOINTS>,
    /// On this processor, or on the other one.
    is_own: bool,
    /// Its place among the fingers of its processor.
    place: usize,
}

/// The grasp of one servo processor.
pub(crate) struct GraspLaw {
    members: [Member; FINGERS],
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

/// One step of the law: of each finger of the hand, whether or not it holds.
struct Step {
    torques: [Vector4<f64>; FINGERS],
    squeeze_share: f64,
    deviation: [f64; 6],
    margins: [f64; FINGERS],
}

impl GraspLaw {
    /// No grasp yet, on processor `own`.
    pub(crate) fn new(hand: &UtahMit, own: u8) -> Result<Self, Failure> {
        let mut members = heapless::Vec::<_, FINGERS>::new();
        for (number, finger) in hand.fingers.iter().enumerate() {
            let processor = finger.processor().unwrap_or(own);
            let mut beside = hand.fingers_on(processor);
            let torque = |joint: &condor_hand::config::Joint<JOINTS>| {
                min(
                    joint.flexor.arm_m * (joint.flexor.max_n - joint.flexor.min_n),
                    -joint.extensor.arm_m * (joint.extensor.max_n - joint.extensor.min_n),
                )
            };
            let member = Member {
                mechanism: finger.planar().ok_or(Failure::Form { finger: number })?,
                limits: TorqueLimits::symmetric(&finger.each(torque)),
                is_own: processor == own,
                place: beside.position(|(index, _)| index == number).unwrap_or(0),
            };
            // As many as the configuration has room for.
            let _ = members.push(member);
        }
        let fingers = members.len();
        let simulated = FINGERS;
        let members = members
            .into_array()
            .map_err(|_| Failure::Hand { fingers, simulated })?;
        Ok(Self {
            members,
            order: Order::RELEASE,
            from: Order::RELEASE,
            since_s: 0.0,
            number: 0,
            law: None,
            waited_s: 0.0,
            has_joined: false,
            report: Report::NOTHING,
        })
    }

    /// The number of the order in force; 0 for none.
    pub(crate) const fn number(&self) -> u64 {
        self.number
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
        gravity: &Vector3<f64>,
        given: &Given,
        own: &mut impl Own,
    ) {
        self.report = self.advance(felt, gravity, given, own);
    }

    fn advance(
        &mut self,
        felt: &Felt,
        gravity: &Vector3<f64>,
        given: &Given,
        own: &mut impl Own,
    ) -> Report {
        let told = &given.told;
        if let Some((number, order)) = told.order {
            if order.fingers == 0 {
                self.let_go(own);
                return Report::new(number, GraspState::Idle, Reason::None);
            }
            if let Err(reason) = self.take(number, &order, own) {
                return Report::new(number, GraspState::Refused, reason);
            }
        }
        if self.number == 0 {
            return self.report;
        }
        match self.hold(felt, gravity, given, own) {
            Ok(report) => report,
            Err(reason) => {
                let number = self.number;
                self.let_go(own);
                Report::new(number, GraspState::Left, reason)
            }
        }
    }

    /// Puts an order into force, or leaves everything as it is.
    fn take(&mut self, number: u64, order: &Order, own: &mut impl Own) -> Result<(), Reason> {
        let count = order.fingers.count_ones();
        if order.fingers >> FINGERS != 0 || count < LEAST_FINGERS {
            return Err(Reason::Fingers);
        }
        let [first, ..] = &self.members;
        let limits = [first.limits; 3];
        let numbers = order.tips.as_flattened().iter().chain([&order.ramp_s]);
        if order.tuning(limits).is_err() || numbers.clone().any(|number| !number.is_finite()) {
            return Err(Reason::Tuning);
        }
        if self.law.is_some() && order.fingers == self.order.fingers {
            self.from = self.now();
        } else {
            if self.law.is_some() {
                self.let_go(own);
            }
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
        Ok(())
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
        felt: &Felt,
        gravity: &Vector3<f64>,
        given: &Given,
        own: &mut impl Own,
    ) -> Result<Report, Reason> {
        let partner = self.hear(given)?;
        let Some(partner) = partner else {
            return Ok(Report::new(self.number, GraspState::Waiting, Reason::None));
        };
        if self.law.is_none() {
            self.law = Some(self.engage(felt, &partner, gravity)?);
        } else if self.is_switched(own) {
            return Err(if has_fault(own) {
                Reason::Fault
            } else {
                Reason::Switched
            });
        }
        let now = self.now();
        self.since_s += given.period_s;
        let Some(mut law) = self.law else {
            return Err(Reason::Law);
        };
        let step = match &mut law {
            Law::Three(fingers, law) => self.update(fingers, law, &now, felt, &partner, gravity),
            Law::Four(fingers, law) => self.update(fingers, law, &now, felt, &partner, gravity),
        };
        self.law = Some(law);
        let step = step.map_err(|_| Reason::Law)?;
        for (torques, member) in step.torques.iter().zip(self.holding()) {
            let Some(member) = member.filter(|member| member.is_own) else {
                continue;
            };
            let finger = own.finger(member.place).ok_or(Reason::Fault)?;
            for (joint, &torque) in torques.iter().enumerate() {
                let target = JointTarget::Grasp(torque);
                finger
                    .set_target(joint, target)
                    .map_err(|_| Reason::Fault)?;
            }
        }
        Ok(Report {
            squeeze_share: step.squeeze_share,
            deviation: step.deviation,
            margins: step.margins,
            ..Report::new(self.number, GraspState::Holding, Reason::None)
        })
    }

    /// The joints of the partner, once there are some.
    fn hear(&mut self, given: &Given) -> Result<Option<Joints>, Reason> {
        let is_patient = self.waited_s < PATIENCE_S;
        self.waited_s += given.period_s;
        match given.told.partner {
            Some(joints) if joints.order != 0 => {
                self.has_joined = true;
                Ok(Some(joints))
            }
            // It has not seen the order yet; its joints are known all the same.
            Some(joints) if !self.has_joined && is_patient => Ok(Some(joints)),
            None if !self.has_joined && self.law.is_none() && is_patient => Ok(None),
            _ => Err(Reason::Partner),
        }
    }

    /// The fingers of the hand that hold.
    fn holding(&self) -> impl Iterator<Item = Option<&Member>> {
        let fingers = self.order.fingers;
        let members = self.members.iter().enumerate();
        members.map(move |(number, member)| (fingers >> number & 1 != 0).then_some(member))
    }

    /// Whether a joint of the own fingers that hold is in another mode than the law gave it.
    fn is_switched(&self, own: &mut impl Own) -> bool {
        let mut mine = self.holding().flatten().filter(|member| member.is_own);
        mine.any(|member| {
            let finger = own.finger(member.place);
            finger.is_none_or(|finger| {
                (0..JOINTS).any(|joint| finger.mode(joint) != Some(Mode::Grasp))
            })
        })
    }

    /// Takes the present tips as the desired ones.
    fn engage(
        &mut self,
        felt: &Felt,
        partner: &Joints,
        gravity: &Vector3<f64>,
    ) -> Result<Law, Reason> {
        let mut numbers = heapless::Vec::<usize, FINGERS>::new();
        for (number, member) in self.holding().enumerate() {
            if member.is_some() {
                // As many as there are.
                let _ = numbers.push(number);
            }
        }
        let three = <[usize; 3]>::try_from(numbers.as_slice());
        let four = <[usize; 4]>::try_from(numbers.as_slice());
        let law = match (three, four) {
            (Ok(fingers), _) => self
                .engaged(&fingers, felt, partner, gravity)
                .map(|law| Law::Three(fingers, law)),
            (_, Ok(fingers)) => self
                .engaged(&fingers, felt, partner, gravity)
                .map(|law| Law::Four(fingers, law)),
            _ => return Err(Reason::Fingers),
        };
        law.map_err(|_| Reason::Law)
    }

    fn engaged<const M: usize>(
        &mut self,
        fingers: &[usize; M],
        felt: &Felt,
        partner: &Joints,
        gravity: &Vector3<f64>,
    ) -> Result<GraspStiffness<f64, M, JOINTS>, GraspError> {
        let states = self.states(fingers, felt, partner, gravity);
        let order = Order {
            force: [0.0; 3],
            moment: [0.0; 3],
            squeeze_n: 0.0,
            ..self.order
        };
        let law = GraspStiffness::engage(&states, order.tuning(self.limits(fingers))?)?;
        for (&finger, state) in fingers.iter().zip(&states) {
            if let Some(tip) = self.from.tips.get_mut(finger) {
                *tip = state.tip.into();
            }
        }
        Ok(law)
    }

    fn update<const M: usize>(
        &self,
        fingers: &[usize; M],
        law: &mut GraspStiffness<f64, M, JOINTS>,
        now: &Order,
        felt: &Felt,
        partner: &Joints,
        gravity: &Vector3<f64>,
    ) -> Result<Step, GraspError> {
        law.set_tuning(now.tuning(self.limits(fingers))?)?;
        let tip = |finger: usize| now.tips.get(finger).copied().unwrap_or_default();
        law.set_desired(&fingers.map(|finger| Vector3::from(tip(finger))))?;
        let output = law.update(&self.states(fingers, felt, partner, gravity))?;
        Ok(Step::of(fingers, &output))
    }

    fn limits<const M: usize>(&self, fingers: &[usize; M]) -> [TorqueLimits<f64, JOINTS>; M] {
        fingers.map(|finger| {
            let member = self.members.get(finger);
            member.map_or(TorqueLimits::none(), |member| member.limits)
        })
    }

    fn states<const M: usize>(
        &self,
        fingers: &[usize; M],
        felt: &Felt,
        partner: &Joints,
        gravity: &Vector3<f64>,
    ) -> [FingerState<f64, JOINTS>; M] {
        fingers.map(|finger| {
            let [first, ..] = &self.members;
            let member = self.members.get(finger).unwrap_or(first);
            let place = member.place;
            let (q, qd) = if member.is_own {
                (
                    felt.position.get(place).copied(),
                    felt.velocity.get(place).copied(),
                )
            } else {
                (
                    partner.position.get(place).copied().map(Vector4::from),
                    partner.velocity.get(place).copied().map(Vector4::from),
                )
            };
            // Both processors serve as many fingers as the type says.
            let (q, qd) = (q.unwrap_or_default(), qd.unwrap_or_default());
            let weight = member.mechanism.gravity_torque(&q, gravity);
            FingerState::new(&member.mechanism, &q, &qd, &weight)
        })
    }

    /// Ends the grasp; the own joints that held stay where they are.
    fn let_go(&mut self, own: &mut impl Own) {
        if self.law.is_some() {
            for member in self.holding().flatten().filter(|member| member.is_own) {
                let Some(finger) = own.finger(member.place) else {
                    continue;
                };
                for joint in 0..JOINTS {
                    if finger.mode(joint) == Some(Mode::Grasp) {
                        // After a fault the finger has its own way to rest.
                        let _ = finger.set_mode(joint, Mode::Position);
                    }
                }
            }
        }
        self.law = None;
        self.number = 0;
        self.order = Order::RELEASE;
    }
}

fn has_fault(own: &mut impl Own) -> bool {
    (0..SERVED).any(|place| {
        let finger = own.finger(place);
        finger.is_some_and(|finger| finger.fault().is_some())
    })
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
    use crate::grasp::Told;

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
        law: &mut GraspLaw,
        fingers: &mut Fingers,
        gravity: &Vector3<f64>,
        told: &Told,
        said: f64,
    ) -> GraspState {
        let [first, second] = [0, 1].map(|_| Vector4::from(POSTURE[0]));
        let mut felt = Felt {
            position: [first, second],
            velocity: [Vector4::zeros(); SERVED],
        };
        felt.position[1][2] = said;
        let sensed = felt.position.map(|position| Sensed {
            position,
            tension: [Pair::both(20.0); JOINTS],
        });
        felt.believe(PERIOD_S, fingers);
        let given = Given {
            period_s: PERIOD_S,
            acceleration: [0.0; 3],
            told: *told,
        };
        law.step(&felt, gravity, &given, fingers);
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
        let mut law = GraspLaw::new(&hand, own).unwrap();
        let [stiffness, damping] = [150.0, 1.0].map(|n| [n, n, n, n * 1e-3, n * 1e-3, n * 1e-3]);
        let mut order = Order::hold(0b1111, tips(&hand, &POSTURE).unwrap(), stiffness, damping);
        order.squeeze_n = 1.0;
        let partner = Joints {
            position: [POSTURE[2], POSTURE[3]],
            velocity: [[0.0; JOINTS]; SERVED],
            order: 1,
            ticks: 0,
        };
        let mut told = Told {
            order: None,
            partner: Some(partner),
        };
        let good = POSTURE[1][2];
        for _ in 0..5 {
            assert_eq!(
                tick(&mut law, &mut fingers, &gravity, &told, good),
                GraspState::Idle
            );
        }
        told.order = Some((1, order));
        assert_eq!(
            tick(&mut law, &mut fingers, &gravity, &told, good),
            GraspState::Holding
        );
        told.order = None;
        for said in [f64::NAN, f64::INFINITY, good + 0.3] {
            for said in [said, good, good] {
                let state = tick(&mut law, &mut fingers, &gravity, &told, said);
                assert_eq!(state, GraspState::Holding, "{said}");
            }
        }
    }
}

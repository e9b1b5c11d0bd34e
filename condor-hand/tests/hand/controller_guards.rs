//! What a finger does with the guards of the motions that it follows.

#![allow(clippy::float_cmp, reason = "what rests does not move at all")]

use condor_hand::config::Hand;
use condor_hand::controller::{FingerController, FingerTick, GuardStop};
use condor_hand::kinematics::PlanarFinger;
use condor_hand::servo::{FingerReadings, JointTarget, ServoMode};
use condor_hand::trajectory::{MotionGuard, SetPoint, StopGuard};
use condor_hand::transmission::Linear;
use nalgebra::{Vector3, Vector4};

const PERIOD_S: f64 = 1.0 / 400.0;
const START: [f64; 4] = [0.1, 0.6, 0.8, 0.7];
const RATE: f64 = 0.1;

/// A finger whose joints go by the same rate, and whose sensors say that they do.
struct Rig {
    hand: Hand<4, 4, 8>,
    controller: FingerController<PlanarFinger, Linear<4, 8>, 4, 8>,
    guards: [StopGuard; 4],
    sensed: FingerReadings<4, 8>,
    ticks: u32,
    former: [f64; 4],
}

impl Rig {
    fn new(guards: [StopGuard; 4]) -> Self {
        let text = include_str!("../../hands/utah-mit.toml");
        let mut hand = Hand::from_toml(text, "utah-mit.toml").unwrap();
        hand.faults.frozen_rad = 10.0;
        hand.faults.tracking_rad = 10.0;
        hand.faults.sensor_samples = 10_000;
        hand.faults.effort_samples = 10_000;
        let finger = &hand.fingers[0];
        let mechanism = finger.planar().unwrap();
        let transmission = finger.transmission().unwrap();
        let controller = FingerController::new(&hand, finger, mechanism, transmission).unwrap();
        let sensed = FingerReadings {
            position: Vector4::from(START),
            actuator_position: [0.0; 8],
            effort: [10.0; 8],
            touch: 0.0,
        };
        let mut rig = Self {
            hand,
            controller,
            guards,
            sensed,
            ticks: 0,
            former: START,
        };
        for joint in 0..4 {
            rig.controller.set_mode(joint, ServoMode::Position).unwrap();
        }
        rig.controller.tick(&sensed, &gravity(), PERIOD_S);
        rig
    }

    /// The master's set-point of a joint a tick of the master from now.
    fn wanted(&self, joint: usize) -> SetPoint {
        SetPoint {
            position: START[joint] + RATE * f64::from(self.ticks + 8) * PERIOD_S,
            velocity: RATE,
            acceleration: 0.0,
        }
    }

    /// A tick, with what the master says if it is its turn; no set-point jumps.
    fn tick(&mut self) -> FingerTick<4, 8> {
        if self.ticks.is_multiple_of(8) {
            let points = [0, 1, 2, 3].map(|joint| self.wanted(joint));
            self.controller.follow(&points, &self.guards).unwrap();
        }
        self.ticks += 1;
        let tick = self.controller.tick(&self.sensed, &gravity(), PERIOD_S);
        assert_eq!(tick.fault, None);
        for (former, now) in self.former.iter_mut().zip(tick.target) {
            let now = now.unwrap();
            // Of the motion, and of closing a gap.
            let most = (RATE + self.hand.fingers[0].limits().velocity[0]) * PERIOD_S;
            assert!((now - *former).abs() <= most, "{former} to {now}");
            *former = now;
        }
        self.sensed.position.add_scalar_mut(RATE * PERIOD_S);
        tick
    }

    fn run(&mut self, ticks: u32) {
        for _ in 0..ticks {
            self.tick();
        }
    }

    fn stops(&self) -> [Option<GuardStop>; 4] {
        core::array::from_fn(|joint| self.controller.stop(joint).copied())
    }
}

fn gravity() -> Vector3<f64> {
    Vector3::new(0.0, 0.0, -9.81)
}

fn guard(motion: u32) -> StopGuard {
    StopGuard {
        motion,
        ..StopGuard::NONE
    }
}

fn on_contact(motion: u32) -> StopGuard {
    StopGuard {
        contact: true,
        ..guard(motion)
    }
}

#[test]
fn a_contact_freezes_all_joints_of_its_motion_in_the_same_tick_and_no_others() {
    let moving = guard(7);
    let mut rig = Rig::new([moving, on_contact(8), on_contact(8), moving]);
    rig.run(100);
    assert_eq!(rig.stops(), [None; 4]);
    // Below the threshold of 0.05 N.
    rig.sensed.touch = 0.05;
    rig.run(20);
    assert_eq!(rig.stops(), [None; 4]);
    let before = rig.former;
    rig.sensed.touch = 0.06;
    let tick = rig.tick();
    rig.sensed.touch = 0.0;
    for joint in [1, 2] {
        assert_eq!(tick.target[joint], Some(before[joint]));
        assert_eq!(
            rig.controller.stop(joint),
            Some(&GuardStop {
                motion: 8,
                guard: MotionGuard::Contact { joint: 1 },
                value: 0.06,
                position: before[joint],
            })
        );
    }
    for joint in [0, 3] {
        assert!(tick.target[joint].unwrap() > before[joint]);
        assert_eq!(rig.controller.stop(joint), None);
    }
    // For as long as the master goes on with that motion.
    rig.run(400);
    assert_eq!(rig.former[1..3], before[1..3]);
    assert!(rig.former[0] > before[0] + 0.08);
}

#[test]
fn a_stopped_joint_joins_the_next_motion_and_closes_the_gap() {
    let mut rig = Rig::new([on_contact(1); 4]);
    rig.run(80);
    rig.sensed.touch = 1.0;
    rig.run(40);
    let rest = rig.former;
    assert_eq!(rig.stops().map(|stop| stop.unwrap().position), rest);
    // The next one, which has the same guard and joint 0 not at all.
    rig.sensed.touch = 0.0;
    rig.guards = [guard(1), on_contact(2), on_contact(2), on_contact(2)];
    rig.run(200);
    assert!(rig.controller.stop(0).is_some());
    assert_eq!(rig.former[0], rest[0]);
    for joint in 1..4 {
        assert_eq!(rig.controller.stop(joint), None);
        let ahead = rig.wanted(joint).position - rig.former[joint];
        assert!(
            (-1e-9..=RATE * 8.5 * PERIOD_S).contains(&ahead),
            "{ahead} rad"
        );
    }
    // And it stops again.
    rig.sensed.touch = 1.0;
    rig.tick();
    let motions = rig.stops().map(|stop| stop.map(|stop| stop.motion));
    assert_eq!(motions, [Some(1), Some(2), Some(2), Some(2)]);
}

#[test]
fn a_master_that_rests_where_a_joint_was_stopped_does_not_move_it() {
    let mut rig = Rig::new([on_contact(1); 4]);
    rig.run(80);
    rig.sensed.touch = 1.0;
    rig.run(8);
    let rest = rig.former;
    let points = rest.map(SetPoint::rest);
    let is_stopped = |guards: &[StopGuard; 4]| guards[0].motion == 1;
    // On the way there it still is the motion that was stopped.
    for number in 0..12 {
        let guards = if number < 2 {
            [on_contact(1); 4]
        } else {
            [StopGuard::NONE; 4]
        };
        rig.controller.follow(&points, &guards).unwrap();
        assert!(
            rig.stops()
                .iter()
                .all(|stop| stop.is_some() == is_stopped(&guards))
        );
        for _ in 0..8 {
            let tick = rig.controller.tick(&rig.sensed, &gravity(), PERIOD_S);
            assert_eq!(tick.target, rest.map(Some));
        }
    }
}

#[test]
fn each_motion_of_a_finger_has_its_own_guard_of_torque_and_effort() {
    let torque = StopGuard {
        torque: 0.3,
        ..guard(1)
    };
    let effort = StopGuard {
        effort: 60.0,
        ..guard(2)
    };
    let mut rig = Rig::new([torque, torque, effort, effort]);
    rig.run(80);
    // Of the extensor of the proximal joint: 0.0127 m times the difference.
    rig.sensed.effort[3] = 10.0 + 0.29 / 0.0127;
    rig.run(16);
    assert_eq!(rig.stops(), [None; 4]);
    rig.sensed.effort[3] = 10.0 + 0.31 / 0.0127;
    rig.run(1);
    let [first, second, third, fourth] = rig.stops();
    let (first, second) = (first.unwrap(), second.unwrap());
    assert_eq!(
        (first.motion, first.guard),
        (1, MotionGuard::Torque { joint: 1 })
    );
    assert!((first.value - 0.31).abs() < 1e-9, "{first:?}");
    assert_eq!((second.motion, second.guard), (first.motion, first.guard));
    assert_eq!((third, fourth), (None, None));
    rig.sensed.effort[6] = 60.5;
    rig.run(1);
    let [_, _, third, fourth] = rig.stops();
    let (third, fourth) = (third.unwrap(), fourth.unwrap());
    assert_eq!(
        (third.motion, third.guard),
        (2, MotionGuard::Effort { joint: 3 })
    );
    assert_eq!((third.value, fourth.value), (60.5, 60.5));
}

#[test]
fn a_reading_that_is_no_number_stops_what_is_guarded_by_it() {
    for wrong in [f64::NAN, f64::INFINITY] {
        let mut rig = Rig::new([
            on_contact(1),
            StopGuard {
                torque: 5.0,
                ..guard(2)
            },
            StopGuard {
                effort: 120.0,
                ..guard(3)
            },
            guard(4),
        ]);
        rig.run(40);
        rig.sensed.touch = wrong;
        rig.run(1);
        let motions = rig.stops().map(|stop| stop.map_or(0, |stop| stop.motion));
        assert_eq!(motions, [1, 0, 0, 0], "{wrong}");
        assert!(!rig.stops()[0].unwrap().value.is_finite());
        // The tendons of the distal joint cross the proximal one, not itself.
        rig.sensed.effort[5] = wrong;
        rig.run(1);
        let motions = rig.stops().map(|stop| stop.map_or(0, |stop| stop.motion));
        assert_eq!(motions, [1, 2, 3, 0], "{wrong}");
    }
}

#[test]
fn an_order_to_a_stopped_joint_ends_the_stop() {
    let mut rig = Rig::new([on_contact(1); 4]);
    rig.run(40);
    rig.sensed.touch = 1.0;
    rig.run(1);
    rig.sensed.touch = 0.0;
    let to = JointTarget::Position(SetPoint::rest(rig.former[1] + 0.01));
    rig.controller.set_target(1, to).unwrap();
    assert_eq!(rig.controller.stop(1), None);
    rig.controller.set_mode(2, ServoMode::Torque).unwrap();
    assert_eq!(rig.controller.stop(2), None);
    assert!(rig.controller.stop(0).is_some());
}

#[test]
fn without_a_sensor_nothing_is_a_contact() {
    let mut rig = Rig::new([on_contact(1); 4]);
    rig.hand.fingers[0].touch = None;
    let finger = &rig.hand.fingers[0];
    rig.controller = FingerController::new(
        &rig.hand,
        finger,
        finger.planar().unwrap(),
        finger.transmission().unwrap(),
    )
    .unwrap();
    for joint in 0..4 {
        rig.controller.set_mode(joint, ServoMode::Position).unwrap();
    }
    rig.controller.tick(&rig.sensed, &gravity(), PERIOD_S);
    rig.sensed.touch = 10.0;
    rig.run(40);
    assert_eq!(rig.stops(), [None; 4]);
}

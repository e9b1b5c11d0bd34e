//! A joint as a spring and a damper, around the simulated finger of the shipped hand.

use condor_hand::config::Hand;
use condor_hand::controller::{FingerController, FingerTick};
use condor_hand::dynamics::Dynamics;
use condor_hand::kinematics::PlanarFinger;
use condor_hand::math::{exp, max, sqrt};
use condor_hand::plant::{PlantModel, SimFinger};
use condor_hand::servo::{FingerReadings, JointTarget, PositionLaw, ServoMode, ServoRefusal};
use condor_hand::transmission::Linear;
use nalgebra::{SVector, Vector3};
use proptest::prelude::*;

use crate::support::largest_step;

const TEXT: &str = include_str!("../../hands/utah-mit.toml");
const PERIOD_S: f64 = 1.0 / 400.0;

type Controller = FingerController<PlanarFinger, Linear<4, 8>, 4, 8>;

/// A controller and the finger that it controls.
struct Bench {
    controller: Controller,
    finger: SimFinger<PlanarFinger, Linear<4, 8>, 4, 8>,
    gravity: Vector3<f64>,
    /// What turns the joints from outside, N m.
    load: SVector<f64, 4>,
}

fn hand() -> Hand<4, 4, 8> {
    Hand::from_toml(TEXT, "utah-mit.toml").unwrap()
}

impl Bench {
    fn new(posture: [f64; 4]) -> Self {
        let hand = hand();
        let entry = &hand.fingers[0];
        let mechanism = entry.planar().unwrap();
        let transmission = entry.transmission().unwrap();
        let finger = PlantModel::default()
            .finger(entry, mechanism, transmission, posture.into())
            .unwrap();
        Self {
            controller: FingerController::new(&hand, entry, mechanism, transmission).unwrap(),
            finger,
            gravity: Vector3::from(hand.gravity),
            load: SVector::zeros(),
        }
    }

    fn tick(&mut self) -> FingerTick<4, 8> {
        let sensed = self.finger.readings();
        let tick = self.controller.tick(&sensed, &self.gravity, PERIOD_S);
        for _ in 0..5 {
            let (command, load) = (&tick.output.command, &self.load);
            self.finger
                .advance(PERIOD_S / 5.0, command, &self.gravity, load)
                .unwrap();
        }
        tick
    }

    #[allow(clippy::cast_sign_loss, reason = "no time is negative")]
    fn run(&mut self, seconds: f64) {
        for _ in 0..(seconds / PERIOD_S).round() as u32 {
            assert_eq!(self.tick().fault, None);
        }
    }
}

/// Every mode that a joint can have.
const MODES: [ServoMode; 6] = [
    ServoMode::Off,
    ServoMode::Effort,
    ServoMode::Torque,
    ServoMode::Position,
    ServoMode::Grasp,
    ServoMode::Impedance,
];

/// In the middle of the joints' ranges, rad.
const POSTURE: [f64; 4] = [0.1, 0.6, 0.8, 0.7];

fn impedance(position: f64, stiffness: f64, damping: f64) -> JointTarget {
    JointTarget::Impedance {
        position,
        stiffness,
        damping,
    }
}

impl Bench {
    /// At rest in [`POSTURE`], with all joints in position mode.
    fn held() -> Self {
        let mut bench = Self::new(POSTURE);
        bench.all(ServoMode::Position);
        bench.run(0.5);
        bench
    }

    fn all(&mut self, mode: ServoMode) {
        for joint in 0..4 {
            self.controller.set_mode(joint, mode).unwrap();
        }
    }

    fn give(&mut self, joint: usize, target: JointTarget) {
        self.controller.set_target(joint, target).unwrap();
    }

    /// The greatest stiffness and damping that a joint can have.
    fn greatest(&self, joint: usize) -> (f64, f64) {
        let mut controller = self.controller.clone();
        let mut highest = |target| match controller.set_target(joint, target) {
            Err(ServoRefusal::Target { high, .. }) => high,
            other => panic!("{other:?}"),
        };
        (
            highest(impedance(0.5, f64::MAX, 0.0)),
            highest(impedance(0.5, 0.0, f64::MAX)),
        )
    }
}

/// The largest change of an effort, N.
fn step(a: &FingerTick<4, 8>, b: &FingerTick<4, 8>) -> f64 {
    largest_step(&a.output.effort, &b.output.effort)
}

/// The greatest change of an effort from one tick to the next by the damping of the soft stops, N, for each rad/s of the
/// fastest joint in the two ticks. It is that of the posture of the greatest inertia, and counts the joint itself and those
/// that it would accelerate.
fn stop_step() -> f64 {
    let entry = &hand().fingers[0];
    let mass = entry.planar().unwrap().mass_matrix(&SVector::zeros());
    let joints = entry.joints.iter().enumerate();
    joints.fold(0.0, |most, (number, joint)| {
        let inertia = mass.row(number).abs().sum() + joint.friction.armature;
        let w = core::f64::consts::TAU * joint.stop.bandwidth_hz;
        let torque = 2.0 * joint.stop.damping_ratio * w * inertia;
        // Each joint has a flexor of its own.
        let arm = entry.actuators[2 * number].arm(&joint.name);
        max(most, torque / arm)
    })
}

#[test]
fn a_load_moves_every_joint_by_the_load_over_the_stiffness() {
    for share in [0.3, 1.0] {
        let mut bench = Bench::held();
        for (joint, position) in POSTURE.into_iter().enumerate() {
            let (stiffness, damping) = bench.greatest(joint);
            bench.give(
                joint,
                impedance(position, share * stiffness, share * damping),
            );
        }
        bench.run(1.0);
        let unloaded = *bench.finger.q() - SVector::from(POSTURE);
        // The model of gravity is the plant's.
        assert!(unloaded.amax() < 1e-6, "{unloaded}");
        for (joint, position) in POSTURE.into_iter().enumerate() {
            let stiffness = share * bench.greatest(joint).0;
            for deflection in [-0.12, 0.15] {
                bench.load = SVector::zeros();
                bench.load[joint] = stiffness * deflection;
                bench.run(2.0);
                let moved = bench.finger.q()[joint] - position;
                assert!(
                    (moved / deflection - 1.0).abs() < 0.02,
                    "joint {joint} moved {moved} rad, not {deflection} rad"
                );
            }
            bench.load = SVector::zeros();
            bench.run(1.0);
        }
    }
}

#[test]
fn a_release_decays_as_stiffness_and_damping_say() {
    let joint = 1;
    // So soft that the way back takes seconds. The tick, the filter of the rate and the actuators, which
    // the root leaves out, are late by some 10 ms in all, and the root is wrong by about that part.
    for (stiffness, share) in [(0.02, 1.0), (0.01, 0.5), (0.03, 1.0)] {
        let mut bench = Bench::held();
        let damping = share * bench.greatest(joint).1;
        bench.give(joint, impedance(POSTURE[joint], stiffness, damping));
        bench.load[joint] = 0.1 * stiffness;
        bench.run(4.0);
        bench.load[joint] = 0.0;
        bench.run(0.3);
        let away = |bench: &Bench| bench.finger.q()[joint] - POSTURE[joint];
        let before = away(&bench);
        let seconds = 0.5;
        bench.run(seconds);
        let after = away(&bench);
        // The slow root of J s² + D s + K, with the friction of the drive.
        let entry = &hand().fingers[0];
        let friction = entry.joints[joint].friction;
        let q = SVector::from(POSTURE);
        let mass = entry.planar().unwrap().mass_matrix(&q);
        let inertia = mass[(joint, joint)] + friction.armature;
        let damping = damping + friction.viscous;
        let root = sqrt(damping * damping - 4.0 * inertia * stiffness);
        let rate = (damping - root) / (2.0 * inertia);
        let expected = before * exp(-rate * seconds);
        assert!(
            (after / expected - 1.0).abs() < 0.01,
            "{after} rad instead of {expected}"
        );
    }
}

#[test]
fn an_impedance_is_bounded_and_an_error_names_the_value_and_the_bounds() {
    let mut bench = Bench::held();
    let (stiffness, damping) = bench.greatest(1);
    assert!((0.3..1.0).contains(&stiffness), "{stiffness}");
    bench.give(1, impedance(0.6, stiffness, damping));
    let kept = bench.controller.clone();
    for (target, begin) in [
        (
            impedance(0.6, -0.1, 0.0),
            "joint 1 cannot have the stiffness -0.1 N m/rad; it can have 0 N m/rad to 0.5",
        ),
        (
            impedance(0.6, f64::NAN, 0.0),
            "joint 1 cannot have the stiffness NaN N m/rad; ",
        ),
        (
            impedance(0.6, f64::INFINITY, 0.0),
            "joint 1 cannot have the stiffness inf N m/rad; ",
        ),
        (
            impedance(0.6, 0.1, -1.0),
            "joint 1 cannot have the damping -1 N m s/rad; it can have 0 N m s/rad to 0.01",
        ),
        (
            impedance(0.6, 0.1, f64::NAN),
            "joint 1 cannot have the damping NaN N m s/rad; ",
        ),
        (
            impedance(3.0, 0.1, 0.0),
            "joint 1 cannot have the position 3 rad; it can have -0.17",
        ),
        (
            impedance(f64::NAN, 0.1, 0.0),
            "joint 1 cannot have the position NaN rad; ",
        ),
    ] {
        let refused = bench.controller.set_target(1, target).unwrap_err();
        assert!(refused.to_string().starts_with(begin), "{refused}");
    }
    // It keeps what it had.
    let (mut kept, sensed) = (
        kept,
        FingerReadings {
            position: *bench.finger.q(),
            actuator_position: [0.0; 8],
            effort: *bench.finger.efforts(),
            touch: 0.0,
        },
    );
    for _ in 0..200 {
        let tick = bench.controller.tick(&sensed, &bench.gravity, PERIOD_S);
        assert_eq!(tick, kept.tick(&sensed, &bench.gravity, PERIOD_S));
    }
    // A position law of less bandwidth allows less.
    let mut gains = *bench.controller.gains(1).unwrap();
    gains.law = PositionLaw::ComputedTorque {
        bandwidth_hz: 5.0,
        damping_ratio: 1.0,
    };
    bench.controller.set_gains(1, &gains).unwrap();
    let (softer, weaker) = bench.greatest(1);
    assert!((softer / stiffness - 0.25).abs() < 1e-9, "{softer}");
    assert!((weaker / damping - 0.5).abs() < 1e-9, "{weaker}");
    gains.law = PositionLaw::Pd {
        kp: 0.2,
        kv: 0.01,
        ki: 0.0,
        integral_nm: 0.0,
    };
    bench.controller.set_gains(1, &gains).unwrap();
    assert_eq!(bench.greatest(1), (0.2, 0.01));
}

#[test]
fn the_stiffest_impedance_of_all_joints_comes_to_rest_in_every_posture() {
    for posture in [
        [0.0, 0.0, 0.2, 0.2],
        [0.3, -0.1, 1.5, 0.2],
        [0.0, 0.6, 0.8, 0.7],
        [-0.3, 1.2, 1.5, 1.4],
    ] {
        let mut bench = Bench::new(posture);
        bench.all(ServoMode::Impedance);
        bench.run(0.2);
        bench.load = SVector::from([0.01, 0.02, 0.01, 0.004]);
        bench.run(0.5);
        bench.load = SVector::zeros();
        bench.run(3.0);
        let rate = bench.finger.qd().amax();
        assert!(rate < 1e-3, "{rate} rad/s in {posture:?}");
        let away = (*bench.finger.q() - SVector::from(posture)).amax();
        assert!(away < 1e-3, "{away} rad from {posture:?}");
    }
}

/// A load beyond what the tendons have does not take an effort beyond its limits.
#[test]
fn an_impedance_keeps_to_the_limits_of_its_tendons_and_to_its_stops() {
    let mut bench = Bench::held();
    let (stiffness, damping) = bench.greatest(3);
    let limits = &hand().fingers[0].joints[3].limits;
    bench.give(3, impedance(limits.high, stiffness, damping));
    bench.run(2.0);
    let is = bench.finger.q()[3];
    // The stop pushes it out of its zone, and does not let it swing.
    assert!((limits.high - 0.06..limits.high).contains(&is), "{is} rad");
    assert!(bench.finger.qd().amax() < 1e-3);
}

/// Changes all joints from one mode to another, while one of them bears a load, N m.
fn changes_without_a_jump(from: ServoMode, to: ServoMode, load: f64) {
    let said = format!("from {from:?} to {to:?} under {load} N m");
    let mut bench = Bench::held();
    bench.load[1] = load;
    bench.run(0.5);
    bench.all(from);
    // Off, the finger falls meanwhile.
    bench.run(0.1);
    let before = bench.tick();
    let is = *bench.finger.q();
    bench.all(to);
    let mut last = bench.tick();
    let first = step(&before, &last);
    assert!(first < 1e-9 || from == to, "{first} N {said}");
    let at_stops = stop_step();
    for _ in 0..100 {
        let rate = bench.finger.qd().amax();
        let tick = bench.tick();
        assert_eq!(tick.fault, None);
        let step = step(&last, &tick);
        // At most the efforts that held the finger go, in the forty ticks of a transition.
        assert!(
            step < 0.2 + at_stops * rate,
            "{step} N at {rate} rad/s {said}"
        );
        last = tick;
    }
    // Off, it falls.
    if from != ServoMode::Off && to != ServoMode::Off {
        let moved = (*bench.finger.q() - is).amax();
        // A law of positions without an integral gives under a load.
        let give = if to == ServoMode::Position {
            2.0 * load.abs()
        } else {
            0.0
        };
        assert!(moved < 1e-3 + give, "{moved} rad {said}");
    }
}

#[test]
fn no_change_between_two_modes_makes_a_jump() {
    for from in MODES {
        for to in MODES {
            changes_without_a_jump(from, to, 0.0);
            changes_without_a_jump(from, to, -0.02);
        }
    }
}

#[test]
fn a_joint_that_bears_a_load_keeps_it_when_it_becomes_a_spring_and_back() {
    let mut bench = Bench::held();
    bench.load[1] = -0.05;
    bench.all(ServoMode::Position);
    bench.run(1.0);
    for (mode, bound) in [
        (ServoMode::Torque, 5e-3),
        (ServoMode::Impedance, 5e-3),
        (ServoMode::Torque, 5e-3),
        (ServoMode::Impedance, 5e-3),
        // Its law has no integral.
        (ServoMode::Position, 0.1),
    ] {
        let is = bench.finger.q()[1];
        bench.all(mode);
        bench.run(0.5);
        let moved = (bench.finger.q()[1] - is).abs();
        assert!(moved < bound, "{moved} rad to {mode:?}");
    }
}

#[test]
fn another_impedance_comes_over_the_time_of_a_transition() {
    let mut bench = Bench::held();
    bench.all(ServoMode::Impedance);
    bench.run(0.3);
    let (stiffness, damping) = bench.greatest(1);
    let mut last = bench.tick();
    for target in [
        impedance(1.2, stiffness, damping),
        impedance(0.2, 0.1 * stiffness, 0.3 * damping),
        impedance(0.2, stiffness, 0.5 * damping),
    ] {
        bench.give(1, target);
        let mut largest = 0.0;
        for _ in 0..80 {
            let tick = bench.tick();
            assert_eq!(tick.fault, None);
            largest = max(largest, step(&last, &tick));
            last = tick;
        }
        assert!(largest < 2.0, "{largest} N to {target:?}");
    }
    // A target that comes in every tick is followed, too.
    for tick in 0..400 {
        let position = 0.4 + 1e-3 * f64::from(tick);
        bench.give(1, impedance(position, stiffness, damping));
        bench.tick();
    }
    let is = bench.finger.q()[1];
    assert!((0.7..0.8).contains(&is), "{is} rad");
}

#[derive(Clone, Copy, Debug)]
enum Change {
    Mode(ServoMode),
    /// A position (rad), and parts of the greatest stiffness and damping.
    Impedance(f64, f64, f64),
}

fn changes() -> impl Strategy<Value = Vec<(usize, Change, usize)>> {
    let change = prop_oneof![
        proptest::sample::select(&MODES[..]).prop_map(Change::Mode),
        (0.2_f64..0.9, 0.0_f64..1.0, 0.1_f64..1.0).prop_map(|(position, stiffness, damping)| {
            Change::Impedance(position, stiffness, damping)
        }),
    ];
    proptest::collection::vec((0_usize..4, change, 0_usize..60), 1..20)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn any_changes_of_mode_keep_efforts_within_limits_and_without_a_jump(changes in changes()) {
        let mut bench = Bench::held();
        let greatest = [0, 1, 2, 3].map(|joint| bench.greatest(joint));
        let at_stops = stop_step();
        let mut last = bench.tick();
        for (joint, change, ticks) in changes {
            // After a fault all are refused.
            let _ = match change {
                Change::Mode(mode) => bench.controller.set_mode(joint, mode),
                Change::Impedance(position, stiffness, damping) => {
                    let (stiffest, most) = greatest[joint];
                    let low = if joint == 0 { 0.5 } else { 0.0 };
                    let position = position - low;
                    let target = impedance(position, stiffness * stiffest, damping * most);
                    bench.controller.set_target(joint, target)
                }
            };
            for _ in 0..=ticks {
                let tick = bench.tick();
                for effort in &tick.output.effort {
                    prop_assert!((4.0..=130.0).contains(effort), "{effort} N");
                }
                let step = step(&last, &tick);
                // The stiffest spring that goes 0.7 rad in the forty ticks of a transition changes an
                // effort by 1 N a tick, and two joints may change what pulls one tendon.
                let rates = [&last, &tick].map(|tick| tick.output.velocity.amax());
                let most = 2.0 + at_stops * max(rates[0], rates[1]);
                prop_assert!(step < most, "{step} N by {change:?} of joint {joint}");
                let q = bench.finger.q();
                prop_assert!(q.iter().all(|q| q.is_finite() && q.abs() < 2.5), "{q}");
                last = tick;
            }
        }
    }
}

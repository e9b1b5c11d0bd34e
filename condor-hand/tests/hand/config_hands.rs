//! The hands that ship say what they should, and become the mechanisms that they describe.
#![cfg(feature = "text")]
#![allow(
    clippy::float_cmp,
    reason = "a number of the file is the number of the hand, to the last bit"
)]

use condor_hand::config::{
    ControlProcessor, Form, Hand, OutputChannel, ProcessorKind, Shape, Wire,
};
use condor_hand::fault::ActuatorFaultLimits;
use condor_hand::math::{sin_cos, sqrt};
use condor_hand::trajectory::{Pace, Primitive, Profile, Target};
use condor_hand::transmission::EffortLimits;
use nalgebra::{Matrix3, Vector3};
use serde_json::Value;

const UTAH: &str = include_str!("../../hands/utah-mit.toml");
const ASYM: &str = include_str!("../hands/utah-mit-asym.toml");
const TRIPOD: &str = include_str!("../hands/tripod.toml");

fn utah() -> Hand<4, 4, 8> {
    Hand::from_toml(UTAH, "utah-mit.toml").unwrap_or_else(|error| panic!("{error}"))
}

fn asym() -> Hand<4, 4, 8> {
    Hand::from_toml(ASYM, "utah-mit-asym.toml").unwrap_or_else(|error| panic!("{error}"))
}

fn tripod<const F: usize, const J: usize, const A: usize>() -> Hand<F, J, A> {
    Hand::from_toml(TRIPOD, "tripod.toml").unwrap_or_else(|error| panic!("{error}"))
}

fn geometry() -> Value {
    serde_json::from_str(include_str!("../reference/geometry.json")).unwrap()
}

fn number(value: &Value) -> f64 {
    value.as_f64().unwrap()
}

fn vector(value: &Value) -> Vector3<f64> {
    Vector3::from_fn(|row, _| number(&value[row]))
}

fn matrix(value: &Value) -> Matrix3<f64> {
    Matrix3::from_fn(|row, column| number(&value[row][column]))
}

#[test]
fn the_utah_hand_is_that_of_the_reference_data() {
    let (hand, geometry) = (utah(), geometry());
    assert_eq!(hand.fingers.len(), 4);
    for (index, finger) in hand.fingers.iter().enumerate() {
        let planar = finger.planar().unwrap();
        let base = &geometry["base"][index];
        assert_eq!(planar.base().rotation, matrix(&base["R"]));
        assert_eq!(planar.base().position, vector(&base["p"]));
        let limits = finger.limits();
        for joint in 0..4 {
            assert_eq!(planar.lengths()[joint], number(&geometry["l"][joint]));
            assert_eq!(limits.low[joint], number(&geometry["qmin"][joint]));
            assert_eq!(limits.high[joint], number(&geometry["qmax"][joint]));
            let body = planar.bodies()[joint];
            assert_eq!(body.mass, number(&geometry["mass"][joint]));
            assert_eq!(
                Vector3::new(body.center, 0.0, 0.0),
                vector(&geometry["com"][joint])
            );
            let inertia = matrix(&geometry["inertia_about_com"][joint]);
            let error = Matrix3::from_diagonal(&body.inertia) - inertia;
            assert!(error.norm() < 1e-12 * inertia.norm(), "{inertia}");
        }
    }
    assert_eq!(Vector3::from(hand.gravity), vector(&geometry["gravity"]));
}

#[test]
fn a_planar_finger_is_the_same_chain() {
    let (hand, geometry) = (utah(), geometry());
    for finger in &hand.fingers {
        let (chain, planar) = (finger.chain(), finger.planar().unwrap());
        assert_eq!(chain.base(), planar.base());
        assert_eq!(*chain.tip_point(), vector(&geometry["tip"]));
        for joint in 0..4 {
            let placed = chain.joints()[joint];
            assert_eq!(
                placed.placement.position,
                vector(&geometry["offsets"][joint])
            );
            assert_eq!(placed.placement.rotation, Matrix3::identity());
            let axis = vector(&geometry["axes"][joint]);
            assert_eq!(
                placed.motion,
                condor_hand::kinematics::ChainMotion::Revolute(axis)
            );
            assert_eq!(
                chain.bodies()[joint].inertia.diagonal(),
                planar.bodies()[joint].inertia
            );
            assert_eq!(
                chain.bodies()[joint].center.x,
                planar.bodies()[joint].center
            );
        }
    }
}

#[test]
fn the_arms_are_those_of_the_reference_data() {
    let geometry = geometry();
    for (hand, name) in [(Box::new(utah()), "P_sym"), (Box::new(asym()), "P_asym")] {
        for finger in &hand.fingers {
            let linear = finger.transmission().unwrap();
            for (actuator, arms) in linear.arms().iter().enumerate() {
                for (joint, &arm) in arms.iter().enumerate() {
                    let expected = number(&geometry[name][joint][actuator]);
                    assert_eq!(arm, expected, "actuator {actuator} at joint {joint}");
                }
                // Each joint has a flexor and an extensor of its own.
                assert_eq!(linear.joint_of(actuator), Some(actuator / 2));
            }
            let limits = EffortLimits {
                low: 4.0,
                high: 130.0,
                bias: 7.0,
            };
            assert_eq!(*linear.limits(), [limits; 8]);
        }
    }
}

#[test]
fn the_processors_are_those_of_the_memo() {
    let hand = utah();
    let indices = |number| {
        let fingers = hand.fingers_on(number);
        fingers.map(|(index, _)| index).collect::<Vec<_>>()
    };
    assert_eq!(indices(1), [0, 1]);
    assert_eq!(indices(2), [2, 3]);
    assert!(indices(0).is_empty() && indices(3).is_empty());
    let rates = hand
        .processors
        .iter()
        .map(|processor| hand.rate_hz(processor));
    assert_eq!(rates.collect::<Vec<_>>(), [50, 400, 400, 400]);
    // 400 Hz times 150 µs and eight joints of 200 µs.
    assert!((hand.load(hand.processor(1).unwrap()) - 0.38).abs() < 1e-12);
    // Sixteen positions, 32 tensions and four tips in, 32 tensions out, and three axes of the table.
    assert_eq!(hand.wires().count(), 16 + 32 + 4 + 32 + 6);
}

#[test]
fn every_channel_leads_to_its_wire_and_back() {
    let (utah, tripod) = (utah(), tripod::<3, 3, 6>());
    for (channel, wire) in utah.wires() {
        assert_eq!(utah.wire(channel), Some(wire));
        let input = utah.input(wire).unwrap();
        let output = utah.output(wire).map(OutputChannel::channel);
        assert!(channel == input.channel() || Some(channel) == output);
    }
    assert_eq!(tripod.wires().count(), 9 * 5);
}

#[test]
fn a_hand_of_another_kind_is_described_too() {
    let hand = tripod::<3, 3, 6>();
    let finger = &hand.fingers[1];
    assert!(finger.planar().is_none());
    assert!(matches!(
        finger.form,
        Form::Chain {
            tip: [0.02, 0.0, 0.0],
            on: None
        }
    ));
    let chain = finger.chain();
    let (sine, cosine) = (sqrt(0.75), -0.5);
    let turn = Matrix3::new(cosine, -sine, 0.0, sine, cosine, 0.0, 0.0, 0.0, 1.0);
    assert!((chain.base().rotation - turn).norm() < 1e-15);
    let (sine, cosine) = sin_cos(0.1);
    let roll = chain.joints()[1].placement.rotation;
    assert!((roll * Vector3::y() - Vector3::new(0.0, cosine, sine)).norm() < 1e-15);
    assert_eq!(
        chain.joints()[2].motion,
        condor_hand::kinematics::ChainMotion::Prismatic(Vector3::x())
    );
    assert_eq!(chain.bodies()[0].inertia[(0, 1)], 1e-7);
    assert_eq!(chain.bodies()[0].inertia[(2, 1)], -1e-7);
    assert_eq!(chain.bodies()[2].mass, 0.0);
    // From the finger that it is like, before what all joints have.
    let limits = finger.actuators[5].limits();
    assert_eq!((limits.low, limits.high, limits.bias), (1.0, 30.0, 5.0));
    let limits = finger.actuators[2].limits();
    assert_eq!((limits.low, limits.high, limits.bias), (1.0, 40.0, 1.0));
    let nail = finger.joints[2].adc.unwrap();
    assert_eq!((nail.channel, nail.bits, nail.gain), (15, 16, 1e-6));
    let servo = hand
        .processors
        .iter()
        .find(|entry| entry.kind == ProcessorKind::Servo)
        .unwrap();
    assert_eq!(hand.rate_hz(servo), 2000);
    assert_eq!(hand.fingers_on(7).count(), 3);
    let linear = finger.transmission().unwrap();
    assert_eq!(
        linear.arms()[2..4],
        [[0.001, 0.006, 0.0], [0.001, -0.006, 0.0]]
    );
    let extensor = &finger.actuators[1];
    assert_eq!(
        [0.0, 30.0, 40.0, 99.0].map(|n| extensor.dac.counts(n)),
        [1000, 250, 0, 0]
    );
    let adc = extensor.adc.as_ref().unwrap();
    assert!((adc.value(30_000) - 30.0).abs() < 1e-12);
    assert_eq!(extensor.dac.counts(f64::NAN), 1000);
    assert_eq!(extensor.dac.counts(f64::INFINITY), 0);
}

#[test]
fn actuators_of_a_finger_that_is_like_another_are_found_by_their_names() {
    let text = include_str!("../hands/differential.toml");
    let second = "
[[fingers]]
name = \"other\"
like = \"wrist\"
actuators = [
    { name = \"right\", dac = { channel = 2 } },
    { name = \"left\", dac = { channel = 3 } },
]

[[fingers.joints]]
adc = { channel = 2 }

[[fingers.joints]]
adc = { channel = 3 }
";
    let text = [text, second].concat();
    let hand = Hand::<2, 2, 2>::from_toml(&text, "two.toml").unwrap();
    let roll = &hand.fingers[1].joints[1].name;
    let arms = hand.fingers[1].actuators.iter().map(|it| it.arm(roll));
    assert_eq!(arms.collect::<Vec<_>>(), [-1.0, 1.0]);
}

#[test]
fn a_differential_of_motors_is_described_too() {
    let text = include_str!("../hands/differential.toml");
    let hand = Hand::<1, 2, 2>::from_toml(text, "differential.toml").unwrap();
    let wrist = &hand.fingers[0];
    let linear = wrist.transmission().unwrap();
    assert_eq!(*linear.arms(), [[1.0, 1.0], [1.0, -1.0]]);
    let motor = EffortLimits {
        low: -2.0,
        high: 2.0,
        bias: 0.0,
    };
    assert_eq!(*linear.limits(), [motor; 2]);
    assert_eq!(wrist.efforts_at_rest(), [0.0; 2]);
    // No sensor measures the efforts.
    assert_eq!(hand.wires().count(), 2 + 2);
    for actuator in 0..2 {
        let wire = Wire::Actuator {
            finger: 0,
            actuator,
        };
        assert_eq!(hand.input(wire), None);
        let output = hand.output(wire).unwrap();
        let counts = [-2.0, 0.0, 1.5].map(|torque| output.counts(torque));
        assert_eq!(counts, [48, 2048, 3548]);
    }
    let settings = wrist.settings(1000.0, 0.1);
    assert!(
        settings
            .actuators
            .iter()
            .all(|actuator| !actuator.is_sensed)
    );
    // No check of an actuator without a sensor is on.
    let limits = wrist.fault_limits(&hand.faults, 1000.0);
    assert_eq!(limits.actuators, [ActuatorFaultLimits::default(); 2]);
}

#[test]
fn room_to_spare_changes_nothing() {
    let (small, large) = (tripod::<3, 3, 6>(), tripod::<5, 6, 8>());
    for (small, large) in small.fingers.iter().zip(&large.fingers) {
        let (few, many) = (small.chain(), large.chain());
        assert_eq!(few.joints()[..], many.joints()[..3]);
        assert_eq!(few.bodies()[..], many.bodies()[..3]);
        assert_eq!(few.tip_point(), many.tip_point());
        assert!(
            many.joints()[3..]
                .iter()
                .all(|joint| joint.motion == condor_hand::kinematics::ChainMotion::Fixed)
        );
        let (few, many) = (small.transmission().unwrap(), large.transmission().unwrap());
        for actuator in 0..6 {
            assert_eq!(few.arms()[actuator], many.arms()[actuator][..3]);
            assert_eq!(many.arms()[actuator][3..], [0.0; 3]);
        }
        // Actuators that the finger does not have move nothing, and have no effort.
        assert_eq!(many.arms()[6..], [[0.0; 6]; 2]);
        assert_eq!(many.limits()[6..], [EffortLimits::fixed(0.0); 2]);
        assert_eq!(many.efforts(&[0.0; 6].into()).saturated, 0);
    }
}

#[test]
fn a_processor_without_a_rate_has_that_of_its_kind() {
    let mut hand = utah();
    hand.servo_hz = 800;
    let rate = |processor: &ControlProcessor| hand.rate_hz(processor);
    assert_eq!(
        hand.processors.iter().map(rate).collect::<Vec<_>>(),
        [50, 800, 800, 800]
    );
}

#[test]
fn a_choice_replaces_another_one_whole() {
    let other = "name = \"middle\"\nlike = \"index\"";
    assert!(UTAH.contains(other));
    let inertia = "shape = { inertia = { moments = [2e-6, 3e-6, 4e-6] } }";
    let (before, after) = UTAH.split_once(other).unwrap();
    let joint = "[[fingers.joints]]\n";
    let own = format!("{joint}body = {{ {inertia} }}\n");
    let text = format!("{before}{other}{}", after.replacen(joint, &own, 1));
    let hand = Hand::<4, 4, 8>::from_toml(&text, "edited").unwrap();
    let shape = Shape::Inertia {
        moments: [2e-6, 3e-6, 4e-6],
        products: [0.0; 3],
    };
    assert_eq!(hand.fingers[1].joints[0].body.unwrap().shape, shape);
}

#[test]
fn what_is_at_a_limit_may_be_rounded() {
    // The home of an axis of the table.
    let read = |home: f64| {
        let with_home = format!("home = {home:?}\nmass_kg = 10.0");
        let text = UTAH.replacen("mass_kg = 10.0", &with_home, 1);
        Hand::<4, 4, 8>::from_toml(&text, "utah-mit.toml")
    };
    assert_eq!(read(0.2 * (1.0 + 1e-12)).map(|_| ()), Ok(()));
    let wrong = read(0.2 * (1.0 + 1e-6)).unwrap_err().to_string();
    assert!(wrong.contains("home"), "{wrong}");
    // A target where a stop is, which becomes one where the joint can rest.
    let hand = utah();
    let joint = hand.joint(0, 1).unwrap();
    let (high, rests) = (joint.limits.high, joint.rest_range().1);
    let far = high * (1.0 + 1e-6);
    for (target, becomes) in [(high, rests), (high * (1.0 + 1e-12), rests), (far, far)] {
        let mut motion = Primitive::<16>::new(Pace::Speed(1.0), Profile::Cubic);
        motion.targets[1] = Target::Absolute(target);
        hand.rest_between_stops(&mut motion);
        assert_eq!(motion.targets[1], Target::Absolute(becomes));
    }
}

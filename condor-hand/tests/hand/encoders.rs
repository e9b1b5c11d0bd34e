//! Positions that sensors at actuators tell: in a transmission, in a description, and in a loop through converters.

#![cfg(feature = "sim")]
#![allow(
    clippy::float_cmp,
    reason = "the tests say where a number is exactly another"
)]

use condor_hand::Subject;
use condor_hand::config::{Channel, Hand, InputChannel, Wire};
use condor_hand::controller::{FingerController, FingerSensors};
use condor_hand::fault::{Fault, FaultCode, FaultPlace, FaultQuantity};
use condor_hand::math::sin_cos;
use condor_hand::plant::PlantModel;
use condor_hand::servo::JointTarget;
use condor_hand::trajectory::SetPoint;
use condor_hand::transmission::{EffortLimits, Linear};
use nalgebra::{SVector, Vector2, Vector3};
use proptest::prelude::*;

const HZ: f64 = 1000.0;

/// The wrist of a differential whose motors have encoders instead of sensors at its joints.
fn hand() -> Hand<1, 2, 2> {
    let text = include_str!("../hands/differential.toml");
    let mut hand = Hand::<1, 2, 2>::from_toml(text, "differential.toml").unwrap();
    let wrist = &mut hand.fingers[0];
    for (joint, actuator) in wrist.joints.iter_mut().zip(&mut wrist.actuators) {
        actuator.encoder = joint.adc.take();
    }
    hand.check().unwrap();
    hand
}

/// The counts of the encoders when the joints are there.
fn counts(hand: &Hand<1, 2, 2>, q: &Vector2<f64>, channel: Channel) -> u32 {
    let Some(Wire::Encoder { finger, actuator }) = hand.wire(channel) else {
        panic!("{channel:?} is another wire");
    };
    let positions = hand.fingers[finger].transmission().unwrap().actuators(q);
    let encoder = hand.input(Wire::Encoder { finger, actuator }).unwrap();
    encoder.counts(positions[actuator])
}

#[test]
fn a_differential_is_controlled_by_the_encoders_of_its_motors() {
    let hand = hand();
    let wrist = &hand.fingers[0];
    let (chain, transmission) = (wrist.chain(), wrist.transmission().unwrap());
    let start = Vector2::new(0.2, -0.1);
    let mut plant = PlantModel::default()
        .finger(wrist, chain, transmission, start)
        .unwrap();
    let mut controller = FingerController::new(&hand, wrist, chain, transmission).unwrap();
    let sensors = FingerSensors::new(wrist).unwrap();
    let gravity = Vector3::from(hand.gravity);
    for (pitch, roll) in [(0.5, -0.6), (-0.4, 0.7)] {
        for (joint, position) in [pitch, roll].into_iter().enumerate() {
            let target = JointTarget::Position(SetPoint::rest(position));
            controller.set_target(joint, target).unwrap();
        }
        for _ in 0..2000 {
            let q = *plant.q();
            let sensed = sensors.read(|channel| Some(counts(&hand, &q, channel)));
            // Half a count of each encoder.
            assert!((sensed.position - q).amax() <= 1e-4, "{}", sensed.position);
            let tick = controller.tick(&sensed, &gravity, 1.0 / HZ);
            assert_eq!(tick.fault, None);
            plant
                .step(1.0 / HZ, 10, &tick.output.command, &gravity)
                .unwrap();
        }
        let away = (plant.q() - Vector2::new(pitch, roll)).amax();
        assert!(away < 2e-3, "{away} rad from {pitch} and {roll}");
    }
    // Both motors tell both joints: without one of them no joint is known.
    let q = *plant.q();
    let mut fault = None;
    for _ in 0..200 {
        let sensed =
            sensors.read(|channel| (channel.channel != 1).then(|| counts(&hand, &q, channel)));
        assert!(sensed.position.iter().all(|position| position.is_nan()));
        fault = controller.tick(&sensed, &gravity, 1.0 / HZ).fault;
    }
    assert_eq!(named(fault.unwrap()), (FaultCode::NotFinite, RIGHT));
}

const RIGHT: FaultPlace = FaultPlace::Actuator(1);

fn named(fault: Fault) -> (FaultCode, FaultPlace) {
    assert_eq!(fault.quantity, FaultQuantity::Position);
    assert!(!fault.allowed.holds(fault.value), "{fault:?}");
    (fault.code, fault.place)
}

/// A change of a position that begins during a motion: of the joint or actuator of this number, by the present position
/// and that at which it began, rad.
type Change<'c> = &'c dyn Fn(usize, f64, f64) -> f64;

const NO_CHANGE: Change<'static> = &|_, now, _| now;

/// The tick in which changes begin.
const BEGIN: i32 = 300;

/// The fault of a wrist whose joints go to and fro, when something changes where joints are and what the encoders of
/// actuators show; `None` if there is none.
fn fault_in_motion(of_joints: Change<'_>, of_encoders: Change<'_>) -> Option<Fault> {
    let hand = hand();
    let wrist = &hand.fingers[0];
    let (chain, transmission) = (wrist.chain(), wrist.transmission().unwrap());
    let mut controller = FingerController::new(&hand, wrist, chain, transmission).unwrap();
    let sensors = FingerSensors::new(wrist).unwrap();
    let gravity = Vector3::from(hand.gravity);
    let along = |tick: i32| 0.4 * sin_cos(3.0 * f64::from(tick) / HZ).1;
    let wanted = |tick: i32| Vector2::new(along(tick), 0.3 * along(tick));
    let changed = |change: Change<'_>, tick: i32, now: Vector2<f64>, begun: Vector2<f64>| {
        let change = |place: usize| change(place, now[place], begun[place]);
        let is_changed = tick >= BEGIN;
        if is_changed {
            Vector2::new(change(0), change(1))
        } else {
            now
        }
    };
    for tick in 0..3000 {
        for joint in 0..2 {
            let position = wanted(tick)[joint];
            let velocity = (position - wanted(tick - 1)[joint]) * HZ;
            let acceleration = 0.0;
            let point = SetPoint {
                position,
                velocity,
                acceleration,
            };
            let target = JointTarget::Position(point);
            controller.set_target(joint, target).unwrap();
        }
        // The joints go where they are to go.
        let begun = wanted(BEGIN);
        let q = changed(of_joints, tick, wanted(tick), begun);
        let of_actuators = |q: &Vector2<f64>| Vector2::from(transmission.actuators(q));
        let shown = changed(of_encoders, tick, of_actuators(&q), of_actuators(&begun));
        let sensed = sensors.read(|channel| {
            let wire = hand.wire(channel).unwrap();
            let Wire::Encoder { actuator, .. } = wire else {
                panic!("{wire:?} is no encoder");
            };
            Some(hand.input(wire).unwrap().counts(shown[actuator]))
        });
        let fault = controller.tick(&sensed, &gravity, 1.0 / HZ).fault;
        if let Some(fault) = fault {
            println!("{}", fault.of(wrist));
            return Some(fault);
        }
    }
    None
}

#[test]
fn an_encoder_that_sticks_is_named() {
    assert_eq!(fault_in_motion(NO_CHANGE, NO_CHANGE), None);
    for actuator in 0..2 {
        let sticks = |number, now, begun| if number == actuator { begun } else { now };
        let fault = fault_in_motion(NO_CHANGE, &sticks).unwrap();
        let expected = (FaultCode::Stuck, FaultPlace::Actuator(actuator));
        assert_eq!(named(fault), expected);
    }
}

#[test]
fn an_encoder_that_jumps_is_named() {
    for actuator in 0..2 {
        for jump in [0.4, -1.0, 3.0] {
            let jumps = |number, now, _| {
                let is_it = number == actuator;
                now + if is_it { jump } else { 0.0 }
            };
            let fault = fault_in_motion(NO_CHANGE, &jumps).unwrap();
            let expected = (FaultCode::Jump, FaultPlace::Actuator(actuator));
            assert_eq!(named(fault), expected, "by {jump} rad");
        }
    }
}

#[test]
fn a_joint_that_is_held_or_hit_is_named_itself() {
    for joint in 0..2 {
        let held = |number, now, begun| if number == joint { begun } else { now };
        let fault = fault_in_motion(&held, NO_CHANGE).unwrap();
        assert_eq!(named(fault).1, FaultPlace::Joint(joint));
        let hit = |number, now, _| now + if number == joint { 0.2 } else { 0.0 };
        let fault = fault_in_motion(&hit, NO_CHANGE).unwrap();
        let expected = (FaultCode::Jump, FaultPlace::Joint(joint));
        assert_eq!(named(fault), expected);
    }
}

#[test]
fn a_joint_with_a_sensor_of_its_own_is_where_that_says() {
    let mut hand = hand();
    let wrist = &mut hand.fingers[0];
    // Pitch has a sensor, and one motor an encoder.
    wrist.joints[0].adc = wrist.actuators[1].encoder.take();
    hand.check().unwrap();
    let wrist = &hand.fingers[0];
    let sensors = FingerSensors::new(wrist).unwrap();
    let value = |input: Option<InputChannel>, value: f64| Some(input.unwrap().counts(value));
    let (pitch, roll) = (0.3, -0.7);
    let read = |channel: Channel| match hand.wire(channel).unwrap() {
        Wire::Position { joint, .. } => value(wrist.joints[joint].adc, pitch),
        Wire::Encoder { actuator, .. } => value(wrist.actuators[actuator].encoder, pitch + roll),
        other => panic!("{other:?}"),
    };
    let sensed = sensors.read(read);
    assert!((sensed.position - Vector2::new(pitch, roll)).amax() < 2e-4);
    // A reading that fails spoils only what depends on it.
    let sensed = sensors.read(|channel| read(channel).filter(|_| channel.channel == 1));
    assert!((sensed.position[0] - pitch).abs() < 1e-4 && sensed.position[1].is_nan());
}

#[test]
fn joints_that_no_sensor_tells_are_refused() {
    let mut hand = hand();
    hand.fingers[0].actuators[1].encoder = None;
    assert_eq!(
        hand.check().unwrap_err().to_string(),
        "joint `pitch` of finger `wrist` is measured by no sensor; give it an `adc`, or give actuators that move it an `encoder`"
    );
    assert_eq!(
        FingerSensors::new(&hand.fingers[0])
            .unwrap_err()
            .to_string(),
        "joint 0: the number of sensors that tell its position is 0; it must be at least 1"
    );
    hand.fingers[0].actuators[0].encoder = None;
    assert!(
        hand.check()
            .unwrap_err()
            .to_string()
            .starts_with("joint `pitch`")
    );
}

#[test]
fn an_encoder_must_reach_as_far_as_the_joints() {
    let mut hand = hand();
    let encoder = hand.fingers[0].actuators[0].encoder.as_mut().unwrap();
    (encoder.gain, encoder.offset) = (1e-5, -0.32768);
    let mistake = hand.check().unwrap_err().to_string();
    assert!(
        mistake.starts_with(
            "`encoder` of actuator `left` of finger `wrist`: a value that it must convert is -3"
        ),
        "{mistake}"
    );
    let mut hand = self::hand();
    hand.fingers[0].actuators[1].encoder = hand.fingers[0].actuators[0].encoder;
    let mistake = hand.check().unwrap_err();
    assert_eq!(mistake.path, "fingers[0].actuators[1].encoder.channel");
}

proptest! {
    /// Positions that are computed are those from which the readings came, whichever sensors there are.
    #[test]
    fn sensors_tell_where_joints_are(
        arms in prop::array::uniform5(prop::array::uniform4(-0.02..0.02)),
        q in prop::array::uniform4(-2.0..2.0),
        joints in prop::array::uniform4(any::<bool>()),
        actuators in prop::array::uniform5(any::<bool>()),
    ) {
        let Ok(linear) = Linear::new(arms, [EffortLimits::fixed(0.0); 5]) else {
            return Ok(());
        };
        let q = SVector::from(q);
        let there = linear.actuators(&q);
        let unknown = joints.iter().filter(|sensed| !**sensed).count();
        let encoders = actuators.iter().filter(|sensed| **sensed).count();
        match linear.position_sensing(&joints, &actuators) {
            Ok(sensing) => {
                prop_assert!(encoders >= unknown);
                let sensed = SVector::from_fn(|row, _| if joints[row] { q[row] } else { f64::NAN });
                let actuated = std::array::from_fn(|row| if actuators[row] { there[row] } else { f64::NAN });
                let away = (sensing.positions(&sensed, &actuated) - q).amax();
                prop_assert!(away < 1e-3, "{} rad away", away);
                let exact = sensing.resolutions(&[0.0; 4], &[0.0; 5]);
                prop_assert_eq!(exact.amax(), 0.0);
            }
            Err(error) => {
                prop_assert!(matches!(error.at, Subject::Joint(0..4)) && unknown > 0);
            }
        }
    }
}

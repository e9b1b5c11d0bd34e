//! The numbers that can change while a robot runs: their ranges, and what they do.

#![allow(clippy::float_cmp, reason = "ends of ranges are exact")]

use condor_hand::config::{
    Actuator, ActuatorNumber, AxisNumber, FaultNumber, FaultPolicy, Hand, Joint, JointNumber,
    MotionNumber,
};
use condor_hand::controller::{AxisServo, FingerController};
use condor_hand::fault::{FaultCode, FaultPlace};
use condor_hand::kinematics::PlanarFinger;
use condor_hand::math::max;
use condor_hand::servo::{FingerReadings, JointTarget, ServoMode, ServoRefusal};
use condor_hand::trajectory::{
    Generator, Observations, Pace, Primitive, Profile, ProfileLimits, SetPoint, Target,
};
use condor_hand::transmission::Linear;
use nalgebra::{Vector3, Vector4};

use crate::support::largest_step;

const TEXT: &str = include_str!("../../hands/utah-mit.toml");
const HZ: u32 = 400;
const PERIOD_S: f64 = 1.0 / 400.0;

type Controller = FingerController<PlanarFinger, Linear<4, 8>, 4, 8>;

/// The hand, whose joints and actuators have all filters.
fn hand() -> Hand<4, 4, 8> {
    let filters = "position_cutoff_hz = 190.0\nvelocity_cutoff_hz = 100.0";
    let text = TEXT.replace("velocity_cutoff_hz = 100.0", filters);
    let text = text.replace(
        "gains = { kp = 1.0 }",
        "gains = { kp = 1.0 }\ncutoff_hz = 150.0",
    );
    let mut hand = Hand::from_toml(&text, "utah-mit.toml").unwrap();
    // The sensors of these tests say what the tests say.
    hand.faults.frozen_rad = 10.0;
    hand
}

fn put(joint: &mut Joint, number: JointNumber, value: f64) {
    match number {
        JointNumber::Low => joint.limits.low = value,
        JointNumber::High => joint.limits.high = value,
        JointNumber::Zone => joint.stop.zone = value,
        JointNumber::StopBandwidth => joint.stop.bandwidth_hz = value,
        JointNumber::PositionCutoff => joint.servo.position_cutoff_hz = Some(value),
        JointNumber::VelocityCutoff => joint.servo.velocity_cutoff_hz = value,
    }
}

fn put_actuator(actuator: &mut Actuator<4>, number: ActuatorNumber, value: f64) {
    match number {
        ActuatorNumber::Below => actuator.faults.below = Some(value),
        ActuatorNumber::Above => actuator.faults.above = Some(value),
        ActuatorNumber::Cutoff => actuator.cutoff_hz = Some(value),
    }
}

fn controller(hand: &Hand<4, 4, 8>) -> Controller {
    let finger = &hand.fingers[0];
    FingerController::new(
        hand,
        finger,
        finger.planar().unwrap(),
        finger.transmission().unwrap(),
    )
    .unwrap()
}

fn tick(controller: &mut Controller, efforts: &mut [f64; 8]) -> Option<FaultCode> {
    let sensed = FingerReadings {
        position: Vector4::new(0.1, 0.6, 0.8, 0.7),
        actuator_position: [0.0; 8],
        effort: *efforts,
        touch: 0.0,
    };
    let tick = controller.tick(&sensed, &Vector3::new(0.0, 0.0, -9.81), PERIOD_S);
    *efforts = tick.output.effort;
    tick.fault.map(|fault| fault.code)
}

/// A finger that holds its posture, and its efforts.
fn holding(hand: &Hand<4, 4, 8>) -> (Controller, [f64; 8]) {
    let (mut controller, mut efforts) = (controller(hand), [4.0; 8]);
    for joint in 0..4 {
        controller.set_mode(joint, ServoMode::Position).unwrap();
    }
    for _ in 0..60 {
        assert_eq!(tick(&mut controller, &mut efforts), None);
    }
    (controller, efforts)
}

#[test]
fn a_description_may_have_all_numbers_at_any_ends_of_their_ranges() {
    let described = hand();
    // In binary, the end that each number is at; some of both for each pair.
    let choices = [
        0, !0, 0x555, 0xaaa, 0x333, 0xccc, 0x0f0, 0xf0f, 0x9a5, 0x65a,
    ];
    for choice in choices {
        let mut hand = described.clone();
        for finger in &mut hand.fingers {
            let of_joints = [0, 1, 2, 3].map(|joint| finger.ranges(joint, HZ));
            for (joint, ranges) in finger.joints.iter_mut().zip(of_joints) {
                for (place, (number, range)) in JointNumber::ALL.into_iter().zip(ranges).enumerate()
                {
                    let range = range.unwrap();
                    let value = number.of(joint).unwrap();
                    assert!(
                        range[0] <= value && value <= range[1],
                        "{number:?}: {range:?}"
                    );
                    assert!(range[0] < range[1], "{number:?}: {range:?}");
                    // A stop that is too soft to end a motion in seconds is harmless, but not as described.
                    let end = if number == JointNumber::StopBandwidth {
                        1
                    } else {
                        choice >> place & 1
                    };
                    put(joint, number, range[end]);
                }
            }
            for actuator in &mut finger.actuators {
                let numbers = ActuatorNumber::ALL.into_iter();
                for (place, (number, range)) in numbers.zip(actuator.ranges(HZ)).enumerate() {
                    let (value, range) = (number.of(actuator).unwrap(), range.unwrap());
                    assert!(
                        range[0] <= value && value <= range[1] && range[0] < range[1],
                        "{number:?}: {range:?}"
                    );
                    put_actuator(actuator, number, range[choice >> place & 1]);
                }
            }
        }
        for number in FaultNumber::THRESHOLDS
            .into_iter()
            .chain(FaultNumber::COUNTS)
        {
            let range = described.faults.range(number, HZ);
            let value = described.faults.number(number);
            assert!(
                range[0] <= value && value <= range[1],
                "{number:?}: {range:?}"
            );
        }
        let table = hand.table.as_mut().unwrap();
        for axis in &mut table.axes {
            let at = choice & 1;
            let [kp, kv, ki, integral, cutoff] =
                AxisNumber::ALL.map(|number| number.range(axis, HZ)[at]);
            let servo = &mut axis.servo;
            (servo.kp, servo.kv, servo.ki) = (kp, kv, ki);
            (servo.integral_max, servo.velocity_cutoff_hz) = (integral, cutoff);
        }
        hand.check()
            .unwrap_or_else(|wrong| panic!("{choice:#x}: {wrong}"));
    }
}

#[test]
fn ranges_are_as_near_to_the_description_as_is_safe() {
    let hand = hand();
    let finger = &hand.fingers[0];
    let joint = &finger.joints[1];
    let range = |number: JointNumber| finger.ranges(1, HZ)[number as usize].unwrap();
    assert_eq!(
        range(JointNumber::StopBandwidth),
        [0.0, joint.stop.bandwidth_hz]
    );
    assert_eq!(
        range(JointNumber::Low)[0].to_bits(),
        joint.limits.low.to_bits()
    );
    let [slow, fast] = range(JointNumber::VelocityCutoff);
    assert!(
        (10.0..100.0).contains(&slow) && fast < 200.0,
        "{slow} to {fast}"
    );
    let flexor = &finger.actuators[2];
    let range = |number: ActuatorNumber| flexor.ranges(HZ)[number as usize].unwrap();
    // A count of the sensor is 0.05 N.
    let [least, most] = range(ActuatorNumber::Below);
    assert!(
        least == 0.0 && most < flexor.limits.low && most > 3.9,
        "{least} to {most}"
    );
    let [least, most] = range(ActuatorNumber::Above);
    assert!(
        least > flexor.limits.high && least < 131.0 && (most - 200.0).abs() < 1e-9,
        "{least} to {most}"
    );
    assert_eq!(finger.ranges(4, HZ), [None; 6]);
    let faults = FaultPolicy {
        tracking_rad: 0.35,
        ..hand.faults
    };
    let [least, most] = faults.range(FaultNumber::Tracking, HZ);
    assert!(
        least > 0.0 && least < 1e-3 && (most - 1.4).abs() < 1e-12,
        "{least} to {most}"
    );
    assert_eq!(faults.range(FaultNumber::TrackingSamples, HZ), [1.0, 400.0]);
    let limits = &joint.limits;
    assert_eq!(
        MotionNumber::Velocity.range(limits)[1].to_bits(),
        limits.velocity.to_bits()
    );
    // A filter that there is not cannot be added.
    let bare = Hand::<4, 4, 8>::from_toml(TEXT, "utah-mit.toml").unwrap();
    let bare = &bare.fingers[0];
    assert_eq!(
        bare.ranges(0, HZ)[JointNumber::PositionCutoff as usize],
        None
    );
    let ranges = bare.actuators[0].ranges(HZ);
    assert_eq!(ranges[ActuatorNumber::Cutoff as usize], None);
}

/// Changes a number of a finger that holds its posture, which must make no step.
fn has_no_step(hand: &Hand<4, 4, 8>, change: impl FnOnce(&mut Controller), number: &str) {
    let (mut controller, mut efforts) = holding(hand);
    change(&mut controller);
    let before = efforts;
    // Past a limit that comes nearer is a fault, which takes samples in a row.
    assert_eq!(tick(&mut controller, &mut efforts), None, "{number}");
    let step = largest_step(&before, &efforts);
    assert!(step < 1e-9, "{number}: {step}");
}

#[test]
fn no_number_makes_a_step_of_effort() {
    let hand = hand();
    let finger = &hand.fingers[0];
    for (number, range) in JointNumber::ALL.into_iter().zip(finger.ranges(1, HZ)) {
        for end in range.unwrap() {
            let change = |controller: &mut Controller| {
                controller.set_number(1, number, end).unwrap();
                assert_eq!(controller.number(1, number), Some(end), "{number:?}");
            };
            has_no_step(&hand, change, number.name().0);
        }
    }
    let ranges = finger.actuators[2].ranges(HZ);
    for (number, range) in ActuatorNumber::ALL.into_iter().zip(ranges) {
        for end in range.unwrap() {
            let change = |controller: &mut Controller| {
                controller.set_actuator_number(2, number, end).unwrap();
                let is = controller.actuator_number(2, number);
                assert_eq!(is, Some(end), "{number:?}");
            };
            has_no_step(&hand, change, number.name().0);
        }
    }
}

#[test]
fn a_threshold_that_is_lowered_makes_its_fault() {
    let hand = hand();
    let (mut controller, mut efforts) = holding(&hand);
    let target = JointTarget::Position(SetPoint::rest(0.7));
    controller.set_target(1, target).unwrap();
    for _ in 0..200 {
        assert_eq!(tick(&mut controller, &mut efforts), None);
    }
    controller
        .set_fault_number(FaultNumber::Tracking, 0.05)
        .unwrap();
    controller
        .set_fault_number(FaultNumber::TrackingSamples, 3.0)
        .unwrap();
    assert!((controller.faults().tracking_rad - 0.05).abs() < f64::EPSILON);
    for _ in 0..2 {
        assert_eq!(tick(&mut controller, &mut efforts), None);
    }
    assert_eq!(
        tick(&mut controller, &mut efforts),
        Some(FaultCode::Tracking)
    );

    // The joint is at 0.6 rad; the thresholds of the others stay.
    let (mut controller, mut efforts) = holding(&hand);
    let least = efforts[5] + 1.0;
    controller
        .set_actuator_number(5, ActuatorNumber::Below, least)
        .unwrap();
    let mut fault = None;
    for _ in 0..hand.faults.effort_samples {
        fault = tick(&mut controller, &mut efforts);
    }
    assert_eq!(fault, Some(FaultCode::LowEffort));
    let site = controller.fault().unwrap().place;
    assert_eq!(site, FaultPlace::Actuator(5));
}

#[test]
fn a_number_that_no_joint_can_have_is_refused_and_changes_nothing() {
    let hand = hand();
    let (mut controller, _) = holding(&hand);
    for (number, value) in [
        (JointNumber::VelocityCutoff, 200.0),
        (JointNumber::VelocityCutoff, 0.0),
        (JointNumber::PositionCutoff, f64::NAN),
        (JointNumber::Low, 9.0),
        (JointNumber::Zone, -0.1),
    ] {
        let before = controller.number(1, number);
        let refused = controller.set_number(1, number, value);
        assert!(
            matches!(refused, Err(ServoRefusal::Gain(_))),
            "{number:?}: {refused:?}"
        );
        assert_eq!(controller.number(1, number), before);
    }
    for (number, value) in [
        (ActuatorNumber::Cutoff, f64::INFINITY),
        (ActuatorNumber::Cutoff, 200.0),
        (ActuatorNumber::Above, f64::NAN),
        (ActuatorNumber::Above, -1.0),
    ] {
        let before = controller.actuator_number(3, number);
        let refused = controller.set_actuator_number(3, number, value);
        assert!(
            matches!(refused, Err(ServoRefusal::Gain(_))),
            "{number:?}: {refused:?}"
        );
        assert_eq!(controller.actuator_number(3, number), before);
    }
    let refused = controller.set_actuator_number(8, ActuatorNumber::Below, 1.0);
    assert_eq!(refused, Err(ServoRefusal::no_actuator(8, 8)));
    let refused = controller.set_number(4, JointNumber::Zone, 0.1);
    assert_eq!(refused, Err(ServoRefusal::no_joint(4, 4)));
    let refused = controller.set_fault_number(FaultNumber::Tracking, -1.0);
    assert!(matches!(refused, Err(ServoRefusal::Gain(_))), "{refused:?}");
}

#[test]
fn the_force_of_an_axis_makes_no_step_when_its_gains_change() {
    let hand = hand();
    let axis = &hand.table.as_ref().unwrap().axes[0];
    let mut servo = AxisServo::new(axis, f64::from(HZ)).unwrap();
    let point = SetPoint::rest(0.01);
    let mut force = 0.0;
    for _ in 0..100 {
        force = servo.update(&point, 0.0, PERIOD_S);
    }
    let first = force;
    let kp = 2.0 * axis.servo.kp;
    servo.set_number(AxisNumber::Kp, kp, 40).unwrap();
    for _ in 0..40 {
        let next = servo.update(&point, 0.0, PERIOD_S);
        assert!((next - force).abs() < first / 20.0, "{force} to {next}");
        force = next;
    }
    assert!((force - 2.0 * first).abs() < 1e-9, "{first} to {force}");
    assert!((servo.number(AxisNumber::Kp) - kp).abs() < f64::EPSILON);
    servo.set_number(AxisNumber::Ki, -1.0, 40).unwrap_err();
}

#[test]
fn limits_of_motions_change_between_motions_alone() {
    let limits = ProfileLimits {
        low: -1.0,
        high: 1.0,
        velocity: 2.0,
        acceleration: 20.0,
        jerk: 1e3,
    };
    let mut generator = Generator::<1, 4>::new([limits], [0.0], 0.02).unwrap();
    let reach = |to| {
        let motion = Primitive::new(Pace::Speed(1.0), Profile::Trapezoid);
        motion.with(0, Target::Absolute(to)).unwrap()
    };
    let fastest = |generator: &mut Generator<1, 4>| {
        let mut fastest = 0.0;
        while !generator.is_idle() {
            let [point] = generator.tick(&Observations::none());
            fastest = max(fastest, point.velocity.abs());
        }
        fastest
    };
    generator.enqueue(reach(1.0)).unwrap();
    generator.tick(&Observations::none());
    assert_eq!(generator.set_rates(0, 0.5, 20.0, 1e3), Ok(false));
    assert!(fastest(&mut generator) > 1.5);
    assert_eq!(generator.set_rates(0, 0.5, 20.0, 1e3), Ok(true));
    generator.enqueue(reach(-1.0)).unwrap();
    let fastest = fastest(&mut generator);
    assert!(fastest > 0.4 && fastest < 0.5 + 1e-9, "{fastest}");
    generator.set_rates(0, 0.0, 20.0, 1e3).unwrap_err();
    assert_eq!(generator.set_rates(1, 0.5, 20.0, 1e3), Ok(false));
}

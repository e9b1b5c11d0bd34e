//! The servo of a finger with other actuators than pairs of tendons: motors, differentials, and arms that change.

#![cfg(feature = "sim")]
#![allow(
    clippy::float_cmp,
    reason = "the tests say where a number is exactly another"
)]

use condor_hand::config::Hand;
use condor_hand::controller::FingerController;
use condor_hand::dynamics::{DriveDynamics, Dynamics};
use condor_hand::kinematics::Chain;
use condor_hand::math::max;
use condor_hand::plant::{DriveKind, FingerParameters, PlantModel, SimDrive, SimFinger};
use condor_hand::servo::{
    ActuatorSettings, EffortGains, FingerReadings, FingerServo, FingerSettings, JointGains,
    JointSettings, JointTarget, PositionLaw, ServoMode, ServoOutput, SoftStop,
};
use condor_hand::trajectory::SetPoint;
use condor_hand::transmission::{EffortLimits, Linear, Transmission};
use nalgebra::{SVector, Vector1, Vector2, Vector3};

use crate::plant::mechanisms::{Pendulum, free_joint};
use crate::support::largest_step;

const HZ: f64 = 1000.0;
const PERIOD_S: f64 = 1.0 / HZ;

/// A servo and the finger that it moves.
struct Bench<M, T, const N: usize, const A: usize> {
    servo: FingerServo<M, T, N, A>,
    finger: SimFinger<M, T, N, A>,
    gravity: Vector3<f64>,
}

impl<M: Dynamics<N>, T: Transmission<N, A>, const N: usize, const A: usize> Bench<M, T, N, A> {
    fn tick(&mut self) -> ServoOutput<N, A> {
        let sensed = self.finger.readings();
        let output = self.servo.tick(&sensed, &self.gravity, PERIOD_S);
        self.finger
            .step(PERIOD_S, 10, &output.command, &self.gravity)
            .unwrap();
        output
    }

    /// Passes so much time, at least one tick; gives the last one.
    fn run(&mut self, ticks: u32) -> ServoOutput<N, A> {
        for _ in 1..ticks {
            self.tick();
        }
        self.tick()
    }

    fn go(&mut self, joint: usize, position: f64) {
        let target = JointTarget::Position(SetPoint::rest(position));
        self.servo.set_target(joint, target).unwrap();
    }
}

/// The joints of the wrist. Motors turn the first one together, and the second one against each other.
const PITCH: usize = 0;
const ROLL: usize = 1;

fn hand() -> Hand<1, 2, 2> {
    let text = include_str!("../hands/differential.toml");
    Hand::from_toml(text, "differential.toml").unwrap()
}

type Wrist = Bench<Chain<2>, Linear<2, 2>, 2, 2>;

/// The wrist of the file, whose motors have these gains, with or without sensors of their torques.
fn wrist_with(gains: EffortGains, is_sensed: bool) -> Wrist {
    let hand = hand();
    let wrist = &hand.fingers[0];
    let transmission = wrist.transmission().unwrap();
    let mut settings = wrist.settings(HZ, 0.1);
    for actuator in &mut settings.actuators {
        (actuator.gains, actuator.is_sensed) = (gains, is_sensed);
    }
    let start = Vector2::new(0.2, -0.1);
    let model = PlantModel::default();
    Bench {
        servo: FingerServo::new(wrist.chain(), transmission, &settings).unwrap(),
        finger: model
            .finger(wrist, wrist.chain(), transmission, start)
            .unwrap(),
        gravity: Vector3::from(hand.gravity),
    }
}

fn wrist() -> Wrist {
    wrist_with(EffortGains::default(), true)
}

#[test]
fn two_motors_of_a_differential_hold_and_move_two_joints() {
    let mut wrist = wrist();
    for (pitch, roll) in [(0.5, -0.6), (-0.4, 0.9), (0.0, 0.0)] {
        wrist.go(PITCH, pitch);
        wrist.go(ROLL, roll);
        let output = wrist.run(2000);
        let away = (wrist.finger.q() - Vector2::new(pitch, roll)).amax();
        assert!(away < 1e-3, "{away} rad from {pitch} and {roll}");
        assert_eq!((output.saturated, output.lost), (0, 0));
    }
    // Level, 0.3 kg hang 50 mm from the axis of pitch, which is positive downwards: the motors share the torque.
    let output = wrist.tick();
    let half = -0.5 * 0.3 * 9.81 * 0.05;
    for effort in output.effort.iter().chain(&output.command) {
        assert!((effort - half).abs() < 1e-3, "{effort} N m, not {half} N m");
    }
}

#[test]
fn a_torque_that_a_law_cannot_have_is_flagged() {
    let (kp, kv, ki, integral_nm) = (1e3, 0.0, 1.0, 0.1);
    for law in [
        PositionLaw::Pd {
            kp,
            kv,
            ki,
            integral_nm,
        },
        PositionLaw::ComputedTorque {
            bandwidth_hz: 400.0,
            damping_ratio: 1.0,
        },
    ] {
        let mut wrist = wrist();
        let gains = *wrist.servo.gains(PITCH).unwrap();
        let gains = JointGains { law, ..gains };
        wrist.servo.set_gains(PITCH, &gains).unwrap();
        wrist.run(1);
        wrist.go(PITCH, 0.4);
        let output = wrist.run(1);
        assert_eq!(output.saturated, 1 << PITCH, "{law:?} {output:?}");
    }
}

#[test]
fn a_joint_that_is_off_has_no_torque_while_the_other_one_follows() {
    for (following, off) in [(PITCH, ROLL), (ROLL, PITCH)] {
        let mut wrist = wrist();
        // Nothing pulls at the joint that is off.
        wrist.gravity = Vector3::zeros();
        let start = *wrist.finger.q();
        wrist.go(following, 0.6);
        for _ in 0..1500 {
            let output = wrist.tick();
            let torque = output.torque[off];
            assert!(torque.abs() < 1e-12, "{torque} N m at joint {off}");
            assert_eq!(output.saturated, 0);
        }
        let q = wrist.finger.q();
        assert!((q[following] - 0.6).abs() < 1e-3, "{q}");
        assert!((q[off] - start[off]).abs() < 1e-3, "{q}");
    }
}

#[test]
fn motors_from_which_nothing_is_asked_are_at_rest() {
    let mut wrist = wrist();
    wrist.go(PITCH, 0.2);
    wrist.go(ROLL, 0.4);
    wrist.run(500);
    for joint in [PITCH, ROLL] {
        wrist.servo.set_mode(joint, ServoMode::Off).unwrap();
    }
    // After the transition of a tenth of a second.
    let output = wrist.run(102);
    assert_eq!((output.effort, output.command), ([0.0; 2], [0.0; 2]));
}

#[test]
fn an_effort_that_is_set_leaves_the_other_motor_of_the_joint_with_its_own() {
    let mut wrist = wrist();
    wrist.go(PITCH, 0.2);
    wrist.go(ROLL, 0.4);
    let before = wrist.run(1500);
    wrist.servo.set_effort(0, -0.5).unwrap();
    // Both motors belong to the last joint that they move.
    assert_eq!(wrist.servo.mode(ROLL), Some(ServoMode::Effort));
    assert_eq!(wrist.servo.mode(PITCH), Some(ServoMode::Position));
    let first = wrist.tick();
    assert!(largest_step(&before.effort, &first.effort) < 1e-9, "a step");
    let output = wrist.run(101);
    assert_eq!(output.effort[0], -0.5);
    let kept = (output.effort[1] - before.effort[1]).abs();
    assert!(kept < 1e-3, "{kept} N m");
    // No motor is left for the other joint.
    assert_eq!(output.saturated, 1 << PITCH);
    wrist.servo.set_effort(1, 0.25).unwrap();
    let output = wrist.tick();
    assert_eq!(output.effort, [-0.5, 0.25]);
    assert_eq!(output.torque, Vector2::new(-0.25, -0.75));
}

/// A reading has no effect.
#[test]
fn a_motor_without_a_sensor_gets_the_effort_that_is_desired() {
    let gains = EffortGains {
        kp: 1.0,
        ki: 5.0,
        ..EffortGains::default()
    };
    for wrong in [0.0, -1.5, f64::NAN] {
        let (mut blind, mut seeing) = (wrist_with(gains, false), wrist_with(gains, true));
        for wrist in [&mut blind, &mut seeing] {
            wrist.go(PITCH, 0.4);
            wrist.go(ROLL, 0.4);
        }
        let mut most = 0.0;
        for _ in 0..200 {
            let sensed = FingerReadings {
                effort: [wrong; 2],
                ..blind.finger.readings()
            };
            let output = blind.servo.tick(&sensed, &blind.gravity, PERIOD_S);
            assert_eq!(output.command, output.effort, "{wrong}");
            let output = seeing.servo.tick(&sensed, &seeing.gravity, PERIOD_S);
            most = max(most, largest_step(&output.command, &output.effort));
        }
        assert!(most > 0.01, "{most} N m");
    }
}

#[test]
fn a_torque_that_no_sensor_measures_is_not_corrected() {
    let mut wrist = wrist_with(EffortGains::default(), false);
    let gains = *wrist.servo.gains(ROLL).unwrap();
    let k_torque = 1.5;
    let gains = JointGains { k_torque, ..gains };
    wrist.servo.set_gains(ROLL, &gains).unwrap();
    let target = JointTarget::Torque(0.02);
    wrist.servo.set_target(ROLL, target).unwrap();
    wrist.run(102);
    for _ in 0..20 {
        let torque = wrist.tick().torque[ROLL];
        assert!((torque - 0.02).abs() < 1e-12, "{torque} N m");
    }
}

/// Readings of one count more and less, in turn, make a law ask for other efforts in each tick.
#[test]
fn joints_that_change_to_efforts_together_keep_the_means() {
    let text = include_str!("../../hands/utah-mit.toml");
    let hand = Hand::<4, 4, 8>::from_toml(text, "utah-mit.toml").unwrap();
    let finger = &hand.fingers[0];
    let (chain, transmission) = (finger.chain(), finger.transmission().unwrap());
    let settings = finger.settings(400.0, 0.1);
    let mut servo = FingerServo::new(chain, transmission, &settings).unwrap();
    let start = SVector::from([0.1, 0.6, 0.8, 0.7]);
    let mut effort = finger.efforts_at_rest();
    let mut tick = |servo: &mut FingerServo<_, _, 4, 8>, number: u32| {
        let count = if number.is_multiple_of(2) {
            7e-4
        } else {
            -7e-4
        };
        let sensed = FingerReadings {
            position: start + SVector::repeat(count),
            actuator_position: [0.0; 8],
            effort,
            touch: 0.0,
        };
        effort = servo
            .tick(&sensed, &hand.gravity.into(), 1.0 / 400.0)
            .effort;
        effort
    };
    for joint in 0..4 {
        let target = JointTarget::Position(SetPoint::rest(start[joint]));
        servo.set_target(joint, target).unwrap();
    }
    let (mut mean, mut last) = ([0.0; 8], [0.0; 8]);
    for number in 0..400 {
        last = tick(&mut servo, number);
        if number >= 360 {
            for (mean, effort) in mean.iter_mut().zip(&last) {
                *mean += effort / 40.0;
            }
        }
    }
    for joint in 0..4 {
        servo.set_mode(joint, ServoMode::Effort).unwrap();
    }
    let mut kept = last;
    for number in 400..460 {
        kept = tick(&mut servo, number);
    }
    for (actuator, kept) in kept.iter().enumerate() {
        let (is, was) = (
            (kept - mean[actuator]).abs(),
            last[actuator] - mean[actuator],
        );
        assert!(was.abs() > 0.05, "{actuator}: {was} N");
        assert!(is < 0.1 * was.abs(), "{actuator}: {is} of {was} N");
    }
}

#[test]
fn a_motor_without_a_sensor_has_no_fault_of_one() {
    let hand = hand();
    let wrist = &hand.fingers[0];
    let transmission = wrist.transmission().unwrap();
    let mut controller = FingerController::new(&hand, wrist, wrist.chain(), transmission).unwrap();
    for joint in [PITCH, ROLL] {
        controller.set_mode(joint, ServoMode::Position).unwrap();
    }
    let sensed = FingerReadings {
        position: Vector2::new(0.2, -0.1),
        actuator_position: [0.0; 2],
        effort: [f64::NAN, 1e9],
        touch: 0.0,
    };
    let gravity = Vector3::from(hand.gravity);
    for _ in 0..500 {
        let tick = controller.tick(&sensed, &gravity, PERIOD_S);
        assert_eq!(tick.fault, None);
        assert_eq!(tick.output.command, tick.output.effort);
    }
}

/// A joint that turns freely, with inertia alone, at 1 rad/s; and the rate that is left after a quarter of a second.
fn left_of_a_turn<T, const A: usize>(transmission: T, kv: f64) -> f64
where
    T: Transmission<1, A> + Copy,
{
    let limits = *transmission.linear().limits();
    let finger = SimFinger::new(
        ROD,
        transmission,
        FingerParameters {
            joints: [free_joint()].into(),
            drives: limits.map(drive).into(),
        },
        Vector1::zeros(),
    );
    let gains = EffortGains {
        kv,
        ..EffortGains::default()
    };
    let mut bench = Bench {
        servo: FingerServo::new(ROD, transmission, &settings(gains)).unwrap(),
        finger: finger.unwrap(),
        gravity: Vector3::zeros(),
    };
    bench
        .finger
        .reset(Vector1::zeros(), limits.map(|limits| limits.bias))
        .unwrap();
    let target = JointTarget::Torque(0.0);
    bench.servo.set_target(0, target).unwrap();
    // The velocity filter and the transition of the new mode are over before it is pushed.
    bench.run(200);
    let push = Vector1::new(ROD.inertia() / 1e-3);
    let still = limits.map(|limits| limits.bias);
    bench
        .finger
        .advance(1e-3, &still, &Vector3::zeros(), &push)
        .unwrap();
    bench.run(250);
    bench.finger.qd().x
}

const ROD: Pendulum = Pendulum {
    mass: 1.0,
    length: 0.1,
};

fn drive(limits: EffortLimits) -> SimDrive {
    let (low, high) = limits.command_range();
    SimDrive {
        low,
        high,
        kind: DriveKind::exact(100.0),
    }
}

/// A joint that goes from -1 to 1 rad, without a stop, and actuators of one kind.
fn settings<const A: usize>(gains: EffortGains) -> FingerSettings<1, A> {
    let joint = JointSettings {
        gains: JointGains {
            law: PositionLaw::ComputedTorque {
                bandwidth_hz: 5.0,
                damping_ratio: 1.0,
            },
            k_torque: 0.0,
        },
        stop: SoftStop {
            low: -1.2,
            high: 1.2,
            zone: 0.0,
            bandwidth_hz: 0.0,
            damping_ratio: 0.0,
        },
        rate_change: 20.0,
        resolution_rad: 0.0,
        frozen_rad: 10.0,
        position_cutoff_hz: None,
        velocity_cutoff_hz: 200.0,
    };
    let actuator = ActuatorSettings {
        gains,
        is_sensed: true,
        cutoff_hz: None,
    };
    FingerSettings {
        joints: [joint].into(),
        actuators: [actuator; A].into(),
        drive: DriveDynamics {
            armature: Vector1::zeros(),
            viscous: Vector1::zeros(),
            coulomb: Vector1::zeros(),
            coulomb_rate: Vector1::zeros(),
        },
        sample_hz: HZ,
        transition_s: 0.1,
    }
}

const MOTOR: EffortLimits = EffortLimits {
    low: -5.0,
    high: 5.0,
    bias: 0.0,
};

#[test]
fn the_gain_of_an_actuators_rate_takes_energy_from_a_joint() {
    // A motor with a gear of 2, and a flexor and an extensor with arms of 20 mm that pull with 20 N.
    let tendon = EffortLimits {
        low: 4.0,
        high: 130.0,
        bias: 20.0,
    };
    let geared = Linear::new([[2.0]], [MOTOR]).unwrap();
    let pulled = Linear::new([[0.02], [-0.02]], [tendon; 2]).unwrap();
    let free = [left_of_a_turn(geared, 0.0), left_of_a_turn(pulled, 0.0)];
    assert!(
        free.iter().all(|rate| (rate - 1.0).abs() < 1e-3),
        "{free:?}"
    );
    // Of both: a damping of 0.02 N m s/rad, which has a time constant of half a second.
    let damped = [left_of_a_turn(geared, 0.005), left_of_a_turn(pulled, 25.0)];
    let expected = libm::exp(-0.02 * 0.25 / ROD.inertia());
    for rate in damped {
        assert!(
            (rate - expected).abs() < 0.02,
            "{rate}, not {expected} rad/s"
        );
    }
}

/// A rod that pulls at a crank: its arm at the joint is the greatest at zero, and becomes less to both sides.
#[derive(Clone, Copy)]
struct Crank {
    radius_m: f64,
    linear: Linear<1, 1>,
}

const ROD_FORCE: EffortLimits = EffortLimits {
    low: -100.0,
    high: 100.0,
    bias: 0.0,
};

impl Crank {
    fn new(radius_m: f64) -> Self {
        Self {
            radius_m,
            linear: Linear::new([[radius_m]], [ROD_FORCE]).unwrap(),
        }
    }
}

impl Transmission<1, 1> for Crank {
    fn set_position(&mut self, position: &Vector1<f64>) {
        let arm = self.radius_m * libm::cos(position.x);
        // A position that is not finite leaves the arms as they were.
        if let Ok(linear) = Linear::new([[arm]], [ROD_FORCE]) {
            self.linear = linear;
        }
    }

    fn linear(&self) -> &Linear<1, 1> {
        &self.linear
    }
}

#[test]
fn a_transmission_whose_arm_changes_gives_the_force_that_the_posture_needs() {
    let crank = Crank::new(0.05);
    let parameters = FingerParameters {
        joints: [free_joint()].into(),
        drives: [drive(ROD_FORCE)].into(),
    };
    let gravity = Vector3::new(0.0, 0.0, -9.81);
    let mut bench = Bench {
        servo: FingerServo::new(ROD, crank, &settings(EffortGains::default())).unwrap(),
        finger: SimFinger::new(ROD, crank, parameters, Vector1::new(0.3)).unwrap(),
        gravity,
    };
    for position in [-1.0_f64, 0.0, 0.8, 1.1] {
        bench.go(0, position);
        let output = bench.run(2000);
        let is = bench.finger.q().x;
        assert!((is - position).abs() < 1e-4, "{is} rad, not {position} rad");
        let arm = 0.05 * libm::cos(position);
        for linear in [bench.servo.linear(), bench.finger.linear()] {
            assert!((linear.arms()[0][0] - arm).abs() < 1e-5);
        }
        // The weight's own arm is 0.1 m times the cosine: the force is the same in all postures.
        let weight = ROD.gravity_torque(&SVector::from([position]), &gravity).x;
        assert!((output.torque[0] - weight).abs() < 1e-4);
        assert!((output.effort[0] + 2.0 * 9.81).abs() < 0.01, "{output:?}");
    }
    // If the position is not read, the servo goes on with the last one, and its arm.
    let blind = FingerReadings {
        position: Vector1::new(f64::NAN),
        actuator_position: [0.0],
        effort: *bench.finger.efforts(),
        touch: 0.0,
    };
    let output = bench.servo.tick(&blind, &gravity, PERIOD_S);
    assert!((output.effort[0] + 2.0 * 9.81).abs() < 0.5, "{output:?}");
}

/// The servo and the plant are made in a posture in which the crank can hardly turn the joint.
#[test]
fn a_transmission_gives_the_torques_of_the_posture_and_not_those_of_the_first_one() {
    let mut crank = Crank::new(0.05);
    crank.set_position(&Vector1::new(1.4));
    let (_, before) = crank.linear().torque_range(0);
    let gravity = Vector3::new(0.0, 0.0, -9.81);
    let weight = -ROD.gravity_torque(&Vector1::zeros(), &gravity).x;
    assert!(before < 0.9 * weight, "{before} N m");
    let mut servo = FingerServo::new(ROD, crank, &settings(EffortGains::default())).unwrap();
    let sensed = FingerReadings {
        position: Vector1::zeros(),
        actuator_position: [0.0],
        effort: [0.0],
        touch: 0.0,
    };
    servo.set_mode(0, ServoMode::Position).unwrap();
    let mut output = servo.tick(&sensed, &gravity, PERIOD_S);
    for _ in 0..200 {
        output = servo.tick(&sensed, &gravity, PERIOD_S);
    }
    let torque = output.torque[0];
    assert!((torque + weight).abs() < 1e-9, "{torque} N m");
    // A torque that the crank can have here is not refused either.
    servo.set_target(0, JointTarget::Torque(4.9)).unwrap();
    servo.set_target(0, JointTarget::Torque(5.1)).unwrap_err();
}

#[test]
fn a_joint_that_nothing_moves_has_no_torque() {
    let hand = hand();
    let wrist = &hand.fingers[0];
    // One motor at the first joint alone.
    let transmission = Linear::new([[1.0, 0.0], [0.0, 0.0]], [MOTOR; 2]).unwrap();
    let settings = wrist.settings(HZ, 0.1);
    let mut servo = FingerServo::new(wrist.chain(), transmission, &settings).unwrap();
    let sensed = FingerReadings {
        position: Vector2::new(0.2, -0.1),
        actuator_position: [0.0; 2],
        effort: [0.0; 2],
        touch: 0.0,
    };
    let gravity = Vector3::from(hand.gravity);
    for joint in [PITCH, ROLL] {
        servo.set_mode(joint, ServoMode::Position).unwrap();
    }
    for _ in 0..200 {
        let output = servo.tick(&sensed, &gravity, PERIOD_S);
        assert_eq!((output.torque[ROLL], output.effort[1]), (0.0, 0.0));
    }
    let refused = servo
        .set_target(ROLL, JointTarget::Torque(0.1))
        .unwrap_err();
    assert_eq!(
        refused.to_string(),
        "joint 1 cannot have the torque 0.1 N m; it can have 0 N m to 0 N m"
    );
    // An actuator that moves nothing is none.
    assert_eq!(servo.effort_gains(1), None);
    let refused = servo.set_effort(1, 0.5).unwrap_err();
    assert_eq!(
        refused.to_string(),
        "there is no actuator 1; the finger has 1, numbered from 0"
    );
    let refused = servo.set_effort(0, -5.5).unwrap_err();
    assert_eq!(
        refused.to_string(),
        "actuator 0 cannot have the effort -5.5; it can have -5 to 5"
    );
}

//! What a finger of the shipped hand promises, whatever its sensors and its users say.

#![allow(
    clippy::float_cmp,
    reason = "what does not move has a rate of exactly zero"
)]

use condor_hand::config::Hand;
use condor_hand::controller::{FingerController, FingerTick};
use condor_hand::dynamics::Dynamics;
use condor_hand::fault::{FaultCode, FaultPlace};
use condor_hand::kinematics::PlanarFinger;
use condor_hand::servo::{
    FingerReadings, JointGains, JointTarget, PositionLaw, ServoMode, ServoRefusal, TargetQuantity,
};
use condor_hand::trajectory::{SetPoint, StopGuard};
use condor_hand::transmission::Linear;
use nalgebra::{SVector, Vector3, Vector4};
use proptest::prelude::*;

use crate::support::largest_step;

const TEXT: &str = include_str!("../../hands/utah-mit.toml");
const PERIOD_S: f64 = 1.0 / 400.0;
const LEAST_N: f64 = 4.0;
const MOST_N: f64 = 130.0;

type Controller = FingerController<PlanarFinger, Linear<4, 8>, 4, 8>;

fn hand() -> Hand<4, 4, 8> {
    let mut hand = Hand::from_toml(TEXT, "utah-mit.toml").unwrap();
    // The sensors of these tests say what the tests say.
    hand.faults.frozen_rad = 10.0;
    hand
}

fn controller() -> Controller {
    let hand = hand();
    let finger = &hand.fingers[0];
    FingerController::new(
        &hand,
        finger,
        finger.planar().unwrap(),
        finger.transmission().unwrap(),
    )
    .unwrap()
}

fn gravity() -> Vector3<f64> {
    Vector3::new(0.0, 0.0, -9.81)
}

fn posture() -> Vector4<f64> {
    Vector4::new(0.1, 0.6, 0.8, 0.7)
}

fn sensed(efforts: [f64; 8]) -> FingerReadings<4, 8> {
    FingerReadings {
        position: posture(),
        actuator_position: [0.0; 8],
        effort: efforts,
        touch: 0.0,
    }
}

/// Ticks with sensors that say what was commanded.
fn run(controller: &mut Controller, efforts: &mut [f64; 8], ticks: usize) {
    for _ in 0..ticks {
        let tick = controller.tick(&sensed(*efforts), &gravity(), PERIOD_S);
        assert_eq!(tick.fault, None);
        *efforts = tick.output.effort;
    }
}

#[test]
fn a_finger_begins_off_with_its_least_efforts() {
    let mut controller = controller();
    let tick = controller.tick(&sensed([LEAST_N; 8]), &gravity(), PERIOD_S);
    assert_eq!(tick.output.effort, [LEAST_N; 8]);
    assert_eq!(tick.target, [None; 4]);
    assert!((0..4).all(|joint| controller.mode(joint) == Some(ServoMode::Off)));
    assert_eq!(controller.mode(4), None);
}

#[test]
fn a_joint_that_is_off_has_no_torque_while_others_follow() {
    let mut controller = controller();
    let mut efforts = [LEAST_N; 8];
    for joint in 0..3 {
        controller.set_mode(joint, ServoMode::Position).unwrap();
    }
    run(&mut controller, &mut efforts, 100);
    let tick = controller.tick(&sensed(efforts), &gravity(), PERIOD_S);
    let torque = tick.output.torque;
    let weight = controller
        .mechanism()
        .gravity_torque(&posture(), &gravity());
    assert!((torque - weight).fixed_rows::<3>(0).amax() < 1e-9);
    assert!(torque[3].abs() < 1e-9, "{torque}");
    assert_eq!(tick.output.saturated, 0);
}

#[test]
fn beside_efforts_that_are_set_a_joint_that_is_off_has_its_least_ones() {
    let mut controller = controller();
    controller.set_effort(6, 20.0).unwrap();
    let mut efforts = [LEAST_N; 8];
    run(&mut controller, &mut efforts, 60);
    assert_eq!(efforts, [4.0, 4.0, 4.0, 4.0, 4.0, 4.0, 20.0, 4.0]);
    let modes = [0, 1, 2, 3].map(|joint| controller.mode(joint).unwrap());
    assert_eq!(modes[..3], [ServoMode::Off; 3]);
    assert_eq!(modes[3], ServoMode::Effort);
}

#[test]
fn no_change_of_mode_makes_a_step_of_effort() {
    let modes = [
        ServoMode::Position,
        ServoMode::Torque,
        ServoMode::Effort,
        ServoMode::Impedance,
        ServoMode::Grasp,
        ServoMode::Position,
        ServoMode::Off,
        ServoMode::Effort,
        ServoMode::Torque,
        ServoMode::Off,
        ServoMode::Grasp,
        ServoMode::Effort,
        ServoMode::Position,
        ServoMode::Grasp,
        ServoMode::Torque,
        ServoMode::Position,
        ServoMode::Effort,
        ServoMode::Off,
    ];
    let mut controller = controller();
    let mut efforts = [LEAST_N; 8];
    run(&mut controller, &mut efforts, 5);
    for mode in modes {
        for joint in 0..4 {
            controller.set_mode(joint, mode).unwrap();
            assert_eq!(controller.mode(joint), Some(mode));
            let before = efforts;
            run(&mut controller, &mut efforts, 1);
            assert!(
                largest_step(&before, &efforts) < 1e-9,
                "joint {joint} to {mode:?}: {before:?} to {efforts:?}"
            );
            // In the midst of the transition, the next joint's change.
            for _ in 0..7 {
                let before = efforts;
                run(&mut controller, &mut efforts, 1);
                assert!(largest_step(&before, &efforts) < 4.0);
            }
        }
        run(&mut controller, &mut efforts, 60);
    }
}

#[test]
fn other_gains_make_no_step_of_effort() {
    let mut controller = controller();
    let mut efforts = [LEAST_N; 8];
    let target = SetPoint::rest(posture()[1] + 0.1);
    for joint in 0..4 {
        controller.set_mode(joint, ServoMode::Position).unwrap();
    }
    run(&mut controller, &mut efforts, 60);
    controller
        .set_target(1, JointTarget::Position(target))
        .unwrap();
    run(&mut controller, &mut efforts, 60);
    let gains = JointGains {
        law: PositionLaw::Pd {
            kp: 3.0,
            kv: 0.01,
            ki: 0.0,
            integral_nm: 0.0,
        },
        ..*controller.gains(1).unwrap()
    };
    controller.set_gains(1, &gains).unwrap();
    assert_eq!(controller.gains(1), Some(&gains));
    let before = efforts;
    run(&mut controller, &mut efforts, 1);
    assert!(largest_step(&before, &efforts) < 1e-9);
    run(&mut controller, &mut efforts, 60);
    assert!(
        largest_step(&before, &efforts) > 1.0,
        "the gains changed nothing"
    );
}

#[test]
fn a_held_joint_gets_the_torque_that_holds_it() {
    let mut controller = controller();
    let mut efforts = [LEAST_N; 8];
    for joint in 0..4 {
        controller.set_mode(joint, ServoMode::Position).unwrap();
    }
    run(&mut controller, &mut efforts, 100);
    let tick = controller.tick(&sensed(efforts), &gravity(), PERIOD_S);
    let weight = controller
        .mechanism()
        .gravity_torque(&posture(), &gravity());
    assert!((tick.output.torque - weight).amax() < 1e-12);
    assert_eq!(
        tick.target,
        [0, 1, 2, 3].map(|joint| Some(posture()[joint]))
    );
}

#[test]
fn what_a_joint_cannot_have_is_refused_with_its_value() {
    let mut controller = controller();
    let refused = controller.set_target(2, JointTarget::Position(SetPoint::rest(3.0)));
    assert!(matches!(
        refused,
        Err(ServoRefusal::Target { joint: 2, quantity: TargetQuantity::Position, value, .. }) if value > 2.9
    ));
    assert!(matches!(
        controller.set_target(1, JointTarget::Torque(f64::NAN)),
        Err(ServoRefusal::Target {
            joint: 1,
            quantity: TargetQuantity::Torque,
            ..
        })
    ));
    assert!(matches!(
        controller.set_effort(1, 131.0),
        Err(ServoRefusal::Effort { actuator: 1, value, low, high })
            if (value, low, high) == (131.0, LEAST_N, MOST_N)
    ));
    assert!(matches!(
        controller.set_effort(0, f64::NAN),
        Err(ServoRefusal::Effort { actuator: 0, .. })
    ));
    assert_eq!(
        controller.set_effort(8, 10.0),
        Err(ServoRefusal::no_actuator(8, 8))
    );
    assert!(matches!(
        controller.set_mode(4, ServoMode::Off),
        Err(ServoRefusal::NoJoint {
            joint: 4,
            joints: 4
        })
    ));
    let mut gains = *controller.gains(0).unwrap();
    gains.k_torque = -1.0;
    let refused = controller.set_gains(0, &gains).unwrap_err();
    assert_eq!(
        refused.to_string(),
        "joint 0: the torque gain is -1; it must be at least 0"
    );
    assert!((0..4).all(|joint| controller.mode(joint) == Some(ServoMode::Off)));
}

#[test]
fn a_lost_sensor_is_a_fault_that_stays_and_takes_the_efforts_down() {
    let mut controller = controller();
    let mut efforts = [LEAST_N; 8];
    for joint in 0..4 {
        controller.set_mode(joint, ServoMode::Position).unwrap();
    }
    run(&mut controller, &mut efforts, 100);
    let mut command = efforts;
    let mut broken = sensed(efforts);
    broken.position[2] = f64::NAN;
    let mut ticks = 0;
    let fault = loop {
        let tick = controller.tick(&broken, &gravity(), PERIOD_S);
        if let Some(fault) = tick.fault {
            assert!(largest_step(&command, &tick.output.command) < 1.0, "a step");
            command = tick.output.command;
            break fault;
        }
        command = tick.output.command;
        ticks += 1;
        assert!(ticks < 1000, "no fault was seen");
    };
    assert_eq!(fault.place, FaultPlace::Joint(2));
    assert_eq!(fault.code, FaultCode::NotFinite);
    assert_eq!(
        controller.set_mode(0, ServoMode::Position),
        Err(ServoRefusal::AfterFault)
    );
    // Good sensors do not bring it back, and the way down has no step.
    for _ in 0..400 {
        let tick = controller.tick(&sensed(efforts), &gravity(), PERIOD_S);
        assert_eq!(tick.fault.unwrap().place, fault.place);
        assert!(largest_step(&command, &tick.output.command) < 1.0);
        command = tick.output.command;
    }
    assert_eq!(command, [LEAST_N; 8]);
    controller.clear();
    let mut efforts = command;
    run(&mut controller, &mut efforts, 1);
    controller.set_mode(0, ServoMode::Position).unwrap();
    run(&mut controller, &mut efforts, 1);
}

#[test]
fn a_master_that_falls_silent_is_a_fault() {
    let mut controller = controller();
    let mut efforts = [LEAST_N; 8];
    controller.set_mode(1, ServoMode::Position).unwrap();
    run(&mut controller, &mut efforts, 100);
    let points = [0, 1, 2, 3].map(|joint| SetPoint::rest(posture()[joint]));
    for _ in 0..10 {
        controller.follow(&points, &[StopGuard::NONE; 4]).unwrap();
        run(&mut controller, &mut efforts, 8);
    }
    let fault = (0..100).find_map(|_| {
        let tick = controller.tick(&sensed(efforts), &gravity(), PERIOD_S);
        tick.fault
    });
    assert_eq!(fault.unwrap().code, FaultCode::StaleSetPoint);
}

/// Follows set-points that go by 1 rad/s, with a sensor that says where they are, for so many ticks of a
/// period each; gives the last tick.
fn glide(
    controller: &mut Controller,
    efforts: &mut [f64; 8],
    periods: &[f64],
) -> Vec<FingerTick<4, 8>> {
    for joint in 0..4 {
        controller.set_mode(joint, ServoMode::Position).unwrap();
    }
    run(controller, efforts, 1);
    let (mut time, mut next) = (0.0, 0.0);
    let mut ticks = Vec::new();
    for &period in periods {
        time += period * PERIOD_S;
        while next < time {
            next += 8.0 * PERIOD_S;
            let mut points = [0, 1, 2, 3].map(|joint| SetPoint::rest(posture()[joint]));
            points[1].position += next;
            points[1].velocity = 1.0;
            controller.follow(&points, &[StopGuard::NONE; 4]).unwrap();
        }
        let mut sensed = sensed(*efforts);
        sensed.position[1] += time;
        let tick = controller.tick(&sensed, &gravity(), period * PERIOD_S);
        *efforts = tick.output.effort;
        ticks.push(tick);
    }
    ticks
}

#[test]
fn rates_and_set_points_go_by_time() {
    let (mut controller, mut efforts) = (controller(), [LEAST_N; 8]);
    let mut periods = vec![1.0; 200];
    // Each is late, and none so late that it is a fault.
    for (number, period) in periods.iter_mut().enumerate().skip(100) {
        *period = [1.0, 2.0, 0.5, 1.0, 4.0, 1.0, 0.5][number % 7];
    }
    let ticks = glide(&mut controller, &mut efforts, &periods);
    let mut time = 100.0 * PERIOD_S;
    for (tick, period) in ticks.iter().zip(&periods).skip(100) {
        time += period * PERIOD_S;
        assert_eq!(tick.fault, None);
        let rate = tick.output.velocity[1];
        assert!((rate - 1.0).abs() < 1e-6, "{rate} rad/s");
        let target = tick.target[1].unwrap() - posture()[1];
        // Set-points are of whole periods, one for a tick unless more have come together.
        assert!(
            (target - time).abs() < 2.1 * PERIOD_S,
            "{target} rad after {time} s"
        );
    }
}

#[test]
fn a_tick_that_comes_early_makes_no_rate_of_a_count() {
    let (mut controller, mut efforts) = (controller(), [LEAST_N; 8]);
    controller.set_mode(1, ServoMode::Position).unwrap();
    run(&mut controller, &mut efforts, 10);
    for period_s in [1e-4, 2e-5, 1e-9] {
        // One count of the sensor, to and fro.
        for count in [1.0, 0.0] {
            let mut said = sensed(efforts);
            said.position[1] += count * 7.67e-4;
            let tick = controller.tick(&said, &gravity(), period_s);
            assert_eq!((tick.fault, tick.output.lost), (None, 0), "{period_s} s");
            let rate = tick.output.velocity[1];
            assert!(rate.abs() < 0.3, "{rate} rad/s after {period_s} s");
        }
        run(&mut controller, &mut efforts, 10);
    }
}

#[test]
fn after_a_fault_a_finger_says_what_its_sensors_say() {
    let (mut controller, mut efforts) = (controller(), [LEAST_N; 8]);
    let last = glide(&mut controller, &mut efforts, &[1.0; 100]);
    assert_eq!(last[99].fault, None);
    let mut blind = sensed(efforts);
    blind.position[1] = f64::NAN;
    let expected = posture()[1] + 100.0 * PERIOD_S;
    for tick in 1..=100 {
        let output = controller.tick(&blind, &gravity(), PERIOD_S).output;
        // It goes on by 1 rad/s until it is a fault.
        let way = f64::from(tick.min(4)) * PERIOD_S;
        let off = output.position[1] - expected - way;
        assert!(off.abs() < 1e-3 || tick > 4, "{off} rad in tick {tick}");
    }
    // Good readings count again, though they are elsewhere, and nobody has cleared the fault.
    let tick = controller.tick(&sensed(efforts), &gravity(), PERIOD_S);
    assert!((tick.output.position - posture()).amax() < 1e-12);
    assert!((controller.plausible(&posture(), PERIOD_S) - posture()).amax() < 1e-12);
    assert_eq!(tick.fault.unwrap().code, FaultCode::NotFinite);
}

#[test]
fn a_loop_that_stood_still_for_half_a_second_is_a_fault() {
    let (mut controller, mut efforts) = (controller(), [LEAST_N; 8]);
    for joint in 0..4 {
        controller.set_mode(joint, ServoMode::Position).unwrap();
    }
    run(&mut controller, &mut efforts, 100);
    let mut follower = controller.clone();
    let tick = controller.tick(&sensed(efforts), &gravity(), 0.5);
    let fault = tick.fault.unwrap();
    assert_eq!(
        (fault.code, fault.place),
        (FaultCode::MissedDeadline, FaultPlace::Finger)
    );
    assert!((fault.value - 0.5).abs() < 1e-12);
    // In a short gap, the set-points of a master age with the time that passes.
    let points = [0, 1, 2, 3].map(|joint| SetPoint::rest(posture()[joint]));
    follower.follow(&points, &[StopGuard::NONE; 4]).unwrap();
    let faults = [0.01, 0.015, 0.01, 0.012, 0.0151].map(|period_s| {
        let before = follower.tick(&sensed(efforts), &gravity(), PERIOD_S).fault;
        assert_eq!(before, None);
        follower.tick(&sensed(efforts), &gravity(), period_s).fault
    });
    assert_eq!(faults[..4], [None; 4]);
    assert_eq!(faults[4].unwrap().code, FaultCode::StaleSetPoint);
}

#[test]
fn a_joint_joins_the_motion_of_the_master_without_a_jump() {
    let mut controller = controller();
    let mut efforts = [LEAST_N; 8];
    for joint in 0..4 {
        controller.set_mode(joint, ServoMode::Position).unwrap();
    }
    run(&mut controller, &mut efforts, 1);
    let aim = posture() + Vector4::new(0.02, 0.3, 0.1, -0.2);
    let points = [0, 1, 2, 3].map(|joint| SetPoint::rest(aim[joint]));
    let mut last = posture();
    for tick in 0..160 {
        if tick % 8 == 0 {
            controller.follow(&points, &[StopGuard::NONE; 4]).unwrap();
        }
        let tick = controller.tick(
            &FingerReadings {
                position: last,
                actuator_position: [0.0; 8],
                effort: efforts,
                touch: 0.0,
            },
            &gravity(),
            PERIOD_S,
        );
        assert_eq!(tick.fault, None);
        efforts = tick.output.effort;
        let now = SVector::from_fn(|joint, _| tick.target[joint].unwrap());
        assert!((now - last).amax() < 15.0 * PERIOD_S + 1e-12);
        last = now;
    }
    assert!((last - aim).amax() < 1e-12);
}

#[test]
fn a_finger_of_fewer_joints_than_there_is_room_for_is_one_without_them() {
    let text = include_str!("../hands/tripod.toml");
    let hand = Hand::<3, 5, 9>::from_toml(text, "tripod.toml").unwrap();
    let finger = &hand.fingers[0];
    assert_eq!(finger.joints.len(), 3);
    let mut controller = FingerController::new(
        &hand,
        finger,
        finger.chain(),
        finger.transmission().unwrap(),
    )
    .unwrap();
    let none = Err(ServoRefusal::NoJoint {
        joint: 3,
        joints: 3,
    });
    assert_eq!(controller.mode(3), None);
    assert_eq!(controller.gains(3), None);
    assert_eq!(controller.set_mode(3, ServoMode::Position), none);
    assert_eq!(controller.set_target(3, JointTarget::Torque(0.0)), none);
    let gains = *controller.gains(2).unwrap();
    assert_eq!(controller.set_gains(3, &gains), none);
    for joint in 0..3 {
        controller.set_mode(joint, ServoMode::Position).unwrap();
    }
    let mut least = [0.0; 9];
    least[..6].fill(1.0);
    let sensed = FingerReadings {
        position: SVector::from([0.1, 0.2, 0.005, 0.0, 0.0]),
        actuator_position: [0.0; 9],
        effort: least,
        touch: 0.0,
    };
    for _ in 0..200 {
        let tick = controller.tick(&sensed, &gravity(), 1.0 / 2000.0);
        assert_eq!(tick.fault, None);
        assert_eq!(tick.output.command[6..], [0.0; 3]);
    }
}

#[test]
fn a_finger_ticks_at_the_rate_of_its_processor() {
    let text = include_str!("../hands/tripod.toml");
    let hand = Hand::<3, 3, 6>::from_toml(text, "tripod.toml").unwrap();
    let finger = &hand.fingers[0];
    assert_eq!((hand.servo_hz, hand.servo_rate_hz(finger)), (1000, 2000));
    let mut controller = FingerController::new(
        &hand,
        finger,
        finger.chain(),
        finger.transmission().unwrap(),
    )
    .unwrap();
    controller.set_mode(0, ServoMode::Position).unwrap();
    let sensed = FingerReadings {
        position: SVector::from([0.1, 0.2, 0.005]),
        actuator_position: [0.0; 6],
        effort: [1.0; 6],
        touch: 0.0,
    };
    controller.tick(&sensed, &gravity(), 1.0 / 2000.0);
    // 100 times a second: 20 ticks of 2 kHz.
    let points = [0.1, 0.2, 0.005].map(SetPoint::rest);
    controller.follow(&points, &[StopGuard::NONE; 3]).unwrap();
    let to = [0.2, 0.2, 0.005].map(SetPoint::rest);
    controller.follow(&to, &[StopGuard::NONE; 3]).unwrap();
    let mut moved = 0;
    let mut last = Some(0.1);
    for _ in 0..100 {
        let tick = controller.tick(&sensed, &gravity(), 1.0 / 2000.0);
        moved += u32::from(tick.target[0] != last);
        last = tick.target[0];
        if moved > 0 && last == Some(0.2) {
            break;
        }
    }
    // Early by one tick of the master, it takes two.
    assert_eq!((last, moved), (Some(0.2), 40));
}

#[test]
fn a_joint_whose_sensor_begins_with_no_number_holds_the_first_that_comes() {
    let mut controller = controller();
    controller.set_mode(1, ServoMode::Position).unwrap();
    let mut efforts = [LEAST_N; 8];
    let mut blind = sensed(efforts);
    blind.position[1] = f64::NAN;
    for _ in 0..3 {
        let tick = controller.tick(&blind, &gravity(), PERIOD_S);
        assert_eq!(tick.fault, None);
        assert_eq!(tick.target[1], None);
        assert_eq!(tick.output.effort[2..4], [LEAST_N; 2]);
    }
    let tick = controller.tick(&sensed(efforts), &gravity(), PERIOD_S);
    assert!(tick.output.velocity[1] == 0.0);
    assert_eq!(tick.output.effort, [LEAST_N; 8]);
    let tick = controller.tick(&sensed(efforts), &gravity(), PERIOD_S);
    assert_eq!(tick.target[1], Some(posture()[1]));
    assert!(tick.output.velocity[1] == 0.0);
    efforts = tick.output.effort;
    run(&mut controller, &mut efforts, 5);
}

#[test]
fn a_target_for_a_joint_that_was_never_seen_pulls_nothing() {
    let mut controller = controller();
    let aim = JointTarget::Position(SetPoint::rest(posture()[1]));
    controller.set_target(1, aim).unwrap();
    let mut blind = sensed([LEAST_N; 8]);
    blind.position[1] = f64::INFINITY;
    // Not yet a fault.
    for _ in 0..3 {
        let tick = controller.tick(&blind, &gravity(), PERIOD_S);
        assert_eq!(tick.fault, None);
        assert!(tick.output.velocity[1] == 0.0);
        assert!(
            tick.output.torque[1].abs() < 0.05,
            "{}",
            tick.output.torque[1]
        );
        blind.effort = tick.output.effort;
    }
}

#[test]
fn a_mode_that_a_joint_has_leaves_it_with_its_master() {
    let mut controller = controller();
    let mut efforts = [LEAST_N; 8];
    controller.set_mode(1, ServoMode::Position).unwrap();
    run(&mut controller, &mut efforts, 1);
    for tick in 0..10 {
        let moving = SetPoint {
            position: posture()[1] + 0.004 * f64::from(tick),
            velocity: 0.2,
            acceleration: 0.0,
        };
        controller
            .follow(&[moving; 4], &[StopGuard::NONE; 4])
            .unwrap();
        controller.set_mode(1, ServoMode::Position).unwrap();
        run(&mut controller, &mut efforts, 8);
    }
    // Still the master's: that it falls silent is noticed.
    let fault = (0..100).find_map(|_| {
        let tick = controller.tick(&sensed(efforts), &gravity(), PERIOD_S);
        tick.fault
    });
    assert_eq!(fault.unwrap().code, FaultCode::StaleSetPoint);
}

#[test]
fn a_set_point_that_is_refused_changes_nothing() {
    let mut controller = controller();
    let mut efforts = [LEAST_N; 8];
    for joint in 0..4 {
        controller.set_mode(joint, ServoMode::Position).unwrap();
    }
    run(&mut controller, &mut efforts, 1);
    let good = [0, 1, 2, 3].map(|joint| SetPoint::rest(posture()[joint]));
    controller.follow(&good, &[StopGuard::NONE; 4]).unwrap();
    run(&mut controller, &mut efforts, 8);
    let mut untouched = controller.clone();
    let mut same = efforts;
    for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
        let mut points = good.map(|point| SetPoint::rest(point.position + 0.1));
        points[3].position = bad;
        assert!(
            controller.follow(&points, &[StopGuard::NONE; 4]).is_err(),
            "{bad}"
        );
    }
    for _ in 0..8 {
        let tick = controller.tick(&sensed(efforts), &gravity(), PERIOD_S);
        let other = untouched.tick(&sensed(same), &gravity(), PERIOD_S);
        assert_eq!(tick, other);
        (efforts, same) = (tick.output.effort, other.output.effort);
    }
}

/// The ramp is the shortest that there is, a transition the longest, and the efforts' servos have
/// integrals: nothing of any of them is left when the finger can be used again.
#[test]
fn after_a_fault_and_its_ramp_a_finger_rests_at_its_least_efforts() {
    let mut hand = hand();
    hand.faults.safe_s = 0.01;
    hand.transition_s = 1.0;
    for finger in &mut hand.fingers {
        for actuator in &mut finger.actuators {
            actuator.gains.ki = 5.0;
        }
    }
    hand.check().unwrap();
    let finger = &hand.fingers[0];
    let mut controller = FingerController::new(
        &hand,
        finger,
        finger.planar().unwrap(),
        finger.transmission().unwrap(),
    )
    .unwrap();
    for actuator in 0..8 {
        controller.set_effort(actuator, 60.0).unwrap();
    }
    let mut efforts = [LEAST_N; 8];
    run(&mut controller, &mut efforts, 500);
    let mut broken = sensed(efforts);
    broken.position[0] = f64::NAN;
    // The measured efforts lag behind, which fills the integrals.
    let faulty = (0..200).find(|_| {
        let tick = controller.tick(&broken, &gravity(), PERIOD_S);
        tick.fault.is_some()
    });
    assert!(faulty.is_some());
    for _ in 0..10 {
        controller.tick(&sensed([2.0; 8]), &gravity(), PERIOD_S);
    }
    controller.clear();
    for _ in 0..20 {
        let tick = controller.tick(&sensed([LEAST_N; 8]), &gravity(), PERIOD_S);
        assert_eq!(tick.fault, None);
        assert_eq!(tick.output.effort, [LEAST_N; 8]);
        assert_eq!(tick.output.command, [LEAST_N; 8]);
    }
}

proptest! {
    #[test]
    fn commands_are_finite_and_within_what_actuators_have(
        values in proptest::collection::vec(proptest::num::f64::ANY, 12 * 40),
        modes in proptest::collection::vec((0_usize..4, 0_usize..6), 40),
    ) {
        let mut controller = controller();
        for (sample, (joint, mode)) in values.chunks(12).zip(modes) {
            // Refused after a fault, which is as good.
            let _ = controller.set_mode(joint, ServoMode::ALL[mode]);
            let sensed = FingerReadings {
                position: SVector::from_column_slice(&sample[..4]),
                actuator_position: [0.0; 8],
                effort: core::array::from_fn(|actuator| sample[4 + actuator]),
                touch: 0.0,
            };
            let tick = controller.tick(&sensed, &gravity(), PERIOD_S);
            for command in tick.output.command {
                prop_assert!((0.0..=MOST_N).contains(&command), "{command}");
            }
        }
    }
}

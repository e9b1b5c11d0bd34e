//! What a finger of the shipped hand promises, whatever its sensors and its users say.

use condor_hand::config::Hand;
use condor_hand::controller::FingerController;
use condor_hand::dynamics::Dynamics;
use condor_hand::kinematics::PlanarFinger;
use condor_hand::servo::{JointGains, JointTarget, Mode, PositionLaw, Sensed, SettingError};
use condor_hand::tendon::fault::{FaultCode, FaultSite};
use condor_hand::tendon::{Pair, Pairs};
use condor_hand::trajectory::SetPoint;
use nalgebra::{SVector, Vector3, Vector4};
use proptest::prelude::*;

const TEXT: &str = include_str!("../hands/utah-mit.toml");
const PERIOD_S: f64 = 1.0 / 400.0;
const LEAST_N: f64 = 4.0;
const MOST_N: f64 = 130.0;

type Controller = FingerController<PlanarFinger, 4>;

fn hand() -> Hand<4, 4> {
    Hand::from_toml(TEXT, "utah-mit.toml").unwrap()
}

fn controller() -> Controller {
    let hand = hand();
    let finger = &hand.fingers[0];
    FingerController::new(&hand, finger, finger.planar().unwrap()).unwrap()
}

fn gravity() -> Vector3<f64> {
    Vector3::new(0.0, 0.0, -9.81)
}

fn posture() -> Vector4<f64> {
    Vector4::new(0.1, 0.6, 0.8, 0.7)
}

fn sensed(tensions: Pairs<f64, 4>) -> Sensed<f64, 4> {
    Sensed {
        position: posture(),
        tension: tensions,
    }
}

/// Ticks with sensors that say what was commanded.
fn run(controller: &mut Controller, tensions: &mut Pairs<f64, 4>, ticks: usize) {
    for _ in 0..ticks {
        let tick = controller.tick(&sensed(*tensions), &gravity(), PERIOD_S);
        assert_eq!(tick.fault, None);
        *tensions = tick.output.tension;
    }
}

fn largest_step(a: &Pairs<f64, 4>, b: &Pairs<f64, 4>) -> f64 {
    a.iter()
        .zip(b)
        .flat_map(|(a, b)| [a.flexor - b.flexor, a.extensor - b.extensor])
        .fold(0.0, |largest, step| {
            condor_hand::math::max(step.abs(), largest)
        })
}

#[test]
fn a_finger_begins_off_with_its_least_tensions() {
    let mut controller = controller();
    let tick = controller.tick(&sensed([Pair::both(LEAST_N); 4]), &gravity(), PERIOD_S);
    assert_eq!(tick.output.tension, [Pair::both(LEAST_N); 4]);
    assert_eq!(tick.target, [None; 4]);
    assert!((0..4).all(|joint| controller.mode(joint) == Some(Mode::Off)));
    assert_eq!(controller.mode(4), None);
}

#[test]
fn no_change_of_mode_makes_a_step_of_tension() {
    let modes = [
        Mode::Position,
        Mode::Torque,
        Mode::Tension,
        Mode::Grasp,
        Mode::Position,
        Mode::Off,
        Mode::Tension,
        Mode::Torque,
        Mode::Off,
        Mode::Grasp,
        Mode::Tension,
        Mode::Position,
        Mode::Grasp,
        Mode::Torque,
        Mode::Position,
        Mode::Tension,
        Mode::Off,
    ];
    let mut controller = controller();
    let mut tensions = [Pair::both(LEAST_N); 4];
    run(&mut controller, &mut tensions, 5);
    for mode in modes {
        for joint in 0..4 {
            controller.set_mode(joint, mode).unwrap();
            assert_eq!(controller.mode(joint), Some(mode));
            let before = tensions;
            run(&mut controller, &mut tensions, 1);
            assert!(
                largest_step(&before, &tensions) < 1e-9,
                "joint {joint} to {mode:?}: {before:?} to {tensions:?}"
            );
            // In the midst of the transition, the next joint's change.
            for _ in 0..7 {
                let before = tensions;
                run(&mut controller, &mut tensions, 1);
                assert!(largest_step(&before, &tensions) < 4.0);
            }
        }
        run(&mut controller, &mut tensions, 60);
    }
}

#[test]
fn other_gains_make_no_step_of_tension() {
    let mut controller = controller();
    let mut tensions = [Pair::both(LEAST_N); 4];
    let target = SetPoint::rest(posture()[1] + 0.1);
    for joint in 0..4 {
        controller.set_mode(joint, Mode::Position).unwrap();
    }
    run(&mut controller, &mut tensions, 60);
    controller
        .set_target(1, JointTarget::Position(target))
        .unwrap();
    run(&mut controller, &mut tensions, 60);
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
    let before = tensions;
    run(&mut controller, &mut tensions, 1);
    assert!(largest_step(&before, &tensions) < 1e-9);
    run(&mut controller, &mut tensions, 60);
    assert!(
        largest_step(&before, &tensions) > 1.0,
        "the gains changed nothing"
    );
}

#[test]
fn a_held_joint_gets_the_torque_that_holds_it() {
    let mut controller = controller();
    let mut tensions = [Pair::both(LEAST_N); 4];
    for joint in 0..4 {
        controller.set_mode(joint, Mode::Position).unwrap();
    }
    run(&mut controller, &mut tensions, 100);
    let tick = controller.tick(&sensed(tensions), &gravity(), PERIOD_S);
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
        Err(SettingError::Position { joint: 2, position, .. }) if position > 2.9
    ));
    assert!(matches!(
        controller.set_target(1, JointTarget::Torque(f64::NAN)),
        Err(SettingError::Torque { joint: 1, .. })
    ));
    assert!(matches!(
        controller.set_target(0, JointTarget::Tension(Pair { flexor: 10.0, extensor: 131.0 })),
        Err(SettingError::Tension { joint: 0, tension, .. }) if tension > 130.0
    ));
    assert!(matches!(
        controller.set_mode(4, Mode::Off),
        Err(SettingError::NoJoint {
            joint: 4,
            joints: 4
        })
    ));
    let mut gains = *controller.gains(0).unwrap();
    gains.k_torque = -1.0;
    let refused = controller.set_gains(0, &gains).unwrap_err();
    assert_eq!(refused.to_string(), "joint 0 cannot have -1 as torque gain");
    assert!((0..4).all(|joint| controller.mode(joint) == Some(Mode::Off)));
}

#[test]
fn a_lost_sensor_is_a_fault_that_stays_and_takes_the_tensions_down() {
    let mut controller = controller();
    let mut tensions = [Pair::both(LEAST_N); 4];
    for joint in 0..4 {
        controller.set_mode(joint, Mode::Position).unwrap();
    }
    run(&mut controller, &mut tensions, 100);
    let mut command = tensions;
    let mut broken = sensed(tensions);
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
    assert_eq!(fault.site, FaultSite::Joint(2));
    assert_eq!(fault.code, FaultCode::NotFinite);
    assert_eq!(
        controller.set_mode(0, Mode::Position),
        Err(SettingError::AfterFault)
    );
    // Good sensors do not bring it back, and the way down has no step.
    for _ in 0..400 {
        let tick = controller.tick(&sensed(tensions), &gravity(), PERIOD_S);
        assert_eq!(tick.fault.unwrap().site, fault.site);
        assert!(largest_step(&command, &tick.output.command) < 1.0);
        command = tick.output.command;
    }
    assert_eq!(command, [Pair::both(LEAST_N); 4]);
    controller.clear();
    let mut tensions = command;
    run(&mut controller, &mut tensions, 1);
    controller.set_mode(0, Mode::Position).unwrap();
    run(&mut controller, &mut tensions, 1);
}

#[test]
fn a_master_that_falls_silent_is_a_fault() {
    let mut controller = controller();
    let mut tensions = [Pair::both(LEAST_N); 4];
    controller.set_mode(1, Mode::Position).unwrap();
    run(&mut controller, &mut tensions, 100);
    let points = [0, 1, 2, 3].map(|joint| SetPoint::rest(posture()[joint]));
    for _ in 0..10 {
        controller.follow(&points).unwrap();
        run(&mut controller, &mut tensions, 8);
    }
    let fault = (0..100).find_map(|_| {
        let tick = controller.tick(&sensed(tensions), &gravity(), PERIOD_S);
        tick.fault
    });
    assert_eq!(fault.unwrap().code, FaultCode::StaleSetPoint);
}

#[test]
fn a_joint_joins_the_motion_of_the_master_without_a_jump() {
    let mut controller = controller();
    let mut tensions = [Pair::both(LEAST_N); 4];
    for joint in 0..4 {
        controller.set_mode(joint, Mode::Position).unwrap();
    }
    run(&mut controller, &mut tensions, 1);
    let aim = posture() + Vector4::new(0.02, 0.3, 0.1, -0.2);
    let points = [0, 1, 2, 3].map(|joint| SetPoint::rest(aim[joint]));
    let mut last = posture();
    for tick in 0..160 {
        if tick % 8 == 0 {
            controller.follow(&points).unwrap();
        }
        let tick = controller.tick(
            &Sensed {
                position: last,
                tension: tensions,
            },
            &gravity(),
            PERIOD_S,
        );
        assert_eq!(tick.fault, None);
        tensions = tick.output.tension;
        let now = SVector::from_fn(|joint, _| tick.target[joint].unwrap());
        assert!((now - last).amax() < 15.0 * PERIOD_S + 1e-12);
        last = now;
    }
    assert!((last - aim).amax() < 1e-12);
}

proptest! {
    #[test]
    fn commands_are_finite_and_within_what_actuators_have(
        values in proptest::collection::vec(proptest::num::f64::ANY, 12 * 40),
        modes in proptest::collection::vec((0_usize..4, 0_u32..5), 40),
    ) {
        let mut controller = controller();
        for (sample, (joint, mode)) in values.chunks(12).zip(modes) {
            // Refused after a fault, which is as good.
            let _ = controller.set_mode(joint, Mode::from_number(mode).unwrap());
            let sensed = Sensed {
                position: SVector::from_column_slice(&sample[..4]),
                tension: core::array::from_fn(|joint| Pair {
                    flexor: sample[4 + 2 * joint],
                    extensor: sample[5 + 2 * joint],
                }),
            };
            let tick = controller.tick(&sensed, &gravity(), PERIOD_S);
            for pair in tick.output.command {
                for command in [pair.flexor, pair.extensor] {
                    prop_assert!((0.0..=MOST_N).contains(&command), "{command}");
                }
            }
        }
    }
}

use condor_hand::config::Hand;
use condor_hand::controller::FingerController;
use condor_hand::grasp::distributed::{
    DistributedGrasp, GraspInputs, GraspOrder, GraspReason, GraspState, HandJoints,
};
use condor_hand::kinematics::{Kinematics, PlanarFinger};
use condor_hand::servo::FingerReadings;
use nalgebra::Vector3;

const HAND: &str = include_str!("../../../hands/utah-mit.toml");
const PERIOD_S: f64 = 1.0 / 400.0;
const POSTURE: [[f64; 4]; 4] = [[0.0, 0.9, 0.8, 0.7]; 4];

#[test]
fn a_reading_that_is_none_does_not_end_a_grasp() {
    let hand = Hand::<4, 4, 8>::from_toml(HAND, "utah-mit.toml").unwrap();
    let gravity = Vector3::from(hand.gravity);
    let fingers = [0, 1, 2, 3].map(|number| {
        let finger = &hand.fingers[number];
        (finger, finger.planar().unwrap())
    });
    let served = [true, true, false, false];
    let mut number = 0;
    let mut controllers = fingers.map(|(finger, mechanism)| {
        number += 1;
        let transmission = finger.transmission().unwrap();
        let new = || FingerController::new(&hand, finger, mechanism, transmission).unwrap();
        served[number - 1].then(new)
    });
    let mut law = DistributedGrasp::new(fingers, served);
    let tips = fingers.map(|(_, mechanism)| {
        let place = mechanism.tip(&POSTURE[0].into()).position;
        place.into()
    });
    let [stiffness, damping] = [150.0, 1.0].map(|n| [n, n, n, n * 1e-3, n * 1e-3, n * 1e-3]);
    let mut order = GraspOrder::hold(0b1111, tips, stiffness, damping);
    order.squeeze_n = 1.0;
    let mut inputs = GraspInputs {
        order: None,
        others: Some(HandJoints {
            position: POSTURE,
            order: [1; 4],
            served: 0b1111,
            ..HandJoints::NONE
        }),
    };
    let mut tick = |inputs: &GraspInputs<4, 4>, said: f64| {
        let mut position = POSTURE;
        position[1][2] = said;
        let joints = law.joints(position, [[0.0; 4]; 4], PERIOD_S, &mut controllers);
        law.step(&joints, inputs, &gravity, PERIOD_S, &mut controllers);
        for (finger, position) in controllers.iter_mut().flatten().zip(&position) {
            let sensed = FingerReadings {
                position: (*position).into(),
                actuator_position: [0.0; 8],
                effort: [20.0; 8],
                touch: 0.0,
            };
            assert_eq!(finger.tick(&sensed, &gravity, PERIOD_S).fault, None);
        }
        law.report().state
    };
    let good = POSTURE[1][2];
    for _ in 0..5 {
        assert_eq!(tick(&inputs, good), GraspState::Idle);
    }
    inputs.order = Some((1, order));
    assert_eq!(tick(&inputs, good), GraspState::Holding);
    inputs.order = None;
    for said in [f64::NAN, f64::INFINITY, good + 0.3] {
        for said in [said, good, good] {
            assert_eq!(tick(&inputs, said), GraspState::Holding, "{said}");
        }
    }
}

#[test]
fn five_fingers_on_one_processor_hold_what_two_are_too_few_for() {
    let hand = Hand::<4, 4, 8>::from_toml(HAND, "utah-mit.toml").unwrap();
    let gravity = Vector3::from(hand.gravity);
    let fingers = [0, 1, 2, 3, 0].map(|number| {
        let finger = &hand.fingers[number];
        (finger, finger.planar().unwrap())
    });
    let [.., (_, fifth)] = fingers;
    let mut base = *fifth.base();
    base.position.y += 0.02;
    let fifth = PlanarFinger::new(base, *fifth.lengths(), *fifth.bodies()).unwrap();
    let [a, b, c, d, (finger, _)] = fingers;
    let fingers = [a, b, c, d, (finger, fifth)];
    let mut controllers = fingers.map(|(finger, mechanism)| {
        let transmission = finger.transmission().unwrap();
        FingerController::new(&hand, finger, mechanism, transmission).ok()
    });
    let mut law = DistributedGrasp::new(fingers, [true; 5]);
    let tips = fingers.map(|(_, mechanism)| mechanism.tip(&POSTURE[0].into()).position.into());
    let mut tick = |order| {
        let joints = law.joints([POSTURE[0]; 5], [[0.0; 4]; 5], PERIOD_S, &mut controllers);
        let inputs = GraspInputs {
            order,
            others: None,
        };
        law.step(&joints, &inputs, &gravity, PERIOD_S, &mut controllers);
        *law.report()
    };
    assert_eq!(tick(None).state, GraspState::Idle);
    let gains = [100.0, 100.0, 100.0, 0.1, 0.1, 0.1];
    let two = GraspOrder::hold(0b1_0001, tips, gains, [0.0; 6]);
    let refused = (1, GraspState::Refused, GraspReason::Fingers);
    assert_eq!(tick(Some((1, two))).event(), refused);
    let five = GraspOrder::hold(0b1_1111, tips, gains, [0.0; 6]);
    let mut report = tick(Some((2, five)));
    let holding = (2, GraspState::Holding, GraspReason::None);
    assert_eq!(report.event(), holding);
    for _ in 0..16 {
        report = tick(None);
    }
    assert_eq!(report.event(), holding);
    assert!(report.margins.iter().all(|&margin| margin != 0.0));
    assert!(report.deviation.iter().all(|part| part.abs() < 1e-9));
}

use condor_hand::config::Hand;
use condor_hand::controller::FingerController;
use condor_hand::grasp::distributed::{
    DistributedGrasp, GraspInputs, GraspOrder, GraspReason, GraspState, HandJoints,
};
use condor_hand::kinematics::{Kinematics, PlanarFinger};
use condor_hand::message::GraspLayout;
use condor_hand::servo::FingerReadings;
use condor_hand::tendon::Pair;
use condor_mbox::{Allocator, MemoryWindow, Region, StaticMemory};
use nalgebra::Vector3;

const HAND: &str = include_str!("../../../hands/utah-mit.toml");
const PERIOD_S: f64 = 1.0 / 400.0;
const POSTURE: [[f64; 4]; 4] = [[0.0, 0.9, 0.8, 0.7]; 4];

#[test]
fn a_reading_that_is_none_does_not_end_a_grasp() {
    let hand = Hand::<4, 4>::from_toml(HAND, "utah-mit.toml").unwrap();
    let gravity = Vector3::from(hand.gravity);
    let fingers = [0, 1, 2, 3].map(|number| {
        let finger = &hand.fingers[number];
        (finger, finger.planar().unwrap())
    });
    let served = [true, true, false, false];
    let mut number = 0;
    let mut controllers = fingers.map(|(finger, mechanism)| {
        number += 1;
        served[number - 1].then(|| FingerController::new(&hand, finger, mechanism).unwrap())
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
                tension: [Pair::both(20.0); 4],
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
fn an_order_comes_back_from_its_words() {
    let mut order = GraspOrder::<5> {
        center: [0.1, -0.2, 0.3],
        force: [1.0, 2.0, 3.0],
        moment: [4.0, 5.0, 6.0],
        friction: 0.7,
        ..GraspOrder::hold(0b1_0101, [[7.0, 8.0, 9.0]; 5], [10.0; 6], [11.0; 6])
    };
    order.stiffness[1][5] = 12.0;
    order.tips[4][2] = f64::MIN_POSITIVE;
    let mut words = [0; GraspOrder::<5>::WORDS];
    order.put(&mut words);
    assert_eq!(GraspOrder::take(&words), order);
    // As a sequence of doubles, the last of which is the time of the ramp.
    let ramp = u64::from(words[203]) << 32 | u64::from(words[202]);
    assert_eq!(f64::from_bits(ramp), order.ramp_s);
}

#[test]
fn five_fingers_on_one_processor_hold_what_two_are_too_few_for() {
    static MEMORY: StaticMemory<4096> = StaticMemory::new();
    let region = Region::whole(MEMORY.window());
    let layout = GraspLayout::<5>::new(&mut Allocator::new(region.size())).unwrap();
    let mut end = layout.servo_end(region).unwrap();
    assert!(layout.report(&region).is_err());

    let hand = Hand::<4, 4>::from_toml(HAND, "utah-mit.toml").unwrap();
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
    let mut controllers = fingers
        .map(|(finger, mechanism)| Some(FingerController::new(&hand, finger, mechanism).unwrap()));
    let mut law = DistributedGrasp::new(fingers, [true; 5]);
    let tips = fingers.map(|(_, mechanism)| mechanism.tip(&POSTURE[0].into()).position.into());
    let mut tick = || {
        let joints = law.joints([POSTURE[0]; 5], [[0.0; 4]; 5], PERIOD_S, &mut controllers);
        let inputs = GraspInputs {
            order: end.order(),
            others: None,
        };
        law.step(&joints, &inputs, &gravity, PERIOD_S, &mut controllers);
        end.tell(law.report());
        let report = layout.report(&region).unwrap();
        assert_eq!(report.event(), law.report().event());
        report
    };
    assert_eq!(tick().state, GraspState::Idle);
    let gains = [100.0, 100.0, 100.0, 0.1, 0.1, 0.1];
    let two = GraspOrder::hold(0b1_0001, tips, gains, [0.0; 6]);
    let number = layout.give(&two, &region).unwrap();
    let refused = (number, GraspState::Refused, GraspReason::Fingers);
    assert_eq!(tick().event(), refused);
    let five = GraspOrder::hold(0b1_1111, tips, gains, [0.0; 6]);
    let number = layout.give(&five, &region).unwrap();
    let mut report = tick();
    let holding = (number, GraspState::Holding, GraspReason::None);
    assert_eq!(report.event(), holding);
    // The squeeze begins with nothing; the next report that is published is of 16 ticks later.
    assert_eq!(report.margins, [0.0; 5]);
    for _ in 0..16 {
        report = tick();
    }
    assert_eq!(report.event(), holding);
    assert!(report.margins.iter().all(|&margin| margin != 0.0));
    assert!(report.deviation.iter().all(|part| part.abs() < 1e-9));
}

//! The whole hand in virtual time: its robot, both servo processors, the table, and a small master.

use condor_hand::grasp::distributed::{GraspOrder, GraspReason, GraspState};
use condor_hand::kinematics::JointLimits;
use condor_robot::plant::PlantRequest;
use condor_robot::table::{TableRefusal, TableRequest, TableStatus};
use nalgebra::{Vector3, Vector4};

use crate::rig::{FIRST, Master, Posture, SECOND, TWO, hand, run, run_with};

const READY: Posture = [[0.0, 0.6, 0.8, 0.7]; 4];

/// Switches all joints on where they are, and brings them to `posture`.
fn begin(master: &mut Master<'_>, posture: Posture) {
    master.wait_for_all();
    master.enable();
    master.hold(0.2);
    master.go(1.0, posture);
    master.stay(0.2);
    master.reset_peak();
}

/// From a posture, by so much of each joint, rad.
fn by(from: &Posture, step: [f64; 4]) -> Posture {
    from.map(|finger| std::array::from_fn(|joint| finger[joint] + step[joint]))
}

fn moves(master: &mut Master<'_>) {
    begin(master, READY);
    // Quintics of 0.4 s, of up to 34 degrees.
    for step in [[0.2, 0.5, 0.6, 0.4], [-0.2, -0.1, 0.1, 0.3], [0.0; 4]] {
        master.go(0.4, by(&READY, step));
    }
    master.stay(0.2);
    for number in [FIRST, SECOND] {
        let tracking = master.tracking(number).whole;
        let fingers = if number == FIRST { 0..2 } else { 2..4 };
        assert_eq!(tracking.rms_rad(5 - fingers.end, 0), None);
        for (finger, joint) in fingers.flat_map(|finger| [(finger, 0), (finger, 3)]) {
            let rms = tracking.rms_rad(finger, joint).unwrap().to_degrees();
            let peak = tracking.peak_rad(finger, joint).unwrap().to_degrees();
            assert!(
                rms > 0.01 && rms < 6.0 && rms < peak,
                "{rms} of {peak} degrees"
            );
        }
    }
}

#[test]
fn set_points_are_tracked_and_no_release_is_skipped() {
    let seen = run(4.0, None, moves);
    let peak = seen.peak_rad.to_degrees();
    assert!(peak > 0.1 && peak < 2.5, "{peak} degrees");
    assert_eq!(seen.counts.len(), 4);
    for (number, runs, skips) in &seen.counts {
        assert!(*runs > 1000, "{number} ran {runs} times");
        assert_eq!(*skips, 0, "{number}");
    }
    assert_eq!(seen.said[0], "controls index and middle at 400 Hz\r\n");
    assert_eq!(seen.said[1], "controls ring and thumb at 400 Hz\r\n");
}

#[test]
fn two_runs_are_the_same_to_the_last_bit() {
    let first = run(4.0, None, moves);
    assert!(first.positions.len() > 100 * 128);
    assert!(first == run(4.0, None, moves));
}

#[test]
fn one_two_three_and_four_processors_move_the_hand_and_hold_a_ball_alike_to_the_last_bit() {
    let hold = |partition| {
        run_with(partition, 8.0, None, |master| {
            take_ball(master);
            // The palm is accelerated while it holds the ball.
            let speed = 0.6;
            let home = TableRequest::Home { speed };
            assert!(master.ask_table(&home).is_ok());
            master.wait(0.5);
            let to = [0.02, -0.01, 0.01];
            let go = TableRequest::Move { to, speed };
            assert!(master.ask_table(&go).is_ok());
            master.wait(1.0);
            assert_eq!(master.truth().unwrap().touching, 0b1111);
        })
    };
    let two = hold(TWO);
    assert!(two.positions.len() > 300 * 128);
    for partition in [[1; 4], [1, 2, 3, 4], [2, 1, 2, 2], [4, 3, 2, 3]] {
        let run = hold(partition);
        assert!(run.positions == two.positions, "{partition:?}");
    }
}

#[test]
fn a_servo_that_ends_leaves_its_fingers_to_the_watchdog_and_no_others() {
    let seen = run(4.0, Some((SECOND, 2.0)), |master| {
        begin(master, READY);
        while master.truth().unwrap().time_s < 1.9 {
            master.stay(0.02);
        }
        let before = master.truth().unwrap();
        assert_eq!(before.resting & 0b1111, 0);
        assert!(before.effort[2][2] > 5.0, "{:?}", before.effort[2]);
        master.stay(0.16);
        let resting = master.truth().unwrap();
        assert_eq!(resting.resting & 0b1111, 0b1100);
        // On the way, not there at once.
        assert!(resting.effort[2].iter().any(|&n| n > 4.2));
        master.stay(0.5);
        let rested = master.truth().unwrap();
        for effort in rested.effort[2..].as_flattened() {
            assert!((effort - 4.0).abs() < 0.05, "{effort} N");
        }
        // The fingers of the other processor stay where they are to be.
        for (is, wanted) in rested.position[..2]
            .as_flattened()
            .iter()
            .zip(READY.as_flattened())
        {
            assert!((is - wanted).abs() < 0.02);
        }
    });
    assert!(
        seen.said[3].contains("D/A board 3 takes its outputs to those of rest"),
        "{:?}",
        seen.said
    );
    assert!(!seen.said[3].contains("D/A board 0"), "{:?}", seen.said);
}

#[test]
fn the_table_goes_home_and_where_it_is_sent_and_the_fingers_stay() {
    run(6.0, None, |master| {
        begin(master, READY);
        let go = |to| TableRequest::Move { to, speed: 0.6 };
        let to = [0.1, -0.05, 0.08];
        let refused = master.ask_table(&go(to));
        assert_eq!(refused, Err(TableRefusal::NotReady));
        let home = TableRequest::Home { speed: 0.6 };
        assert_eq!(master.ask_table(&home), Ok(TableStatus::Homing));
        master.stay(0.5);
        let status = master.ask_table(&TableRequest::Status);
        assert_eq!(status, Ok(TableStatus::Ready));
        let far = master.ask_table(&go([0.3, 0.0, 0.0]));
        assert_eq!(far, Err(TableRefusal::Motion));
        assert_eq!(master.ask_table(&go(to)), Ok(TableStatus::Ready));
        master.reset_peak();
        master.stay(1.5);
        let truth = master.truth().unwrap();
        for (is, to) in truth.table.iter().zip(to) {
            assert!((is - to).abs() < 1e-3, "{:?}", truth.table);
        }
        // What the servos are told of the acceleration holds the fingers.
        let peak = master.peak_rad().to_degrees();
        assert!(peak < 0.3, "{peak} degrees");
    });
}

pub(crate) const BALL: [f64; 3] = [0.085, 0.004, -0.0625];
const RADIUS_M: f64 = 0.02;
const MASS_KG: f64 = 0.05;
/// From the centre of the ball to the tips.
const TIPS: [[f64; 3]; 4] = [
    [0.0, 0.9, 0.4],
    [0.1, 0.0, 1.0],
    [0.0, -0.9, 0.4],
    [0.05, 0.0, -1.0],
];
const STIFFNESS: [f64; 6] = [200.0, 250.0, 150.0, 0.1, 0.1, 0.1];
const DAMPING: [f64; 6] = [4.0, 4.0, 4.0, 2e-3, 2e-3, 2e-3];

/// The joints with which the tips are so far from the middle of the ball, m.
fn around(distance_m: f64) -> Posture {
    apart([distance_m; 4])
}

/// The joints with which each tip is so far from the middle of the ball, m.
pub(crate) fn apart(far_m: [f64; 4]) -> Posture {
    let hand = hand();
    std::array::from_fn(|finger| {
        let entry = &hand.fingers[finger];
        let limits = JointLimits::new(entry.limits().low, entry.limits().high).unwrap();
        // Bent behind the proximal joint, as fingers are that close on something: they meet the ball nearly head-on.
        let present = Vector4::new(0.0, 0.1, 1.2, 1.3);
        let to = Vector3::from(BALL) + Vector3::from(TIPS[finger]).normalize() * far_m[finger];
        let nearest = entry.chain().nearest(&to, &present, &limits).unwrap();
        assert!(nearest.distance < 1e-8);
        nearest.posture.into()
    })
}

/// Has all fingers hold the ball.
fn take_ball(master: &mut Master<'_>) {
    begin(master, around(RADIUS_M + 2e-3));
    let place = PlantRequest::PlaceBall {
        center: BALL,
        radius: RADIUS_M,
        mass: MASS_KG,
    };
    assert_eq!(master.ask_plant(&place), Ok(()));
    let mut tips = master.tips();
    for tip in &mut tips {
        let from = Vector3::from(*tip) - Vector3::from(BALL);
        *tip = (Vector3::from(BALL) + from.normalize() * RADIUS_M).into();
    }
    let mut order = GraspOrder::hold(0b1111, tips, STIFFNESS, DAMPING);
    order.center = BALL;
    order.friction = 0.5;
    master.forget();
    master.grasp(&order);
    master.wait(1.5);
    // It bears its weight from here on.
    order.force = [0.0, 0.0, 9.81 * MASS_KG];
    master.grasp(&order);
    let let_go = PlantRequest::LetGo { seconds: 1.0 };
    assert_eq!(master.ask_plant(&let_go), Ok(()));
    master.wait(2.5);
    for &number in &master.servos {
        assert_eq!(master.report(number).state, GraspState::Holding);
    }
    assert_eq!(master.truth().unwrap().touching, 0b1111);
}

#[test]
fn a_ball_that_both_processors_hold_gives_way_as_ordered() {
    run(12.0, None, |master| {
        take_ball(master);
        let before = master.truth().unwrap().ball;
        let push_n = [0.2, 0.1, -0.1];
        let push = |force| PlantRequest::Push {
            force,
            moment: [0.0; 3],
        };
        assert_eq!(master.ask_plant(&push(push_n)), Ok(()));
        master.wait(2.0);
        let truth = master.truth().unwrap();
        for axis in 0..3 {
            let moved = truth.ball[axis] - before[axis];
            let expected = push_n[axis] / STIFFNESS[axis];
            assert!(
                (moved - expected).abs() < 0.15 * expected.abs(),
                "{moved} m along {axis} in place of {expected}"
            );
        }
        assert_eq!((truth.touching, truth.sliding), (0b1111, 0));
        assert_eq!(master.ask_plant(&push([0.0; 3])), Ok(()));
        master.wait(1.0);

        // Letting go leaves the joints where they are.
        let held = master.truth().unwrap().position;
        master.grasp(&GraspOrder::RELEASE);
        master.hold(0.5);
        assert_eq!(master.report(FIRST).state, GraspState::Idle);
        let released = master.truth().unwrap().position;
        for (is, was) in released.as_flattened().iter().zip(held.as_flattened()) {
            assert!((is - was).abs() < 0.05, "{is} in place of {was}");
        }
    });
}

#[test]
fn a_grasp_ends_when_the_other_processor_does() {
    let seen = run(9.0, Some((SECOND, 7.0)), |master| {
        take_ball(master);
        master.wait(2.5);
        let report = master.report(FIRST);
        assert_eq!(report.state, GraspState::Left);
        assert_eq!(report.reason, GraspReason::Partner);
    });
    assert!(
        seen.said[0].contains("grasp 2: holds the ball"),
        "{:?}",
        seen.said
    );
    assert!(
        seen.said[0].contains("ended: another finger"),
        "{:?}",
        seen.said
    );
}

#[test]
fn orders_that_no_grasp_can_be_are_refused_and_change_nothing() {
    run(3.0, None, |master| {
        begin(master, READY);
        let tips = master.tips();
        let mut two = GraspOrder::hold(0b0011, tips, STIFFNESS, DAMPING);
        two.squeeze_n = 0.0;
        let mut soft = GraspOrder::hold(0b1101, tips, STIFFNESS, DAMPING);
        soft.stiffness[0][0] = -1.0;
        let mut nowhere = GraspOrder::hold(0b1101, tips, STIFFNESS, DAMPING);
        nowhere.tips[3][1] = f64::NAN;
        for (order, reason) in [
            (two, GraspReason::Fingers),
            (soft, GraspReason::Tuning),
            (nowhere, GraspReason::Tuning),
        ] {
            master.grasp(&order);
            master.stay(0.04);
            for number in [FIRST, SECOND] {
                let report = master.report(number);
                assert_eq!((report.state, report.reason), (GraspState::Refused, reason));
            }
        }
        assert!(master.peak_rad() < 0.02);
    });
}

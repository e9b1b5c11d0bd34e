//! What the generator does when servos have stopped joints by a guard.

use condor_hand::trajectory::{
    Begin, Generator, Guards, Happening, MotionEnd, MotionGuard, MotionTicket, Observations, OnEnd,
    Pace, Primitive, Profile, SetPoint, StopGuard, Target,
};

use super::generator::{Hand, J, LIMITS, Motion, TICK, check};

const CONTACT: MotionGuard = MotionGuard::Contact { joint: 1 };

fn hand() -> Hand {
    let hand = Generator::new([LIMITS; J], [0.0; J], TICK).unwrap();
    hand.with_guards_in_servos()
}

fn reach(joints: &[usize], position: f64) -> Motion {
    let still = Primitive::new(Pace::Duration(0.8), Profile::MinimumJerk);
    let mut motion = joints.iter().fold(still, |motion, &joint| {
        motion.with(joint, Target::Absolute(position)).unwrap()
    });
    motion.stop = Guards {
        torque: Some(0.5),
        contact: true,
        ..Guards::none()
    };
    motion
}

/// Runs ticks, all of which keep the limits.
fn run(hand: &mut Hand, ticks: usize) -> [SetPoint; J] {
    for _ in 0..ticks {
        let before = hand.set_points();
        let after = hand.tick(&Observations::none());
        check(&before, &after).unwrap();
    }
    hand.set_points()
}

fn ends(hand: &mut Hand) -> Vec<(MotionTicket, MotionEnd)> {
    let events = core::iter::from_fn(|| hand.take_event());
    let ends = events.filter_map(|event| match event.happening {
        Happening::Ended(ended) => Some((event.ticket, ended)),
        _ => None,
    });
    ends.collect()
}

#[test]
fn stopped_joints_come_to_rest_exactly_where_the_servo_stopped_them() {
    let mut hand = hand();
    let first = hand.enqueue(reach(&[0, 1, 2], 1.2)).unwrap();
    let second = hand.enqueue(reach(&[1], 0.2)).unwrap();
    let served = run(&mut hand, 18).map(|point| point.position);
    // The master is two ticks ahead when it hears of that.
    let ahead = run(&mut hand, 2);
    assert!(ahead[1].position > served[1] + 0.05);
    let returning = hand.stopped(first.number(), CONTACT, 0b011, &served);
    assert_eq!(returning, Ok(0b011));
    // Told again and again, until the joint has another motion.
    let mut ticks = 0;
    while hand.guards()[1].motion == first.number() {
        run(&mut hand, 1);
        let again = hand.stopped(first.number(), CONTACT, 0b011, &served);
        assert_eq!(again, Ok(0));
        ticks += 1;
        assert!(ticks < 20);
    }
    assert_eq!(ends(&mut hand), [(first, MotionEnd::Stopped(CONTACT))]);
    let points = hand.set_points();
    assert_eq!(points[0], SetPoint::rest(served[0]));
    // Joint 2 slowed down on its path.
    assert!(points[2].position > ahead[2].position);
    assert_eq!(points[2].velocity.to_bits(), 0);
    let points = run(&mut hand, 50);
    assert_eq!(points[1], SetPoint::rest(0.2));
    assert_eq!(ends(&mut hand), [(second, MotionEnd::Reached)]);
    assert!(hand.is_idle());
}

#[test]
fn the_next_motion_starts_from_where_the_servo_stopped_the_joint() {
    let mut hand = hand();
    let first = hand.enqueue(reach(&[1], 1.2)).unwrap();
    run(&mut hand, 20);
    let at = [0.0, 0.3, 0.0, 0.0];
    hand.stopped(first.number(), CONTACT, 0b10, &at).unwrap();
    let by = Primitive::new(Pace::Duration(0.4), Profile::MinimumJerk);
    hand.enqueue(by.with(1, Target::Relative(0.25)).unwrap())
        .unwrap();
    let points = run(&mut hand, 60);
    assert!((points[1].position - 0.55).abs() < 1e-12, "{points:?}");
}

#[test]
fn a_second_finger_that_stops_later_returns_too_and_the_motion_ends_once() {
    let mut hand = hand();
    let mut motion = reach(&[0, 1, 2, 3], 1.2);
    motion.on_end = OnEnd::Hold;
    let ticket = hand.enqueue(motion).unwrap();
    let served = run(&mut hand, 20).map(|point| point.position);
    let number = ticket.number();
    hand.stopped(number, CONTACT, 0b0011, &served).unwrap();
    run(&mut hand, 1);
    let torque = MotionGuard::Torque { joint: 3 };
    assert_eq!(hand.stopped(number, torque, 0b1000, &served), Ok(0b1000));
    let points = run(&mut hand, 40);
    assert_eq!(ends(&mut hand), [(ticket, MotionEnd::Stopped(CONTACT))]);
    assert!(hand.is_held() && hand.is_idle());
    for joint in [0, 1, 3] {
        assert_eq!(points[joint], SetPoint::rest(served[joint]));
    }
}

#[test]
fn a_joint_whose_motion_has_ended_returns_and_one_with_another_motion_does_not() {
    let mut hand = hand();
    let first = hand.enqueue(reach(&[0, 1], 0.5)).unwrap();
    run(&mut hand, 60);
    let mut second = reach(&[0], 0.0);
    second.begin = Begin::Beside;
    let second = hand.enqueue(second).unwrap();
    run(&mut hand, 5);
    assert_eq!(ends(&mut hand), [(first, MotionEnd::Reached)]);
    let served = [0.48, 0.49, 0.0, 0.0];
    assert_eq!(
        hand.stopped(first.number(), CONTACT, 0b11, &served),
        Ok(0b10)
    );
    let points = run(&mut hand, 60);
    assert_eq!(points[0], SetPoint::rest(0.0));
    assert_eq!(points[1], SetPoint::rest(0.49));
    assert_eq!(ends(&mut hand), [(second, MotionEnd::Reached)]);
}

#[test]
fn an_abort_lets_stopped_joints_return() {
    let mut hand = hand();
    let ticket = hand.enqueue(reach(&[0, 1], 1.2)).unwrap();
    let served = run(&mut hand, 20).map(|point| point.position);
    hand.stopped(ticket.number(), CONTACT, 0b01, &served)
        .unwrap();
    run(&mut hand, 1);
    hand.abort();
    let points = run(&mut hand, 40);
    assert_eq!(points[0], SetPoint::rest(served[0]));
    assert_eq!(ends(&mut hand), [(ticket, MotionEnd::Aborted)]);
}

#[test]
fn what_a_servo_says_is_not_believed_beyond_the_limits() {
    let mut hand = hand();
    let ticket = hand.enqueue(reach(&[0, 1], 1.2)).unwrap();
    run(&mut hand, 20);
    let number = ticket.number();
    let wrong = [0.0, f64::NAN, 0.0, 0.0];
    assert!(hand.stopped(number, CONTACT, 0b10, &wrong).is_err());
    assert_eq!(hand.stopped(0, CONTACT, 0b10, &[0.0; J]), Ok(0));
    assert_eq!(hand.stopped(number + 1, CONTACT, 0b10, &[0.0; J]), Ok(0));
    let far = [0.0, 1e300, 0.0, 0.0];
    assert_eq!(hand.stopped(number, CONTACT, 0b10, &far), Ok(0b10));
    let points = run(&mut hand, 100);
    assert_eq!(points[1], SetPoint::rest(LIMITS.high));
}

#[test]
fn the_servos_get_the_guards_of_what_moves_their_joints() {
    let mut hand = hand();
    let motion = |joint: usize| hand.guards()[joint].motion;
    assert_eq!([0, 1, 2, 3].map(motion), [0; 4]);
    let first = hand.enqueue(reach(&[0, 1], 1.2)).unwrap();
    run(&mut hand, 5);
    let guard = StopGuard {
        motion: first.number(),
        torque: 0.5,
        effort: f64::INFINITY,
        contact: true,
    };
    let guards = hand.guards();
    assert_eq!(guards, [guard, guard, StopGuard::NONE, StopGuard::NONE]);
    assert!(guard.is_armed() && !StopGuard::NONE.is_armed());
    // It does not look at what it is given itself.
    let seen = Observations {
        torques: [f64::NAN; J],
        efforts: [f64::NAN; J],
        contacts: u32::MAX,
    };
    for _ in 0..60 {
        hand.tick(&seen);
    }
    assert_eq!(ends(&mut hand), [(first, MotionEnd::Reached)]);
    // The motion that was the last one remains known, without conditions.
    let after = hand.guards()[0];
    assert_eq!(after.motion, first.number());
    assert!(!after.is_armed());
    // A joint that rests where it is measured has none.
    hand.hold(1, &[0.3; J]).unwrap();
    assert_eq!(hand.guards()[0], StopGuard::NONE);
}

#[test]
fn a_guard_of_time_stays_with_the_generator() {
    let mut hand = hand();
    let mut motion = reach(&[1], 1.2);
    motion.stop.time = Some(0.3);
    let ticket = hand.enqueue(motion).unwrap();
    run(&mut hand, 40);
    assert_eq!(
        ends(&mut hand),
        [(ticket, MotionEnd::Stopped(MotionGuard::Time))]
    );
}

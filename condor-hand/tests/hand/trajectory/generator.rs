//! What the generator promises: limits, continuity, order.

use condor_hand::trajectory::{
    Begin, Generator, Guards, Happening, MotionEnd, MotionError, MotionEvent, MotionGuard,
    MotionProgress, MotionTicket, Observations, OnEnd, Pace, Primitive, Profile, ProfileLimits,
    SetPoint, Target, Via,
};
use condor_hand::{NumberError, Requirement, Subject};
use proptest::{prelude::TestCaseError, prop_assert};

pub(super) const J: usize = 4;
pub(super) const TICK: f64 = 0.02;
pub(super) const LIMITS: ProfileLimits = ProfileLimits {
    low: -0.5,
    high: 1.5,
    velocity: 3.0,
    acceleration: 40.0,
    jerk: 800.0,
};

pub(super) type Hand = Generator<J, 4>;
pub(super) type Motion = Primitive<J>;

pub(super) fn hand() -> Hand {
    Hand::new([LIMITS; J], [0.0; J], TICK).unwrap()
}

fn to(joints: &[usize], position: f64, pace: Pace, profile: Profile) -> Motion {
    joints
        .iter()
        .fold(Motion::new(pace, profile), |motion, &joint| {
            motion.with(joint, Target::Absolute(position)).unwrap()
        })
}

fn reach(joints: &[usize], position: f64) -> Motion {
    to(joints, position, Pace::Duration(0.8), Profile::MinimumJerk)
}

fn slow(joints: &[usize], position: f64) -> Motion {
    to(joints, position, Pace::Duration(1.0), Profile::MinimumJerk)
}

fn events(hand: &mut Hand) -> Vec<MotionEvent> {
    core::iter::from_fn(|| hand.take_event()).collect()
}

pub(super) fn run(hand: &mut Hand, ticks: usize) -> Vec<[SetPoint; J]> {
    (0..ticks)
        .map(|_| hand.tick(&Observations::none()))
        .collect()
}

/// More than the tolerance of the checks.
const CLOSE: f64 = 1e-6;

/// The limits, and whether each position is where the velocities lead.
pub(super) fn check(before: &[SetPoint; J], after: &[SetPoint; J]) -> Result<(), TestCaseError> {
    for (joint, (from, to)) in before.iter().zip(after).enumerate() {
        let all = [to.position, to.velocity, to.acceleration];
        prop_assert!(all.into_iter().all(f64::is_finite), "joint {joint}: {to:?}");
        prop_assert!(to.position >= LIMITS.low - CLOSE, "joint {joint}: {to:?}");
        prop_assert!(to.position <= LIMITS.high + CLOSE, "joint {joint}: {to:?}");
        prop_assert!(
            to.velocity.abs() <= LIMITS.velocity * (1.0 + CLOSE),
            "joint {joint}: {to:?}"
        );
        let most = LIMITS.acceleration * (1.0 + CLOSE);
        prop_assert!(to.acceleration.abs() <= most, "joint {joint}: {to:?}");
        let change = to.velocity - from.velocity;
        prop_assert!(
            change.abs() <= 2.0 * most * TICK,
            "joint {joint}: {from:?} {to:?}"
        );
        let step = to.position - from.position;
        prop_assert!(
            step.abs() <= LIMITS.velocity * TICK * (1.0 + CLOSE),
            "joint {joint}"
        );
        let mean = (to.velocity + from.velocity) * 0.5 * TICK;
        prop_assert!(
            (step - mean).abs() <= most * TICK * TICK,
            "joint {joint}: {from:?} {to:?}"
        );
    }
    Ok(())
}

#[test]
fn joints_reach_their_targets_together_and_others_hold() {
    for profile in [
        Profile::Cubic,
        Profile::MinimumJerk,
        Profile::Trapezoid,
        Profile::JerkLimited,
    ] {
        for pace in [Pace::Duration(0.9), Pace::Speed(0.8)] {
            let mut hand = hand();
            let motion = to(&[0, 2], 1.2, pace, profile);
            let motion = motion.with(3, Target::Relative(-0.25)).unwrap();
            let ticket = hand.enqueue(motion).unwrap();
            assert_eq!(
                hand.progress(ticket),
                Some(MotionProgress::Queued { before: 0 })
            );
            let states = run(&mut hand, 60);
            assert_eq!(
                states[59].map(|point| point.position),
                [1.2, 0.0, 1.2, -0.25],
                "{profile:?} {pace:?}"
            );
            assert!(hand.is_idle());
            let happened: Vec<_> = events(&mut hand)
                .iter()
                .map(|event| event.happening)
                .collect();
            assert_eq!(
                happened,
                [
                    Happening::Started { adjusted: false },
                    Happening::Ended(MotionEnd::Reached)
                ]
            );
            // Together: the way of each is the same part of its whole at every time, but for
            // trapezoids, which share the end only.
            let last = states.iter().rposition(|s| s[0].velocity != 0.0);
            assert_eq!(last, states.iter().rposition(|s| s[3].velocity != 0.0));
        }
    }
}

#[test]
fn limits_are_checked_when_enqueued_and_the_joint_is_named() {
    let mut hand = hand();
    let far = to(&[1], 1.51, Pace::Speed(1.0), Profile::Cubic);
    let most = NumberError {
        at: Subject::Joint(1),
        what: "the position, rad,",
        value: 1.51,
        must: Requirement::AtMost(1.5),
    };
    assert_eq!(hand.enqueue(far), Err(most.into()));
    let fast = to(&[2], 1.5, Pace::Duration(0.9), Profile::MinimumJerk);
    let Err(MotionError::Number(NumberError {
        at: Subject::Joint(2),
        what,
        value,
        must,
    })) = hand.enqueue(fast)
    else {
        panic!("accepted");
    };
    let most = Requirement::AtMost(3.0);
    assert_eq!((what, must), ("the velocity, rad/s,", most));
    assert!((value - 1.875 * 1.5 / 0.9).abs() < 1e-12);
    let hard = to(&[0], 0.2, Pace::Duration(0.15), Profile::Cubic);
    let Err(MotionError::Number(NumberError {
        at: Subject::Joint(0),
        what,
        value,
        ..
    })) = hand.enqueue(hard)
    else {
        panic!("accepted");
    };
    assert_eq!(what, "the acceleration, rad/s²,");
    assert!((value - 6.0 * 0.2 / (0.15 * 0.15)).abs() < 1e-9);
    let short = to(&[0], 0.2, Pace::Duration(0.1), Profile::Trapezoid);
    let error = hand.enqueue(short).unwrap_err();
    assert!(
        error
            .to_string()
            .starts_with("joint 0: the duration, s, is 0.1; it must be at least 0.14"),
        "{error}"
    );
    // The second starts where the first will end.
    let only = hand.enqueue(reach(&[0], 1.0)).unwrap();
    let relative = Motion::new(Pace::Speed(0.5), Profile::Cubic);
    let relative = relative.with(0, Target::Relative(0.6)).unwrap();
    assert!(matches!(
        hand.enqueue(relative),
        Err(MotionError::Number(NumberError {
            at: Subject::Joint(0),
            value: 1.6,
            ..
        }))
    ));
    // A spline that overshoots between points that are all within the range.
    let mut via = to(&[3], 0.0, Pace::Duration(4.0), Profile::Cubic);
    for at in [0.45, 0.5] {
        let positions = [1.49; J];
        via.vias.push(Via { at, positions }).unwrap();
    }
    assert!(matches!(
        hand.enqueue(via),
        Err(MotionError::Number(NumberError {
            at: Subject::Joint(3),
            ..
        }))
    ));
    hand.abort();
    let aborted = Happening::Ended(MotionEnd::Aborted);
    let events: Vec<_> = events(&mut hand).into_iter().collect();
    assert_eq!(events.len(), 1);
    assert_eq!((events[0].ticket, events[0].happening), (only, aborted));
}

#[test]
fn a_target_at_a_limit_may_be_rounded() {
    let mut hand = hand();
    let rounded = LIMITS.high * (1.0 + 1e-13);
    assert!(LIMITS.contains(rounded) && !LIMITS.contains(1.000_001 * rounded));
    hand.enqueue(slow(&[0], rounded)).unwrap();
    let refused = hand.enqueue(slow(&[0], 1.000_001 * rounded)).unwrap_err();
    assert_eq!(
        refused.to_string(),
        "joint 0: the position, rad, is 1.5000015; it must be at most 1.5"
    );
}

#[test]
fn speed_uses_the_limits_up() {
    for profile in [Profile::Cubic, Profile::MinimumJerk, Profile::Trapezoid] {
        let mut hand = hand();
        hand.enqueue(to(&[0], 1.5, Pace::Speed(0.5), profile))
            .unwrap();
        let states = run(&mut hand, 100);
        let fastest = states.iter().map(|s| s[0].velocity).fold(0.0, f64::max);
        assert!(
            fastest <= 1.5 + 1e-9 && fastest > 1.49,
            "{profile:?} {fastest}"
        );
    }
}

#[test]
fn via_points_are_passed_at_their_times() {
    let mut hand = hand();
    let mut motion = to(&[0, 1], 1.0, Pace::Duration(2.0), Profile::Cubic);
    motion.targets[1] = Target::Relative(-0.2);
    for (at, x) in [(0.25, 0.5), (0.75, 0.1)] {
        motion
            .vias
            .push(Via {
                at,
                positions: [x, x, 9.0, 9.0],
            })
            .unwrap();
    }
    hand.enqueue(motion).unwrap();
    let states = run(&mut hand, 100);
    for (tick, x) in [(25, 0.5), (75, 0.1)] {
        for joint in [0, 1] {
            assert!((states[tick - 1][joint].position - x).abs() < 1e-9);
        }
    }
    assert_eq!(states[99][1].position, -0.2);
    let smooth = states[30][0].velocity;
    assert!(smooth.abs() > 0.1, "it must not stop at a via point");
}

#[test]
fn disjoint_motions_run_beside_each_other() {
    let mut hand = hand();
    let first = hand.enqueue(reach(&[0, 1], 1.0)).unwrap();
    let mut beside = reach(&[2], 0.5);
    beside.begin = Begin::Beside;
    let beside = hand.enqueue(beside).unwrap();
    let mut blocked = reach(&[1], 0.5);
    blocked.begin = Begin::Beside;
    let blocked = hand.enqueue(blocked).unwrap();
    run(&mut hand, 1);
    for ticket in [first, beside] {
        assert!(matches!(
            hand.progress(ticket),
            Some(MotionProgress::Running { .. })
        ));
    }
    assert_eq!(
        hand.progress(blocked),
        Some(MotionProgress::Queued { before: 0 })
    );
    run(&mut hand, 40);
    assert!(matches!(
        hand.progress(blocked),
        Some(MotionProgress::Running { .. })
    ));
}

#[test]
fn a_newer_one_takes_its_joints_from_where_they_are() {
    let mut hand = hand();
    let first = hand.enqueue(reach(&[0, 1], 1.0)).unwrap();
    run(&mut hand, 20);
    let before = hand.set_points();
    let mut newer = reach(&[0], -0.4);
    newer.begin = Begin::Now;
    let newer = hand.enqueue(newer).unwrap();
    let after = run(&mut hand, 1)[0];
    assert!(before[0].velocity > 1.0 && after[0].velocity > 1.0);
    check(&before, &after).unwrap();
    assert!(matches!(
        hand.progress(first),
        Some(MotionProgress::Running { .. })
    ));
    run(&mut hand, 60);
    assert_eq!(hand.set_points()[0].position, -0.4);
    assert_eq!(hand.set_points()[1].position, 1.0);

    let mut all = reach(&[0, 1], 0.0);
    all.pace = Pace::Duration(1.0);
    let old = hand.enqueue(all.clone()).unwrap();
    run(&mut hand, 10);
    all.begin = Begin::Now;
    let by = hand.enqueue(all).unwrap();
    run(&mut hand, 1);
    let superseded = Happening::Ended(MotionEnd::Superseded { by });
    let seen = events(&mut hand);
    assert!(seen.contains(&MotionEvent {
        ticket: old,
        happening: superseded
    }));
    let ends: Vec<_> = [first, newer]
        .map(|ticket| {
            seen.iter()
                .any(|e| e.ticket == ticket && e.happening == Happening::Ended(MotionEnd::Reached))
        })
        .into();
    assert_eq!(ends, [true, true]);
}

#[test]
fn blending_begins_before_the_end_and_does_not_stop() {
    let slowest = |blend: f64| {
        let mut hand = hand();
        hand.enqueue(reach(&[0], 0.7)).unwrap();
        let mut second = reach(&[0], 1.4);
        second.blend = blend;
        hand.enqueue(second).unwrap();
        let states = run(&mut hand, 100);
        assert_eq!(states[99][0].position, 1.4);
        let end = states.iter().position(|s| s[0].position >= 1.39).unwrap();
        let middle = &states[20..end];
        middle
            .iter()
            .map(|s| s[0].velocity)
            .fold(f64::INFINITY, f64::min)
    };
    assert_eq!(slowest(0.0), 0.0);
    assert!(slowest(0.2) > 0.3);
}

#[test]
fn guards_start_and_stop() {
    let mut hand = hand();
    let mut motion = reach(&[1], 1.0);
    motion.start.contact = true;
    motion.stop.torque = Some(0.3);
    let ticket = hand.enqueue(motion).unwrap();
    let mut seen = Observations::none();
    seen.contacts = 0b1101;
    seen.torques = [9.0, 0.1, 9.0, f64::NAN];
    hand.tick(&seen);
    assert!(matches!(
        hand.progress(ticket),
        Some(MotionProgress::Queued { .. })
    ));
    seen.contacts = 0b0010;
    for _ in 0..20 {
        hand.tick(&seen);
    }
    assert!(hand.set_points()[1].velocity > 1.0);
    seen.torques[1] = -0.31;
    let mut ticks = 0;
    while !hand.is_idle() {
        let before = hand.set_points();
        let after = hand.tick(&seen);
        check(&before, &after).unwrap();
        ticks += 1;
    }
    assert!(ticks <= 10, "{ticks}");
    let stop = Happening::Ended(MotionEnd::Stopped(MotionGuard::Torque { joint: 1 }));
    assert_eq!(events(&mut hand).last().unwrap().happening, stop);
    assert_eq!(hand.tick(&seen)[1].velocity, 0.0);
    assert!(hand.set_points()[1].position < 0.9);
}

#[test]
fn sensors_without_a_number_stop_and_do_not_start() {
    let mut seen = Observations::none();
    seen.efforts[0] = f64::NAN;
    let mut hand = hand();
    let mut motion = reach(&[0], 1.0);
    motion.start.effort = Some(10.0);
    let waiting = hand.enqueue(motion.clone()).unwrap();
    hand.tick(&seen);
    let queued = MotionProgress::Queued { before: 0 };
    assert_eq!(hand.progress(waiting), Some(queued));
    hand.abort();
    motion.start = Guards::none();
    motion.stop.effort = Some(10.0);
    hand.enqueue(motion).unwrap();
    for _ in 0..10 {
        hand.tick(&seen);
    }
    assert!(hand.is_idle());
    let stop = Happening::Ended(MotionEnd::Stopped(MotionGuard::Effort { joint: 0 }));
    assert_eq!(events(&mut hand).last().unwrap().happening, stop);
}

#[test]
fn times_start_and_stop() {
    let mut hand = hand();
    let mut motion = reach(&[0], 1.0);
    motion.start.time = Some(0.1);
    motion.stop.time = Some(0.2);
    hand.enqueue(motion).unwrap();
    let states = run(&mut hand, 40);
    let first = states.iter().position(|s| s[0].velocity > 0.0).unwrap();
    assert_eq!(first, 5);
    let last = states.iter().rposition(|s| s[0].velocity > 0.0).unwrap();
    assert!((15..=22).contains(&last), "{last}");
}

#[test]
fn a_pause_stops_on_the_path_and_resuming_ends_where_it_was_to() {
    let mut hand = hand();
    let ticket = hand.enqueue(slow(&[0, 1], 1.4)).unwrap();
    run(&mut hand, 25);
    hand.pause();
    run(&mut hand, 30);
    let stopped = hand.set_points();
    assert!(stopped[0].position < 1.3 && stopped[0].velocity == 0.0);
    assert_eq!(run(&mut hand, 5)[4][0], SetPoint::rest(stopped[0].position));
    assert!(matches!(
        hand.progress(ticket),
        Some(MotionProgress::Running { rate: 0.0, .. })
    ));
    hand.resume();
    let states = run(&mut hand, 60);
    assert_eq!(states[59][0].position, 1.4);
    assert!(
        states
            .iter()
            .all(|s| (s[0].position - s[1].position).abs() < 1e-12)
    );
}

#[test]
fn an_abort_forgets_everything() {
    let mut hand = hand();
    let tickets = [1.4, 0.3].map(|x| hand.enqueue(slow(&[0], x)).unwrap());
    run(&mut hand, 25);
    hand.abort();
    let mut ticks = 0;
    while !hand.is_idle() {
        run(&mut hand, 1);
        ticks += 1;
    }
    // 2.6 rad/s and 40 rad/s² would need 4 ticks.
    assert!(ticks <= 8, "{ticks}");
    let aborted = |ticket: MotionTicket| MotionEvent {
        ticket,
        happening: Happening::Ended(MotionEnd::Aborted),
    };
    let seen = events(&mut hand);
    assert!(
        tickets
            .iter()
            .all(|&ticket| seen.contains(&aborted(ticket)))
    );
}

#[test]
fn hold_waits_to_be_told() {
    let mut hand = hand();
    let mut motion = reach(&[0], 1.0);
    motion.on_end = OnEnd::Hold;
    hand.enqueue(motion).unwrap();
    hand.enqueue(reach(&[0], 0.0)).unwrap();
    run(&mut hand, 80);
    assert!(hand.is_held());
    assert_eq!(hand.set_points()[0], SetPoint::rest(1.0));
    hand.proceed();
    run(&mut hand, 80);
    assert_eq!(hand.set_points()[0], SetPoint::rest(0.0));
}

#[test]
fn what_cannot_run_from_where_joints_are_is_adjusted_or_refused() {
    let mut hand = hand();
    let mut guarded = reach(&[0], 1.2);
    guarded.stop.time = Some(0.1);
    hand.enqueue(guarded).unwrap();
    // Short from 1.2 rad, long from where the guard stops.
    let near = hand
        .enqueue(to(&[0], 1.4, Pace::Duration(0.3), Profile::MinimumJerk))
        .unwrap();
    let back = Motion::new(Pace::Duration(1.0), Profile::Cubic);
    let back = hand
        .enqueue(back.with(0, Target::Relative(-1.7)).unwrap())
        .unwrap();
    let mut limits = Vec::new();
    for _ in 0..100 {
        let before = hand.set_points();
        let after = run(&mut hand, 1)[0];
        limits.push(check(&before, &after));
    }
    limits.into_iter().for_each(Result::unwrap);
    let seen = events(&mut hand);
    let adjusted = Happening::Started { adjusted: true };
    assert!(
        seen.contains(&MotionEvent {
            ticket: near,
            happening: adjusted
        }),
        "{seen:?}"
    );
    assert!(seen.iter().any(|event| event.ticket == back), "{seen:?}");
}

#[test]
fn near_the_end_of_its_range_a_joint_brakes_without_regard_of_jerk() {
    let limits = ProfileLimits {
        jerk: 60.0,
        ..LIMITS
    };
    let mut hand = Hand::new([limits; J], [0.0; J], TICK).unwrap();
    hand.enqueue(to(&[0], 1.5, Pace::Speed(1.0), Profile::Trapezoid))
        .unwrap();
    while hand.set_points()[0].position < 1.3 {
        run(&mut hand, 1);
    }
    assert_eq!(hand.set_points()[0].velocity, 3.0);
    let mut back = slow(&[0], 0.0);
    back.begin = Begin::Now;
    let back = hand.enqueue(back).unwrap();
    while !hand.is_idle() {
        let before = hand.set_points();
        let after = run(&mut hand, 1)[0];
        check(&before, &after).unwrap();
    }
    assert_eq!(hand.set_points()[0], SetPoint::rest(0.0));
    let happening = Happening::Started { adjusted: true };
    let ticket = back;
    assert!(events(&mut hand).contains(&MotionEvent { ticket, happening }));
}

#[test]
fn joints_that_are_held_leave_the_others_in_motion() {
    let mut hand = hand();
    let both = hand.enqueue(slow(&[0, 1], 1.0)).unwrap();
    let one = hand
        .enqueue(Motion {
            begin: Begin::Now,
            ..slow(&[2], 1.0)
        })
        .unwrap();
    let before = run(&mut hand, 20)[19];
    assert!(before[0].velocity > 0.1 && before[2].velocity > 0.1);
    let mut free = hand.clone();
    hand.hold(0b110, &[f64::NAN, 0.25, 0.75, f64::NAN]).unwrap();
    let after = run(&mut hand, 1)[0];
    assert_eq!(after[0], run(&mut free, 1)[0][0]);
    assert_eq!(after[1..3], [SetPoint::rest(0.25), SetPoint::rest(0.75)]);
    assert_eq!(hand.progress(one), None);
    assert!(hand.progress(both).is_some());
    let refused = hand.hold(1, &[f64::NAN; J]).unwrap_err();
    assert_eq!(
        refused.to_string(),
        "joint 0: the starting position, rad, is NaN; it must be finite"
    );
    let last = run(&mut hand, 60)[59];
    assert_eq!(last[0].position, 1.0);
    assert_eq!(last[1], SetPoint::rest(0.25));
    let ended = events(&mut hand);
    let ended = |ticket| {
        ended
            .iter()
            .filter_map(|event| match event.happening {
                Happening::Ended(why) if event.ticket == ticket => Some(why),
                _ => None,
            })
            .collect::<Vec<_>>()
    };
    assert_eq!(ended(one), [MotionEnd::Aborted]);
    assert_eq!(ended(both), [MotionEnd::Reached]);
}

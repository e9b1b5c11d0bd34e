//! The generator, whatever it is asked and whenever: limits, continuity, and a queue too simple to be
//! wrong.

use condor_hand::trajectory::{
    Begin, Guards, Happening, MotionProgress, MotionTicket, Observations, OnEnd, Pace, Profile,
    ProfileLimits, SetPoint, Target, Via,
};
use proptest::prelude::*;

use super::generator::{Hand, J, LIMITS, Motion, TICK, check, hand, run};

#[derive(Clone, Debug)]
enum Step {
    Enqueue(Box<Motion>),
    Pause,
    Resume,
    Abort,
    Proceed,
    Tick(u8, Observations<J>),
}

fn target() -> impl Strategy<Value = Target> {
    prop_oneof![
        (-0.5..1.5).prop_map(Target::Absolute),
        (-1.0..1.0).prop_map(Target::Relative),
    ]
}

fn motion() -> impl Strategy<Value = Motion> {
    let pace = prop_oneof![
        (0.05..1.5).prop_map(Pace::Duration),
        (0.1..1.0).prop_map(Pace::Speed)
    ];
    let profile = prop_oneof![
        Just(Profile::Cubic),
        Just(Profile::MinimumJerk),
        Just(Profile::Trapezoid),
        Just(Profile::JerkLimited)
    ];
    let begin = prop_oneof![
        2 => Just(Begin::After), 2 => Just(Begin::Beside), 3 => Just(Begin::Now)
    ];
    let guards = prop::option::of(0.0..0.6);
    let via = prop::option::weighted(0.2, (0.2..0.8, prop::array::uniform4(-0.5..1.5)));
    let parts = (
        1_u32..16,
        prop::array::uniform4(target()),
        pace,
        profile,
        begin,
    );
    (
        parts,
        0.0..0.4,
        guards,
        prop::option::of(0.1..1.0),
        any::<bool>(),
        via,
    )
        .prop_map(
            |((mask, targets, pace, profile, begin), blend, torque, time, hold, via)| {
                let mut motion = Motion::new(pace, profile);
                motion.mask = mask;
                motion.targets = targets;
                motion.begin = begin;
                motion.blend = blend;
                motion.stop.torque = torque;
                motion.stop.time = time;
                if hold && time.is_some() {
                    motion.on_end = OnEnd::Hold;
                }
                if let Some((at, positions)) = via {
                    motion.profile = Profile::Cubic;
                    motion.vias.push(Via { at, positions }).unwrap();
                }
                motion
            },
        )
}

fn step() -> impl Strategy<Value = Step> {
    let observations = prop::array::uniform4(-0.7..0.7).prop_map(|torques| Observations {
        torques,
        ..Observations::none()
    });
    prop_oneof![
        6 => motion().prop_map(|motion| Step::Enqueue(Box::new(motion))),
        1 => Just(Step::Pause),
        2 => Just(Step::Resume),
        1 => Just(Step::Abort),
        1 => Just(Step::Proceed),
        8 => (1_u8..20, observations).prop_map(|(n, seen)| Step::Tick(n, seen)),
    ]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(400))]

    #[test]
    fn limits_hold_and_nothing_jumps_whatever_is_asked(
        steps in prop::collection::vec(step(), 1..40), jerk in prop_oneof![Just(60.0), Just(800.0)],
    ) {
        let limits = ProfileLimits { jerk, ..LIMITS };
        let mut hand = Hand::new([limits; J], [0.0; J], TICK).unwrap();
        // To a place within the range there is always a way.
        let mut never_refused = Vec::new();
        for step in steps {
            match step {
                Step::Enqueue(motion) => {
                    let always = motion.vias.is_empty()
                        && motion.targets.iter().all(|t| matches!(t, Target::Absolute(_)));
                    if let (Ok(ticket), true) = (hand.enqueue(*motion), always) {
                        never_refused.push(ticket);
                    }
                }
                Step::Pause => hand.pause(),
                Step::Resume => hand.resume(),
                Step::Abort => hand.abort(),
                Step::Proceed => hand.proceed(),
                Step::Tick(ticks, seen) => {
                    for _ in 0..ticks {
                        let before = hand.set_points();
                        let after = hand.tick(&seen);
                        check(&before, &after)?;
                    }
                }
            }
            while let Some(event) = hand.take_event() {
                let refused = matches!(event.happening, Happening::Refused(_));
                prop_assert!(!(refused && never_refused.contains(&event.ticket)), "{event:?}");
            }
        }
    }

    #[test]
    fn what_is_accepted_from_rest_runs_as_it_is(motion in motion()) {
        let mut hand = hand();
        let mut motion = motion;
        motion.stop = Guards::none();
        if hand.enqueue(motion).is_ok() {
            hand.tick(&Observations::none());
            let started = Happening::Started { adjusted: false };
            prop_assert_eq!(hand.take_event().unwrap().happening, started);
        }
    }

    #[test]
    fn an_abort_at_any_time_stops(ticks in 0_usize..50, motions in prop::collection::vec(motion(), 1..4)) {
        let mut hand = hand();
        for motion in motions {
            let _ = hand.enqueue(motion);
        }
        run(&mut hand, ticks);
        hand.abort();
        let mut left = 0;
        while !hand.is_idle() {
            let before = hand.set_points();
            let after = hand.tick(&Observations::none());
            check(&before, &after)?;
            left += 1;
            prop_assert!(left < 100);
        }
        for point in hand.tick(&Observations::none()) {
            prop_assert_eq!(point, SetPoint::rest(point.position));
        }
    }

    #[test]
    fn arbitrary_numbers_give_errors_or_finite_set_points(
        x in any::<[f64; J]>(), pace in any::<f64>(), speed in any::<bool>(),
        blend in any::<f64>(), guard in any::<Option<f64>>(), mask in any::<u32>(),
        relative in any::<bool>(), torque in any::<f64>(),
    ) {
        let mut hand = hand();
        for profile in [Profile::Cubic, Profile::MinimumJerk, Profile::Trapezoid, Profile::JerkLimited] {
            for mask in [mask, mask & 0xf] {
                let pace = if speed { Pace::Speed(pace) } else { Pace::Duration(pace) };
                let mut motion = Motion::new(pace, profile);
                motion.mask = mask;
                motion.targets = x.map(|x| if relative { Target::Relative(x) } else { Target::Absolute(x) });
                motion.blend = blend;
                motion.stop.torque = guard;
                let _ = hand.enqueue(motion);
            }
        }
        let mut seen = Observations::none();
        seen.torques = [torque; J];
        for _ in 0..20 {
            let before = hand.set_points();
            let after = hand.tick(&seen);
            check(&before, &after)?;
        }
    }

    /// Motions of one duration, so that a list of their remaining ticks is all there is to know.
    #[test]
    fn the_queue_runs_as_a_naive_one_does(
        calls in prop::collection::vec((prop::option::of((1_u32..16, 0_u8..3)), 0_usize..15), 1..25),
    ) {
        const TICKS: usize = 10;
        let mut hand = hand();
        let mut next = 0;
        let mut queue: Vec<(u32, u32, Begin)> = Vec::new();
        let mut running: Vec<(u32, u32, usize)> = Vec::new();
        for (call, ticks) in calls {
            if let Some((mask, begin)) = call {
                let begin = [Begin::After, Begin::Beside, Begin::Now][usize::from(begin)];
                let mut motion = Motion::new(Pace::Duration(0.199), Profile::MinimumJerk);
                motion.mask = mask;
                motion.begin = begin;
                let full = queue.len() == 4;
                match hand.enqueue(motion) {
                    Ok(ticket) => {
                        prop_assert!(!full);
                        prop_assert_eq!(ticket, MotionTicket(next));
                        queue.push((next, mask, begin));
                        next += 1;
                    }
                    Err(error) => prop_assert!(full, "{error}"),
                }
            }
            for _ in 0..ticks {
                hand.tick(&Observations::none());
                while let Some(&(ticket, mask, begin)) = queue.first() {
                    let waits = match begin {
                        Begin::After => !running.is_empty(),
                        Begin::Beside => running.iter().any(|r| r.1 & mask != 0),
                        Begin::Now => false,
                    };
                    if waits {
                        break;
                    }
                    queue.remove(0);
                    for other in &mut running {
                        other.1 &= !mask;
                    }
                    running.retain(|r| r.1 != 0);
                    running.push((ticket, mask, TICKS));
                }
                for one in &mut running {
                    one.2 -= 1;
                }
                running.retain(|r| r.2 > 0);
                for ticket in 0..next {
                    let expected = queue.iter().position(|q| q.0 == ticket);
                    let runs = running.iter().any(|r| r.0 == ticket);
                    match hand.progress(MotionTicket(ticket)) {
                        Some(MotionProgress::Queued { before }) => prop_assert_eq!(Some(before), expected),
                        Some(MotionProgress::Running { .. }) => prop_assert!(runs),
                        None => prop_assert!(!runs && expected.is_none()),
                    }
                }
            }
        }
    }
}

//! Streams of points: whatever comes and whenever, the set-points stay within the limits.

use condor_hand::trajectory::{
    Bounds, JointStream, JointStreamError, ProfileLimits, Segments, SetPoint, StreamEnd,
    StreamPoint,
};
use proptest::prelude::*;

const TICK: f64 = 0.02;
const LIMITS: ProfileLimits = ProfileLimits {
    low: -1.0,
    high: 0.5,
    velocity: 3.0,
    acceleration: 40.0,
    jerk: 1000.0,
};
const START: f64 = 0.1;

type Stream = JointStream<2, 4>;

fn stream() -> Stream {
    Stream::new(0b01, [LIMITS; 2], [START, 0.3], TICK, 10).unwrap()
}

/// A point of the first joint; the other one is not in the mask.
fn point(time: f64, position: f64, velocity: f64) -> StreamPoint<2> {
    StreamPoint {
        time,
        positions: [position, 99.0],
        velocities: [velocity, f64::NAN],
    }
}

/// Checks a tick against the one before it.
fn check(before: &SetPoint, now: &SetPoint) {
    // More than the tolerance of the checks.
    let close = 1e-6;
    assert!(
        now.position >= LIMITS.low - close && now.position <= LIMITS.high + close,
        "{now:?}"
    );
    assert!(now.velocity.abs() <= LIMITS.velocity + close, "{now:?}");
    assert!(
        now.acceleration.abs() <= LIMITS.acceleration + close,
        "{now:?}"
    );
    let change = (now.velocity - before.velocity).abs();
    assert!(
        change <= LIMITS.acceleration * TICK + close,
        "{before:?}, {now:?}"
    );
    // Between two velocities that differ by no more, no position is farther off.
    let mean = (before.velocity + now.velocity) * 0.5 * TICK;
    let off = (now.position - before.position - mean).abs();
    assert!(
        off <= LIMITS.acceleration * TICK * TICK * 0.25 + close,
        "{before:?}, {now:?}"
    );
}

#[derive(Clone, Debug)]
enum Step {
    Ticks(u8),
    /// So much after the last point: time, position, velocity; and the sequence number off by some.
    Push(Vec<(f64, f64, f64)>, bool, u32),
    Abort,
}

fn steps() -> impl Strategy<Value = Vec<Step>> {
    let near = (0.005..0.3_f64, -0.2..0.2_f64, -2.0..2.0_f64);
    let far = (-0.1..0.5_f64, -2.0..2.0_f64, -9.0..9.0_f64);
    let point = prop_oneof![8 => near, 1 => far];
    let points = prop::collection::vec(point, 0..4);
    let off = prop_oneof![6 => Just(0_u32), 1 => 0..3_u32];
    let step = prop_oneof![
        6 => (0..9_u8).prop_map(Step::Ticks),
        8 => (points, prop::bool::weighted(0.05), off)
            .prop_map(|(points, is_last, off)| Step::Push(points, is_last, off)),
        1 => Just(Step::Abort),
    ];
    prop::collection::vec(step, 1..60)
}

proptest! {
    #[test]
    fn the_set_points_are_within_the_limits_and_do_not_jump(steps in steps()) {
        let mut stream = stream();
        let mut state = stream.set_points();
        let (mut next, mut last, mut taken) = (0, (0.0, START), Vec::new());
        let mut tick = |stream: &mut Stream, taken: &mut Vec<StreamPoint<2>>| {
            let now = stream.tick();
            check(&state[0], &now[0]);
            assert_eq!(now[1], SetPoint::rest(0.3), "beyond the mask");
            state = now;
            if stream.end().is_some() {
                assert_eq!((now[0].velocity, now[0].acceleration), (0.0, 0.0));
            }
            if stream.end() == Some(StreamEnd::Done) {
                let at = taken.last().map_or(START, |it| it.positions[0]);
                assert!((now[0].position - at).abs() < 1e-9, "{now:?}");
            }
        };
        for step in steps {
            match step {
                Step::Ticks(count) => (0..count).for_each(|_| tick(&mut stream, &mut taken)),
                Step::Push(points, is_last, off) => {
                    let mut at = last;
                    let points: Vec<_> = points.iter().map(|&(time, by, velocity)| {
                        at = (at.0 + time, at.1 + by);
                        point(at.0, at.1, velocity)
                    }).collect();
                    let sequence = next + off;
                    let pushed = stream.push(sequence, &points, is_last);
                    match pushed {
                        Ok(()) => {
                            assert_eq!(sequence, next);
                            next += 1;
                            last = at;
                            taken.extend(points);
                            // Again: nothing changes.
                            let until = stream.until();
                            assert_eq!(stream.push(sequence, &[point(0.0, 9.0, 9.0)], true), Ok(()));
                            assert_eq!(stream.until(), until);
                        }
                        Err(_) => assert_eq!(stream.until(), last.0),
                    }
                }
                Step::Abort => stream.abort(),
            }
        }
        for _ in 0..200 {
            tick(&mut stream, &mut taken);
        }
        assert!(stream.end().is_some());
    }
}

#[test]
fn a_stream_goes_through_its_points_and_ends_at_the_last() {
    let mut stream = stream();
    let wave = |time: f64| {
        let angle = 5.0 * time;
        point(time, START + 0.2 * (1.0 - angle.cos()), angle.sin())
    };
    let end = core::f64::consts::TAU / 5.0;
    let mut times: Vec<f64> = (1..20).map(|tick| f64::from(tick) * 3.0 * TICK).collect();
    times.push(end);
    let mut sent = 0;
    let mut worst = 0.0_f64;
    for tick in 1..80 {
        while let Some(&time) = times.get(sent) {
            let at = wave(time);
            let is_last = sent + 1 == times.len();
            let at = if is_last { point(end, START, 0.0) } else { at };
            match stream.push(sent as u32, &[at], is_last) {
                Ok(()) => sent += 1,
                Err(JointStreamError::Full { until }) => {
                    assert_eq!(until, times[sent - 1]);
                    break;
                }
                Err(error) => panic!("{error}"),
            }
        }
        let time = (f64::from(tick) * TICK).min(end);
        let is = stream.tick()[0].position;
        worst = worst.max((is - wave(time).positions[0]).abs());
    }
    assert_eq!((stream.end(), sent), (Some(StreamEnd::Done), 20));
    assert!(worst < 1e-4, "{worst} rad");
}

#[test]
fn without_points_it_brakes_as_fast_as_it_can() {
    let mut stream = stream();
    stream.push(0, &[point(0.2, 0.2, 1.0)], false).unwrap();
    let mut ticks = 0;
    while stream.end().is_none() {
        stream.tick();
        ticks += 1;
    }
    assert_eq!(stream.end(), Some(StreamEnd::Starved));
    // 1 rad/s, 40 rad/s²: 25 ms and 12.5 mrad.
    assert_eq!(ticks, 12);
    assert!((stream.set_points()[0].position - 0.2125).abs() < 1e-12);
    assert_eq!(
        stream.push(1, &[point(0.4, 0.2, 0.0)], true),
        Err(JointStreamError::Ended)
    );
    // Nobody has ever sent anything.
    let mut stream = Stream::new(1, [LIMITS; 2], [START, 0.3], TICK, 3).unwrap();
    for _ in 0..3 {
        assert_eq!(stream.end(), None);
        stream.tick();
    }
    assert_eq!(stream.end(), Some(StreamEnd::Starved));
}

#[test]
fn what_no_joint_can_do_is_refused_with_its_name() {
    let mut stream = stream();
    for (batch, why) in [
        (
            point(0.1, 0.6, 0.0),
            "joint 0 at 0.1 s: the position, rad, is 0.6; it must be at most 0.5",
        ),
        (
            point(0.5, 0.49, 2.0),
            "joint 0 at 0.5 s: the position after braking, rad, is 0.54; it must be at most 0.5",
        ),
        (
            point(0.5, 0.2, -3.5),
            "joint 0 at 0.5 s: the speed, rad/s, is 3.5; it must be at most 3",
        ),
        (
            point(0.1, 0.0, 0.0),
            "joint 0 at 0.1 s: the acceleration, rad/s², is 60; it must be at most 40",
        ),
        (
            point(-0.1, 0.1, 0.0),
            "a point at -0.1 s is not after the point before it, or the start, at 0 s",
        ),
        (
            point(0.0, 0.2, 0.0),
            "joint 0 at 0 s: the position at the time of the point before, rad, is 0.2; it must be at most 0.1",
        ),
    ] {
        // The good one before it does not come either.
        let error = stream.push(0, &[batch], false).unwrap_err();
        assert!(error.to_string().starts_with(&why[..20]), "{error}");
        assert_eq!(error.to_string(), why);
        assert_eq!(stream.until(), 0.0);
    }
    let error = stream.push(1, &[], false).unwrap_err();
    assert_eq!(
        error.to_string(),
        "batch 1 has come, but batch 0 must come first"
    );
    let error = stream.push(0, &[point(0.5, 0.2, 0.1)], true).unwrap_err();
    assert_eq!(
        error.to_string(),
        "joint 0 at 0.5 s: the speed at the end, rad/s, is 0.1; it must be at most 0"
    );
}

/// The points of a stream of one joint, which may be at `acceleration`, in rad/s².
fn pushed(
    acceleration: f64,
    points: &[(f64, f64, f64)],
    is_last: bool,
) -> Result<(), JointStreamError> {
    let limits = ProfileLimits {
        low: -2.0,
        high: 2.0,
        velocity: 1.0,
        acceleration,
        jerk: 1e6,
    };
    let mut stream = JointStream::<1, 512>::new(1, [limits], [0.0], TICK, 10).unwrap();
    let points: Vec<_> = points
        .iter()
        .map(|&(time, position, velocity)| StreamPoint {
            time,
            positions: [position],
            velocities: [velocity],
        })
        .collect();
    stream.push(0, &points, is_last)
}

#[test]
fn a_stream_at_its_limits_is_taken() {
    let points = [(0.02, 0.002, 0.2), (0.04, 0.008, 0.4)];
    assert_eq!(pushed(10.0, &points, false), Ok(()));
    // At the limit of the acceleration, with points every 1 to 30 ms.
    for period in 1..=30 {
        let period = 1e-3 * f64::from(period);
        let points: Vec<_> = (1..=3)
            .map(|number| {
                let time = period * f64::from(number);
                (time, 5.0 * time * time, 10.0 * time)
            })
            .collect();
        assert_eq!(pushed(10.0, &points, false), Ok(()), "{period} s");
    }
    // At the limit of the velocity: to it in a time, then on.
    for rise in 1..=18 {
        let rise = 0.1 + 0.01 * f64::from(rise);
        let points: Vec<_> = (0..=9)
            .map(|number| {
                let time = 0.03 * f64::from(number);
                (rise + time, 0.5 * rise + time, 1.0)
            })
            .collect();
        assert_eq!(pushed(10.0, &points, false), Ok(()), "{rise} s");
    }
    // A trapezoid whose parts take whole ticks: 0.1, 0.3 and 0.1 s.
    for period in [0.001, 0.002, 0.005, 0.02] {
        let bounds = Bounds {
            velocity: 1.0,
            acceleration: 10.0,
            jerk: None,
        };
        let trapezoid = Segments::fastest(&SetPoint::rest(0.0), 0.4, &bounds).unwrap();
        let times = (1..).map(|tick| period * f64::from(tick));
        let points: Vec<_> = times
            .take_while(|time| *time < trapezoid.duration() + 0.5 * period)
            .map(|time| {
                let at = trapezoid.at(time);
                (time, at.position, at.velocity)
            })
            .collect();
        assert_eq!(pushed(10.0, &points, true), Ok(()), "{period} s");
    }
    // A millionth more is refused, and shown.
    let beyond = (0.02, 0.002 * (1.0 + 1e-6), 0.2 * (1.0 + 1e-6));
    assert_eq!(
        pushed(10.0, &[beyond], false).unwrap_err().to_string(),
        "joint 0 at 0.02 s: the acceleration, rad/s², is 10.00001; it must be at most 10"
    );
}

/// Every limit that a stream can reach: points that reach it with a factor of 1, and what is told of a greater one.
#[test]
fn every_limit_may_be_rounded_and_no_more() {
    type Points = fn(factor: f64) -> Vec<(f64, f64, f64)>;
    let cases: [(Points, &str); 8] = [
        (
            |factor| vec![(4.0, 2.0 * factor, 0.0)],
            "the position, rad,",
        ),
        (
            |factor| vec![(4.0, -2.0 * factor, 0.0)],
            "the position, rad,",
        ),
        (|factor| vec![(0.2, 0.1, factor)], "the speed, rad/s,"),
        // It comes to rest 0.05 rad after the point.
        (
            |factor| vec![(0.2, 0.1, 1.0), (2.05, 2.0 * factor - 0.05, 1.0)],
            "the position after braking, rad,",
        ),
        (
            |factor| vec![(0.2, -0.1, -1.0), (2.05, 0.05 - 2.0 * factor, -1.0)],
            "the position after braking, rad,",
        ),
        // There and back between two points, 0.04 rad further.
        (
            |factor| {
                let turn = 2.0 * factor - 0.04;
                vec![(3.0, 1.5, 0.0), (4.0, turn, 0.8), (4.2, turn, -0.8)]
            },
            "the greatest position on the way, rad,",
        ),
        (
            |factor| {
                let turn = 0.04 - 2.0 * factor;
                vec![(3.0, -1.5, 0.0), (4.0, turn, -0.8), (4.2, turn, 0.8)]
            },
            "the least position on the way, rad,",
        ),
        // The speed in the middle is 3/2 of the mean one.
        (
            |factor| vec![(0.6, 0.4 * factor, 0.0)],
            "the speed on the way, rad/s,",
        ),
    ];
    for (points, what) in cases {
        assert_eq!(pushed(10.0, &points(1.0), false), Ok(()), "{what}");
        assert_eq!(pushed(10.0, &points(1.0 + 1e-10), false), Ok(()), "{what}");
        let refused = pushed(10.0, &points(1.0 + 1e-6), false).unwrap_err();
        assert!(refused.to_string().contains(what), "{what}: {refused}");
    }
}

#[test]
fn a_stream_that_all_but_rests_ends() {
    let points = [(0.1, 0.01, 0.1), (0.2, 0.02, 1e-17)];
    assert_eq!(pushed(10.0, &points, true), Ok(()));
}

#[test]
fn a_point_may_be_repeated() {
    let mut stream = stream();
    // Where the joint is, as the first point.
    let first = [point(0.0, START, 0.0), point(0.2, 0.15, 0.5)];
    assert_eq!(stream.push(0, &first, false), Ok(()));
    assert_eq!(stream.until(), 0.2);
    // Rounding changes neither.
    let rounded = point(0.2 - 1e-11, 0.15 + 1e-10, 0.5 - 1e-10);
    assert_eq!(stream.clone().push(1, &[rounded], false), Ok(()));
    let wrong = stream.push(1, &[point(0.2, 0.15, 0.4)], false);
    assert_eq!(
        wrong.unwrap_err().to_string(),
        "joint 0 at 0.2 s: the velocity at the time of the point before, rad/s, is 0.4; it must be at \
         least 0.5"
    );
    // The last point of the former batch, then as many as there is room for.
    let second = [
        first[1],
        point(0.3, 0.2, 0.5),
        point(0.4, 0.25, 0.5),
        point(0.6, 0.3, 0.0),
    ];
    assert_eq!(stream.push(1, &second, true), Ok(()));
    while stream.end().is_none() {
        stream.tick();
    }
    assert_eq!(stream.end(), Some(StreamEnd::Done));
    assert_eq!(stream.set_points()[0], SetPoint::rest(0.3));
}

//! Boundaries, continuity and extremes of the profiles, for whatever they are asked.

use condor_hand::trajectory::{Bounds, Polynomial, Segments, SetPoint, Spline};
use condor_hand::{NumberError, Requirement, Subject};
use proptest::prelude::*;

fn state(x: f64, v: f64, a: f64) -> SetPoint {
    SetPoint {
        position: x,
        velocity: v,
        acceleration: a,
    }
}

fn states(v: f64, a: f64) -> impl Strategy<Value = SetPoint> {
    (-2.0..2.0, -v..v, -a..a).prop_map(|(x, v, a)| state(x, v, a))
}

fn bounds() -> impl Strategy<Value = Bounds> {
    let jerk = prop_oneof![Just(None), (5.0..500.0).prop_map(Some)];
    (0.1..5.0, 0.5..40.0, jerk).prop_map(|(velocity, acceleration, jerk)| Bounds {
        velocity,
        acceleration,
        jerk,
    })
}

/// A start within bounds, as parts of them.
fn moving() -> impl Strategy<Value = (Bounds, SetPoint, f64)> {
    let rest = prop_oneof![Just(0.0), -1.0..1.0];
    (bounds(), -2.0..2.0, -1.0..1.0, rest, -2.0..2.0).prop_map(|(bounds, x, v, a, end)| {
        let start = state(x, v * bounds.velocity, a * bounds.acceleration);
        (bounds, start, end)
    })
}

const SAMPLES: u32 = 400;

/// The greatest of what a profile does at many times, which its peaks must cover and nearly be.
fn check_peaks(
    duration: f64,
    at: impl Fn(f64) -> SetPoint,
    peaks: condor_hand::trajectory::ProfilePeaks,
    close: bool,
) -> Result<(), TestCaseError> {
    let mut seen = [f64::INFINITY, f64::NEG_INFINITY, 0.0, 0.0];
    for sample in 0..=SAMPLES {
        let point = at(duration * f64::from(sample) / f64::from(SAMPLES));
        seen[0] = seen[0].min(point.position);
        seen[1] = seen[1].max(point.position);
        seen[2] = seen[2].max(point.velocity.abs());
        seen[3] = seen[3].max(point.acceleration.abs());
    }
    let scale = |x: f64| 1e-9 * x.abs().max(1.0);
    prop_assert!(peaks.low <= seen[0] + scale(seen[0]), "{peaks:?} {seen:?}");
    prop_assert!(peaks.high >= seen[1] - scale(seen[1]), "{peaks:?} {seen:?}");
    prop_assert!(
        peaks.velocity >= seen[2] - scale(seen[2]),
        "{peaks:?} {seen:?}"
    );
    prop_assert!(
        peaks.acceleration >= seen[3] - scale(seen[3]),
        "{peaks:?} {seen:?}"
    );
    if close {
        let near = |peak: f64, seen: f64| (peak - seen).abs() <= 2e-3 * (1.0 + peak.abs());
        prop_assert!(near(peaks.low, seen[0]), "{peaks:?} {seen:?}");
        prop_assert!(near(peaks.high, seen[1]), "{peaks:?} {seen:?}");
        prop_assert!(near(peaks.velocity, seen[2]), "{peaks:?} {seen:?}");
        prop_assert!(near(peaks.acceleration, seen[3]), "{peaks:?} {seen:?}");
    }
    Ok(())
}

fn near(a: f64, b: f64, tolerance: f64) -> bool {
    (a - b).abs() <= tolerance * (1.0 + b.abs())
}

proptest! {
    #[test]
    fn polynomials_meet_their_ends(
        start in states(3.0, 20.0), end in states(3.0, 20.0), duration in 0.05..5.0,
    ) {
        let quintic = Polynomial::quintic(&start, &end, duration).unwrap();
        let cubic = Polynomial::cubic(&start, &end, duration).unwrap();
        for (t, wanted) in [(0.0, start), (duration, end), (-1.0, start), (duration + 1.0, end)] {
            for point in [quintic.at(t), cubic.at(t)] {
                prop_assert!(near(point.position, wanted.position, 1e-11));
                prop_assert!(near(point.velocity, wanted.velocity, 1e-9));
            }
            prop_assert!(near(quintic.at(t).acceleration, wanted.acceleration, 1e-8));
        }
        check_peaks(duration, |t| quintic.at(t), quintic.peaks(), true)?;
        check_peaks(duration, |t| cubic.at(t), cubic.peaks(), true)?;
    }

    #[test]
    fn splines_pass_their_knots_smoothly(
        steps in prop::collection::vec((0.05..1.0, -2.0..2.0), 1..18),
        start in -2.0..2.0, rates in (-3.0..3.0, -3.0..3.0),
    ) {
        let (mut times, mut positions) = (vec![0.0], vec![start]);
        for (interval, position) in steps {
            times.push(times.last().unwrap() + interval);
            positions.push(position);
        }
        let spline = Spline::<18>::clamped(&times, &positions, rates).unwrap();
        let last = *times.last().unwrap();
        prop_assert!(near(spline.at(0.0).velocity, rates.0, 1e-9));
        prop_assert!(near(spline.at(last).velocity, rates.1, 1e-9));
        for (&t, &x) in times.iter().zip(&positions) {
            prop_assert!(near(spline.at(t).position, x, 1e-11));
        }
        for &t in &times[1..times.len() - 1] {
            let (before, after) = (spline.at(t - 1e-9), spline.at(t));
            prop_assert!(near(before.velocity, after.velocity, 1e-4));
            prop_assert!(near(before.acceleration, after.acceleration, 1e-3));
        }
        check_peaks(last, |t| spline.at(t), spline.peaks(), false)?;
    }

    #[test]
    fn segments_keep_their_bounds((bounds, start, end) in moving(), longer in 1.0..4.0) {
        let fastest = Segments::fastest(&start, end, &bounds).unwrap();
        let mut all = vec![fastest];
        let lasting = Segments::lasting(&start, end, &bounds, fastest.duration() * longer);
        match lasting {
            Ok(Some(lasting)) => {
                prop_assert!(near(lasting.duration(), fastest.duration() * longer, 1e-7));
                all.push(lasting);
            }
            Ok(None) => prop_assert!(start.velocity != 0.0),
            Err(other) => prop_assert!(false, "{other}"),
        }
        for segments in all {
            let duration = segments.duration();
            let first = segments.at(0.0);
            prop_assert!(near(first.position, start.position, 1e-12));
            prop_assert!(near(first.velocity, start.velocity, 1e-12));
            let peaks = segments.peaks();
            prop_assert!(peaks.velocity <= bounds.velocity * (1.0 + 1e-12), "{peaks:?}");
            prop_assert!(peaks.acceleration <= bounds.acceleration * (1.0 + 1e-12), "{peaks:?}");
            check_peaks(duration, |t| segments.at(t), peaks, false)?;
            prop_assert_eq!(segments.at(duration), SetPoint::rest(end));
            let step = duration / f64::from(SAMPLES);
            for sample in 0..SAMPLES {
                let here = segments.at(f64::from(sample) * step);
                let next = segments.at(f64::from(sample + 1) * step);
                let way = (here.velocity + next.velocity) * 0.5 * step;
                let bend = bounds.acceleration * step * step;
                prop_assert!((next.position - here.position - way).abs() <= bend + 1e-9);
                let change = next.velocity - here.velocity;
                prop_assert!(change.abs() <= bounds.acceleration * step * (1.0 + 1e-9) + 1e-8);
                if let Some(jerk) = bounds.jerk {
                    let change = next.acceleration - here.acceleration;
                    prop_assert!(change.abs() <= jerk * step * (1.0 + 1e-6) + 1e-5, "{change}");
                }
            }
        }
    }

    #[test]
    fn no_other_velocity_is_faster((bounds, start, end) in moving(), part in 0.01..1.0) {
        let fastest = Segments::fastest(&start, end, &bounds).unwrap();
        let slower = Bounds { velocity: bounds.velocity * part, ..bounds };
        // From rest only: a moving start may exceed the lower bound.
        if start.velocity.abs() <= slower.velocity && start.acceleration == 0.0 {
            let slower = Segments::fastest(&start, end, &slower).unwrap();
            prop_assert!(fastest.duration() <= slower.duration() + 1e-9);
        }
    }

    #[test]
    fn nothing_that_is_made_is_not_finite(
        x in any::<f64>(), v in any::<f64>(), a in any::<f64>(), end in any::<f64>(),
        duration in any::<f64>(), limits in any::<[f64; 3]>(), at in 0.0..1.0,
    ) {
        let start = state(x, v, a);
        let finite = |point: SetPoint| {
            point.position.is_finite() && point.velocity.is_finite() && point.acceleration.is_finite()
        };
        for made in [
            Polynomial::quintic(&start, &SetPoint::rest(end), duration),
            Polynomial::cubic(&start, &SetPoint::rest(end), duration),
        ].into_iter().flatten() {
            prop_assert!(finite(made.at(duration * at)));
        }
        for jerk in [None, Some(limits[2])] {
            let bounds = Bounds { velocity: limits[0], acceleration: limits[1], jerk };
            if let Ok(made) = Segments::fastest(&start, end, &bounds) {
                prop_assert!(finite(made.at(made.duration() * at)));
            }
            if let Ok(Some(made)) = Segments::lasting(&start, end, &bounds, duration) {
                prop_assert!(finite(made.at(made.duration() * at)));
            }
        }
    }
}

#[test]
fn trapezoids_that_arrive_together_have_the_velocity_of_the_closed_form() {
    let bounds = Bounds {
        velocity: 3.0,
        acceleration: 20.0,
        jerk: None,
    };
    let (dx, t) = (0.3_f64, 0.5_f64);
    let slow = Segments::lasting(&SetPoint::rest(1.0), 1.0 + dx, &bounds, t);
    let slow = slow.unwrap().unwrap();
    let v = (20.0 * t - (400.0 * t * t - 80.0 * dx).sqrt()) / 2.0;
    assert!((slow.peaks().velocity - v).abs() < 1e-12);
    assert!((slow.duration() - t).abs() < 1e-12);
    let error = Segments::lasting(&SetPoint::rest(1.0), 1.0 + dx, &bounds, 0.1).unwrap_err();
    let least = 2.0 * (dx / 20.0_f64).sqrt();
    assert!(
        matches!(error.must, Requirement::AtLeast(l) if (l - least).abs() < 1e-12),
        "{error}"
    );
}

#[test]
fn bad_knots_are_named() {
    let spline = |t: &[f64], x: &[f64]| Spline::<4>::clamped(t, x, (0.0, 0.0)).unwrap_err();
    assert_eq!(
        spline(&[0.0, 1.0, 1.0], &[0.0; 3]),
        NumberError {
            at: Subject::Knot(2),
            what: "the time, s,",
            value: 1.0,
            must: Requirement::Above(1.0)
        }
    );
    let count = Requirement::Within(2.0, 4.0);
    assert_eq!(spline(&[0.0], &[0.0]).must, count);
    assert_eq!(spline(&[0.0, 1.0, 2.0, 3.0, 4.0], &[0.0; 5]).must, count);
    assert_eq!(spline(&[0.0, 1.0], &[0.0; 3]).must, Requirement::Equal(3.0));
}

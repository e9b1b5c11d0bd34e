//! Against `SciPy`'s splines and Ruckig's durations.

use condor_hand::trajectory::{Bounds, Polynomial, Segments, SetPoint, Spline};
use serde_json::Value;

const REFERENCE: &str = include_str!("../../reference/trajectory.json");

fn cases(kind: &str) -> Vec<Value> {
    let file: Value = serde_json::from_str(REFERENCE).unwrap();
    let all = file["cases"].as_array().unwrap();
    let kinds = ["poly", "ruckig"];
    assert!(
        all.iter()
            .all(|case| kinds.contains(&case["kind"].as_str().unwrap()))
    );
    let chosen: Vec<_> = all
        .iter()
        .filter(|case| case["kind"] == kind)
        .cloned()
        .collect();
    assert!(!chosen.is_empty());
    chosen
}

fn number(value: &Value) -> f64 {
    value.as_f64().unwrap()
}

fn numbers(value: &Value) -> Vec<f64> {
    value.as_array().unwrap().iter().map(number).collect()
}

type Column = fn(SetPoint) -> f64;

/// Errors are relative to the greatest value of the column: derivatives of a spline reach hundreds.
fn compare(name: &str, times: &[f64], expected: &Value, at: impl Fn(f64) -> SetPoint) {
    let columns: [(&str, Column); 3] = [
        ("x", |point| point.position),
        ("v", |point| point.velocity),
        ("a", |point| point.acceleration),
    ];
    for (column, get) in columns {
        let values = numbers(&expected[column]);
        assert_eq!(values.len(), times.len());
        let scale = values.iter().fold(1.0, |s: f64, v| s.max(v.abs()));
        for (&t, value) in times.iter().zip(&values) {
            let got = get(at(t));
            let error = (got - value).abs() / scale;
            assert!(error < 1e-12, "{name}.{column} at {t}: {got}, not {value}");
        }
    }
}

#[test]
fn polynomials_agree_with_scipy() {
    for case in cases("poly") {
        let state = |end: &str| SetPoint {
            position: number(&case[format!("x{end}")]),
            velocity: number(&case[format!("v{end}")]),
            acceleration: number(&case[format!("a{end}")]),
        };
        let (start, end) = (state("0"), state("1"));
        let duration = number(&case["T"]);
        let times = numbers(&case["t"]);
        let cubic = Polynomial::cubic(&start, &end, duration).unwrap();
        compare("cubic", &times, &case["cubic"], |t| cubic.at(t));
        let quintic = Polynomial::quintic(&start, &end, duration).unwrap();
        compare("quintic", &times, &case["quintic"], |t| quintic.at(t));
        let reach = Polynomial::minimum_jerk(start.position, end.position, duration).unwrap();
        compare("minjerk", &times, &case["minjerk"], |t| reach.at(t));

        let dx = (end.position - start.position).abs();
        let peaks = reach.peaks();
        assert!((peaks.velocity - 1.875 * dx / duration).abs() < 1e-12 * peaks.velocity);
        let acceleration = 10.0 / 3.0_f64.sqrt() * dx / (duration * duration);
        assert!((peaks.acceleration - acceleration).abs() < 1e-12 * acceleration);
    }
}

#[test]
fn splines_agree_with_scipy() {
    for case in cases("poly") {
        let expected = &case["spline"];
        let times = numbers(&expected["knots_t"]);
        let positions = numbers(&expected["knots_x"]);
        let spline = Spline::<18>::clamped(&times, &positions, (0.0, 0.0)).unwrap();
        compare("spline", &numbers(&expected["t"]), expected, |t| {
            spline.at(t)
        });
    }
}

#[test]
fn trapezoids_take_the_least_time() {
    for case in cases("poly") {
        let expected = &case["trapezoid"];
        let bounds = Bounds {
            velocity: number(&expected["vmax"]),
            acceleration: number(&expected["amax"]),
            jerk: None,
        };
        let start = SetPoint::rest(number(&case["x0"]));
        let segments = Segments::fastest(&start, number(&case["x1"]), &bounds).unwrap();
        let duration = number(&expected["T"]);
        assert!((segments.duration() - duration).abs() < 1e-12 * duration.max(1.0));
    }
}

#[test]
fn jerk_limited_motions_take_ruckigs_time() {
    for case in cases("ruckig") {
        let bounds = Bounds {
            velocity: number(&case["vmax"]),
            acceleration: number(&case["amax"]),
            jerk: Some(number(&case["jmax"])),
        };
        let starts = numbers(&case["p0"]);
        let ends = numbers(&case["p1"]);
        let speeds = numbers(&case["v0"]);
        let least = numbers(&case["independent_min"]);
        let together = number(&case["duration"]);
        let mut longest = 0.0_f64;
        for joint in 0..starts.len() {
            let start = SetPoint {
                position: starts[joint],
                velocity: speeds[joint],
                acceleration: 0.0,
            };
            let fastest = Segments::fastest(&start, ends[joint], &bounds).unwrap();
            let (got, expected) = (fastest.duration(), least[joint]);
            assert!((got - expected).abs() < 1e-9, "{got}, Ruckig {expected}");
            longest = longest.max(got);

            let slowed = Segments::lasting(&start, ends[joint], &bounds, together);
            let slowed = slowed.unwrap().unwrap();
            assert!((slowed.duration() - together).abs() < 1e-9, "joint {joint}");
        }
        assert!(
            (longest - together).abs() < 1e-9,
            "{longest}, Ruckig {together}"
        );
    }
}

//! Between ticks, without them, and when they come again.

use condor_hand::trajectory::{
    Bounds, Generator, Interpolator, Observations, Pace, Primitive, Profile, ProfileLimits,
    SetPoint, Target,
};
use condor_hand::{NumberError, Subject};
use proptest::prelude::*;

const TICK: f64 = 0.02;
const BOUNDS: Bounds = Bounds {
    velocity: 2.0,
    acceleration: 50.0,
    jerk: None,
};

fn interpolator(substeps: u16) -> Interpolator<1> {
    Interpolator::new(substeps, TICK, [0.0], [BOUNDS]).unwrap()
}

fn steps(servo: &mut Interpolator<1>, steps: u16) {
    for _ in 0..steps {
        servo.step();
    }
}

fn generator() -> Generator<1, 4> {
    let limits = ProfileLimits {
        low: -1.0,
        high: 1.0,
        velocity: 3.0,
        acceleration: 40.0,
        jerk: 800.0,
    };
    Generator::new([limits], [0.0], TICK).unwrap()
}

fn motion() -> Primitive<1> {
    Primitive::new(Pace::Speed(0.9), Profile::MinimumJerk)
        .with(0, Target::Absolute(1.0))
        .unwrap()
}

#[test]
fn ticks_in_time_are_met_and_the_way_between_is_the_hermite_polynomial() {
    for substeps in [1, 8, 20] {
        let (mut servo, mut master) = (interpolator(substeps), generator());
        // The first tick ends the wait for it, which nothing has moved in.
        servo.tick(&master.set_points()).unwrap();
        steps(&mut servo, substeps);
        master.enqueue(motion()).unwrap();
        let mut worst = 0.0_f64;
        for _ in 0..60 {
            let from = servo.set_points()[0];
            let to = master.tick(&Observations::none());
            servo.tick(&to).unwrap();
            for step in 1..=substeps {
                let point = servo.step()[0];
                let s = f64::from(step) / f64::from(substeps);
                let (h1, h3) = (s * s * (3.0 - 2.0 * s), s * s * (s - 1.0));
                let h2 = s * (1.0 - s) * (1.0 - s);
                let expected = from.position
                    + h1 * (to[0].position - from.position)
                    + TICK * (h2 * from.velocity + h3 * to[0].velocity);
                worst = worst.max((point.position - expected).abs());
            }
            let end = servo.set_points()[0];
            assert_eq!(
                (end.position, end.velocity),
                (to[0].position, to[0].velocity)
            );
        }
        assert!(worst < 1e-14, "{worst}");
        assert_eq!(servo.set_points()[0].position, 1.0);
    }
}

#[test]
fn a_late_tick_is_waited_for_at_constant_velocity_and_then_it_brakes() {
    let mut servo = interpolator(8);
    let moving = SetPoint {
        position: 0.02,
        velocity: 1.5,
        acceleration: 0.0,
    };
    servo.tick(&[SetPoint::rest(0.0)]).unwrap();
    steps(&mut servo, 8);
    servo.tick(&[moving]).unwrap();
    steps(&mut servo, 8);
    for step in 1..=8 {
        let point = servo.step()[0];
        assert_eq!(point.velocity, 1.5);
        let expected = 0.02 + 1.5 * f64::from(step) * TICK / 8.0;
        assert!((point.position - expected).abs() < 1e-15);
    }
    let mut count = 0;
    while servo.set_points()[0].velocity > 0.0 {
        let before = servo.set_points()[0];
        let point = servo.step()[0];
        assert!(before.velocity - point.velocity <= 50.0 * TICK / 8.0 + 1e-12);
        count += 1;
    }
    // 1.5 / 50 s are 12 steps of 2.5 ms.
    assert_eq!(count, 12);
    let rest = servo.set_points()[0].position;
    assert!((rest - (0.02 + 1.5 * TICK + 1.5 * 1.5 / 100.0)).abs() < 1e-12);
    assert_eq!(servo.step()[0], SetPoint::rest(rest));
}

#[test]
fn bad_set_points_change_nothing() {
    let mut servo = interpolator(8);
    let point = SetPoint {
        position: f64::NAN,
        velocity: 0.0,
        acceleration: 0.0,
    };
    assert!(matches!(
        servo.tick(&[point]),
        Err(NumberError {
            at: Subject::Joint(0),
            what: "the position, rad,",
            ..
        })
    ));
    assert_eq!(servo.step()[0], SetPoint::rest(0.0));
    let error = Interpolator::<1>::new(0, TICK, [0.0], [BOUNDS]).unwrap_err();
    assert_eq!(
        error.to_string(),
        "the number of servo periods in a tick is 0; it must be above 0"
    );
}

/// The steps after a tick, and whether the tick is lost.
type Gap = (u8, bool);

/// Runs a motion whose ticks come like that; speeds in rad/s and changes of them in rad/s² are below
/// the given ones.
fn run(gaps: Vec<Gap>, pauses: u64, speed: f64, acceleration: f64) -> Result<(), TestCaseError> {
    let (mut servo, mut master) = (interpolator(8), generator());
    master.enqueue(motion()).unwrap();
    let step_s = TICK / 8.0;
    let mut before = servo.set_points()[0];
    for (index, (gap, lost)) in gaps.into_iter().enumerate() {
        if pauses >> (index % 64) & 1 == 1 {
            master.pause();
        } else {
            master.resume();
        }
        let points = master.tick(&Observations::none());
        if !(lost && gap > 8) {
            servo.tick(&points).unwrap();
            let now = servo.set_points()[0];
            prop_assert!((now.position - before.position).abs() < 1e-12);
            prop_assert!((now.velocity - before.velocity).abs() < 1e-9);
        }
        for _ in 0..gap {
            let after = servo.step()[0];
            prop_assert!(after.velocity.abs() < speed, "{after:?}");
            let change = (after.velocity - before.velocity).abs();
            prop_assert!(change < acceleration * step_s, "{before:?} {after:?}");
            let step = after.position - before.position;
            let mean = (after.velocity + before.velocity) * 0.5 * step_s;
            let bend = (step - mean).abs();
            prop_assert!(
                bend < acceleration * step_s * step_s,
                "{before:?} {after:?}"
            );
            before = after;
        }
    }
    // In time again, it rejoins exactly.
    master.resume();
    for _ in 0..400 {
        servo.tick(&master.tick(&Observations::none())).unwrap();
        steps(&mut servo, 8);
    }
    prop_assert_eq!(servo.set_points()[0].position, 1.0);
    Ok(())
}

fn late() -> impl Strategy<Value = Vec<Gap>> {
    let gap = prop_oneof![4 => Just(8_u8), 1 => 7_u8..11, 1 => 9_u8..60];
    prop::collection::vec((gap, any::<bool>()), 1..60)
}

fn any_gaps() -> impl Strategy<Value = Vec<Gap>> {
    prop::collection::vec((1_u8..60, any::<bool>()), 1..60)
}

proptest! {
    #[test]
    fn late_and_lost_ticks_cost_no_more_than_the_bounds(gaps in late(), pauses in any::<u64>()) {
        run(gaps, pauses, 3.0 + BOUNDS.velocity, 40.0 + 2.0 * BOUNDS.acceleration)?;
    }

    #[test]
    fn nothing_jumps_even_if_ticks_come_in_bursts(gaps in any_gaps(), pauses in any::<u64>()) {
        run(gaps, pauses, 9.0, 1500.0)?;
    }

    #[test]
    fn arbitrary_set_points_give_errors_or_finite_positions(
        points in prop::collection::vec((any::<f64>(), any::<f64>(), 0_u8..40), 1..10),
    ) {
        let mut servo = interpolator(8);
        for (position, velocity, steps) in points {
            let _ = servo.tick(&[SetPoint { position, velocity, acceleration: f64::NAN }]);
            for _ in 0..steps {
                let point = servo.step()[0];
                prop_assert!(point.position.is_finite() && point.velocity.is_finite());
            }
        }
    }
}

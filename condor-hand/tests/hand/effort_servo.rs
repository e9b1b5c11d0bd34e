//! The servo that keeps an actuator at its effort.

#![allow(
    clippy::float_cmp,
    reason = "the tests say where a number is exactly another"
)]

use condor_hand::servo::{EffortGains, EffortServos};
use condor_hand::transmission::EffortLimits;
use proptest::prelude::*;

const HZ: f64 = 400.0;
/// A tendon. Commands may be less than its least tension.
const TENDON: EffortLimits = EffortLimits {
    low: 4.0,
    high: 130.0,
    bias: 7.0,
};
/// A motor that turns both ways.
const MOTOR: EffortLimits = EffortLimits {
    low: -2.0,
    high: 3.0,
    bias: 0.0,
};
const ACTUATOR_HZ: f64 = 20.0;

fn gains(kp: f64) -> EffortGains {
    EffortGains {
        kp,
        ..EffortGains::default()
    }
}

/// One servo.
struct Servo(EffortServos<1>);

impl Servo {
    fn update(&mut self, desired: f64, measured: f64, rate: f64) -> f64 {
        let [command] = self.0.update(&[desired], &[measured], &[rate]);
        command
    }
}

fn servo(gains: EffortGains) -> Servo {
    of(TENDON, gains)
}

fn of(limits: EffortLimits, gains: EffortGains) -> Servo {
    Servo(EffortServos::new([gains], &[limits], HZ).unwrap())
}

/// A first-order actuator that holds its command for a sample, and gets it so many samples late.
struct Actuator {
    pole: f64,
    effort: f64,
    late: Option<f64>,
}

impl Actuator {
    fn new(effort: f64, is_late: bool) -> Self {
        Self {
            pole: libm::exp(-core::f64::consts::TAU * ACTUATOR_HZ / HZ),
            effort,
            late: is_late.then_some(effort),
        }
    }

    fn update(&mut self, command: f64) {
        let acts = match &mut self.late {
            Some(late) => core::mem::replace(late, command),
            None => command,
        };
        self.effort = self.pole * self.effort + (1.0 - self.pole) * acts;
    }
}

/// How far from the desired effort a loop still swings two thousand samples after 0.01 N.
fn swing(kp: f64, is_late: bool) -> f64 {
    let mut servo = servo(gains(kp));
    let mut actuator = Actuator::new(65.01, is_late);
    let mut swing = 0.0_f64;
    for k in 0..2000 {
        let command = servo.update(65.0, actuator.effort, 0.0);
        actuator.update(command);
        if k >= 1990 && (actuator.effort - 65.0).abs() > swing {
            swing = (actuator.effort - 65.0).abs();
        }
    }
    swing
}

#[test]
fn the_loop_is_stable_up_to_its_bound() {
    let pole = Actuator::new(0.0, false).pole;
    let prompt = (1.0 + pole) / (1.0 - pole);
    let late = 1.0 / (1.0 - pole);
    assert!((prompt - 6.418).abs() < 1e-3 && (late - 3.709).abs() < 1e-3);
    assert!(swing(prompt - 0.01, false) < 0.005);
    assert!(swing(prompt + 0.01, false) > 0.02);
    assert!(swing(late - 0.01, true) < 0.005);
    assert!(swing(late + 0.01, true) > 0.02);
}

#[test]
fn feedback_makes_the_actuator_faster() {
    for kp in [0.0, 1.0, 3.0] {
        let mut servo = servo(gains(kp));
        let mut actuator = Actuator::new(50.0, false);
        let (pole, mut error) = (actuator.pole, -5.0);
        for _ in 0..20 {
            let command = servo.update(55.0, actuator.effort, 0.0);
            actuator.update(command);
            error *= pole - kp * (1.0 - pole);
            assert!((actuator.effort - 55.0 - error).abs() < 1e-12);
        }
    }
}

#[test]
fn the_integral_takes_away_what_a_sensor_and_an_actuator_disagree_in() {
    let mut servo = servo(EffortGains {
        ki: 20.0,
        ..gains(1.0)
    });
    let mut actuator = Actuator::new(40.0, false);
    for _ in 0..4000 {
        let command = servo.update(60.0, actuator.effort - 3.0, 0.0);
        actuator.update(command);
    }
    assert!((actuator.effort - 63.0).abs() < 1e-6, "{}", actuator.effort);
}

#[test]
fn the_integral_does_not_wind_up_against_a_limit() {
    let mut servo = servo(EffortGains {
        ki: 20.0,
        ..gains(1.0)
    });
    let mut command = 0.0;
    for _ in 0..4000 {
        command = servo.update(100.0, 80.0, 0.0);
    }
    assert_eq!(command, TENDON.high);
    // Only what it took to reach the limit, 10 N beyond the proportional part.
    let after = servo.update(50.0, 50.0, 0.0);
    assert!((59.0..=60.0).contains(&after), "{after}");
}

#[test]
fn an_actuator_that_moves_is_damped_and_the_rate_of_the_error_counts() {
    let mut servo = servo(EffortGains {
        kv: 100.0,
        kd: 0.001,
        ..gains(0.0)
    });
    // Drawn in, a tendon pulls less; drawn out, it pulls more.
    assert_eq!(servo.update(50.0, 50.0, 0.1), 40.0);
    assert_eq!(servo.update(50.0, 50.0, -0.1), 60.0);
    assert_eq!(servo.update(50.0, 49.0, 0.0), 50.0 + 0.001 * HZ);
    assert_eq!(servo.update(50.0, 49.0, 0.0), 50.0);
}

#[test]
fn commands_end_at_zero_or_at_the_limits() {
    // A tendon that is too tight gets less than its least tension, but is not pushed.
    let mut tendon = servo(gains(1.0));
    assert_eq!(tendon.update(4.0, 6.0, 0.0), 2.0);
    assert_eq!(tendon.update(4.0, 60.0, 0.0), 0.0);
    assert_eq!(tendon.update(120.0, 60.0, 0.0), 130.0);
    let mut motor = of(MOTOR, gains(1.0));
    assert_eq!(motor.update(-1.0, -0.5, 0.0), -1.5);
    assert_eq!(motor.update(-1.0, 9.0, 0.0), -2.0);
    assert_eq!(motor.update(1.0, -9.0, 0.0), 3.0);
    assert_eq!(motor.update(-7.0, -2.0, 0.0), -2.0);
}

#[test]
fn the_integral_of_a_motor_acts_both_ways() {
    for sense in [1.0, -1.0] {
        let mut servo = of(
            MOTOR,
            EffortGains {
                ki: 20.0,
                ..gains(0.0)
            },
        );
        let mut command = 0.0;
        for _ in 0..20 {
            // 0.2 N m are missing: 20/s times that, for 50 ms.
            command = servo.update(sense, 0.8 * sense, 0.0);
        }
        assert!((command - 1.2 * sense).abs() < 1e-9, "{command}");
    }
}

#[test]
fn without_a_sensor_the_loop_is_open() {
    let mut servo = servo(gains(3.0));
    assert_eq!(servo.update(50.0, 40.0, 0.0), 80.0);
    assert_eq!(servo.update(50.0, f64::NAN, 0.0), 50.0);
    assert_eq!(servo.update(f64::NAN, 45.0, f64::NAN), 65.0);
    assert_eq!(servo.update(f64::INFINITY, 50.0, 0.0), 50.0);
}

#[test]
fn servos_say_what_is_wrong_with_their_numbers() {
    let error = EffortServos::new([gains(-1.0)], &[TENDON], HZ).unwrap_err();
    assert_eq!(
        error.to_string(),
        "the gain kp is -1; it must be at least 0"
    );
    assert!(EffortServos::new([gains(1.0)], &[TENDON], 0.0).is_err());
    let mut servo = servo(gains(1.0));
    assert!(servo.0.set_gains([gains(f64::NAN)]).is_err());
    assert_eq!(servo.update(50.0, 40.0, 0.0), 60.0);
}

fn anything() -> impl Strategy<Value = f64> {
    prop_oneof![
        3 => -200.0..200.0_f64,
        1 => any::<f64>(),
        1 => Just(f64::NAN),
        1 => prop::sample::select(vec![f64::INFINITY, f64::NEG_INFINITY, f64::MAX, f64::MIN]),
    ]
}

proptest! {
    #[test]
    fn a_command_is_one_that_the_actuator_has(
        inputs in prop::collection::vec((anything(), anything(), anything()), 1..100),
        kp in 0.0..10.0, ki in 0.0..1e3, kd in 0.0..1.0, kv in 0.0..1e3,
    ) {
        for limits in [TENDON, MOTOR] {
            let (low, high) = limits.command_range();
            let mut servo = of(limits, EffortGains { kp, ki, kd, kv });
            for &(desired, measured, rate) in &inputs {
                let command = servo.update(desired, measured, rate);
                prop_assert!((low..=high).contains(&command), "{}", command);
            }
        }
    }
}

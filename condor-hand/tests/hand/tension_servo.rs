//! What the servo of a tendon promises.

#![allow(
    clippy::float_cmp,
    reason = "the tests say where a number is exactly another"
)]

use condor_hand::tendon::{TensionGains, TensionServos};
use proptest::prelude::*;

const HZ: f64 = 400.0;
const MAX_N: f64 = 130.0;
const ACTUATOR_HZ: f64 = 20.0;

fn gains(kt: f64) -> TensionGains {
    TensionGains {
        kt,
        ki: 0.0,
        kd: 0.0,
        kv: 0.0,
    }
}

/// One servo.
struct Servo(TensionServos<1>);

impl Servo {
    fn update(&mut self, desired: f64, measured: f64, length_rate: f64) -> f64 {
        let [command] = self.0.update(&[desired], &[measured], &[length_rate]);
        command
    }
}

fn servo(gains: TensionGains) -> Servo {
    Servo(TensionServos::new([gains], [MAX_N], HZ).unwrap())
}

/// A first-order actuator that holds its command for a sample, and gets it so many samples late.
struct Actuator {
    pole: f64,
    tension: f64,
    late: Option<f64>,
}

impl Actuator {
    fn new(tension: f64, is_late: bool) -> Self {
        Self {
            pole: libm::exp(-core::f64::consts::TAU * ACTUATOR_HZ / HZ),
            tension,
            late: is_late.then_some(tension),
        }
    }

    fn update(&mut self, command: f64) {
        let acts = match &mut self.late {
            Some(late) => core::mem::replace(late, command),
            None => command,
        };
        self.tension = self.pole * self.tension + (1.0 - self.pole) * acts;
    }
}

/// How far from the desired tension a loop still swings two thousand samples after 0.01 N.
fn swing(kt: f64, is_late: bool) -> f64 {
    let mut servo = servo(gains(kt));
    let mut actuator = Actuator::new(65.01, is_late);
    let mut swing = 0.0_f64;
    for k in 0..2000 {
        let command = servo.update(65.0, actuator.tension, 0.0);
        actuator.update(command);
        if k >= 1990 && (actuator.tension - 65.0).abs() > swing {
            swing = (actuator.tension - 65.0).abs();
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
    for kt in [0.0, 1.0, 3.0] {
        let mut servo = servo(gains(kt));
        let mut actuator = Actuator::new(50.0, false);
        let (pole, mut error) = (actuator.pole, -5.0);
        for _ in 0..20 {
            let command = servo.update(55.0, actuator.tension, 0.0);
            actuator.update(command);
            error *= pole - kt * (1.0 - pole);
            assert!((actuator.tension - 55.0 - error).abs() < 1e-12);
        }
    }
}

#[test]
fn the_integral_takes_away_what_a_sensor_and_an_actuator_disagree_in() {
    let mut servo = servo(TensionGains {
        ki: 20.0,
        ..gains(1.0)
    });
    let mut actuator = Actuator::new(40.0, false);
    for _ in 0..4000 {
        let command = servo.update(60.0, actuator.tension - 3.0, 0.0);
        actuator.update(command);
    }
    assert!(
        (actuator.tension - 63.0).abs() < 1e-6,
        "{}",
        actuator.tension
    );
}

#[test]
fn the_integral_does_not_wind_up_against_a_limit() {
    let mut servo = servo(TensionGains {
        ki: 20.0,
        ..gains(1.0)
    });
    let mut command = 0.0;
    for _ in 0..4000 {
        command = servo.update(100.0, 80.0, 0.0);
    }
    assert_eq!(command, MAX_N);
    // Only what it took to reach the limit, 10 N beyond the proportional part.
    let after = servo.update(50.0, 50.0, 0.0);
    assert!((59.0..=60.0).contains(&after), "{after}");
}

#[test]
fn a_pulled_tendon_is_damped_and_the_rate_of_the_error_counts() {
    let mut servo = servo(TensionGains {
        kv: 100.0,
        kd: 0.001,
        ..gains(0.0)
    });
    assert_eq!(servo.update(50.0, 50.0, 0.1), 40.0);
    assert_eq!(servo.update(50.0, 49.0, 0.0), 50.0 + 0.001 * HZ);
    assert_eq!(servo.update(50.0, 49.0, 0.0), 50.0);
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
    let error = TensionServos::new([gains(-1.0)], [MAX_N], HZ).unwrap_err();
    assert_eq!(
        error.to_string(),
        "the gain kt is -1; it must be at least 0"
    );
    let error = TensionServos::new([gains(1.0)], [-5.0], HZ).unwrap_err();
    assert_eq!((error.what, error.value), ("the largest tension, N,", -5.0));
    assert!(TensionServos::new([gains(1.0)], [MAX_N], 0.0).is_err());
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
    fn a_command_is_a_tension(
        inputs in prop::collection::vec((anything(), anything(), anything()), 1..100),
        kt in 0.0..10.0, ki in 0.0..1e3, kd in 0.0..1.0, kv in 0.0..1e3,
    ) {
        let mut servo = servo(TensionGains { kt, ki, kd, kv });
        for (desired, measured, rate) in inputs {
            let command = servo.update(desired, measured, rate);
            prop_assert!((0.0..=MAX_N).contains(&command), "{}", command);
        }
    }
}

//! What filters, servo laws and limiters promise.

#![allow(
    clippy::float_cmp,
    reason = "the tests say where a number is exactly another"
)]

use condor_hand::Requirement;
use condor_hand::control::{
    Biquad, Derivative, MotionLimiter, OnePole, Pid, PidGains, PidLimits, RateLimiter,
};
use proptest::prelude::*;

const HZ: f64 = 400.0;

/// A filter, by what all have.
trait Filter {
    fn update(&mut self, x: f64) -> f64;
    fn rejected(&self) -> u32;
}

macro_rules! filters {
    ($($name:ident),*) => {$(
        impl Filter for $name {
            fn update(&mut self, x: f64) -> f64 {
                $name::update(self, x)
            }
            fn rejected(&self) -> u32 {
                $name::rejected(self)
            }
        }
    )*};
}
filters!(OnePole, Biquad, Derivative);

fn filters() -> [Box<dyn Filter>; 3] {
    [
        Box::new(OnePole::low_pass(60.0, HZ).unwrap()),
        Box::new(Biquad::low_pass(60.0, HZ).unwrap()),
        Box::new(Derivative::new(60.0, HZ).unwrap()),
    ]
}

#[test]
fn butterworth_has_the_coefficients_of_the_books() {
    let (b, a) = Biquad::<f64>::low_pass(60.0, HZ).unwrap().coefficients();
    // scipy.signal.butter(2, 60, fs=400)
    let expected = [0.131_106, 0.262_213, 0.131_106, -0.747_789, 0.272_215];
    for (found, expected) in b.iter().chain(&a).zip(expected) {
        assert!((found - expected).abs() < 1e-6, "{found} {expected}");
    }
}

/// The amplitude that is left of a sine, by correlation over whole periods.
fn gain(hz: f64, mut filter: impl FnMut(f64) -> f64) -> f64 {
    let (mut sine, mut cosine) = (0.0, 0.0);
    for k in 0..8000 {
        let phase = std::f64::consts::TAU * hz * f64::from(k) / HZ;
        let y = filter(libm::sin(phase));
        if k >= 4000 {
            sine += y * libm::sin(phase) / 2000.0;
            cosine += y * libm::cos(phase) / 2000.0;
        }
    }
    libm::hypot(sine, cosine)
}

#[test]
fn half_the_power_passes_at_the_cutoff() {
    let mut biquad = Biquad::low_pass(60.0, HZ).unwrap();
    let at_cutoff = gain(60.0, |x| biquad.update(x));
    assert!(
        (at_cutoff - core::f64::consts::FRAC_1_SQRT_2).abs() < 1e-9,
        "{at_cutoff}"
    );
    let mut biquad = Biquad::low_pass(60.0, HZ).unwrap();
    assert!(gain(5.0, |x| biquad.update(x)) > 0.999);
    let mut biquad = Biquad::low_pass(60.0, HZ).unwrap();
    assert!(gain(180.0, |x| biquad.update(x)) < 0.02);
}

#[test]
fn a_constant_passes_unchanged_from_the_first_sample() {
    for value in [0.0, 3.7, -1e-9, 1e12] {
        let mut one_pole = OnePole::low_pass(5.0, HZ).unwrap();
        let mut biquad = Biquad::low_pass(5.0, HZ).unwrap();
        let mut derivative = Derivative::new(5.0, HZ).unwrap();
        assert_eq!(one_pole.update(value), value);
        assert_eq!(biquad.update(value), value);
        for _ in 0..1000 {
            assert_eq!(one_pole.update(value), value);
            assert!((biquad.update(value) - value).abs() <= 1e-12 * value.abs());
            assert_eq!(derivative.update(value), 0.0);
        }
    }
}

#[test]
fn a_step_settles_at_its_height_in_32_bits_too() {
    let mut one_pole = OnePole::<f32>::low_pass(2.0, 400.0).unwrap();
    let mut biquad = Biquad::<f32>::low_pass(2.0, 400.0).unwrap();
    one_pole.update(0.0);
    biquad.update(0.0);
    let mut last = (0.0, 0.0);
    for _ in 0..4000 {
        last = (one_pole.update(100.0), biquad.update(100.0));
    }
    assert!((last.0 - 100.0).abs() < 1e-3, "{last:?}");
    assert!((last.1 - 100.0).abs() < 1e-2, "{last:?}");
}

#[test]
fn a_lag_has_decayed_to_one_over_e_after_its_time() {
    // 1 / (2 pi fc) is a hundred samples.
    let mut one_pole = OnePole::low_pass(HZ / (200.0 * std::f64::consts::PI), HZ).unwrap();
    one_pole.update(1.0);
    let mut y = 1.0;
    for _ in 0..100 {
        y = one_pole.update(0.0);
    }
    assert!((y - 1.0 / core::f64::consts::E).abs() < 1e-12);
}

#[test]
fn the_rate_of_a_ramp_is_exact_also_after_lost_samples() {
    let mut derivative = Derivative::new(60.0, HZ).unwrap();
    let mut rate = 0.0;
    for k in 0..200 {
        let lost = (50..60).contains(&k) || k == 150;
        let x = if lost {
            f64::NAN
        } else {
            0.5 + 3.0 * f64::from(k) / HZ
        };
        rate = derivative.update(x);
        assert!((-1e-12..=3.0 + 1e-9).contains(&rate), "sample {k}: {rate}");
    }
    assert!((rate - 3.0).abs() < 1e-9);
    assert_eq!(derivative.rejected(), 11);
}

#[test]
fn filters_say_what_is_wrong_with_their_numbers() {
    let error = Biquad::<f64>::low_pass(200.0, HZ).unwrap_err();
    assert_eq!(
        error.to_string(),
        "the cutoff, Hz, is 200; it must be below 200"
    );
    for cutoff in [0.0, -1.0, f64::NAN, f64::INFINITY, 201.0] {
        assert!(OnePole::low_pass(cutoff, HZ).is_err());
        assert!(Derivative::new(cutoff, HZ).is_err());
    }
    for rate in [0.0, -400.0, f64::NAN, f64::INFINITY] {
        let error = OnePole::low_pass(1.0, rate).unwrap_err();
        assert_eq!(error.what, "the sample rate, Hz,");
    }
}

/// Numbers as a broken sensor gives them.
fn anything() -> impl Strategy<Value = f64> {
    prop_oneof![
        4 => -1e3..1e3,
        1 => any::<f64>(),
        1 => prop::sample::select(vec![
            f64::NAN, f64::INFINITY, f64::NEG_INFINITY, f64::MAX, f64::MIN, f64::MIN_POSITIVE, 5e-324,
        ]),
    ]
}

proptest! {
    #[test]
    fn filters_stay_finite(inputs in prop::collection::vec(anything(), 1..100)) {
        for mut filter in filters() {
            let mut last = 0.0;
            for &x in &inputs {
                let before = filter.rejected();
                let y = filter.update(x);
                prop_assert!(y.is_finite());
                if !x.is_finite() {
                    prop_assert_eq!(filter.rejected(), before + 1);
                    prop_assert_eq!(y, last);
                }
                last = y;
            }
        }
    }

    #[test]
    fn a_servo_law_keeps_its_limits(
        inputs in prop::collection::vec((anything(), anything()), 1..100),
        kp in 0.0..1e3, ki in 0.0..1e3, kd in 0.0..10.0,
    ) {
        let limits = PidLimits { output: (-2.0, 3.0), integral: 1.0 };
        let mut pid = Pid::new(PidGains { kp, ki, kd }, limits, HZ).unwrap();
        for (error, rate) in inputs {
            let output = pid.update(error, rate);
            prop_assert!((-2.0..=3.0).contains(&output));
        }
    }

    #[test]
    fn limiters_keep_their_rates(targets in prop::collection::vec(anything(), 2..100)) {
        let mut limiter = RateLimiter::new(8.0, HZ).unwrap();
        limiter.reset_to(0.0);
        let mut motion = MotionLimiter::new(8.0, 50.0, HZ).unwrap();
        motion.reset_to(0.0);
        let (mut value, mut position, mut velocity) = (0.0, 0.0, 0.0);
        for target in targets {
            for _ in 0..20 {
                let next = limiter.update(target);
                prop_assert!((next - value).abs() <= 8.0 / HZ + 1e-12);
                value = next;
                let next = motion.update(target);
                let step = (next - position) * HZ;
                prop_assert!(step.abs() <= 8.0 + 1e-9);
                prop_assert!((step - velocity).abs() <= 50.0 / HZ + 1e-9);
                (position, velocity) = (next, step);
            }
        }
    }

    #[test]
    fn motion_arrives_and_does_not_overshoot(
        target in -2.0..2.0_f64, max_velocity in 0.1..10.0, max_acceleration in 1.0..200.0,
    ) {
        let mut motion = MotionLimiter::new(max_velocity, max_acceleration, HZ).unwrap();
        motion.reset_to(0.0);
        let seconds = target.abs() / max_velocity + max_velocity / max_acceleration
            + 2.0 * libm::sqrt(target.abs() / max_acceleration);
        let mut samples = 0.0;
        let mut x = 0.0_f64;
        while samples < seconds * HZ + 5.0 {
            samples += 1.0;
            let next = motion.update(target);
            prop_assert!((next - x) * target.signum() >= -1e-12, "back from {} to {}", x, next);
            prop_assert!(next.abs() <= target.abs() + 1e-12);
            x = next;
        }
        prop_assert_eq!(x, target);
        motion.update(target);
        prop_assert_eq!(motion.velocity(), 0.0);
    }
}

#[test]
fn the_first_target_is_taken_as_it_is() {
    let mut limiter = RateLimiter::new(1.0, HZ).unwrap();
    assert_eq!(limiter.update(7.0), 7.0);
    assert_eq!(limiter.update(f64::NAN), 7.0);
    assert_eq!(limiter.rejected(), 1);
    assert!((limiter.update(8.0) - 7.0025).abs() < 1e-12);
    let mut motion = MotionLimiter::new(1.0, 1.0, HZ).unwrap();
    assert_eq!(motion.update(7.0), 7.0);
}

#[test]
fn limiters_say_what_is_wrong_with_their_numbers() {
    let error = MotionLimiter::<f64>::new(1.0, -2.0, HZ).unwrap_err();
    assert_eq!(
        error.to_string(),
        "the limit of the acceleration is -2; it must be above 0"
    );
    assert!(RateLimiter::new(f64::NAN, HZ).is_err());
    let error = RateLimiter::new(1.0, 0.0).unwrap_err();
    assert_eq!(error.what, "the sample rate, Hz,");
}

#[test]
fn servo_laws_say_what_is_wrong_with_their_numbers() {
    let gains = PidGains {
        kp: 1.0,
        ki: 1.0,
        kd: 0.0,
    };
    let limits = PidLimits {
        output: (-1.0, 1.0),
        integral: 1.0,
    };
    let negative = PidGains { ki: -1.0, ..gains };
    let error = Pid::new(negative, limits, HZ).unwrap_err();
    assert_eq!(
        error.to_string(),
        "the gain ki is -1; it must be at least 0"
    );
    let crossed = PidLimits {
        output: (1.0, -1.0),
        ..limits
    };
    let error = Pid::new(gains, crossed, HZ).unwrap_err();
    assert_eq!(error.must, Requirement::AtLeast(1.0));
    let windup = PidLimits {
        integral: f64::NAN,
        ..limits
    };
    let error = Pid::new(gains, windup, HZ).unwrap_err();
    assert_eq!(error.what, "the limit of the integral");
    let error = Pid::new(gains, limits, -1.0).unwrap_err();
    assert_eq!(error.what, "the sample rate, Hz,");
    let mut pid = Pid::new(gains, limits, HZ).unwrap();
    assert!(pid.set_gains(negative).is_err());
}

/// The time in samples that the output takes to leave its limit after the error has changed sign.
fn recovery(integral: f64) -> usize {
    let gains = PidGains {
        kp: 1.0,
        ki: 10.0,
        kd: 0.0,
    };
    let limits = PidLimits {
        output: (-1.0, 1.0),
        integral,
    };
    let mut pid = Pid::new(gains, limits, HZ).unwrap();
    for _ in 0..4000 {
        assert_eq!(pid.update(2.0, 0.0), 1.0);
    }
    (0..4000).find(|_| pid.update(-0.1, 0.0) < 1.0).unwrap()
}

#[test]
fn an_integral_does_not_wind_up() {
    // Ten seconds against the limit would have left 200 in a plain integral of so wide a limit.
    assert_eq!(recovery(1e6), 0);
}

#[test]
fn an_integral_takes_the_rest_of_an_error_away() {
    let gains = PidGains {
        kp: 2.0,
        ki: 20.0,
        kd: 0.01,
    };
    let limits = PidLimits {
        output: (-10.0, 10.0),
        integral: 10.0,
    };
    let mut pid = Pid::new(gains, limits, HZ).unwrap();
    let (mut x, mut v) = (0.0, 0.0);
    for _ in 0..4000 {
        // A lag of 50 ms under a constant load of -3.
        let u = pid.update(1.0 - x, v);
        v = (u - 3.0 - x) / 0.05;
        x += v / HZ;
    }
    assert!((x - 1.0).abs() < 1e-6, "{x}");
}

#[test]
fn taking_over_makes_no_bump() {
    let gains = PidGains {
        kp: 2.0,
        ki: 20.0,
        kd: 0.1,
    };
    let limits = PidLimits {
        output: (-10.0, 10.0),
        integral: 10.0,
    };
    let mut pid = Pid::new(gains, limits, HZ).unwrap();
    pid.track(4.5, 0.3, -0.2);
    let first = pid.update(0.3, -0.2);
    assert!((first - 4.5).abs() <= 20.0 * 0.3 / HZ + 1e-12, "{first}");
    pid.set_gains(PidGains { ki: 0.0, ..gains }).unwrap();
    assert_eq!(pid.update(0.3, -0.2), first);
    pid.reset();
    assert!((pid.update(0.3, -0.2) - 0.62).abs() < 1e-12);
}

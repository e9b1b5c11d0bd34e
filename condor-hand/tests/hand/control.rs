//! What filters promise.

#![allow(
    clippy::float_cmp,
    reason = "the tests say where a number is exactly another"
)]

use condor_hand::control::{Derivative, LowPass};
use proptest::prelude::*;

const HZ: f64 = 400.0;

#[test]
fn a_constant_passes_unchanged_from_the_first_sample() {
    for value in [0.0, 3.7, -1e-9, 1e12] {
        let mut one_pole = LowPass::new([Some(5.0)], HZ).unwrap();
        let mut derivative = Derivative::new([5.0], HZ).unwrap();
        assert_eq!(one_pole.update(&[value])[0], value);
        for _ in 0..1000 {
            assert_eq!(one_pole.update(&[value])[0], value);
            assert_eq!(derivative.update(&[value])[0], 0.0);
        }
    }
}

#[test]
fn a_lag_has_decayed_to_one_over_e_after_its_time() {
    // 1 / (2 pi fc) is a hundred samples.
    let mut one_pole = LowPass::new([Some(HZ / (200.0 * std::f64::consts::PI))], HZ).unwrap();
    one_pole.update(&[1.0]);
    let mut y = 1.0;
    for _ in 0..100 {
        y = one_pole.update(&[0.0])[0];
    }
    assert!((y - 1.0 / core::f64::consts::E).abs() < 1e-12);
}

#[test]
fn the_rate_of_a_ramp_is_exact_also_after_lost_samples() {
    let mut derivative = Derivative::new([60.0], HZ).unwrap();
    let mut rate = 0.0;
    for k in 0..200 {
        let lost = (50..60).contains(&k) || k == 150;
        let x = if lost {
            f64::NAN
        } else {
            0.5 + 3.0 * f64::from(k) / HZ
        };
        rate = derivative.update(&[x])[0];
        assert!((-1e-12..=3.0 + 1e-9).contains(&rate), "sample {k}: {rate}");
    }
    assert!((rate - 3.0).abs() < 1e-9);
}

#[test]
fn filters_say_what_is_wrong_with_their_numbers() {
    let error = LowPass::new([Some(200.0)], HZ).unwrap_err();
    assert_eq!(
        error.to_string(),
        "the cutoff, Hz, is 200; it must be below 200"
    );
    for cutoff in [0.0, -1.0, f64::NAN, f64::INFINITY, 201.0] {
        assert!(LowPass::new([Some(cutoff)], HZ).is_err());
        assert!(Derivative::new([cutoff], HZ).is_err());
    }
    for rate in [0.0, -400.0, f64::NAN, f64::INFINITY] {
        let error = LowPass::new([Some(1.0)], rate).unwrap_err();
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
        let mut one_pole = LowPass::new([Some(60.0)], HZ).unwrap();
        let mut derivative = Derivative::new([60.0], HZ).unwrap();
        let mut last = (0.0, 0.0);
        for &x in &inputs {
            let next = (one_pole.update(&[x])[0], derivative.update(&[x])[0]);
            prop_assert!(next.0.is_finite() && next.1.is_finite());
            if !x.is_finite() {
                prop_assert_eq!(next, last);
            }
            last = next;
        }
    }
}

#[test]
fn states_never_become_denormal() {
    let mut filter = LowPass::new([Some(5.0)], 400.0).unwrap();
    let mut derivative = Derivative::new([5.0], 400.0).unwrap();
    filter.update(&[1.0]);
    derivative.update(&[1.0]);
    let mut last = (filter.update(&[0.0]), derivative.update(&[2.0]));
    for _ in 0..5000 {
        last = (filter.update(&[0.0]), derivative.update(&[2.0]));
        let ([output], [rate]) = last;
        assert!(!output.is_subnormal() && !rate.is_subnormal());
    }
    assert_eq!(last, ([0.0], [0.0]));
}

//! Numbers as people write them.

#![allow(clippy::float_cmp, reason = "what is read is exactly what was shown")]

use condor_hand::decimal::Decimal;
use proptest::prelude::*;

#[test]
fn shows_numbers_as_people_write_them() {
    for (value, text) in [
        (0.0, "0"),
        (-0.0, "-0"),
        (1.0, "1"),
        (-1200.0, "-1200"),
        (0.7, "0.7"),
        (0.1 + 0.2, "0.3"),
        (1.0 / 3.0, "0.333333333333"),
        (2.0e9, "2000000000"),
        (123_456_789_012.0, "123456789012"),
        (1e17, "100000000000000000"),
        (0.000_012_5, "0.0000125"),
        (1.5e-21, "1.5e-21"),
        (9.999_999_999_999_99, "10"),
        (1e300, "1e300"),
        (-2.5e-300, "-2.5e-300"),
        (5e-324, "4.94065645841e-324"),
        (f64::MAX, "1.79769313486e308"),
        (f64::INFINITY, "inf"),
        (f64::NEG_INFINITY, "-inf"),
        (f64::NAN, "NaN"),
    ] {
        assert_eq!(Decimal(value).to_string(), text);
    }
}

#[test]
fn reads_what_is_a_number_and_nothing_else() {
    for text in [
        "", "-", ".", "e5", "1e", "1e+", "1.2.3", "0x10", "1 ", "inf", "nan", "--1",
    ] {
        assert_eq!(Decimal::parse(text), None, "{text}");
    }
    for text in [
        "1",
        "+1",
        "-.5",
        "5.",
        "1e22",
        "123456789012345e-22",
        "000.100",
        "7E+2",
    ] {
        assert_eq!(
            Decimal::parse(text),
            text.parse().ok().map(Decimal),
            "{text}"
        );
    }
    let infinite = Some(Decimal(f64::INFINITY));
    assert_eq!(Decimal::parse("1e999999999999"), infinite);
    assert_eq!(Decimal::parse("1e-999999999999"), Some(Decimal(0.0)));
}

proptest! {
    #[test]
    fn shows_as_core_does_with_a_precision(value in -1e6..1e6_f64, after in 0..6_usize) {
        let ours = format!("{:.after$}", Decimal(value));
        let ours: f64 = ours.parse().unwrap();
        // Ties may go another way.
        let unit = 1.0 / [1.0, 10.0, 1e2, 1e3, 1e4, 1e5][after];
        prop_assert!((ours - value).abs() <= 0.500_001 * unit);
    }

    #[test]
    fn shows_twelve_digits_of_any_number(bits: u64) {
        let value = f64::from_bits(bits);
        prop_assume!(value.is_normal());
        let back: f64 = Decimal(value).to_string().parse().unwrap();
        prop_assert!(((back - value) / value).abs() < 6e-12, "{value} {}", Decimal(value));
    }

    #[test]
    fn reads_fifteen_digits_as_core_does(
        digits in 0_u64..1_000_000_000_000_000,
        exponent in -22..=22_i32,
    ) {
        let text = format!("{digits}e{exponent}");
        prop_assert_eq!(Decimal::parse(&text), text.parse().ok().map(Decimal));
    }

    #[test]
    fn reads_any_number_closely(bits: u64) {
        let value = f64::from_bits(bits);
        prop_assume!(value.is_normal());
        let read = Decimal::parse(&format!("{value:e}")).unwrap().0;
        prop_assert!(read == value || ((read - value) / value).abs() < 1e-14, "{value} {read}");
    }

    #[test]
    fn takes_any_text(text in ".*") {
        let _ = Decimal::parse(&text);
    }
}

//! [`Decimal`]: numbers as text, without code that can panic.
//!
//! Core prints and reads floating point to the last bit, by code with internal checks that panic.
//! Firmware that is checked to contain no path to a panic cannot use it; so the errors of control,
//! from set-points to actuators, print their numbers in this way.

use core::fmt::{self, Write as _};

use crate::math;

/// A number that is printed and read as people write it: `0.25`, `-1200`, `1.5e-21`.
///
/// `{}` prints at most twelve significant digits, and `{:#}` at most four, without zeros at the end. A precision, as
/// in `{:.3}`, is the number of digits after the point. A width is ignored.
///
/// ```
/// use condor_hand::decimal::Decimal;
///
/// assert_eq!(Decimal(0.1 + 0.2).to_string(), "0.3");
/// assert_eq!(format!("{:.3}", Decimal(-1.23456)), "-1.235");
/// assert_eq!(format!("{:#}", Decimal(0.0123456)), "0.01235");
/// assert_eq!(Decimal::parse("25e-2"), Some(Decimal(0.25)));
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Decimal(pub f64);

/// For twelve digits, and for four: the least number with so many digits before the point, its power of ten, and the least
/// number with one digit more.
const TWELVE_DIGITS: (f64, i32, f64) = (1e11, 11, 1e12);
const FOUR_DIGITS: (f64, i32, f64) = (1e3, 3, 1e4);
/// Digits that a 64-bit word has for certain, before the point and after.
const WORD_DIGITS: u32 = 18;
/// Powers of ten that are exact.
const POWERS: [f64; 23] = [
    1e0, 1e1, 1e2, 1e3, 1e4, 1e5, 1e6, 1e7, 1e8, 1e9, 1e10, 1e11, 1e12, 1e13, 1e14, 1e15, 1e16,
    1e17, 1e18, 1e19, 1e20, 1e21, 1e22,
];
/// No number has as large an exponent, however many digits are before it.
const MOST_EXPONENT: i32 = 100_000;

impl Decimal {
    /// Reads a number from `text`: digits with at most one point, optionally a sign before them,
    /// and optionally an exponent after `e` or `E`. Returns `None` if `text` is anything else.
    ///
    /// The result is the nearest `f64` if there are at most fifteen digits and the power of ten of
    /// the last digit is at most 22 in size. Otherwise the result may be off in its last bits.
    #[must_use]
    pub fn parse(text: &str) -> Option<Self> {
        let (is_negative, text) = sign(text);
        let (digits, exponent) = match text.split_once(['e', 'E']) {
            Some((digits, exponent)) => (digits, whole(exponent)?),
            None => (text, 0),
        };
        let (before, after) = digits.split_once('.').unwrap_or((digits, ""));
        let mut word = 0_u64;
        let mut places = 0_i32;
        let mut is_empty = true;
        for (part, is_after) in [(before, false), (after, true)] {
            for digit in part.chars() {
                let digit = digit.to_digit(10)?;
                is_empty = false;
                let longer = word.checked_mul(10);
                match longer.and_then(|longer| longer.checked_add(digit.into())) {
                    Some(longer) => {
                        word = longer;
                        places = places.saturating_sub(is_after.into());
                    }
                    // The word is full: the digit is only a place.
                    None => places = places.saturating_add((!is_after).into()),
                }
            }
        }
        #[expect(clippy::cast_precision_loss, reason = "fifteen digits lose nothing")]
        let magnitude = scaled(word as f64, exponent.saturating_add(places));
        let value = if is_negative { -magnitude } else { magnitude };
        (!is_empty).then_some(Self(value))
    }
}

impl fmt::Display for Decimal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self(value) = *self;
        if value.is_nan() {
            return f.write_str("NaN");
        }
        if value.is_sign_negative() {
            f.write_char('-')?;
        }
        let magnitude = math::abs(value);
        if magnitude == f64::INFINITY {
            return f.write_str("inf");
        }
        let asked = f.precision().and_then(|digits| u32::try_from(digits).ok());
        if let Some(after) = asked.filter(|&after| after <= WORD_DIGITS) {
            let all = magnitude * power(after);
            if all < power(WORD_DIGITS) {
                return put(f, nearest(all), after);
            }
        }
        let shown = if f.alternate() {
            FOUR_DIGITS
        } else {
            TWELVE_DIGITS
        };
        short(f, magnitude, shown)
    }
}

/// Writes as many significant digits as there are to show.
fn short(
    f: &mut fmt::Formatter<'_>,
    magnitude: f64,
    (least, places, end): (f64, i32, f64),
) -> fmt::Result {
    if magnitude == 0.0 {
        return f.write_char('0');
    }
    // As digits before a point, and a power of ten.
    let (mut digits, mut exponent) = (magnitude, 0_i32);
    while digits >= end {
        digits /= 10.0;
        exponent = exponent.saturating_add(1);
    }
    // Small numbers in strides: a power of ten may be too large for all at once.
    while digits < least {
        let (stride, power) = if digits < 1.0 {
            (places, least)
        } else {
            (1, 10.0)
        };
        digits *= power;
        exponent = exponent.saturating_sub(stride);
    }
    let mut word = nearest(digits);
    while word != 0 && word.is_multiple_of(10) {
        word /= 10;
        exponent = exponent.saturating_add(1);
    }
    let most = WORD_DIGITS.cast_signed();
    let after_first = word.checked_ilog10().unwrap_or(0);
    let largest = exponent.saturating_add(after_first.cast_signed());
    if exponent >= 0 && largest < most {
        let zeros = 10_u64.checked_pow(exponent.unsigned_abs());
        return put(f, word.saturating_mul(zeros.unwrap_or(1)), 0);
    }
    if (-most..0).contains(&exponent) {
        return put(f, word, exponent.unsigned_abs());
    }
    put(f, word, after_first)?;
    write!(f, "e{largest}")
}

/// The digits of a word, the last `after` of them after a point.
fn put(f: &mut fmt::Formatter<'_>, word: u64, after: u32) -> fmt::Result {
    let first = word.checked_ilog10().unwrap_or(0).max(after);
    for place in (0..=first).rev() {
        let shifted = 10_u64
            .checked_pow(place)
            .and_then(|unit| word.checked_div(unit));
        let digit = (shifted.unwrap_or(0) % 10) as u8;
        f.write_char(char::from(b'0'.wrapping_add(digit)))?;
        if place == after && place > 0 {
            f.write_char('.')?;
        }
    }
    Ok(())
}

/// The nearest whole number to one that is not negative.
#[expect(clippy::cast_sign_loss, reason = "there is no sign")]
fn nearest(magnitude: f64) -> u64 {
    (magnitude + 0.5) as u64
}

/// Ten to a power that a number is scaled by exactly.
fn power(exponent: u32) -> f64 {
    let power = POWERS.get(exponent as usize);
    power.copied().unwrap_or(f64::INFINITY)
}

/// A number times a power of ten.
fn scaled(mut value: f64, exponent: i32) -> f64 {
    let most = POWERS.len().saturating_sub(1) as u32;
    let mut left = exponent.unsigned_abs();
    // Beyond, it stays 0 or infinite.
    while left > 0 && value != 0.0 && value.is_finite() {
        let step = left.min(most);
        if exponent > 0 {
            value *= power(step);
        } else {
            value /= power(step);
        }
        left = left.saturating_sub(step);
    }
    value
}

/// Returns true if the text has a minus, and the rest of the text after its sign.
fn sign(text: &str) -> (bool, &str) {
    match text.strip_prefix('-') {
        Some(rest) => (true, rest),
        None => (false, text.strip_prefix('+').unwrap_or(text)),
    }
}

/// An exponent.
fn whole(text: &str) -> Option<i32> {
    let (is_negative, digits) = sign(text);
    let mut value = None;
    for digit in digits.chars() {
        let so_far = value.unwrap_or(0_i32).saturating_mul(10);
        let digit = digit.to_digit(10)?.cast_signed();
        value = Some(so_far.saturating_add(digit).min(MOST_EXPONENT));
    }
    value.map(|value: i32| {
        if is_negative {
            value.saturating_neg()
        } else {
            value
        }
    })
}

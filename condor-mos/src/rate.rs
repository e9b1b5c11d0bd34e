//! [`Rate`]: a frequency, as an exact fraction of whole numbers.

use core::cmp::Ordering;
use core::fmt::{self, Write};

/// An exact frequency in hertz: a fraction of two whole numbers in lowest terms, never zero.
///
/// So releases are exact for every rate. If periods were whole microseconds, 60 Hz would become a
/// slightly different rate, and the releases of loops with 400, 60 and 50 Hz would repeat only
/// after minutes; with fractions they repeat after 100 ms.
///
/// ```
/// use condor_mos::Rate;
///
/// const SERVO: Rate = Rate::hz(400);
/// const VIDEO: Rate = Rate::fraction(60_000, 1001); // 59.94 Hz
/// assert!(SERVO > VIDEO);
/// assert_eq!(VIDEO.to_string(), "60000/1001 Hz");
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Rate {
    numerator: u32,
    denominator: u32,
}

impl Rate {
    /// Makes a rate of `hertz` times per second.
    ///
    /// # Panics
    /// If `hertz` is 0; in a constant, that is an error of compilation. For values that are known
    /// only at run time use [`new`](Self::new).
    #[must_use]
    pub const fn hz(hertz: u32) -> Self {
        Self::fraction(hertz, 1)
    }

    /// Makes a rate of once in `seconds` seconds.
    ///
    /// # Panics
    /// If `seconds` is 0; in a constant, that is an error of compilation.
    #[must_use]
    pub const fn every_seconds(seconds: u32) -> Self {
        Self::fraction(1, seconds)
    }

    /// Makes a rate of `numerator` times in `denominator` seconds.
    ///
    /// # Panics
    /// If either is 0; in a constant, that is an error of compilation.
    #[must_use]
    pub const fn fraction(numerator: u32, denominator: u32) -> Self {
        match Self::new(numerator, denominator) {
            Some(rate) => rate,
            None => panic!("a rate is a fraction of two numbers that are not 0"),
        }
    }

    /// Makes a rate of `numerator` times in `denominator` seconds; returns `None` if either is 0.
    #[must_use]
    pub const fn new(numerator: u32, denominator: u32) -> Option<Self> {
        let divisor = greatest_common_divisor(numerator as u64, denominator as u64) as u32;
        if numerator == 0 || denominator == 0 {
            return None;
        }
        match (
            numerator.checked_div(divisor),
            denominator.checked_div(divisor),
        ) {
            (Some(numerator), Some(denominator)) => Some(Self {
                numerator,
                denominator,
            }),
            _ => None,
        }
    }

    /// Returns the numerator of the rate in lowest terms: the number of times in
    /// [`denominator`](Self::denominator) seconds.
    #[must_use]
    pub const fn numerator(self) -> u32 {
        self.numerator
    }

    /// Returns the denominator of the rate in lowest terms: the number of seconds for
    /// [`numerator`](Self::numerator) times.
    #[must_use]
    pub const fn denominator(self) -> u32 {
        self.denominator
    }

    /// Returns the rate in hertz, rounded, for people and plots. Do not compute instants from it.
    #[must_use]
    pub fn as_hz(self) -> f64 {
        f64::from(self.numerator) / f64::from(self.denominator)
    }

    /// Returns true if this rate is greater than `other`; it also works in constants.
    #[must_use]
    pub const fn is_faster_than(self, other: Self) -> bool {
        self.numerator as u64 * other.denominator as u64
            > other.numerator as u64 * self.denominator as u64
    }
}

impl PartialOrd for Rate {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

/// Orders rates; the faster rate is the greater.
impl Ord for Rate {
    fn cmp(&self, other: &Self) -> Ordering {
        let product = |a: u32, b: u32| u64::from(a) * u64::from(b);
        product(self.numerator, other.denominator).cmp(&product(other.numerator, self.denominator))
    }
}

impl fmt::Display for Rate {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut text = Text::default();
        match self.denominator {
            1 => write!(text, "{} Hz", self.numerator),
            denominator => write!(text, "{}/{denominator} Hz", self.numerator),
        }?;
        f.pad(text.as_str())
    }
}

/// The printed form of a rate, so that it can be padded.
#[derive(Default)]
struct Text {
    bytes: [u8; "4294967295/4294967295 Hz".len()],
    len: usize,
}

impl Text {
    fn as_str(&self) -> &str {
        let bytes = self.bytes.get(..self.len).unwrap_or_default();
        core::str::from_utf8(bytes).unwrap_or_default()
    }
}

impl fmt::Write for Text {
    fn write_str(&mut self, piece: &str) -> fmt::Result {
        let end = self.len + piece.len();
        let place = self.bytes.get_mut(self.len..end).ok_or(fmt::Error)?;
        place.copy_from_slice(piece.as_bytes());
        self.len = end;
        Ok(())
    }
}

/// The greatest number that divides both; the other one, if one is 0.
pub(crate) const fn greatest_common_divisor(mut a: u64, mut b: u64) -> u64 {
    while b != 0 {
        (a, b) = (b, a % b);
    }
    a
}

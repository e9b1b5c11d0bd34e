//! [`Scale`]: the range of an axis, and its marks.

/// The range of an axis, whose marks are at multiples of `step`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Scale {
    pub(crate) low: f64,
    pub(crate) high: f64,
    pub(crate) step: f64,
}

impl Scale {
    /// Returns the scale that has all of a range and ends at marks, of which there are about `marks`.
    pub(crate) fn around(low: f64, high: f64, marks: u16) -> Self {
        let size = low.abs().max(high.abs());
        // Values that differ only by rounding, and constant ones, are in the middle.
        let (low, high) = if high - low > 1e-9 * size && high > low {
            (low, high)
        } else {
            let half = (0.1 * size).max(1e-9);
            (low - half, high + half)
        };
        let step = step((high - low) / f64::from(marks.max(2) - 1));
        Self {
            low: (low / step).floor() * step,
            high: (high / step).ceil() * step,
            step,
        }
    }

    /// Returns the scale of exactly a range, with at most about so many marks.
    pub(crate) fn of(low: f64, high: f64, marks: u16) -> Self {
        Self {
            low,
            high,
            step: step((high - low) / f64::from(marks.max(2) - 1)),
        }
    }

    /// Iterates over the marks, from the lowest, with their texts.
    pub(crate) fn marks(self) -> impl Iterator<Item = (f64, String)> {
        let first = (self.low / self.step - 1e-6).ceil();
        let values = (0..100_u32).map(move |number| (first + f64::from(number)) * self.step);
        let values = values.take_while(move |value| *value <= self.high + 1e-6 * self.step);
        values.map(move |value| (value, self.text(value)))
    }

    /// Returns the part of the range that is below a value: 0 at the low end, 1 at the high one.
    pub(crate) fn part(self, value: f64) -> f64 {
        (value - self.low) / (self.high - self.low)
    }

    fn text(self, value: f64) -> String {
        let size = self.low.abs().max(self.high.abs());
        if size >= 1e6 || self.step < 1e-5 {
            return format!("{value:.2e}");
        }
        let digits = (-self.step.log10()).ceil().clamp(0.0, 6.0) as usize;
        // No mark is minus nothing.
        let value = if value.abs() < self.step / 2.0 {
            0.0
        } else {
            value
        };
        format!("{value:.digits$}")
    }
}

/// Returns the least of 1, 2 and 5 times a power of ten that is not below `least`.
fn step(least: f64) -> f64 {
    if !(least.is_finite() && least > 0.0) {
        return 1.0;
    }
    let power = 10_f64.powf(least.log10().floor());
    let nice = [1.0, 2.0, 5.0].map(|factor| factor * power).into_iter();
    let found = nice.into_iter().find(|nice| *nice >= least * (1.0 - 1e-9));
    found.unwrap_or(10.0 * power)
}

/// Returns a value with four digits that count.
pub(crate) fn brief(value: f64) -> String {
    let size = value.abs();
    if size == 0.0 {
        return "0".into();
    }
    if !(1e-3..1e6).contains(&size) {
        return format!("{value:.2e}");
    }
    let before = size.log10().floor() as i32 + 1;
    let digits = usize::try_from(4 - before.max(1)).unwrap_or(0);
    format!("{value:.digits$}")
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn marks_are_round_numbers() {
        let texts = |scale: Scale| scale.marks().map(|(_, text)| text).collect::<Vec<_>>();
        assert_eq!(
            texts(Scale::around(-0.17, 0.93, 5)),
            ["-0.5", "0.0", "0.5", "1.0"]
        );
        assert_eq!(texts(Scale::of(-10.0, 0.0, 3)), ["-10", "-5", "0"]);
        assert_eq!(
            texts(Scale::around(3e7, 5e7, 3)),
            ["3.00e7", "4.00e7", "5.00e7"]
        );
        // A constant has room on both sides.
        assert_eq!(texts(Scale::around(50.0, 50.0, 3)), ["45", "50", "55"]);
    }

    #[test]
    fn values_have_few_digits() {
        let texts = [0.0, 0.512_34, -12.345_6, 1234.56, 99_999.0, 1e-9, -3e12].map(brief);
        let expected = [
            "0", "0.512", "-12.35", "1235", "99999", "1.00e-9", "-3.00e12",
        ];
        assert_eq!(texts, expected);
    }

    proptest! {
        #[test]
        fn the_range_is_within_the_scale(low in -1e12..1e12, size in 0.0..1e12, marks in 0..30_u16) {
            let scale = Scale::around(low, low + size, marks);
            prop_assert!(scale.low <= low && low + size <= scale.high, "{scale:?}");
            prop_assert!(scale.step > 0.0 && scale.part(scale.high).to_bits() == 1_f64.to_bits());
            let count = scale.marks().count();
            prop_assert!((2..=usize::from(marks.max(2)) + 2).contains(&count), "{count}, {scale:?}");
        }
    }
}

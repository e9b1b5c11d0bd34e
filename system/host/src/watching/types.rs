//! [`Type`]: values as people and scripts read and write them.

use core::fmt;

use condor_vars::{AnyValue, ValueKind};
use serde_json::{Value as Json, json};

use crate::names::whole;

/// The type of a variable, with the labels of its values if it is a choice. It converts values to text and JSON, and
/// text to values.
#[derive(Clone, Debug)]
pub struct Type {
    /// The form in which its values are stored.
    pub kind: ValueKind,
    /// The labels of a choice, by their numbers; otherwise empty.
    pub labels: Vec<String>,
}

impl Type {
    /// Returns the exact text of a value, which [`parse`](Self::parse) reads again. The text of a choice is its label.
    #[must_use]
    pub fn text(&self, value: AnyValue) -> String {
        match value {
            AnyValue::F32(value) => format!("{value:?}"),
            AnyValue::F64(value) => format!("{value:?}"),
            AnyValue::Choice(number) => self.label(number).unwrap_or_else(|| number.to_string()),
            value => value.to_string(),
        }
    }

    /// Returns the text of a value for a column of a table. Floating-point numbers have five decimal places, and an
    /// exponent if they are very small or very large.
    #[must_use]
    pub fn brief(&self, value: AnyValue) -> String {
        let number = match value {
            AnyValue::F32(value) => f64::from(value),
            AnyValue::F64(value) => value,
            value => return self.text(value),
        };
        let size = number.abs();
        if size == 0.0 || (1e-3..1e6).contains(&size) {
            format!("{number:.5}")
        } else {
            format!("{number:.5e}")
        }
    }

    /// Converts a value to JSON: a number, a boolean, or the label of a choice. A number that is infinite or NaN
    /// becomes `null`.
    #[must_use]
    pub fn json(&self, value: AnyValue) -> Json {
        match value {
            // The shortest text that is this value, and not its digits as a longer one.
            AnyValue::F32(value) => json!(value.to_string().parse::<f64>().ok()),
            AnyValue::F64(value) => json!(value),
            AnyValue::Int(value) => json!(value),
            AnyValue::Uint(value) => json!(value),
            AnyValue::Bool(value) => json!(value),
            AnyValue::Choice(number) => match self.label(number) {
                Some(label) => json!(label),
                None => json!(number),
            },
        }
    }

    /// Parses `text` as a value of this type: a number, `true`, `false`, or the label of a choice. Whole numbers may be
    /// hexadecimal, such as `0x10` and `-0x10`.
    ///
    /// # Errors
    /// Returns an error if `text` is not a value of this type; the text of the error names `text`, and says
    /// which values are possible.
    pub fn parse(&self, text: &str) -> Result<AnyValue, String> {
        let value = match self.kind {
            ValueKind::F32 => text.parse().ok().map(AnyValue::F32),
            ValueKind::F64 => text.parse().ok().map(AnyValue::F64),
            ValueKind::I8 | ValueKind::I16 | ValueKind::I32 | ValueKind::I64 => {
                let number = whole(text).and_then(|number| number.try_into().ok());
                number.map(AnyValue::Int)
            }
            ValueKind::U8 | ValueKind::U16 | ValueKind::U32 | ValueKind::U64 => {
                let number = whole(text).and_then(|number| number.try_into().ok());
                number.map(AnyValue::Uint)
            }
            ValueKind::Bool => text.parse().ok().map(AnyValue::Bool),
            ValueKind::Choice => {
                let place = self.labels.iter().position(|label| label == text);
                let number = place.and_then(|place| u32::try_from(place).ok());
                number.or_else(|| text.parse().ok()).map(AnyValue::Choice)
            }
        };
        let fits = |value: &AnyValue| self.kind.words_of(*value).is_some();
        value.filter(fits).ok_or_else(|| match self.kind {
            ValueKind::Bool => format!("`{text}` is neither true nor false"),
            ValueKind::Choice => format!("`{text}` is not one of {}", self.labels.join(", ")),
            _ => format!("`{text}` is not a value of type {self}"),
        })
    }

    fn label(&self, number: u32) -> Option<String> {
        self.labels.get(usize::try_from(number).ok()?).cloned()
    }
}

impl fmt::Display for Type {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.kind.fmt(f)
    }
}

/// Converts a value to the nearest `f64`. A boolean becomes 0 or 1, and a choice its number.
#[expect(
    clippy::cast_precision_loss,
    reason = "as near as a floating-point number is"
)]
#[must_use]
pub fn float(value: AnyValue) -> f64 {
    match value {
        AnyValue::F32(value) => value.into(),
        AnyValue::F64(value) => value,
        AnyValue::Int(value) => value as f64,
        AnyValue::Uint(value) => value as f64,
        AnyValue::Bool(value) => u8::from(value).into(),
        AnyValue::Choice(value) => value.into(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(kind: ValueKind) -> Type {
        let labels = match kind {
            ValueKind::Choice => vec!["idle".to_owned(), "hold".to_owned()],
            _ => Vec::new(),
        };
        Type { kind, labels }
    }

    #[test]
    fn values_are_shown_as_they_are_written() {
        for (kind, text, value) in [
            (ValueKind::F32, "0.1", AnyValue::F32(0.1)),
            (ValueKind::F64, "-2.5e-9", AnyValue::F64(-2.5e-9)),
            (ValueKind::I8, "-128", AnyValue::Int(-128)),
            (
                ValueKind::U64,
                "18446744073709551615",
                AnyValue::Uint(u64::MAX),
            ),
            (ValueKind::Bool, "true", AnyValue::Bool(true)),
            (ValueKind::Choice, "hold", AnyValue::Choice(1)),
        ] {
            let it = of(kind);
            assert_eq!(it.parse(text), Ok(value));
            assert_eq!(it.text(value), text);
        }
        assert_eq!(of(ValueKind::I8).parse("-0x80"), Ok(AnyValue::Int(-128)));
        assert_eq!(
            of(ValueKind::U16).parse("0xfff_f"),
            Ok(AnyValue::Uint(65_535))
        );
        assert_eq!(of(ValueKind::Choice).parse("0"), Ok(AnyValue::Choice(0)));
        assert_eq!(of(ValueKind::Choice).text(AnyValue::Choice(7)), "7");
    }

    #[test]
    fn what_is_no_value_is_told() {
        for (kind, text, complaint) in [
            (ValueKind::F64, "soft", "`soft` is not a value of type f64"),
            (ValueKind::U8, "256", "`256` is not a value of type u8"),
            (ValueKind::U8, "-1", "`-1` is not a value of type u8"),
            (ValueKind::U8, "-0x1", "`-0x1` is not a value of type u8"),
            (ValueKind::I8, "-0x81", "`-0x81` is not a value of type i8"),
            (ValueKind::Bool, "1", "`1` is neither true nor false"),
            (ValueKind::Choice, "run", "`run` is not one of idle, hold"),
        ] {
            assert_eq!(of(kind).parse(text), Err(complaint.to_owned()));
        }
    }

    #[test]
    fn json_has_numbers_booleans_and_labels() {
        let json = |kind, value| of(kind).json(value).to_string();
        assert_eq!(json(ValueKind::F32, AnyValue::F32(0.1)), "0.1");
        assert_eq!(json(ValueKind::F64, AnyValue::F64(f64::NAN)), "null");
        assert_eq!(json(ValueKind::F32, AnyValue::F32(f32::INFINITY)), "null");
        assert_eq!(
            json(ValueKind::I64, AnyValue::Int(i64::MIN)),
            i64::MIN.to_string()
        );
        assert_eq!(json(ValueKind::Bool, AnyValue::Bool(false)), "false");
        assert_eq!(json(ValueKind::Choice, AnyValue::Choice(0)), "\"idle\"");
        assert_eq!(json(ValueKind::Choice, AnyValue::Choice(9)), "9");
    }

    #[test]
    fn columns_have_few_digits() {
        let brief = |value| of(ValueKind::F64).brief(AnyValue::F64(value));
        assert_eq!(brief(0.1 + 0.2), "0.30000");
        assert_eq!(brief(-1.5e-9), "-1.50000e-9");
        assert_eq!(brief(1e300), "1.00000e300");
        assert_eq!([brief(0.0), brief(f64::NAN)], ["0.00000", "NaN"]);
    }
}

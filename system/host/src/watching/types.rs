//! [`Type`]: values as people and scripts read and write them.

use core::fmt;

use condor_vars::{Kind, Value};
use serde_json::{Value as Json, json};

use crate::names::whole;

/// The type of a variable, and the labels of its values if it is a choice.
#[derive(Clone, Debug)]
pub struct Type {
    /// What it is stored as.
    pub kind: Kind,
    /// The labels of a choice, by their numbers; otherwise empty.
    pub labels: Vec<String>,
}

impl Type {
    /// Returns a value as exactly as it is.
    #[must_use]
    pub fn text(&self, value: Value) -> String {
        match value {
            Value::F32(value) => format!("{value:?}"),
            Value::F64(value) => format!("{value:?}"),
            Value::Choice(number) => self.label(number).unwrap_or_else(|| number.to_string()),
            value => value.to_string(),
        }
    }

    /// Returns a value with five decimal places at most, for columns.
    #[must_use]
    pub fn brief(&self, value: Value) -> String {
        let number = match value {
            Value::F32(value) => f64::from(value),
            Value::F64(value) => value,
            value => return self.text(value),
        };
        let size = number.abs();
        if size == 0.0 || (1e-3..1e6).contains(&size) {
            format!("{number:.5}")
        } else {
            format!("{number:.5e}")
        }
    }

    /// Returns a value for JSON: a number, a boolean or a label, and `null` if it is no number.
    #[must_use]
    pub fn json(&self, value: Value) -> Json {
        match value {
            // The shortest text that is this value, and not its digits as a longer one.
            Value::F32(value) => json!(value.to_string().parse::<f64>().ok()),
            Value::F64(value) => json!(value),
            Value::Int(value) => json!(value),
            Value::Uint(value) => json!(value),
            Value::Bool(value) => json!(value),
            Value::Choice(number) => match self.label(number) {
                Some(label) => json!(label),
                None => json!(number),
            },
        }
    }

    /// Returns the value that somebody has written: a number, `true`, `false`, or a label. Whole numbers may be
    /// hexadecimal, such as `0x10` and `-0x10`.
    ///
    /// # Errors
    /// A text that names `text`, and says what would be a value.
    pub fn parse(&self, text: &str) -> Result<Value, String> {
        let value = match self.kind {
            Kind::F32 => text.parse().ok().map(Value::F32),
            Kind::F64 => text.parse().ok().map(Value::F64),
            Kind::I8 | Kind::I16 | Kind::I32 | Kind::I64 => {
                let number = whole(text).and_then(|number| number.try_into().ok());
                number.map(Value::Int)
            }
            Kind::U8 | Kind::U16 | Kind::U32 | Kind::U64 => {
                let number = whole(text).and_then(|number| number.try_into().ok());
                number.map(Value::Uint)
            }
            Kind::Bool => text.parse().ok().map(Value::Bool),
            Kind::Choice => {
                let place = self.labels.iter().position(|label| label == text);
                let number = place.and_then(|place| u32::try_from(place).ok());
                number.or_else(|| text.parse().ok()).map(Value::Choice)
            }
        };
        let fits = |value: &Value| self.kind.words_of(*value).is_some();
        value.filter(fits).ok_or_else(|| match self.kind {
            Kind::Bool => format!("`{text}` is neither true nor false"),
            Kind::Choice => format!("`{text}` is not one of {}", self.labels.join(", ")),
            _ => format!("`{text}` is not a value of type {self}"),
        })
    }

    fn label(&self, number: u32) -> Option<String> {
        self.labels.get(usize::try_from(number).ok()?).cloned()
    }
}

impl fmt::Display for Type {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(&format!("{:?}", self.kind).to_lowercase())
    }
}

/// Returns a value as a number to compute with: 0 or 1 for a boolean, the number of a choice.
#[expect(
    clippy::cast_precision_loss,
    reason = "as near as a floating-point number is"
)]
#[must_use]
pub fn float(value: Value) -> f64 {
    match value {
        Value::F32(value) => value.into(),
        Value::F64(value) => value,
        Value::Int(value) => value as f64,
        Value::Uint(value) => value as f64,
        Value::Bool(value) => u8::from(value).into(),
        Value::Choice(value) => value.into(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(kind: Kind) -> Type {
        let labels = match kind {
            Kind::Choice => vec!["idle".to_owned(), "hold".to_owned()],
            _ => Vec::new(),
        };
        Type { kind, labels }
    }

    #[test]
    fn values_are_shown_as_they_are_written() {
        for (kind, text, value) in [
            (Kind::F32, "0.1", Value::F32(0.1)),
            (Kind::F64, "-2.5e-9", Value::F64(-2.5e-9)),
            (Kind::I8, "-128", Value::Int(-128)),
            (Kind::U64, "18446744073709551615", Value::Uint(u64::MAX)),
            (Kind::Bool, "true", Value::Bool(true)),
            (Kind::Choice, "hold", Value::Choice(1)),
        ] {
            let it = of(kind);
            assert_eq!(it.parse(text), Ok(value));
            assert_eq!(it.text(value), text);
        }
        assert_eq!(of(Kind::I8).parse("-0x80"), Ok(Value::Int(-128)));
        assert_eq!(of(Kind::U16).parse("0xfff_f"), Ok(Value::Uint(65_535)));
        assert_eq!(of(Kind::Choice).parse("0"), Ok(Value::Choice(0)));
        assert_eq!(of(Kind::Choice).text(Value::Choice(7)), "7");
    }

    #[test]
    fn what_is_no_value_is_told() {
        for (kind, text, complaint) in [
            (Kind::F64, "soft", "`soft` is not a value of type f64"),
            (Kind::U8, "256", "`256` is not a value of type u8"),
            (Kind::U8, "-1", "`-1` is not a value of type u8"),
            (Kind::U8, "-0x1", "`-0x1` is not a value of type u8"),
            (Kind::I8, "-0x81", "`-0x81` is not a value of type i8"),
            (Kind::Bool, "1", "`1` is neither true nor false"),
            (Kind::Choice, "run", "`run` is not one of idle, hold"),
        ] {
            assert_eq!(of(kind).parse(text), Err(complaint.to_owned()));
        }
    }

    #[test]
    fn json_has_numbers_booleans_and_labels() {
        let json = |kind, value| of(kind).json(value).to_string();
        assert_eq!(json(Kind::F32, Value::F32(0.1)), "0.1");
        assert_eq!(json(Kind::F64, Value::F64(f64::NAN)), "null");
        assert_eq!(json(Kind::F32, Value::F32(f32::INFINITY)), "null");
        assert_eq!(json(Kind::I64, Value::Int(i64::MIN)), i64::MIN.to_string());
        assert_eq!(json(Kind::Bool, Value::Bool(false)), "false");
        assert_eq!(json(Kind::Choice, Value::Choice(0)), "\"idle\"");
        assert_eq!(json(Kind::Choice, Value::Choice(9)), "9");
    }

    #[test]
    fn columns_have_few_digits() {
        let brief = |value| of(Kind::F64).brief(Value::F64(value));
        assert_eq!(brief(0.1 + 0.2), "0.30000");
        assert_eq!(brief(-1.5e-9), "-1.50000e-9");
        assert_eq!(brief(1e300), "1.00000e300");
        assert_eq!([brief(0.0), brief(f64::NAN)], ["0.00000", "NaN"]);
    }
}

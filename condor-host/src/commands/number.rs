//! Numbers and times of the command line, and values as numbers.

use std::time::Duration;

use condor_vars::Value;
use jiff::SignedDuration;

/// A word: decimal, or hexadecimal after `0x`.
pub(super) fn word(text: &str) -> Result<u32, String> {
    let digits = text.replace('_', "");
    let hexadecimal = digits
        .strip_prefix("0x")
        .or_else(|| digits.strip_prefix("0X"));
    let number = match hexadecimal {
        Some(digits) => u32::from_str_radix(digits, 16),
        None => digits.parse(),
    };
    number.map_err(|_| {
        format!(
            "`{text}` is not a number from 0 to {}, or from 0x0 to {:#x}",
            u32::MAX,
            u32::MAX
        )
    })
}

/// A time of the command line.
pub(crate) fn duration(text: &str) -> Result<Duration, String> {
    let span: SignedDuration = text
        .parse()
        .map_err(|error| format!("{error}; write a time such as 10s or 500ms"))?;
    span.try_into()
        .map_err(|_| "a time must not be negative".into())
}

/// Returns a value as a number to compute with: 0 or 1 for a boolean, the number of a choice.
#[expect(
    clippy::cast_precision_loss,
    reason = "as near as a floating-point number is"
)]
pub(super) fn float(value: Value) -> f64 {
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
    use super::word;

    #[test]
    fn words_are_decimal_or_hexadecimal() {
        assert_eq!(word("42"), Ok(42));
        assert_eq!(word("0xdead_beef"), Ok(0xdead_beef));
        for wrong in ["", "0x", "-1", "4294967296", "0x1_0000_0000", "ten"] {
            let text = word(wrong).unwrap_err();
            assert!(text.contains("4294967295"), "{text}");
        }
    }
}

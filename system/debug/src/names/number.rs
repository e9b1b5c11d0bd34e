//! [`Number`]: values that are one number, to be drawn and written.

use super::NamedValue;
use super::dwarf::Shape;

/// The type of a [`NamedValue`] that is a single number or a truth value. It converts the bytes of
/// the value into a number, and a text into such bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Number {
    encoding: gimli::DwAte,
    /// 1, 2, 4 or 8.
    bytes: usize,
}

impl NamedValue<'_, '_> {
    /// Returns the type of the value if it is a single number, a truth value, a pointer or an enum without fields, or
    /// if it wraps one, as an atomic does. Returns `None` for all other values, and for bit fields.
    #[must_use]
    pub fn number(&self) -> Option<Number> {
        if self.bits.is_some() {
            return None;
        }
        let debug = &self.names.debug;
        let mut at = self.at;
        let encoding = loop {
            match debug.shape(at) {
                Shape::Base { encoding } => break encoding,
                Shape::Pointer | Shape::Enumeration(_) => break gimli::DW_ATE_unsigned,
                Shape::Fields(fields) => {
                    let wrapped = debug.wrapped(&fields)?;
                    (wrapped.offset == 0).then_some(())?;
                    at = wrapped.at;
                }
                Shape::Variants { .. } | Shape::Array { .. } | Shape::Unknown => return None,
            }
        };
        let bytes = self.bytes;
        matches!(bytes, 1 | 2 | 4 | 8).then_some(Number { encoding, bytes })
    }
}

impl Number {
    /// Returns the number that `bytes` hold, in little-endian order; 0 for `false` and 1 for `true`. An integer of 64
    /// bits is rounded to the 53 bits that an `f64` can hold.
    #[must_use]
    #[expect(clippy::cast_precision_loss, reason = "as documented")]
    pub fn value(self, bytes: &[u8]) -> f64 {
        let mut word = [0; 8];
        for (place, byte) in word.iter_mut().zip(bytes.iter().take(self.bytes)) {
            *place = *byte;
        }
        let word = u64::from_le_bytes(word);
        let unused = 64 - 8 * self.bytes as u32;
        match (self.encoding, self.bytes) {
            (gimli::DW_ATE_float, 4) => f32::from_bits(word as u32).into(),
            (gimli::DW_ATE_float, 8) => f64::from_bits(word),
            (gimli::DW_ATE_signed | gimli::DW_ATE_signed_char, _) => {
                ((word << unused).cast_signed() >> unused) as f64
            }
            _ => word as f64,
        }
    }

    /// Returns the little-endian bytes of the value that `text` states, such as `-3`, `0x1f`, `1.5` or `true`; `None`
    /// if the type has no such value.
    #[must_use]
    pub fn bytes(self, text: &str) -> Option<Vec<u8>> {
        let word = match (self.encoding, self.bytes) {
            (gimli::DW_ATE_float, 4) => text.parse::<f32>().ok()?.to_bits().into(),
            (gimli::DW_ATE_float, 8) => text.parse::<f64>().ok()?.to_bits(),
            (gimli::DW_ATE_boolean, _) => text.parse::<bool>().ok()?.into(),
            (gimli::DW_ATE_signed | gimli::DW_ATE_signed_char, bytes) => {
                let number: i64 = text.parse().ok()?;
                let unused = 64 - 8 * bytes as u32;
                ((number << unused) >> unused == number).then_some(number.cast_unsigned())?
            }
            (gimli::DW_ATE_unsigned | gimli::DW_ATE_unsigned_char, bytes) => {
                let number = match text.strip_prefix("0x") {
                    Some(digits) => u64::from_str_radix(digits, 16).ok()?,
                    None => text.parse().ok()?,
                };
                let unused = 64 - 8 * bytes as u32;
                ((number << unused) >> unused == number).then_some(number)?
            }
            _ => return None,
        };
        let mut all = word.to_le_bytes().to_vec();
        all.truncate(self.bytes);
        Some(all)
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn number(encoding: gimli::DwAte, bytes: usize) -> Number {
        Number { encoding, bytes }
    }

    #[test]
    fn texts_outside_of_a_type_are_no_values() {
        let byte = number(gimli::DW_ATE_unsigned, 1);
        assert_eq!(byte.bytes("255"), Some(vec![255]));
        assert_eq!(byte.bytes("0xfe"), Some(vec![0xfe]));
        for wrong in ["256", "-1", "1.0", "", "0x", "true"] {
            assert_eq!(byte.bytes(wrong), None, "{wrong}");
        }
        let short = number(gimli::DW_ATE_signed, 2);
        assert_eq!(short.bytes("-32768"), Some(vec![0, 0x80]));
        assert_eq!(short.bytes("32768"), None);
        let truth = number(gimli::DW_ATE_boolean, 1);
        assert_eq!(truth.bytes("true"), Some(vec![1]));
        assert_eq!(truth.bytes("2"), None);
    }

    proptest! {
        #[test]
        fn what_is_written_is_read(value in any::<i32>(), float in any::<f32>()) {
            let signed = number(gimli::DW_ATE_signed, 4);
            let bytes = signed.bytes(&value.to_string()).expect("it fits");
            prop_assert!((signed.value(&bytes) - f64::from(value)).abs() < 0.5);
            let floating = number(gimli::DW_ATE_float, 4);
            let bytes = floating.bytes(&float.to_string()).expect("it is one");
            prop_assert_eq!(floating.value(&bytes).to_bits(), f64::from(float).to_bits());
        }
    }
}

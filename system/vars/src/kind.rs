//! [`ValueKind`] and [`AnyValue`]: types and values that are known only at run time.

use core::fmt;
use core::mem::discriminant;

/// The type of the value of a variable, a parameter or a field, as a table states it.
///
/// The value of a variable is stored in one 32-bit word, or in two for 64 bits, the lower first.
/// Narrow integers are extended to a word with their sign; `false` is 0.
///
/// ```
/// use condor_vars::{AnyValue, ValueKind};
///
/// assert_eq!(ValueKind::I16.value([u32::MAX, 0]), AnyValue::Int(-1));
/// assert_eq!(ValueKind::from_code(ValueKind::F64 as u32), Some(ValueKind::F64));
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[repr(u8)]
pub enum ValueKind {
    /// `f32`.
    F32 = 1,
    /// `f64`.
    F64 = 2,
    /// `i8`.
    I8 = 3,
    /// `i16`.
    I16 = 4,
    /// `i32`.
    I32 = 5,
    /// `i64`.
    I64 = 6,
    /// `u8`.
    U8 = 7,
    /// `u16`.
    U16 = 8,
    /// `u32`.
    U32 = 9,
    /// `u64`.
    U64 = 10,
    /// `bool`, stored as 0 or 1.
    Bool = 11,
    /// A small enum, stored as the number of one of its labels.
    Choice = 12,
}

impl fmt::Display for ValueKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(match self {
            Self::F32 => "f32",
            Self::F64 => "f64",
            Self::I8 => "i8",
            Self::I16 => "i16",
            Self::I32 => "i32",
            Self::I64 => "i64",
            Self::U8 => "u8",
            Self::U16 => "u16",
            Self::U32 => "u32",
            Self::U64 => "u64",
            Self::Bool => "bool",
            Self::Choice => "choice",
        })
    }
}

/// A value whose type is known only at run time.
///
/// ```
/// use condor_vars::{AnyValue, ValueKind};
///
/// let angle = AnyValue::F32(0.5);
/// assert_eq!(angle.to_string(), "0.5");
/// assert_eq!(ValueKind::F32.words_of(angle), Some([0.5_f32.to_bits(), 0]));
/// ```
#[derive(Clone, Copy, Debug, PartialEq, PartialOrd)]
pub enum AnyValue {
    /// A value of [`ValueKind::F32`].
    F32(f32),
    /// A value of [`ValueKind::F64`].
    F64(f64),
    /// A signed integer of any size.
    Int(i64),
    /// An unsigned integer of any size.
    Uint(u64),
    /// A value of [`ValueKind::Bool`].
    Bool(bool),
    /// A value of [`ValueKind::Choice`]: the number of its label.
    Choice(u32),
}

impl ValueKind {
    const ALL: [Self; 12] = [
        Self::F32,
        Self::F64,
        Self::I8,
        Self::I16,
        Self::I32,
        Self::I64,
        Self::U8,
        Self::U16,
        Self::U32,
        Self::U64,
        Self::Bool,
        Self::Choice,
    ];

    /// Returns the kind whose number in a table is `code`; `None` if no kind has this number.
    #[must_use]
    pub fn from_code(code: u32) -> Option<Self> {
        Self::ALL.get((code as usize).checked_sub(1)?).copied()
    }

    /// Returns the number of 32-bit words of a variable of this kind: 1 or 2.
    #[must_use]
    pub const fn words(self) -> usize {
        match self {
            Self::F64 | Self::I64 | Self::U64 => 2,
            _ => 1,
        }
    }

    /// Returns the size of a field of this kind in a published struct, in bytes; a `Choice` has
    /// four.
    #[must_use]
    pub const fn bytes(self) -> usize {
        match self {
            Self::I8 | Self::U8 | Self::Bool => 1,
            Self::I16 | Self::U16 => 2,
            _ => 4 * self.words(),
        }
    }

    /// Returns the value of this kind that `words` hold, the lower word first. A kind of one word
    /// ignores the second word.
    #[must_use]
    pub fn value(self, words: [u32; 2]) -> AnyValue {
        let ([low, _], long) = (words, join(words));
        match self {
            Self::F32 => AnyValue::F32(f32::from_bits(low)),
            Self::F64 => AnyValue::F64(f64::from_bits(long)),
            Self::I8 => AnyValue::Int((low as i8).into()),
            Self::I16 => AnyValue::Int((low as i16).into()),
            Self::I32 => AnyValue::Int(low.cast_signed().into()),
            Self::I64 => AnyValue::Int(long.cast_signed()),
            Self::U8 => AnyValue::Uint((low as u8).into()),
            Self::U16 => AnyValue::Uint((low as u16).into()),
            Self::U32 => AnyValue::Uint(low.into()),
            Self::U64 => AnyValue::Uint(long),
            Self::Bool => AnyValue::Bool(low != 0),
            Self::Choice => AnyValue::Choice(low),
        }
    }

    /// Returns the value of this kind that `bytes` hold: the bytes of a field of a published
    /// struct, in little-endian order. Returns `None` if there are too few bytes; ignores further
    /// bytes.
    #[must_use]
    pub fn value_of_bytes(self, bytes: &[u8]) -> Option<AnyValue> {
        let field = bytes.get(..self.bytes())?.iter().rev();
        let long = field.fold(0, |long, byte| long << 8 | u64::from(*byte));
        Some(self.value(split(long)))
    }

    /// Splits the first value, which must be of this kind, off the words of a row. Returns the
    /// value and the words after it; `None` if there are too few words.
    ///
    /// ```
    /// use condor_vars::{ValueKind, AnyValue};
    ///
    /// let (value, rest) = ValueKind::I32.split(&[u32::MAX, 7]).unwrap();
    /// assert_eq!(value, AnyValue::Int(-1));
    /// assert_eq!(rest, [7]);
    /// ```
    #[must_use]
    pub fn split(self, words: &[u32]) -> Option<(AnyValue, &[u32])> {
        let (own, rest) = words.split_at_checked(self.words())?;
        let low = own.first().copied()?;
        let high = own.get(1).copied().unwrap_or(0);
        Some((self.value([low, high]), rest))
    }

    /// Returns the words that store `value` as this kind, the lower word first. Returns `None` if
    /// `value` is of another kind, or does not fit into this one.
    #[must_use]
    pub fn words_of(self, value: AnyValue) -> Option<[u32; 2]> {
        let [low, high] = split(value.bits());
        let words = [low, if self.words() == 2 { high } else { 0 }];
        let found = self.value(words);
        let is_same = discriminant(&found) == discriminant(&value) && found.bits() == value.bits();
        is_same.then_some(words)
    }
}

impl AnyValue {
    fn bits(self) -> u64 {
        match self {
            Self::F32(value) => value.to_bits().into(),
            Self::F64(value) => value.to_bits(),
            Self::Int(value) => value.cast_unsigned(),
            Self::Uint(value) => value,
            Self::Bool(value) => value.into(),
            Self::Choice(value) => value.into(),
        }
    }
}

/// Prints the value; a choice is printed as its number, since its label is in the table.
///
/// Floating point is printed with as many digits as distinguish it from all other numbers. `core`'s
/// own printing has paths that panic, and the code of a control processor must have none.
impl fmt::Display for AnyValue {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::F32(value) => f.write_str(zmij::Buffer::new().format(*value)),
            Self::F64(value) => f.write_str(zmij::Buffer::new().format(*value)),
            Self::Int(value) => value.fmt(f),
            Self::Uint(value) => value.fmt(f),
            Self::Bool(value) => value.fmt(f),
            Self::Choice(value) => value.fmt(f),
        }
    }
}

pub(crate) const fn split(long: u64) -> [u32; 2] {
    [long as u32, (long >> 32) as u32]
}

pub(crate) const fn join([low, high]: [u32; 2]) -> u64 {
    (high as u64) << 32 | low as u64
}

#[cfg(test)]
mod tests {
    use super::{AnyValue, ValueKind};

    #[test]
    fn codes_values_and_words_agree() {
        let int = [i64::from(i8::MIN), -2, i32::MIN.into(), i64::MIN].map(AnyValue::Int);
        let uint = [255, 65_535, u32::MAX.into(), u64::MAX].map(AnyValue::Uint);
        let floats = [AnyValue::F32(-0.5), AnyValue::F64(1e300)];
        let others = [AnyValue::Bool(true), AnyValue::Choice(3)];
        let values = floats.into_iter().chain(int).chain(uint).chain(others);
        for ((code, kind), value) in (1..).zip(ValueKind::ALL).zip(values) {
            assert_eq!(kind as u32, code);
            assert_eq!(ValueKind::from_code(code), Some(kind));
            assert_eq!(kind.value(kind.words_of(value).unwrap()), value);
        }
        assert_eq!(ValueKind::from_code(0), None);
        assert_eq!(ValueKind::from_code(13), None);
        assert_eq!(ValueKind::U8.words_of(AnyValue::Uint(256)), None);
        assert_eq!(ValueKind::I8.words_of(AnyValue::Int(128)), None);
        assert_eq!(ValueKind::F32.words_of(AnyValue::F64(1.0)), None);
    }

    #[test]
    fn fields_have_their_signs() {
        assert_eq!(
            ValueKind::I8.value_of_bytes(&[0xff, 7]),
            Some(AnyValue::Int(-1))
        );
        assert_eq!(
            ValueKind::U16.value_of_bytes(&[1, 2]),
            Some(AnyValue::Uint(513))
        );
        assert_eq!(ValueKind::F64.value_of_bytes(&[0; 7]), None);
    }
}

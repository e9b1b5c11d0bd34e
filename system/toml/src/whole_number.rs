use core::fmt;
use core::marker::PhantomData;

use serde::de::{self, Deserialize, Deserializer, Unexpected, Visitor};

/// A whole number from `LEAST` to `MOST` that is a multiple of `UNIT`, to be read by serde. Reading
/// any other number is an error.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct WholeNumber<T, const LEAST: i64, const MOST: i64, const UNIT: i64 = 1>(
    /// The number.
    pub T,
);

impl<'de, T: TryFrom<i64>, const LEAST: i64, const MOST: i64, const UNIT: i64> Deserialize<'de>
    for WholeNumber<T, LEAST, MOST, UNIT>
{
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let within = Within::<T, LEAST, MOST, UNIT>(PhantomData);
        deserializer.deserialize_i64(within).map(Self)
    }
}

struct Within<T, const LEAST: i64, const MOST: i64, const UNIT: i64>(PhantomData<T>);

impl<T: TryFrom<i64>, const LEAST: i64, const MOST: i64, const UNIT: i64> Visitor<'_>
    for Within<T, LEAST, MOST, UNIT>
{
    type Value = T;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match UNIT {
            1 => f.write_str("a whole number")?,
            _ => write!(f, "a multiple of {UNIT}")?,
        }
        write!(f, " from {LEAST} to {MOST}")
    }

    fn visit_i64<E: de::Error>(self, number: i64) -> Result<T, E> {
        let is_right = (LEAST..=MOST).contains(&number) && number % UNIT == 0;
        let number_ = is_right.then(|| T::try_from(number).ok()).flatten();
        number_.ok_or_else(|| E::invalid_value(Unexpected::Signed(number), &self))
    }
}

//! Every number of a hand, wherever it is: a serializer that writes nothing and looks at each.

use core::fmt::{self, Display, Write};

use serde::ser::{self, Serialize};

use super::place::{Path, resolve};
use crate::Requirement;
use crate::config::{Hand, Mistake};
use crate::math::{abs, is_finite};

/// The largest number that a hand may have, to either side: products of some such numbers are finite.
const MOST: f64 = 1e15;

/// Refuses a number that is not finite, and one that is too large to compute with.
pub(super) fn examine<const FINGERS: usize, const JOINTS: usize>(
    hand: &Hand<FINGERS, JOINTS>,
    path: &mut Path,
) -> Result<(), Mistake> {
    path.clear();
    let Err(Beyond(value)) = hand.serialize(&mut Walk { path: &mut *path }) else {
        return Ok(());
    };
    let place = resolve(hand, path);
    let must = if !is_finite(value) {
        Requirement::Finite
    } else if value > MOST {
        Requirement::AtMost(MOST)
    } else {
        Requirement::AtLeast(-MOST)
    };
    Err(Mistake::Number { place, value, must })
}

#[derive(Debug)]
struct Beyond(f64);

/// On the way through a value; a walk that ends early leaves the way there in `path`.
struct Walk<'p> {
    path: &'p mut Path,
}

/// Among the entries of a list.
struct Entries<'w, 'p> {
    walk: &'w mut Walk<'p>,
    next: usize,
}

impl Walk<'_> {
    fn field<V: Serialize + ?Sized>(&mut self, key: &str, value: &V) -> Result<(), Beyond> {
        let before = self.path.len();
        let dot = if before == 0 { "" } else { "." };
        self.step(before, format_args!("{dot}{key}"), value)
    }

    fn step<V: Serialize + ?Sized>(
        &mut self,
        before: usize,
        step: fmt::Arguments<'_>,
        value: &V,
    ) -> Result<(), Beyond> {
        // What does not fit leads to what is around it.
        let _ = self.path.write_fmt(step);
        value.serialize(&mut *self)?;
        // Not `truncate`, which panics within a character.
        while self.path.len() > before {
            self.path.pop();
        }
        Ok(())
    }
}

impl Display for Beyond {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} is not within 1e15", self.0)
    }
}

impl core::error::Error for Beyond {}

impl ser::Error for Beyond {
    /// No type of a hand has a reason of its own to fail.
    fn custom<M: Display>(_: M) -> Self {
        Self(f64::NAN)
    }
}

macro_rules! passes {
    ($($method:ident: $type:ty),* $(,)?) => {
        $(fn $method(self, _: $type) -> Result<(), Beyond> {
            Ok(())
        })*
    };
}

impl<'w, 'p> ser::Serializer for &'w mut Walk<'p> {
    type Ok = ();
    type Error = Beyond;
    type SerializeSeq = Entries<'w, 'p>;
    type SerializeTuple = Entries<'w, 'p>;
    type SerializeTupleStruct = Entries<'w, 'p>;
    type SerializeTupleVariant = Entries<'w, 'p>;
    type SerializeMap = ser::Impossible<(), Beyond>;
    type SerializeStruct = Self;
    type SerializeStructVariant = Self;

    passes! {
        serialize_bool: bool, serialize_i8: i8, serialize_i16: i16, serialize_i32: i32,
        serialize_i64: i64, serialize_u8: u8, serialize_u16: u16, serialize_u32: u32,
        serialize_u64: u64, serialize_char: char, serialize_str: &str, serialize_bytes: &[u8],
        serialize_unit_struct: &'static str,
    }

    fn serialize_f32(self, value: f32) -> Result<(), Beyond> {
        self.serialize_f64(value.into())
    }

    fn serialize_f64(self, value: f64) -> Result<(), Beyond> {
        // Neither is a NaN.
        if abs(value) <= MOST {
            Ok(())
        } else {
            Err(Beyond(value))
        }
    }

    fn serialize_none(self) -> Result<(), Beyond> {
        Ok(())
    }

    fn serialize_some<V: Serialize + ?Sized>(self, value: &V) -> Result<(), Beyond> {
        value.serialize(self)
    }

    fn serialize_unit(self) -> Result<(), Beyond> {
        Ok(())
    }

    fn serialize_unit_variant(
        self,
        _: &'static str,
        _: u32,
        _: &'static str,
    ) -> Result<(), Beyond> {
        Ok(())
    }

    fn serialize_newtype_struct<V: Serialize + ?Sized>(
        self,
        _: &'static str,
        value: &V,
    ) -> Result<(), Beyond> {
        value.serialize(self)
    }

    fn serialize_newtype_variant<V: Serialize + ?Sized>(
        self,
        _: &'static str,
        _: u32,
        variant: &'static str,
        value: &V,
    ) -> Result<(), Beyond> {
        self.field(variant, value)
    }

    fn serialize_seq(self, _: Option<usize>) -> Result<Entries<'w, 'p>, Beyond> {
        Ok(Entries {
            walk: self,
            next: 0,
        })
    }

    fn serialize_tuple(self, _: usize) -> Result<Entries<'w, 'p>, Beyond> {
        Ok(Entries {
            walk: self,
            next: 0,
        })
    }

    fn serialize_tuple_struct(self, _: &'static str, _: usize) -> Result<Entries<'w, 'p>, Beyond> {
        Ok(Entries {
            walk: self,
            next: 0,
        })
    }

    fn serialize_tuple_variant(
        self,
        _: &'static str,
        _: u32,
        _: &'static str,
        _: usize,
    ) -> Result<Entries<'w, 'p>, Beyond> {
        Ok(Entries {
            walk: self,
            next: 0,
        })
    }

    fn serialize_map(self, _: Option<usize>) -> Result<Self::SerializeMap, Beyond> {
        Err(ser::Error::custom("no type of a hand is a map"))
    }

    fn serialize_struct(self, _: &'static str, _: usize) -> Result<Self, Beyond> {
        Ok(self)
    }

    fn serialize_struct_variant(
        self,
        _: &'static str,
        _: u32,
        variant: &'static str,
        _: usize,
    ) -> Result<Self, Beyond> {
        let dot = if self.path.is_empty() { "" } else { "." };
        let _ = write!(self.path, "{dot}{variant}");
        Ok(self)
    }

    fn collect_str<V: Display + ?Sized>(self, _: &V) -> Result<(), Beyond> {
        Ok(())
    }
}

impl Entries<'_, '_> {
    fn entry<V: Serialize + ?Sized>(&mut self, value: &V) -> Result<(), Beyond> {
        let before = self.walk.path.len();
        let index = self.next;
        self.next += 1;
        self.walk.step(before, format_args!("[{index}]"), value)
    }
}

/// The parts of a value, each of which is walked through by a method of the walker.
macro_rules! parts {
    ($($walker:ty, $part:ident: $($of:ident . $method:ident($($key:ident)?)),*;)*) => { $($(
        impl ser::$of for $walker {
            type Ok = ();
            type Error = Beyond;

            fn $method<V: Serialize + ?Sized>(
                &mut self,
                $($key: &'static str,)?
                value: &V,
            ) -> Result<(), Beyond> {
                self.$part($($key,)? value)
            }

            fn end(self) -> Result<(), Beyond> {
                Ok(())
            }
        }
    )*)* };
}

parts! {
    Entries<'_, '_>, entry: SerializeSeq.serialize_element(), SerializeTuple.serialize_element(),
        SerializeTupleStruct.serialize_field(), SerializeTupleVariant.serialize_field();
    &mut Walk<'_>, field: SerializeStruct.serialize_field(key),
        SerializeStructVariant.serialize_field(key);
}

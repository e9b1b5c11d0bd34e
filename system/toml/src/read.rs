//! A value as a deserializer whose errors have their places in the text.

use core::convert::Infallible;
use core::fmt;
use std::borrow::Cow;

use serde::de::value::{MapDeserializer, SeqDeserializer};
use serde::de::{
    self, Deserialize, Deserializer, EnumAccess, Error as _, IntoDeserializer, Unexpected,
    VariantAccess, Visitor,
};
use serde::forward_to_deserialize_any;
use serde_spanned::de::{SpannedDeserializer, is_spanned};
use toml::Spanned;
use toml::de::DeValue;

use crate::Misreading;

/// Reads `value`, which is a part of a text, into a `T` by serde.
///
/// A program may insert tables that the text does not have. An inserted table has the same span as
/// the table around it; a key that is missing in it is reported as missing in that outer table.
///
/// # Errors
/// [`Misreading`] for the first mistake in the order of the text; a missing key of a table comes after
/// the other mistakes of that table.
pub fn read<'de, T: Deserialize<'de>>(value: &'de Spanned<DeValue<'_>>) -> Result<T, Misreading> {
    T::deserialize(Value {
        value,
        way: String::new(),
    })
}

struct Value<'de, 't> {
    value: &'de Spanned<DeValue<'t>>,
    /// The keys that lead here from the table in which this one was filled in, each with a dot after it.
    way: String,
}

#[derive(Clone, Copy)]
struct Key<'de, 't>(&'de Spanned<Cow<'t, str>>);

impl<'de> IntoDeserializer<'de, Misreading> for Value<'de, '_> {
    type Deserializer = Self;

    fn into_deserializer(self) -> Self {
        self
    }
}

impl<'de> IntoDeserializer<'de, Misreading> for Key<'de, '_> {
    type Deserializer = Self;

    fn into_deserializer(self) -> Self {
        self
    }
}

impl<'de> Deserializer<'de> for Key<'de, '_> {
    type Error = Misreading;

    fn deserialize_any<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Misreading> {
        visitor
            .visit_borrowed_str(self.0.get_ref())
            .map_err(|fault: Misreading| fault.within(&self.0.span()))
    }

    fn deserialize_struct<V: Visitor<'de>>(
        self,
        name: &'static str,
        _: &'static [&'static str],
        visitor: V,
    ) -> Result<V::Value, Misreading> {
        if is_spanned(name) {
            return visitor.visit_map(SpannedDeserializer::new(self, self.0.span()));
        }
        self.deserialize_any(visitor)
    }

    forward_to_deserialize_any! {
        bool i8 i16 i32 i64 u8 u16 u32 u64 f32 f64 char str string bytes byte_buf option unit
        unit_struct newtype_struct seq tuple tuple_struct map enum identifier ignored_any
    }
}

impl<'de, 't> Value<'de, 't> {
    fn entry(&self, key: &str, value: &'de Spanned<DeValue<'t>>) -> Self {
        let is_filled_in = value.get_ref().is_table() && value.span() == self.value.span();
        let way = if is_filled_in {
            format!("{}{key}.", self.way)
        } else {
            String::new()
        };
        Self { value, way }
    }

    fn visit<V: Visitor<'de>>(&self, visitor: V) -> Result<V::Value, Misreading> {
        let beyond = |number: &str| {
            Misreading::from(format!(
                "{number} stands where a number of 64 bits should be"
            ))
        };
        match self.value.get_ref() {
            DeValue::Table(table) => {
                let mut entries: Vec<_> = table.iter().collect();
                // In the order of the text, so that its first mistake is the one that is reported.
                entries.sort_by_key(|(key, _)| key.span().start);
                let entries = entries
                    .into_iter()
                    .map(|(key, value)| (Key(key), self.entry(key.get_ref(), value)));
                visitor.visit_map(&mut MapDeserializer::new(entries))
            }
            DeValue::Array(list) => {
                let entries = list.iter().map(|value| {
                    let way = String::new();
                    Value { value, way }
                });
                let mut entries = SeqDeserializer::new(entries);
                let value = visitor.visit_seq(&mut entries);
                let value = value.map_err(|fault: Misreading| fault.surplus(list))?;
                // An array takes as many as it has places, and leaves the rest.
                entries.end().map(|()| value)
            }
            DeValue::String(text) => visitor.visit_borrowed_str(text),
            DeValue::Integer(number) => {
                let value = i64::from_str_radix(number.as_str(), number.radix());
                visitor.visit_i64(value.map_err(|_| beyond(number.as_str()))?)
            }
            DeValue::Float(number) => {
                let value = number.as_str().parse();
                visitor.visit_f64(value.map_err(|_| beyond(number.as_str()))?)
            }
            DeValue::Boolean(value) => visitor.visit_bool(*value),
            DeValue::Datetime(_) => Err(Misreading::invalid_type(
                Unexpected::Other("a time"),
                &visitor,
            )),
        }
    }
}

impl<'de> Deserializer<'de> for Value<'de, '_> {
    type Error = Misreading;

    fn deserialize_any<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Misreading> {
        self.visit(visitor)
            .map_err(|fault| fault.lacking(&self.way).within(&self.value.span()))
    }

    fn deserialize_option<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Misreading> {
        visitor.visit_some(self)
    }

    fn deserialize_newtype_struct<V: Visitor<'de>>(
        self,
        _: &'static str,
        visitor: V,
    ) -> Result<V::Value, Misreading> {
        visitor.visit_newtype_struct(self)
    }

    fn deserialize_struct<V: Visitor<'de>>(
        self,
        name: &'static str,
        _: &'static [&'static str],
        visitor: V,
    ) -> Result<V::Value, Misreading> {
        if is_spanned(name) {
            let span = self.value.span();
            let spanned = SpannedDeserializer::new(self, span.clone());
            let value = visitor.visit_map(spanned);
            return value.map_err(|fault: Misreading| fault.within(&span));
        }
        self.deserialize_any(visitor)
    }

    fn deserialize_enum<V: Visitor<'de>>(
        self,
        _: &'static str,
        _: &'static [&'static str],
        visitor: V,
    ) -> Result<V::Value, Misreading> {
        let only = match self.value.get_ref() {
            DeValue::Table(entries) if entries.len() == 1 => entries.iter().next(),
            _ => None,
        };
        let value = match (self.value.get_ref(), only) {
            (DeValue::String(word), _) => visitor.visit_enum(word.as_ref().into_deserializer()),
            (_, Some((key, value))) => {
                let value = self.entry(key.get_ref(), value);
                visitor.visit_enum(Choice(Key(key), value))
            }
            _ => {
                let expected = "a word, or a table with the one key that chooses";
                Err(Misreading::unsuitable(self.value, expected))
            }
        };
        value.map_err(|fault: Misreading| fault.within(&self.value.span()))
    }

    forward_to_deserialize_any! {
        bool i8 i16 i32 i64 u8 u16 u32 u64 f32 f64 char str string bytes byte_buf unit unit_struct
        seq tuple tuple_struct map identifier ignored_any
    }
}

/// Refuses every value.
struct Refusal<'a>(&'a str);

impl Visitor<'_> for Refusal<'_> {
    type Value = Infallible;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.0)
    }
}

impl Misreading {
    /// Makes a `Misreading` which says that `value` stands where `expected`, a description in
    /// words, should be.
    #[must_use]
    pub fn unsuitable(value: &Spanned<DeValue<'_>>, expected: &str) -> Self {
        let way = String::new();
        match (Value { value, way }).deserialize_any(Refusal(expected)) {
            Ok(never) => match never {},
            Err(fault) => fault,
        }
    }
}

/// A table with one key, which chooses a variant.
struct Choice<'de, 't>(Key<'de, 't>, Value<'de, 't>);

impl<'de> EnumAccess<'de> for Choice<'de, '_> {
    type Error = Misreading;
    type Variant = Self;

    fn variant_seed<V: de::DeserializeSeed<'de>>(
        self,
        seed: V,
    ) -> Result<(V::Value, Self), Misreading> {
        Ok((seed.deserialize(self.0)?, self))
    }
}

impl<'de> VariantAccess<'de> for Choice<'de, '_> {
    type Error = Misreading;

    fn unit_variant(self) -> Result<(), Misreading> {
        let Key(key) = self.0;
        let problem = format!("a table stands where the word \"{key}\" should be");
        Err(Misreading::at(&key.span(), problem))
    }

    fn newtype_variant_seed<T: de::DeserializeSeed<'de>>(
        self,
        seed: T,
    ) -> Result<T::Value, Misreading> {
        seed.deserialize(self.1)
    }

    fn tuple_variant<V: Visitor<'de>>(self, _: usize, visitor: V) -> Result<V::Value, Misreading> {
        self.1.deserialize_any(visitor)
    }

    fn struct_variant<V: Visitor<'de>>(
        self,
        _: &'static [&'static str],
        visitor: V,
    ) -> Result<V::Value, Misreading> {
        self.1.deserialize_any(visitor)
    }
}

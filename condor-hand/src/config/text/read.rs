//! The tree as a deserializer whose errors know where they are.

use serde::de::value::{MapDeserializer, SeqDeserializer};
use serde::de::{self, IntoDeserializer, Visitor};
use serde::forward_to_deserialize_any;

use super::problem::{Fault, Problem};
use super::tree::{Key, Node, Value};

impl<'de> IntoDeserializer<'de, Fault> for &'de Node {
    type Deserializer = Self;

    fn into_deserializer(self) -> Self {
        self
    }
}

impl<'de> IntoDeserializer<'de, Fault> for &'de Key {
    type Deserializer = Self;

    fn into_deserializer(self) -> Self {
        self
    }
}

impl<'de> de::Deserializer<'de> for &'de Key {
    type Error = Fault;

    fn deserialize_any<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Fault> {
        visitor
            .visit_borrowed_str(&self.name)
            .map_err(|fault: Fault| fault.within(&self.span))
    }

    forward_to_deserialize_any! {
        bool i8 i16 i32 i64 u8 u16 u32 u64 f32 f64 char str string bytes byte_buf option unit
        unit_struct newtype_struct seq tuple tuple_struct map struct enum identifier ignored_any
    }
}

impl<'de> de::Deserializer<'de> for &'de Node {
    type Error = Fault;

    fn deserialize_any<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Fault> {
        let value = match &self.value {
            Value::Table(entries) => {
                let entries = entries.iter().map(|(key, node)| (key, node));
                let mut map = MapDeserializer::new(entries);
                visitor.visit_map(&mut map)
            }
            Value::List(list) => {
                let mut entries = SeqDeserializer::new(list.iter());
                let value = visitor.visit_seq(&mut entries);
                // An array takes as many as it has places, and leaves the rest.
                value.and_then(|value| entries.end().map(|()| value))
            }
            Value::Text(text) => visitor.visit_borrowed_str(text),
            Value::Integer(integer) => visitor.visit_i64(*integer),
            Value::Float(float) => visitor.visit_f64(*float),
            Value::Bool(value) => visitor.visit_bool(*value),
            Value::Time => Err(Problem::Unsuitable {
                found: "a time".into(),
                expected: "a number, a text, a list or a table".into(),
            }
            .into()),
        };
        value.map_err(|fault| fault.lacking(self).within(&self.span))
    }

    fn deserialize_option<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Fault> {
        visitor.visit_some(self)
    }

    fn deserialize_enum<V: Visitor<'de>>(
        self,
        _: &'static str,
        _: &'static [&'static str],
        visitor: V,
    ) -> Result<V::Value, Fault> {
        let value = match &self.value {
            Value::Text(word) => visitor.visit_enum(word.as_str().into_deserializer()),
            Value::Table(entries) => match entries.as_slice() {
                [(key, node)] => visitor.visit_enum(Choice { key, node }),
                _ => Err(Problem::Length {
                    length: entries.len(),
                    expected: "a table with the one key that chooses".into(),
                }
                .into()),
            },
            _ => Err(Problem::Unsuitable {
                found: "a value".into(),
                expected: "a word, or a table with the one key that chooses".into(),
            }
            .into()),
        };
        value.map_err(|fault: Fault| fault.within(&self.span))
    }

    forward_to_deserialize_any! {
        bool i8 i16 i32 i64 u8 u16 u32 u64 f32 f64 char str string bytes byte_buf unit unit_struct
        newtype_struct seq tuple tuple_struct map struct identifier ignored_any
    }
}

/// A table with one key, which chooses a variant.
struct Choice<'de> {
    key: &'de Key,
    node: &'de Node,
}

impl<'de> de::EnumAccess<'de> for Choice<'de> {
    type Error = Fault;
    type Variant = Self;

    fn variant_seed<V: de::DeserializeSeed<'de>>(self, seed: V) -> Result<(V::Value, Self), Fault> {
        Ok((seed.deserialize(self.key)?, self))
    }
}

impl<'de> de::VariantAccess<'de> for Choice<'de> {
    type Error = Fault;

    fn unit_variant(self) -> Result<(), Fault> {
        let problem = Problem::Unsuitable {
            found: "a table".into(),
            expected: std::format!("the word \"{}\"", self.key.name),
        };
        Err(Fault::at(&self.key.span, problem))
    }

    fn newtype_variant_seed<T: de::DeserializeSeed<'de>>(self, seed: T) -> Result<T::Value, Fault> {
        seed.deserialize(self.node)
    }

    fn tuple_variant<V: Visitor<'de>>(self, _: usize, visitor: V) -> Result<V::Value, Fault> {
        de::Deserializer::deserialize_any(self.node, visitor)
    }

    fn struct_variant<V: Visitor<'de>>(
        self,
        _: &'static [&'static str],
        visitor: V,
    ) -> Result<V::Value, Fault> {
        de::Deserializer::deserialize_any(self.node, visitor)
    }
}

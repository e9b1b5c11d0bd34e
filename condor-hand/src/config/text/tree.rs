//! TOML as a tree whose every key and value knows where it stands.

use core::ops::Range;
use std::string::String;
use std::vec::Vec;

use toml::Spanned;
use toml::de::{DeTable, DeValue};

use super::problem::{Fault, Problem};

/// A value and where it stands.
#[derive(Clone, Debug)]
pub(super) struct Node {
    pub(super) span: Range<usize>,
    pub(super) value: Value,
    /// Where a key belongs that is missing here, if this is a table of defaults.
    pub(super) filled_in: Option<FilledIn>,
}

/// The table that a table of defaults was filled in.
#[derive(Clone, Debug)]
pub(super) struct FilledIn {
    pub(super) span: Range<usize>,
    /// The keys from there to the table of defaults.
    pub(super) way: String,
}

/// A key and where it stands.
#[derive(Clone, Debug)]
pub(super) struct Key {
    pub(super) span: Range<usize>,
    pub(super) name: String,
}

#[derive(Clone, Debug)]
pub(super) enum Value {
    Table(Vec<(Key, Node)>),
    List(Vec<Node>),
    Text(String),
    Integer(i64),
    Float(f64),
    Bool(bool),
    /// A date or a time, which no key of a hand has.
    Time,
}

impl Node {
    pub(super) fn parse(text: &str) -> Result<Self, Fault> {
        let table = DeTable::parse(text).map_err(|error| {
            let message = error.message().into();
            let span = error.span().unwrap_or_default();
            Fault::at(&span, Problem::Syntax { message })
        })?;
        let span = table.span();
        Self::table(table.get_ref(), span)
    }

    fn table(table: &DeTable<'_>, span: Range<usize>) -> Result<Self, Fault> {
        let mut entries = Vec::new();
        for (key, value) in table {
            let name = String::from(key.get_ref().as_ref());
            let span = key.span();
            entries.push((Key { span, name }, Self::from_value(value)?));
        }
        // In the order of the file, so that its first problem is the one that is told.
        entries.sort_by_key(|(key, _)| key.span.start);
        let value = Value::Table(entries);
        Ok(Self::new(span, value))
    }

    fn new(span: Range<usize>, value: Value) -> Self {
        Self {
            span,
            value,
            filled_in: None,
        }
    }

    fn from_value(node: &Spanned<DeValue<'_>>) -> Result<Self, Fault> {
        let span = node.span();
        let unsuitable = |found: &str| {
            let (found, expected) = (found.into(), "a number of 64 bits".into());
            Fault::at(&node.span(), Problem::Unsuitable { found, expected })
        };
        let value = match node.get_ref() {
            DeValue::String(text) => Value::Text(text.as_ref().into()),
            DeValue::Integer(integer) => {
                let parsed = i64::from_str_radix(integer.as_str(), integer.radix());
                Value::Integer(parsed.map_err(|_| unsuitable(integer.as_str()))?)
            }
            DeValue::Float(float) => {
                let parsed = float.as_str().parse();
                Value::Float(parsed.map_err(|_| unsuitable(float.as_str()))?)
            }
            DeValue::Boolean(value) => Value::Bool(*value),
            DeValue::Datetime(_) => Value::Time,
            DeValue::Array(list) => Value::List(
                list.iter()
                    .map(Self::from_value)
                    .collect::<Result<_, _>>()?,
            ),
            DeValue::Table(table) => return Self::table(table, span),
        };
        Ok(Self::new(span, value))
    }

    pub(super) fn get(&self, name: &str) -> Option<&Self> {
        let Value::Table(entries) = &self.value else {
            return None;
        };
        let mut entries = entries.iter();
        entries
            .find(|(key, _)| key.name == name)
            .map(|(_, node)| node)
    }

    pub(super) fn get_mut(&mut self, name: &str) -> Option<&mut Self> {
        let Value::Table(entries) = &mut self.value else {
            return None;
        };
        let mut entries = entries.iter_mut();
        entries
            .find(|(key, _)| key.name == name)
            .map(|(_, node)| node)
    }

    /// Takes an entry out of a table.
    pub(super) fn take(&mut self, name: &str) -> Option<Self> {
        let Value::Table(entries) = &mut self.value else {
            return None;
        };
        let place = entries.iter().position(|(key, _)| key.name == name)?;
        Some(entries.remove(place).1)
    }

    /// The node at the end of a path such as `fingers[1].base`, or the last one on the way there.
    pub(super) fn nearest(&self, path: &str) -> &Self {
        let mut node = self;
        for step in path.split(['.', '[']) {
            let next = match (step.strip_suffix(']'), &node.value) {
                (Some(index), Value::List(list)) => {
                    index.parse().ok().and_then(|index: usize| list.get(index))
                }
                _ => node.get(step),
            };
            match next {
                Some(next) => node = next,
                None => return node,
            }
        }
        node
    }
}

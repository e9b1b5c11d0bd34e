use core::fmt::Display;
use core::ops::Range;

use serde::Deserialize;
use toml::Spanned;
use toml::de::{DeTable, DeValue};

use crate::{Fault, Text, read};

/// The keys of a table, which a reader asks for one by one. Mistakes are noted in the [`Text`]; a wrong value is
/// returned as `None`.
#[derive(Debug)]
pub struct Keys<'a, 't> {
    text: &'a Text<'t>,
    entries: &'a DeTable<'t>,
    /// Where a missing key is missing.
    span: Range<usize>,
    known: Vec<&'static str>,
}

impl<'t> Text<'t> {
    /// Returns the keys of a table of this text. A value of another type is noted as a mistake.
    pub fn keys<'a>(&'a self, table: &'a Spanned<DeValue<'t>>) -> Option<Keys<'a, 't>> {
        let DeValue::Table(entries) = table.get_ref() else {
            self.note(Fault::unsuitable(table, "a table"));
            return None;
        };
        Some(Keys {
            text: self,
            entries,
            span: table.span(),
            known: Vec::new(),
        })
    }
}

impl<'a, 't> Keys<'a, 't> {
    /// Notes that the text at `span` is wrong.
    pub fn wrong(&self, span: &Range<usize>, problem: impl Display) {
        self.text.wrong(span, problem);
    }

    /// Returns the line of a byte of the text, from 1.
    #[must_use]
    pub fn line(&self, byte: usize) -> usize {
        self.text.line(byte)
    }

    /// Returns the place of the table.
    #[must_use]
    pub fn span(&self) -> Range<usize> {
        self.span.clone()
    }

    fn value(&mut self, key: &'static str) -> Option<&'a Spanned<DeValue<'t>>> {
        self.known.push(key);
        self.entries.get(key)
    }

    /// As `value`, for a required key.
    fn needed(&mut self, key: &'static str, what: &str) -> Option<&'a Spanned<DeValue<'t>>> {
        let value = self.value(key);
        if value.is_none() {
            let problem = format!("the key `{key}` is missing here; it is {what}");
            self.wrong(&self.span, problem);
        }
        value
    }

    fn read<T: Deserialize<'a>>(&self, value: &'a Spanned<DeValue<'t>>) -> Option<T> {
        read(value).map_err(|fault| self.text.note(fault)).ok()
    }

    /// Returns the value of a key, if there is one. A [`Spanned`] value has its place, and a
    /// [`Whole`](crate::Whole) number has bounds.
    pub fn get<T: Deserialize<'a>>(&mut self, key: &'static str) -> Option<T> {
        let value = self.value(key)?;
        self.read(value)
    }

    /// Returns the value of a required key; `what` describes it for the error.
    pub fn need<T: Deserialize<'a>>(&mut self, key: &'static str, what: &str) -> Option<T> {
        let value = self.needed(key, what)?;
        self.read(value)
    }

    /// Returns the value that belongs to the word of a key; `choices` are all allowed words with their values.
    pub fn word<T: Copy>(&mut self, key: &'static str, choices: &[(&'static str, T)]) -> Option<T> {
        let word: Spanned<String> = self.get(key)?;
        let choice = choices.iter().find(|(choice, _)| choice == word.get_ref());
        if choice.is_none() {
            let known: Vec<_> = choices.iter().map(|(word, _)| *word).collect();
            let fault = Fault::unknown_word(word.get_ref(), &known);
            self.text.note(fault.within(&word.span()));
        }
        choice.map(|(_, choice)| *choice)
    }

    /// Returns the keys of the table of a key, if there is one.
    pub fn table(&mut self, key: &'static str) -> Option<Keys<'a, 't>> {
        let value = self.value(key)?;
        self.text.keys(value)
    }

    /// Returns the keys of each table in the list under the required key `key`; `what` describes
    /// that list in error messages. If the list is missing or has another type, that is noted as a
    /// mistake and the result is empty.
    pub fn tables(&mut self, key: &'static str, what: &str) -> Vec<Keys<'a, 't>> {
        let Some(value) = self.needed(key, what) else {
            return Vec::new();
        };
        let Some(list) = value.get_ref().as_array() else {
            self.text.note(Fault::unsuitable(value, what));
            return Vec::new();
        };
        let tables = list.iter();
        tables.filter_map(|table| self.text.keys(table)).collect()
    }

    /// Notes each key of the table that was not read as a mistake.
    pub fn finish(self) {
        for key in self.entries.keys() {
            let name = key.get_ref().as_ref();
            if !self.known.contains(&name) {
                let fault = Fault::unknown_key(name, &self.known);
                self.text.note(fault.within(&key.span()));
            }
        }
    }
}

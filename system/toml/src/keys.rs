use core::fmt::Display;
use core::ops::Range;

use serde::Deserialize;
use toml::Spanned;
use toml::de::{DeTable, DeValue};

use crate::{Misreading, SourceText, read};

/// A reader of one table, which returns the values of its keys one by one. If a value is wrong, it
/// notes a mistake in the [`SourceText`] and returns `None`, so that all mistakes of a text are
/// found at once.
#[derive(Debug)]
pub struct Keys<'a, 't> {
    text: &'a SourceText<'t>,
    entries: &'a DeTable<'t>,
    /// The byte range of the table, at which missing keys are reported.
    span: Range<usize>,
    known: Vec<&'static str>,
}

impl<'t> SourceText<'t> {
    /// Returns a reader of the keys of `table`. If `table` is a value of another type, notes a
    /// mistake and returns `None`.
    pub fn keys<'a>(&'a self, table: &'a Spanned<DeValue<'t>>) -> Option<Keys<'a, 't>> {
        let DeValue::Table(entries) = table.get_ref() else {
            self.note(Misreading::unsuitable(table, "a table"));
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
    /// Notes a mistake at the byte range `span` of the text, for [`SourceText::finish`] to return;
    /// `problem` is the message.
    pub fn wrong(&self, span: &Range<usize>, problem: impl Display) {
        self.text.wrong(span, problem);
    }

    /// Returns the number of the line, from 1, in which the byte at offset `byte` of the text lies.
    #[must_use]
    pub fn line(&self, byte: usize) -> usize {
        self.text.line(byte)
    }

    /// Returns the byte range of the table in the text.
    #[must_use]
    pub fn span(&self) -> Range<usize> {
        self.span.clone()
    }

    fn value(&mut self, key: &'static str) -> Option<&'a Spanned<DeValue<'t>>> {
        self.known.push(key);
        self.entries.get(key)
    }

    /// Returns the value of a required key; notes a mistake if the key is missing.
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

    /// Returns the value of the optional key `key`. Returns `None` if the key is missing, or if its value is wrong,
    /// which is noted as a mistake. A [`Spanned`] value comes with its byte range; a
    /// [`WholeNumber`](crate::WholeNumber) is checked against its bounds.
    pub fn get<T: Deserialize<'a>>(&mut self, key: &'static str) -> Option<T> {
        let value = self.value(key)?;
        self.read(value)
    }

    /// Returns the value of the required key `key`. If the key is missing or its value is wrong,
    /// notes a mistake and returns `None`; `what` describes the value in the message for a missing
    /// key.
    pub fn need<T: Deserialize<'a>>(&mut self, key: &'static str, what: &str) -> Option<T> {
        let value = self.needed(key, what)?;
        self.read(value)
    }

    /// Returns the value that belongs to the word under the key `key`; `choices` are all allowed words with their
    /// values. Returns `None` if the key is missing, or if its word is not one of the choices, which is noted as a
    /// mistake.
    pub fn word<T: Copy>(&mut self, key: &'static str, choices: &[(&'static str, T)]) -> Option<T> {
        let word: Spanned<String> = self.get(key)?;
        let choice = choices.iter().find(|(choice, _)| choice == word.get_ref());
        if choice.is_none() {
            let known: Vec<_> = choices.iter().map(|(word, _)| *word).collect();
            let fault = Misreading::unknown_word(word.get_ref(), &known);
            self.text.note(fault.within(&word.span()));
        }
        choice.map(|(_, choice)| *choice)
    }

    /// Returns a reader of the table under the key `key`. Returns `None` if the key is missing, or if its value is not
    /// a table, which is noted as a mistake.
    pub fn table(&mut self, key: &'static str) -> Option<Keys<'a, 't>> {
        let value = self.value(key)?;
        self.text.keys(value)
    }

    /// Returns a reader of each table in the list under the required key `key`; `what` describes
    /// that list in error messages. If the list is missing or has another type, that is noted as a
    /// mistake and the result is empty. Entries that are not tables are noted and left out.
    pub fn tables(&mut self, key: &'static str, what: &str) -> Vec<Keys<'a, 't>> {
        let Some(value) = self.needed(key, what) else {
            return Vec::new();
        };
        let Some(list) = value.get_ref().as_array() else {
            self.text.note(Misreading::unsuitable(value, what));
            return Vec::new();
        };
        let tables = list.iter();
        tables.filter_map(|table| self.text.keys(table)).collect()
    }

    /// Notes a mistake for each key of the table that no call has asked for. Call it after all
    /// known keys were read.
    pub fn finish(self) {
        for key in self.entries.keys() {
            let name = key.get_ref().as_ref();
            if !self.known.contains(&name) {
                let fault = Misreading::unknown_key(name, &self.known);
                self.text.note(fault.within(&key.span()));
            }
        }
    }
}

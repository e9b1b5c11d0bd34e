//! Reads a table key by key, and collects what is wrong with it.

use core::cell::RefCell;
use core::ops::{Range, RangeInclusive};

use toml::Spanned;
use toml::de::{DeTable, DeValue};

use super::mistake::{Mistake, Mistakes, Problem, nearest, place};

/// A text, and what is wrong with it.
#[derive(Debug)]
pub(super) struct Text<'t> {
    pub(super) file: &'t str,
    pub(super) content: &'t str,
    mistakes: RefCell<Vec<(usize, Mistake)>>,
    /// Lines that are no TOML: what was read there is not what was meant.
    unread: Vec<usize>,
}

impl<'t> Text<'t> {
    pub(super) fn new(file: &'t str, content: &'t str) -> Self {
        Self {
            file,
            content,
            mistakes: RefCell::default(),
            unread: Vec::new(),
        }
    }

    /// As `wrong`, for what is no TOML; the first of each line.
    pub(super) fn syntax(&mut self, span: &Range<usize>, message: &str) {
        let line = self.line(span.start);
        if !self.unread.contains(&line) {
            self.wrong(span, Problem::Syntax(message.into()));
            self.unread.push(line);
        }
    }

    pub(super) fn wrong(&self, span: &Range<usize>, problem: Problem) {
        let mistake = Mistake::at(self.file, self.content, span, problem);
        // What stands for a value that could not be read stands nowhere.
        if self.unread.contains(&mistake.line) || (!self.unread.is_empty() && span.start == 0) {
            return;
        }
        self.mistakes.borrow_mut().push((span.start, mistake));
    }

    pub(super) fn line(&self, byte: usize) -> usize {
        place(self.content, byte).0
    }

    /// What was wrong, in the order of the text.
    pub(super) fn into_mistakes(self) -> Mistakes {
        let mut mistakes = self.mistakes.into_inner();
        mistakes.sort_by_key(|(start, _)| *start);
        Mistakes(mistakes.into_iter().map(|(_, mistake)| mistake).collect())
    }

    pub(super) fn is_right(&self) -> bool {
        self.mistakes.borrow().is_empty()
    }
}

/// A value and its place.
#[derive(Clone, Debug)]
pub struct At<T> {
    /// The value.
    pub value: T,
    /// The place of the value, as a range of bytes of the description.
    pub span: Range<usize>,
}

/// The keys of a table of a description, which a reader asks for one by one. Mistakes are
/// collected, and reported with their places when everything has been read; a wrong value is
/// returned as `None`.
#[derive(Debug)]
pub struct Keys<'a, 't> {
    text: &'a Text<'t>,
    entries: &'a DeTable<'t>,
    /// Where a missing key is missing.
    span: Range<usize>,
    known: Vec<&'static str>,
}

impl<'a, 't> Keys<'a, 't> {
    pub(super) fn new(text: &'a Text<'t>, entries: &'a DeTable<'t>, span: Range<usize>) -> Self {
        Self {
            text,
            entries,
            span,
            known: Vec::new(),
        }
    }

    /// Reports that the text at `span` is wrong.
    pub fn wrong(&self, span: &Range<usize>, problem: impl Into<String>) {
        self.text.wrong(span, Problem::Other(problem.into()));
    }

    /// Returns the line of a byte of the description, from 1.
    #[must_use]
    pub fn line(&self, byte: usize) -> usize {
        self.text.line(byte)
    }

    fn get(&mut self, key: &'static str) -> Option<&'a Spanned<DeValue<'t>>> {
        self.known.push(key);
        let mut entries = self.entries.iter();
        entries
            .find(|(other, _)| other.get_ref().as_ref() == key)
            .map(|(_, value)| value)
    }

    /// As `get`, for a key that must be there.
    fn need(&mut self, key: &'static str, expected: &str) -> Option<&'a Spanned<DeValue<'t>>> {
        let value = self.get(key);
        if value.is_none() {
            let expected = expected.into();
            self.text
                .wrong(&self.span, Problem::MissingKey { key, expected });
        }
        value
    }

    fn unsuitable<T>(&self, value: &Spanned<DeValue<'_>>, expected: &str) -> Option<T> {
        let found = found(value.get_ref());
        let expected = expected.into();
        self.text
            .wrong(&value.span(), Problem::Unsuitable { found, expected });
        None
    }

    /// Returns the text of a required key; `expected` describes it for the error.
    pub fn text(&mut self, key: &'static str, expected: &str) -> Option<At<String>> {
        let value = self.need(key, expected)?;
        self.as_text(value, expected)
    }

    /// Returns the text of a key.
    pub fn optional_text(&mut self, key: &'static str, expected: &str) -> Option<At<String>> {
        let value = self.get(key)?;
        self.as_text(value, expected)
    }

    fn as_text(&self, value: &Spanned<DeValue<'_>>, expected: &str) -> Option<At<String>> {
        match value.get_ref() {
            DeValue::String(text) => Some(At {
                value: text.as_ref().into(),
                span: value.span(),
            }),
            _ => self.unsuitable(value, expected),
        }
    }

    /// Returns the list of texts of a key.
    pub fn texts(&mut self, key: &'static str) -> Option<At<Vec<String>>> {
        let value = self.get(key)?;
        let DeValue::Array(list) = value.get_ref() else {
            return self.unsuitable(value, "a list of texts");
        };
        let texts = list
            .iter()
            .filter_map(|value| Some(self.as_text(value, "a text")?.value));
        Some(At {
            value: texts.collect(),
            span: value.span(),
        })
    }

    /// Returns the truth value of a key.
    pub fn boolean(&mut self, key: &'static str) -> Option<bool> {
        let value = self.get(key)?;
        match value.get_ref() {
            DeValue::Boolean(value) => Some(*value),
            _ => self.unsuitable(value, "`true` or `false`"),
        }
    }

    /// Returns the whole number of a required key; it must be within `range` and a multiple of
    /// `unit`.
    pub fn number(
        &mut self,
        key: &'static str,
        range: RangeInclusive<i64>,
        unit: i64,
    ) -> Option<At<i64>> {
        let expected = whole(&range, unit);
        let value = self.need(key, &expected)?;
        self.as_number(value, &range, unit)
    }

    /// Returns the whole number of a key, which must be within `range`.
    pub fn optional_number(
        &mut self,
        key: &'static str,
        range: RangeInclusive<i64>,
    ) -> Option<i64> {
        Some(self.optional_number_at(key, range)?.value)
    }

    /// Returns the whole number of a key, which must be within `range`, with its place.
    pub fn optional_number_at(
        &mut self,
        key: &'static str,
        range: RangeInclusive<i64>,
    ) -> Option<At<i64>> {
        let value = self.get(key)?;
        self.as_number(value, &range, 1)
    }

    /// Returns the place of the value of a key, if there is one.
    #[must_use]
    pub fn span_of(&self, key: &str) -> Option<Range<usize>> {
        let mut entries = self.entries.iter();
        let entry = entries.find(|(other, _)| other.get_ref().as_ref() == key);
        entry.map(|(_, value)| value.span())
    }

    /// Returns the place of the table.
    #[must_use]
    pub fn span(&self) -> Range<usize> {
        self.span.clone()
    }

    fn as_number(
        &self,
        value: &Spanned<DeValue<'_>>,
        range: &RangeInclusive<i64>,
        unit: i64,
    ) -> Option<At<i64>> {
        let expected = whole(range, unit);
        let DeValue::Integer(integer) = value.get_ref() else {
            return self.unsuitable(value, &expected);
        };
        let Ok(found) = i64::from_str_radix(integer.as_str(), integer.radix()) else {
            return self.unsuitable(value, &expected);
        };
        let span = value.span();
        if range.contains(&found) && found % unit == 0 {
            return Some(At { value: found, span });
        }
        let problem = Problem::OutOfRange { found, expected };
        self.text.wrong(&span, problem);
        None
    }

    /// Returns the value that belongs to the word of a key; `choices` are all allowed words with
    /// their values.
    pub fn word<T: Copy>(&mut self, key: &'static str, choices: &[(&'static str, T)]) -> Option<T> {
        let value = self.get(key)?;
        let text = self.as_text(value, "a word")?;
        let choice = choices.iter().find(|(word, _)| *word == text.value);
        if choice.is_none() {
            let known: Vec<_> = choices.iter().map(|(word, _)| *word).collect();
            let nearest = nearest(&text.value, &known);
            let problem = Problem::UnknownWord {
                word: text.value,
                nearest,
                known,
            };
            self.text.wrong(&text.span, problem);
        }
        choice.map(|(_, choice)| *choice)
    }

    pub(super) fn table(&mut self, key: &'static str) -> Option<Keys<'a, 't>> {
        let value = self.get(key)?;
        match value.get_ref() {
            DeValue::Table(table) => Some(Keys::new(self.text, table, value.span())),
            _ => self.unsuitable(value, "a table"),
        }
    }

    pub(super) fn tables(&mut self, key: &'static str, expected: &str) -> Vec<Keys<'a, 't>> {
        let Some(value) = self.need(key, expected) else {
            return Vec::new();
        };
        let DeValue::Array(list) = value.get_ref() else {
            return self.unsuitable(value, expected).unwrap_or_default();
        };
        let tables = list.iter().filter_map(|value| match value.get_ref() {
            DeValue::Table(table) => Some(Keys::new(self.text, table, value.span())),
            _ => self.unsuitable(value, "a table"),
        });
        tables.collect()
    }

    /// Says which keys nobody asked for.
    pub(super) fn finish(self) {
        for (key, _) in self.entries {
            let name = key.get_ref().as_ref();
            if !self.known.contains(&name) {
                let nearest = nearest(name, &self.known);
                let problem = Problem::UnknownKey {
                    key: name.into(),
                    nearest,
                    known: self.known.clone(),
                };
                self.text.wrong(&key.span(), problem);
            }
        }
    }
}

fn whole(range: &RangeInclusive<i64>, unit: i64) -> String {
    let (least, most) = range.clone().into_inner();
    match unit {
        1 => format!("a whole number from {least} to {most}"),
        _ => format!("a multiple of {unit} from {least} to {most}"),
    }
}

fn found(value: &DeValue<'_>) -> String {
    match value {
        DeValue::String(text) => format!("the text \"{text}\""),
        DeValue::Integer(number) => format!("the number {number}"),
        DeValue::Float(number) => format!("the number {number}"),
        DeValue::Boolean(value) => format!("`{value}`"),
        DeValue::Datetime(_) => "a time".into(),
        DeValue::Array(_) => "a list".into(),
        DeValue::Table(_) => "a table".into(),
    }
}

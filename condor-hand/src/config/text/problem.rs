//! Mistakes in a text, with their places.

use core::fmt;
use core::ops::Range;
use std::boxed::Box;
use std::string::{String, ToString};

use serde::de;
use thiserror::Error;

use super::tree::Node;
use crate::config::Mistake;

/// The error of a text that is not a hand.
#[derive(Clone, Debug, PartialEq, Error)]
#[error(
    "{file}:{line}:{column}: {problem}{}{text}",
    if text.is_empty() { "" } else { "\n    " }
)]
#[non_exhaustive]
pub struct TextError {
    /// The name of the file.
    pub file: String,
    /// The line, from 1.
    pub line: usize,
    /// The column in characters, from 1.
    pub column: usize,
    /// The wrong text, up to the end of that line.
    pub text: String,
    /// The problem, and the remedy.
    pub problem: Box<Problem>,
}

/// The problem of a text.
#[derive(Clone, Debug, PartialEq, Error)]
#[non_exhaustive]
pub enum Problem {
    /// The text is not TOML.
    #[error("{message}")]
    Syntax {
        /// The parser's message.
        message: String,
    },
    /// The table has a key that is not known there.
    #[error("there is no key `{key}` here; {}", Choice { nearest: *nearest, known })]
    UnknownKey {
        /// The key.
        key: String,
        /// The known key with the most similar spelling.
        nearest: Option<&'static str>,
        /// All keys of the table.
        known: &'static [&'static str],
    },
    /// The value is a word that is not known there.
    #[error("`{word}` is none of the choices here; {}", Choice { nearest: *nearest, known })]
    UnknownWord {
        /// The word.
        word: String,
        /// The known word with the most similar spelling.
        nearest: Option<&'static str>,
        /// All words that are allowed.
        known: &'static [&'static str],
    },
    /// A required key is missing.
    #[error("the key `{key}` is missing here")]
    MissingKey {
        /// The key.
        key: String,
    },
    /// A value is of the wrong kind, or exceeds its type.
    #[error("{found} stands where {expected} should be")]
    Unsuitable {
        /// The kind of the value.
        found: String,
        /// The kind that is expected.
        expected: String,
    },
    /// A list or a name has the wrong length.
    #[error("the length {length} is not that of {expected}")]
    Length {
        /// The length.
        length: usize,
        /// The expected length, and of what.
        expected: String,
    },
    /// A list has more entries than the program has room for.
    #[error("there are {count} {of}; this program has room for {most}")]
    TooMany {
        /// The kind of entry.
        of: &'static str,
        /// The number of entries.
        count: usize,
        /// The greatest number of entries.
        most: usize,
    },
    /// The word `like` does not name a finger above this one.
    #[error("no finger `{name}` stands above this one")]
    LikeNothing {
        /// The name after `like`.
        name: String,
    },
    /// The hand breaks a rule.
    #[error(transparent)]
    Mistake(Mistake),
}

/// What a person may have meant.
struct Choice<'a> {
    nearest: Option<&'static str>,
    known: &'a [&'static str],
}

impl fmt::Display for Choice<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let Some(nearest) = self.nearest {
            return write!(f, "did you mean `{nearest}`?");
        }
        f.write_str("it can be ")?;
        for (index, word) in self.known.iter().enumerate() {
            write!(f, "{}`{word}`", if index == 0 { "" } else { ", " })?;
        }
        Ok(())
    }
}

/// A problem before it has a line.
#[derive(Debug)]
pub(super) struct Fault {
    pub(super) span: Option<Range<usize>>,
    pub(super) problem: Box<Problem>,
}

impl Fault {
    pub(super) fn at(span: &Range<usize>, problem: Problem) -> Self {
        Self::from(problem).within(span)
    }

    /// The place, where none nearer to the problem was known.
    pub(super) fn within(mut self, span: &Range<usize>) -> Self {
        self.span.get_or_insert_with(|| span.clone());
        self
    }

    /// A key that a table of defaults lacks is one that the table lacks which took the defaults.
    pub(super) fn lacking(mut self, node: &Node) -> Self {
        if let (None, Problem::MissingKey { key }, Some(filled_in)) =
            (&self.span, self.problem.as_mut(), &node.filled_in)
        {
            *key = std::format!("{}.{key}", filled_in.way);
            self.span = Some(filled_in.span.clone());
        }
        self
    }

    pub(super) fn locate(self, text: &str, file: &str) -> TextError {
        let span = self.span.unwrap_or(0..0);
        let before = text.get(..span.start).unwrap_or(text);
        let line_start = before.rfind('\n').map_or(0, |newline| newline + 1);
        let offending = text
            .get(span.start..span.end.max(span.start))
            .unwrap_or_default();
        TextError {
            file: file.into(),
            line: before.matches('\n').count() + 1,
            column: before.get(line_start..).unwrap_or_default().chars().count() + 1,
            text: offending.lines().next().unwrap_or_default().into(),
            problem: self.problem,
        }
    }
}

impl From<Problem> for Fault {
    fn from(problem: Problem) -> Self {
        Self {
            span: None,
            problem: Box::new(problem),
        }
    }
}

impl fmt::Display for Fault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.problem.fmt(f)
    }
}

impl core::error::Error for Fault {}

/// The word that differs least, if it differs little.
fn nearest(word: &str, known: &[&'static str]) -> Option<&'static str> {
    let distances = known
        .iter()
        .map(|&other| (strsim::osa_distance(word, other), other));
    let (distance, nearest) = distances.min()?;
    let tolerance = word.chars().count().div_ceil(2);
    (distance <= tolerance).then_some(nearest)
}

impl de::Error for Fault {
    fn custom<T: fmt::Display>(message: T) -> Self {
        let message = message.to_string();
        Problem::Syntax { message }.into()
    }

    fn invalid_type(found: de::Unexpected<'_>, expected: &dyn de::Expected) -> Self {
        let found = found.to_string();
        let expected = match expected.to_string().as_str() {
            "f64" => "a number".into(),
            "u8" => std::format!("a whole number from 0 to {}", u8::MAX),
            "u16" => std::format!("a whole number from 0 to {}", u16::MAX),
            "u32" => std::format!("a whole number from 0 to {}", u32::MAX),
            other => other.into(),
        };
        Problem::Unsuitable { found, expected }.into()
    }

    fn invalid_value(found: de::Unexpected<'_>, expected: &dyn de::Expected) -> Self {
        Self::invalid_type(found, expected)
    }

    fn invalid_length(length: usize, expected: &dyn de::Expected) -> Self {
        let expected = expected.to_string();
        Problem::Length { length, expected }.into()
    }

    fn unknown_variant(word: &str, known: &'static [&'static str]) -> Self {
        let nearest = nearest(word, known);
        let word = word.into();
        Problem::UnknownWord {
            word,
            nearest,
            known,
        }
        .into()
    }

    fn unknown_field(key: &str, known: &'static [&'static str]) -> Self {
        let nearest = nearest(key, known);
        let key = key.into();
        Problem::UnknownKey {
            key,
            nearest,
            known,
        }
        .into()
    }

    fn missing_field(key: &'static str) -> Self {
        Problem::MissingKey { key: key.into() }.into()
    }
}

//! What is wrong with a description, where, and what would be right.

use core::fmt;
use core::ops::Range;
use std::path::PathBuf;

use thiserror::Error;

/// A mistake in a description.
#[derive(Debug, Error)]
#[error(
    "{file}:{line}:{column}: {problem}{}{text}",
    if text.is_empty() { "" } else { "\n    " }
)]
#[non_exhaustive]
pub struct Mistake {
    /// The name of the file.
    pub file: String,
    /// The line, from 1.
    pub line: usize,
    /// The column in characters, from 1.
    pub column: usize,
    /// The wrong text, up to the end of that line.
    pub text: String,
    /// The problem, and the remedy.
    pub problem: Problem,
}

/// All mistakes in a description, in the order of its lines; there is at least one.
#[derive(Debug)]
pub struct Mistakes(pub Vec<Mistake>);

impl fmt::Display for Mistakes {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (index, mistake) in self.0.iter().enumerate() {
            write!(f, "{}{mistake}", if index == 0 { "" } else { "\n" })?;
        }
        Ok(())
    }
}

impl core::error::Error for Mistakes {}

/// The problem of a mistake.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum Problem {
    /// The file cannot be read.
    #[error("cannot read it: {0}")]
    Unreadable(std::io::Error),
    /// The text is not TOML.
    #[error("{0}")]
    Syntax(String),
    /// The table has a key that is not known there.
    #[error("there is no key `{key}` here; {}", Choice { nearest: *nearest, known })]
    UnknownKey {
        /// The key.
        key: String,
        /// The known key with the most similar spelling.
        nearest: Option<&'static str>,
        /// All keys of the table.
        known: Vec<&'static str>,
    },
    /// The value is a word that is not known there.
    #[error("`{word}` is none of the choices here; {}", Choice { nearest: *nearest, known })]
    UnknownWord {
        /// The word.
        word: String,
        /// The known word with the most similar spelling.
        nearest: Option<&'static str>,
        /// All words that are allowed.
        known: Vec<&'static str>,
    },
    /// A required key is missing.
    #[error("the key `{key}` is missing here; it is {expected}")]
    MissingKey {
        /// The key.
        key: &'static str,
        /// The value that it should have.
        expected: String,
    },
    /// A value is of the wrong kind.
    #[error("{found} stands where {expected} should be")]
    Unsuitable {
        /// The kind of the value.
        found: String,
        /// The kind that is expected.
        expected: String,
    },
    /// A whole number is too small, too large, or not a multiple of the required unit.
    #[error("{found} is not {expected}")]
    OutOfRange {
        /// The number.
        found: i64,
        /// The numbers that are allowed.
        expected: String,
    },
    /// A name cannot be that of a file or an argument.
    #[error("\"{name}\" cannot be a name: take 1 to {longest} letters, digits, `-` and `_`")]
    BadName {
        /// The name.
        name: String,
        /// The greatest number of characters.
        longest: usize,
    },
    /// A processor has the name of a service.
    #[error("`{name}` is the name of a service; take another one")]
    ServiceName {
        /// The name.
        name: String,
    },
    /// Two processors have the same name.
    #[error("the processor in line {line} is called `{name}`, too; take another name")]
    DuplicateName {
        /// The name.
        name: String,
        /// The line of the first one.
        line: usize,
    },
    /// Two processors have the same number.
    #[error(
        "the processor in line {line} has the number {number}, too; {}",
        Free(free)
    )]
    DuplicateNumber {
        /// The number.
        number: u8,
        /// The line of the first one.
        line: usize,
        /// The numbers that are free.
        free: Vec<u8>,
    },
    /// The file of a program was not found.
    #[error("there is no program `{program}`; looked for {}", Places(looked))]
    NoProgram {
        /// The program, as the description writes it.
        program: String,
        /// The places that were searched.
        looked: Vec<PathBuf>,
    },
    /// The file of a program cannot be executed.
    #[error("{path:?} is no program: it is no file that may be executed")]
    NotExecutable {
        /// The file.
        path: PathBuf,
    },
    /// The binary has no program of this name.
    #[error("this program has no program `{word}` of its own; {}", Choice { nearest: *nearest, known })]
    NoOwnProgram {
        /// The first argument.
        word: String,
        /// The program with the most similar spelling.
        nearest: Option<&'static str>,
        /// All programs of the binary.
        known: Vec<&'static str>,
    },
    /// `"self"` is not followed by the name of a program.
    #[error("`arguments` must begin with the name of one of this program's own; {}", Choice { nearest: None, known })]
    WhichOwnProgram {
        /// All programs of the binary.
        known: Vec<&'static str>,
    },
    /// A path does not lead to a directory.
    #[error("{path:?} is no directory; name one, or what is not there yet")]
    NoDirectory {
        /// The path.
        path: PathBuf,
    },
    /// A problem that the application or an extension reports.
    #[error("{0}")]
    Other(String),
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
        if self.known.is_empty() {
            return f.write_str("it has none");
        }
        f.write_str("it can be ")?;
        for (index, word) in self.known.iter().enumerate() {
            write!(f, "{}`{word}`", if index == 0 { "" } else { ", " })?;
        }
        Ok(())
    }
}

struct Free<'a>(&'a [u8]);

impl fmt::Display for Free<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.0.is_empty() {
            return f.write_str("all numbers are taken");
        }
        f.write_str("free are")?;
        for (index, number) in self.0.iter().enumerate() {
            write!(f, "{} {number}", if index == 0 { "" } else { "," })?;
        }
        Ok(())
    }
}

struct Places<'a>(&'a [PathBuf]);

impl fmt::Display for Places<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for place in self.0 {
            write!(f, "{}, ", place.display())?;
        }
        f.write_str("and in PATH")
    }
}

/// The word that differs least, if it differs little.
pub(super) fn nearest(word: &str, known: &[&'static str]) -> Option<&'static str> {
    let distances = known
        .iter()
        .map(|&other| (strsim::osa_distance(word, other), other));
    let (distance, nearest) = distances.min()?;
    let tolerance = word.chars().count().div_ceil(2);
    (distance <= tolerance).then_some(nearest)
}

/// The line and column of a byte, from 1.
pub(super) fn place(text: &str, byte: usize) -> (usize, usize) {
    let before = text.get(..byte).unwrap_or(text);
    let line_start = before.rfind('\n').map_or(0, |newline| newline + 1);
    let line = before.matches('\n').count() + 1;
    let column = before.get(line_start..).unwrap_or_default().chars().count() + 1;
    (line, column)
}

impl Mistake {
    pub(super) fn at(file: &str, text: &str, span: &Range<usize>, problem: Problem) -> Self {
        let (line, column) = place(text, span.start);
        let offending = text.get(span.clone()).unwrap_or_default();
        Self {
            file: file.into(),
            line,
            column,
            text: offending.lines().next().unwrap_or_default().into(),
            problem,
        }
    }
}

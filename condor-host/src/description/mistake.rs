//! What is wrong with a description, where, and what would be right.

use core::fmt;
use core::ops::Range;
use std::path::PathBuf;

use thiserror::Error;

/// One thing that is wrong with a description.
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
    /// The offending text, as far as it is on that line.
    pub text: String,
    /// What is wrong, and what would be right.
    pub problem: Problem,
}

/// All that is wrong with a description, in the order of its lines; at least one.
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

/// What is wrong.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum Problem {
    /// The file cannot be read.
    #[error("cannot read it: {0}")]
    Unreadable(std::io::Error),
    /// No TOML.
    #[error("{0}")]
    Syntax(String),
    /// A key that means nothing there.
    #[error("there is no key `{key}` here; {}", Choice { nearest: *nearest, known })]
    UnknownKey {
        /// The key.
        key: String,
        /// The key that is spelt most like it.
        nearest: Option<&'static str>,
        /// All keys of the table.
        known: Vec<&'static str>,
    },
    /// A word that means nothing there.
    #[error("`{word}` is none of the choices here; {}", Choice { nearest: *nearest, known })]
    UnknownWord {
        /// The word.
        word: String,
        /// The word that is spelt most like it.
        nearest: Option<&'static str>,
        /// All words that are possible.
        known: Vec<&'static str>,
    },
    /// A key that must be there.
    #[error("the key `{key}` is missing here; it is {expected}")]
    MissingKey {
        /// The key.
        key: &'static str,
        /// What its value would be.
        expected: String,
    },
    /// A value of the wrong kind.
    #[error("{found} stands where {expected} should be")]
    Unsuitable {
        /// What the value is.
        found: String,
        /// What it should be.
        expected: String,
    },
    /// A whole number that is too small or too large.
    #[error("{found} is not {expected}")]
    OutOfRange {
        /// The number.
        found: i64,
        /// What it should be.
        expected: String,
    },
    /// A name that cannot be that of a file or of an argument.
    #[error("\"{name}\" cannot be a name: take 1 to {longest} letters, digits, `-` and `_`")]
    BadName {
        /// The name.
        name: String,
        /// How many characters it may have.
        longest: usize,
    },
    /// A name that a service of the system has.
    #[error("`{name}` is the name of a service; take another one")]
    ServiceName {
        /// The name.
        name: String,
    },
    /// A name that a processor above has.
    #[error("the processor in line {line} is called `{name}`, too; take another name")]
    DuplicateName {
        /// The name.
        name: String,
        /// The line of the other one.
        line: usize,
    },
    /// A number that a processor above has.
    #[error(
        "the processor in line {line} has the number {number}, too; {}",
        Free(free)
    )]
    DuplicateNumber {
        /// The number.
        number: u8,
        /// The line of the other one.
        line: usize,
        /// The numbers that no processor has.
        free: Vec<u8>,
    },
    /// A program that is nowhere.
    #[error("there is no program `{program}`; looked for {}", Places(looked))]
    NoProgram {
        /// As the description calls it.
        program: String,
        /// Where it was looked for.
        looked: Vec<PathBuf>,
    },
    /// A file that cannot be run.
    #[error("{path:?} is no program: it is no file that may be executed")]
    NotExecutable {
        /// The file.
        path: PathBuf,
    },
    /// One of the own programs that there is not.
    #[error("this program has no program `{word}` of its own; {}", Choice { nearest: *nearest, known })]
    NoOwnProgram {
        /// The first argument.
        word: String,
        /// The program that is spelt most like it.
        nearest: Option<&'static str>,
        /// All of them.
        known: Vec<&'static str>,
    },
    /// `"self"` without the name of a program.
    #[error("`arguments` must begin with the name of one of this program's own; {}", Choice { nearest: None, known })]
    WhichOwnProgram {
        /// All of them.
        known: Vec<&'static str>,
    },
    /// A directory that is none.
    #[error("{path:?} is no directory; name one, or what is not there yet")]
    NoDirectory {
        /// The path.
        path: PathBuf,
    },
    /// What the application or an extension tells.
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

//! A text, and the mistakes in it.

use core::cell::{OnceCell, RefCell};
use core::fmt::{self, Display};
use core::ops::Range;

use serde::de::DeserializeOwned;
use thiserror::Error;
use toml::Spanned;
use toml::de::{DeTable, DeValue};

use crate::line_table::LineTable;
use crate::{Misreading, read};

/// A mistake in a text, with the file, line and column where it is.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
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
    /// The wrong text, up to the end of its line.
    pub text: String,
    /// The problem, and the remedy.
    pub problem: String,
}

/// All mistakes in a text, in the order of its lines.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct TextErrors(pub Vec<TextError>);

impl Display for TextErrors {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (index, error) in self.0.iter().enumerate() {
            write!(f, "{}{error}", if index == 0 { "" } else { "\n" })?;
        }
        Ok(())
    }
}

impl core::error::Error for TextErrors {}

impl From<TextError> for TextErrors {
    fn from(error: TextError) -> Self {
        Self(vec![error])
    }
}

/// A text with the name of its file, which collects the mistakes in it.
///
/// ```
/// use condor_toml::SourceText;
///
/// #[derive(Debug, serde::Deserialize)]
/// struct Joint {
///     low: f64,
/// }
///
/// let error = SourceText::new("joint.toml", "\nlow = true").read::<Joint>().unwrap_err();
/// assert!(error.to_string().contains("joint.toml"), "{error}");
/// ```
#[derive(Debug)]
pub struct SourceText<'t> {
    file: &'t str,
    content: &'t str,
    /// Made for the first mistake.
    places: OnceCell<LineTable>,
    errors: RefCell<Vec<TextError>>,
}

impl<'t> SourceText<'t> {
    /// Creates a text from `content`. `file` is the name of its file in errors; nothing is opened.
    #[must_use]
    pub fn new(file: &'t str, content: &'t str) -> Self {
        Self {
            file,
            content,
            places: OnceCell::new(),
            errors: RefCell::default(),
        }
    }

    /// Parses the text as TOML, and returns its values as a tree, whose root is a table.
    ///
    /// # Errors
    /// [`TextError`] at the first part that is not TOML.
    pub fn parse(&self) -> Result<Spanned<DeValue<'t>>, TextError> {
        let table = DeTable::parse(self.content).map_err(|error| {
            let span = error.span().unwrap_or_default();
            self.error(Misreading::at(&span, error.message()))
        })?;
        Ok(Spanned::new(
            table.span(),
            DeValue::Table(table.into_inner()),
        ))
    }

    /// Parses the text as TOML, and reads it as a whole into a `T` by serde.
    ///
    /// # Errors
    /// [`TextError`] for the first mistake: a part that is not TOML, or a value that does not suit
    /// `T`.
    pub fn read<T: DeserializeOwned>(&self) -> Result<T, TextError> {
        read(&self.parse()?).map_err(|fault| self.error(fault))
    }

    /// Returns the number of the line, from 1, in which the byte at offset `byte` lies.
    #[must_use]
    pub fn line(&self, byte: usize) -> usize {
        self.place(byte).0
    }

    /// The line and column of a byte, from 1.
    fn place(&self, byte: usize) -> (usize, usize) {
        let places = self.places.get_or_init(|| LineTable::of(self.content));
        places.place(self.content, byte)
    }

    /// Converts `fault` to an error with the file, the line, the column and the wrong text.
    #[must_use]
    pub fn error(&self, fault: Misreading) -> TextError {
        let problem = fault.to_string();
        let span = fault.span.unwrap_or_default();
        let (line, column) = self.place(span.start);
        let offending = self.content.get(span).unwrap_or_default();
        TextError {
            file: self.file.into(),
            line,
            column,
            text: offending.lines().next().unwrap_or_default().into(),
            problem,
        }
    }

    /// Notes a mistake at the byte range `span` of the text, for [`finish`](Self::finish) to
    /// return; `problem` is the message.
    pub fn wrong(&self, span: &Range<usize>, problem: impl Display) {
        self.note(Misreading::at(span, problem));
    }

    pub(crate) fn note(&self, fault: Misreading) {
        self.errors.borrow_mut().push(self.error(fault));
    }

    /// Returns `value`, which was read from the text, if no mistake was noted. Call it after the
    /// whole text was read.
    ///
    /// # Errors
    /// [`TextErrors`] with all mistakes that were noted. If `value` is `None`, its reader must have
    /// noted the reason.
    pub fn finish<T>(self, value: Option<T>) -> Result<T, TextErrors> {
        let mut errors = self.errors.into_inner();
        errors.sort_by_key(|error| (error.line, error.column));
        match value {
            Some(value) if errors.is_empty() => Ok(value),
            _ => Err(TextErrors(errors)),
        }
    }
}

//! A mistake before its line is known.

use core::fmt::{self, Display};
use core::ops::Range;

use serde::de::{self, Expected, Unexpected};
use toml::Spanned;
use toml::de::DeValue;

/// A mistake in a text, at a range of bytes whose line is not known yet.
/// [`SourceText::error`](crate::SourceText::error) finds the line.
#[derive(Debug)]
pub struct Misreading {
    pub(crate) span: Option<Range<usize>>,
    problem: Problem,
}

#[derive(Debug)]
enum Problem {
    /// A required key that is missing.
    Missing(String),
    /// A list with more than this many entries.
    TooLong(usize),
    Other(String),
}

impl Misreading {
    /// Makes a `Misreading` for a mistake at the byte range `span` of the text; `problem` is the
    /// message.
    #[must_use]
    pub fn at(span: &Range<usize>, problem: impl Display) -> Self {
        Self::from(problem.to_string()).within(span)
    }

    /// Sets the place, if none nearer to the problem is known.
    pub(crate) fn within(mut self, span: &Range<usize>) -> Self {
        self.span.get_or_insert_with(|| span.clone());
        self
    }

    /// Puts `way` before a missing key: the keys to its table, which was filled in there.
    pub(crate) fn lacking(mut self, way: &str) -> Self {
        if let (None, Problem::Missing(key)) = (&self.span, &mut self.problem) {
            key.insert_str(0, way);
        }
        self
    }

    /// Sets the place to the first entry of `list` that is too many, if that is the problem.
    pub(crate) fn surplus(self, list: &[Spanned<DeValue<'_>>]) -> Self {
        let Problem::TooLong(most) = self.problem else {
            return self;
        };
        match list.get(most) {
            Some(entry) => self.within(&entry.span()),
            None => self,
        }
    }

    pub(crate) fn unknown_key(key: &str, known: &[&str]) -> Self {
        format!("there is no key `{key}` here; {}", suggest(key, known)).into()
    }

    pub(crate) fn unknown_word(word: &str, known: &[&str]) -> Self {
        let choice = suggest(word, known);
        format!("`{word}` is none of the choices here; {choice}").into()
    }
}

impl From<String> for Misreading {
    fn from(problem: String) -> Self {
        Self {
            span: None,
            problem: Problem::Other(problem),
        }
    }
}

impl Display for Misreading {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match &self.problem {
            Problem::Missing(key) => write!(f, "the key `{key}` is missing here"),
            Problem::TooLong(most) => {
                write!(
                    f,
                    "this entry is one too many; the program has room for {most}"
                )
            }
            Problem::Other(problem) => f.write_str(problem),
        }
    }
}

impl core::error::Error for Misreading {}

/// Returns a hint for the wrong word `word`: the question whether the most similar word of `known`
/// was meant, or the list of all words of `known` if none is similar.
#[must_use]
pub fn suggest(word: &str, known: &[&str]) -> String {
    let length = word.chars().count();
    let most = length.div_ceil(2);
    // Words whose lengths differ by more are not similar, and a long word takes long to compare.
    let near = |other: &&&str| length.abs_diff(other.chars().count()) <= most;
    let distances = known
        .iter()
        .filter(near)
        .map(|&other| (strsim::osa_distance(word, other), other));
    match distances.min() {
        Some((distance, nearest)) if distance <= most => format!("did you mean `{nearest}`?"),
        _ if known.is_empty() => "it has none".into(),
        _ => format!("it can be `{}`", known.join("`, `")),
    }
}

impl de::Error for Misreading {
    fn custom<T: Display>(message: T) -> Self {
        message.to_string().into()
    }

    fn invalid_type(found: Unexpected<'_>, expected: &dyn Expected) -> Self {
        let found = match found {
            Unexpected::Bool(value) => format!("`{value}`"),
            Unexpected::Signed(number) => format!("the number {number}"),
            Unexpected::Float(number) => format!("the number {number:?}"),
            Unexpected::Str(text) => format!("the text \"{text}\""),
            Unexpected::Seq => "a list".into(),
            Unexpected::Map => "a table".into(),
            other => other.to_string(),
        };
        // The texts of serde are for readers who know Rust's types.
        let expected = match expected.to_string().as_str() {
            "f64" => "a number".into(),
            "u8" => format!("a whole number from 0 to {}", u8::MAX),
            "u16" => format!("a whole number from 0 to {}", u16::MAX),
            "u32" => format!("a whole number from 0 to {}", u32::MAX),
            "u64" => format!("a whole number from 0 to {}", i64::MAX),
            "a boolean" => "`true` or `false`".into(),
            "a string" => "a text".into(),
            "a sequence" => "a list".into(),
            other if other.starts_with("struct ") => "a table".into(),
            other => other.into(),
        };
        format!("{found} stands where {expected} should be").into()
    }

    fn invalid_value(found: Unexpected<'_>, expected: &dyn Expected) -> Self {
        Self::invalid_type(found, expected)
    }

    fn invalid_length(length: usize, expected: &dyn Expected) -> Self {
        let expected = expected.to_string();
        // This is the text of heapless for the first entry for which a list has no room.
        if expected == "a sequence" {
            let problem = Problem::TooLong(length.saturating_sub(1));
            return Self {
                span: None,
                problem,
            };
        }
        // The number in a text such as "an array of length 3" or "a string no more than 64 bytes long".
        let number = expected
            .split(' ')
            .find_map(|word| word.parse::<usize>().ok());
        match number {
            Some(most) if expected.starts_with("a string") => {
                format!("the text has {length} bytes and may have at most {most}")
            }
            Some(number) => format!("the list must have {number} entries, not {length}"),
            None => format!("{length} entries stand where {expected} should be"),
        }
        .into()
    }

    fn unknown_variant(word: &str, known: &'static [&'static str]) -> Self {
        Self::unknown_word(word, known)
    }

    fn unknown_field(key: &str, known: &'static [&'static str]) -> Self {
        Self::unknown_key(key, known)
    }

    fn missing_field(key: &'static str) -> Self {
        Self {
            span: None,
            problem: Problem::Missing(key.into()),
        }
    }
}

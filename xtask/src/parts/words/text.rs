//! [`Text`]: a piece of words, and where it stands.

use std::sync::LazyLock;

use regex::{Captures, Regex};

/// A piece of code, or a link from the end of its text to that of its target.
static SPANS: LazyLock<Regex> = LazyLock::new(|| {
    Regex::new(r"`[^`]*`|\]\([^)]*").expect("the pattern is a regular expression")
});

/// A doc, a comment, a paragraph or a message.
#[derive(Debug, Clone)]
pub(super) struct Text {
    /// The number of its first line in the file.
    pub line: usize,
    pub kind: Kind,
    /// True if users of the crate or of the program read it.
    pub public: bool,
    /// The name of the documented item; empty if it has none.
    pub name: String,
    /// Its lines, without the marks of a comment.
    pub body: String,
}

/// The place of a text, on which rules depend.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Kind {
    /// The doc of a function or method.
    Function,
    /// The doc of a struct, enum, union, trait, type or macro.
    Type,
    /// The doc of a field, variant, constant or static variable.
    Value,
    /// The doc of a module or crate.
    Module,
    /// A comment other than a doc.
    Comment,
    /// A paragraph of a Markdown file.
    Prose,
    /// The help of a command.
    Help,
    /// An error, or a line that a program prints.
    Message,
}

impl Kind {
    /// Returns the name by which `xtask/words.toml` calls it.
    pub(super) fn class(self, public: bool) -> &'static str {
        match self {
            Self::Function | Self::Type | Self::Value | Self::Module if public => "docs",
            Self::Function | Self::Type | Self::Value | Self::Module | Self::Comment => "private",
            Self::Prose => "prose",
            Self::Help | Self::Message => "texts",
        }
    }
}

impl Text {
    /// Returns the text with all code, links' targets and addresses covered by `_`, at the same offsets and
    /// with blanks in place of line breaks, so that a phrase is found across lines.
    pub(super) fn covered(&self) -> String {
        let mut covered = String::with_capacity(self.body.len());
        let mut fence = false;
        for (index, line) in self.body.split('\n').enumerate() {
            if index > 0 {
                covered.push(' ');
            }
            let is_fence = line.trim_start().starts_with("```");
            if is_fence || fence {
                covered.extend(std::iter::repeat_n('_', line.len()));
            } else {
                covered.push_str(line);
            }
            fence ^= is_fence;
        }
        let cover = |found: &Captures<'_>| {
            let is_code = found[0].starts_with('`');
            let (open, close) = if is_code { ("`", "`") } else { ("](", "") };
            format!("{open}{}{close}", "_".repeat(found[0].len() - 2))
        };
        SPANS.replace_all(&covered, cover).into_owned()
    }

    /// Returns the first paragraph, in one line.
    pub(super) fn summary(&self) -> String {
        let lines = self.body.lines().skip_while(|line| line.trim().is_empty());
        let lines = lines.take_while(|line| !line.trim().is_empty());
        lines.map(str::trim).collect::<Vec<_>>().join(" ")
    }

    /// Returns the line of the file in which the offset of the text lies.
    pub(super) fn line_of(&self, offset: usize) -> usize {
        self.line + self.body[..offset].matches('\n').count()
    }
}

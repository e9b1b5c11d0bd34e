//! [`Text`]: a piece of words, and where it stands.

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
        cover(&mut covered, '`', '`');
        cover_targets(&mut covered);
        covered
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

/// Covers what lies between pairs of the two characters.
fn cover(text: &mut String, open: char, close: char) {
    let mut result = String::with_capacity(text.len());
    let mut rest = text.as_str();
    while let Some((before, after)) = rest.split_once(open) {
        let Some((inside, after)) = after.split_once(close) else {
            break;
        };
        result.push_str(before);
        result.push(open);
        result.extend(std::iter::repeat_n('_', inside.len()));
        result.push(close);
        rest = after;
    }
    result.push_str(rest);
    *text = result;
}

/// Covers the targets of links, `](…)`.
fn cover_targets(text: &mut String) {
    let mut result = String::with_capacity(text.len());
    let mut rest = text.as_str();
    while let Some((before, after)) = rest.split_once("](") {
        let end = after.find(')').unwrap_or(after.len());
        result.push_str(before);
        result.push_str("](");
        result.extend(std::iter::repeat_n('_', end));
        rest = &after[end..];
    }
    result.push_str(rest);
    *text = result;
}

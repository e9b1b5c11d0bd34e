//! Reads a Markdown file: its paragraphs, without code.

use super::text::{Kind, Text};

/// Returns the paragraphs of a file; a row of a table is a paragraph of its own.
pub(super) fn read(source: &str) -> Vec<Text> {
    let mut found: Vec<Text> = Vec::new();
    let (mut fence, mut open) = (false, false);
    for (index, line) in source.lines().enumerate() {
        let text = line.trim();
        let is_fence = text.starts_with("```");
        fence ^= is_fence;
        if fence || is_fence || text.is_empty() {
            open = false;
            continue;
        }
        let begins = ["#", "|", "* ", "- ", "<!--"];
        let begins = begins.iter().any(|mark| text.starts_with(mark));
        match found.last_mut() {
            Some(paragraph) if open && !begins => {
                paragraph.body.push('\n');
                paragraph.body.push_str(text);
            }
            _ => found.push(Text {
                line: index + 1,
                kind: Kind::Prose,
                public: true,
                name: String::new(),
                body: text.to_owned(),
            }),
        }
        open = true;
    }
    found
}

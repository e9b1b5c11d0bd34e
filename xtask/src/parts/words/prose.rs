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
        // A heading is one line.
        open = !text.starts_with('#');
    }
    found
}

#[cfg(test)]
mod tests {
    use super::read;

    #[test]
    fn paragraphs_rows_and_items_are_apart_and_code_is_left_out() {
        let source = "# Title\nA text\nof two lines.\n\n```rust\nlet what = 1;\n```\n| a | b |\n| c | d |\n* item\n  goes on\n";
        let found: Vec<_> = read(source)
            .into_iter()
            .map(|text| (text.line, text.body))
            .collect();
        let expected = [
            (1, "# Title"),
            (2, "A text\nof two lines."),
            (8, "| a | b |"),
            (9, "| c | d |"),
            (10, "* item\ngoes on"),
        ];
        assert_eq!(found, expected.map(|(line, body)| (line, body.to_owned())));
    }
}

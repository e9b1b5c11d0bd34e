//! Text from programs and shared memory, made safe for a terminal.

use std::borrow::Cow;
use std::fmt::Write as _;

/// Returns `text` in a form that is safe to print on a terminal. Characters that a terminal would obey instead of
/// showing them are escaped, such as `\u{1b}` and `\n`: control characters, and characters that change the direction of
/// text or have no width. A tab becomes a blank.
///
/// All text that a program may have chosen passes through this function before a person sees it: names in windows,
/// lines of the log, errors. Only `condor tty` shows the bytes of a terminal unchanged.
pub fn plain(text: &str) -> Cow<'_, str> {
    if !text.chars().any(is_obeyed) {
        return Cow::Borrowed(text);
    }
    let mut plain = String::with_capacity(text.len() + 16);
    for character in text.chars() {
        match character {
            '\t' => plain.push(' '),
            _ if is_obeyed(character) => {
                // A string takes everything.
                let _ = write!(plain, "{}", character.escape_default());
            }
            _ => plain.push(character),
        }
    }
    Cow::Owned(plain)
}

/// Returns the lines that a terminal shows after `text` was written to it, in a form that is safe to print: of a line
/// that a program has written again from its beginning, the last form.
#[must_use]
pub fn shown_lines(text: &str) -> String {
    let shown = |line: &str| {
        // A terminal that makes `\r\n` of newlines makes more of those that are so already.
        let line = line.trim_end_matches('\r');
        let last = line.rsplit('\r').next().unwrap_or_default();
        plain(&last.replace("\x1b[K", "")).into_owned()
    };
    let lines: Vec<_> = text.lines().map(shown).collect();
    lines.join("\n")
}

/// Returns a text of several lines in a form that is safe to print: it escapes the same characters as [`plain`], but
/// keeps the line ends.
pub fn plain_lines(text: &str) -> String {
    let lines: Vec<_> = text.lines().map(plain).collect();
    lines.join("\n")
}

/// Writes `value` as JSON that is safe to print: the characters that [`plain`] escapes are written as JSON escapes, so
/// strings keep their meaning.
///
/// # Errors
/// Returns the serializer's error if `value` cannot be written as JSON.
pub fn plain_json(value: &impl serde::Serialize) -> serde_json::Result<String> {
    let json = serde_json::to_string(value)?;
    let mut plain = String::with_capacity(json.len());
    for character in json.chars() {
        if is_obeyed(character) {
            for unit in character.encode_utf16(&mut [0; 2]) {
                // A string takes everything.
                let _ = write!(plain, "\\u{unit:04x}");
            }
        } else {
            plain.push(character);
        }
    }
    Ok(plain)
}

const fn is_obeyed(character: char) -> bool {
    matches!(
        character,
        '\0'..='\x1f'
            | '\x7f'..='\u{9f}'
            | '\u{ad}'
            | '\u{61c}'
            | '\u{200b}'..='\u{200f}'
            | '\u{2028}'..='\u{202e}'
            | '\u{2060}'..='\u{206f}'
            | '\u{feff}'
            | '\u{fff9}'..='\u{fffb}'
            | '\u{e0000}'..='\u{e007f}'
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_a_terminal_obeys_is_spelled_out() {
        assert!(matches!(plain("a joint of 3°"), Cow::Borrowed(_)));
        let escapes = plain("\x1b[2J\x07a\tb\r\n\u{9b}c");
        assert_eq!(escapes, "\\u{1b}[2J\\u{7}a b\\r\\n\\u{9b}c");
        assert_eq!(plain("\u{202e}txt\u{200b}"), "\\u{202e}txt\\u{200b}");
        assert_eq!(plain(&escapes), escapes, "twice is once");
        assert_eq!(plain_lines("a\r\nb\x1b\n"), "a\nb\\u{1b}");
        let prompts = "\r> \x1b[Kenable\r\n\r> \x1b[K\r\x1b[Kdone\r\n\r> \x1b[K";
        assert_eq!(shown_lines(prompts), "> enable\ndone\n> ");
        assert_eq!(shown_lines("1\r\r\n2\r\n"), "1\n2");
    }

    #[test]
    fn json_says_the_same_without_it() {
        let text = "\x1b\u{9b}\u{e0001}\u{202e}ä";
        let json = plain_json(&text).expect("a string");
        assert!(!json.chars().any(is_obeyed), "{json:?}");
        assert_eq!(serde_json::from_str::<String>(&json).expect("JSON"), text);
    }
}

//! Any bytes, typed at a line editor whose completion offers any words, and the picture on a small terminal of
//! 80 columns.

use std::cell::Cell;
use std::fmt::{self, Write as _};

use crate::LineEditor;

use super::script::Script;

/// The parts of which words are made; no word can have some of them.
const PARTS: [&str; 8] = [
    "a",
    "b",
    ".",
    "\u{f6}",
    " ",
    "\x1b",
    "index.middle",
    "\u{3c0}",
];

/// A simulated terminal that understands only the escape sequences that a [`LineEditor`] may write.
pub struct Screen {
    pub rows: Vec<Vec<char>>,
    column: usize,
    held: String,
}

impl Screen {
    pub const COLUMNS: usize = 80;

    pub fn new() -> Self {
        Self {
            rows: vec![Vec::new()],
            column: 0,
            held: String::new(),
        }
    }

    pub fn last(&self) -> String {
        let row: String = self.rows.last().unwrap().iter().collect();
        row.trim_end().to_owned()
    }

    fn character(&mut self, character: char) {
        if !self.held.is_empty() {
            self.held.push(character);
            if character.is_ascii_alphabetic() {
                let sequence = std::mem::take(&mut self.held);
                match sequence.as_str() {
                    "\x1b[K" => self.rows.last_mut().unwrap().truncate(self.column),
                    other => {
                        let right = other.strip_prefix("\x1b[").unwrap();
                        let right = right.strip_suffix('C').expect(other);
                        self.column += right.parse::<usize>().unwrap();
                        assert!(self.column < Self::COLUMNS);
                    }
                }
            }
            return;
        }
        match character {
            '\x1b' => self.held.push(character),
            '\r' => self.column = 0,
            '\n' => {
                self.rows.push(Vec::new());
                self.column = 0;
            }
            '\x08' => {
                self.column = self
                    .column
                    .checked_sub(1)
                    .expect("not past the first column");
            }
            '\x07' => {}
            character => {
                assert!(!character.is_control(), "{character:?}");
                if self.column == Self::COLUMNS {
                    self.rows.push(Vec::new());
                    self.column = 0;
                }
                let row = self.rows.last_mut().unwrap();
                while row.len() <= self.column {
                    row.push(' ');
                }
                row[self.column] = character;
                self.column += 1;
            }
        }
    }
}

impl fmt::Write for Screen {
    fn write_str(&mut self, text: &str) -> fmt::Result {
        text.chars().for_each(|character| self.character(character));
        Ok(())
    }
}

/// Checks that the line in `editor` is valid, and that `screen` shows `prompt`, and the part of the line around the
/// cursor.
///
/// # Panics
/// Panics if the line or the screen is wrong.
pub fn check<const LINE: usize, const LINES: usize>(
    editor: &LineEditor<LINE, LINES>,
    screen: &Screen,
    prompt: &str,
) {
    let line = editor.line();
    assert!(line.len() <= LINE, "{line:?}");
    assert!(!line.chars().any(char::is_control), "{line:?}");
    let before = line.get(..editor.cursor());
    let before = before.expect("the cursor is between characters of the line");
    let left = (prompt.len() + before.chars().count()).checked_sub(screen.column);
    let left = left.expect("the cursor is in the line that is shown");
    let width = Screen::COLUMNS - 1 - prompt.len();
    let shown: String = line.chars().skip(left).take(width).collect();
    assert_eq!(screen.last(), format!("{prompt}{shown}").trim_end());
}

/// Runs a fuzz test of a [`LineEditor`]: `bytes` are the characters that are typed, and decide the sizes of the editor.
///
/// # Panics
/// Panics if the editor shows a wrong screen, or its line is too long or has control characters.
pub fn run(bytes: &[u8]) {
    let script = Script::new(bytes);
    match script.below(4) {
        0 => types::<0, 0>(&script),
        1 => types::<7, 1>(&script),
        2 => types::<79, 2>(&script),
        _ => types::<200, 4>(&script),
    }
}

fn types<const LINE: usize, const LINES: usize>(script: &Script<'_>) {
    let word = |_| -> String {
        let parts = 0..script.below(20);
        parts.map(|_| PARTS[script.below(PARTS.len())]).collect()
    };
    let words: Vec<String> = (0..script.below(6)).map(word).collect();
    let offers_others = script.below(2) == 1;
    let calls = Cell::new(0);
    let mut complete = |before: &str, offer: &mut dyn FnMut(&str)| {
        assert!(before.len() <= LINE, "{before:?}");
        // In some runs, each call offers other words than the one before.
        calls.set(calls.get() + usize::from(offers_others));
        words.iter().skip(calls.get() % 2).for_each(|it| offer(it));
    };
    let prompt = ["", "> "][script.below(2)];
    let mut editor = LineEditor::<LINE, LINES>::new().with_prompt(prompt);
    let mut screen = Screen::new();
    editor.show(&mut screen).unwrap();
    while !script.is_over() {
        let byte = script.byte();
        if byte == 0xff {
            // No text has this byte: here it stands for an interrupt.
            editor.clear();
            screen.write_char('\n').unwrap();
            editor.show(&mut screen).unwrap();
        } else if let Some(line) = editor.feed(byte, &mut complete, &mut screen).unwrap() {
            assert!(line.as_str().len() <= LINE, "{line:?}");
            assert!(!line.as_str().chars().any(char::is_control), "{line:?}");
            assert_eq!((editor.line(), editor.cursor()), ("", 0));
            editor.show(&mut screen).unwrap();
        }
        check(&editor, &screen, prompt);
    }
}

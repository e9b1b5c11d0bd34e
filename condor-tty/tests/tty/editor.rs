//! The line editor against a reference model, and what it shows against a small terminal of 80 columns.
#![cfg(feature = "hostile")]

use std::fmt::Write as _;

use condor_tty::LineEditor;
use proptest::prelude::*;

use condor_tty::hostile::typing::{self, Screen, check};

const LINE: usize = 120;
const LINES: usize = 4;
type Editor = LineEditor<LINE, LINES>;

const WORDS: [&str; 5] = ["help", "status", "stop", "index.proximal", "index.middle"];

fn words(_before: &str, offer: &mut dyn FnMut(&str)) {
    for word in WORDS {
        offer(word);
    }
}

/// What is typed.
#[derive(Clone, Debug)]
enum Typed {
    Text(String),
    Left,
    Right,
    Home,
    End,
    Erase,
    Delete,
    KillWord,
    KillLine,
    Former,
    Next,
    Tab,
    Show,
    Enter,
    /// A sequence without effect.
    Other(&'static str),
}

impl Typed {
    /// One of the ways to type it.
    fn bytes(&self, way: bool) -> Vec<u8> {
        let of = |one: &str, other: &str| if way { one } else { other }.as_bytes().to_vec();
        match self {
            Self::Text(text) => text.as_bytes().to_vec(),
            Self::Left => of("\x1b[D", "\x02"),
            Self::Right => of("\x1bOC", "\x06"),
            Self::Home => of("\x1b[1~", "\x01"),
            Self::End => of("\x1b[F", "\x05"),
            Self::Erase => of("\x7f", "\x08"),
            Self::Delete => of("\x1b[3~", "\x1b[3;1~"),
            Self::KillWord => of("\x17", "\x17"),
            Self::KillLine => of("\x15", "\x15"),
            Self::Former => of("\x1b[A", "\x10"),
            Self::Next => of("\x1bOB", "\x0e"),
            Self::Tab => of("\t", "\t"),
            Self::Show => of("\x0c", "\x0c"),
            Self::Enter => of("\r", "\n"),
            Self::Other(text) => of(text, text),
        }
    }
}

/// The editor as a vector of characters.
#[derive(Default)]
struct Model {
    line: Vec<char>,
    cursor: usize,
    history: Vec<Vec<char>>,
    back: usize,
    draft: Vec<char>,
}

impl Model {
    fn len(&self) -> usize {
        self.line.iter().map(|it| it.len_utf8()).sum()
    }

    fn text(&self) -> String {
        self.line.iter().collect()
    }

    fn put(&mut self, text: &str, whole: bool) {
        if whole && self.len() + text.len() > LINE {
            return;
        }
        for character in text.chars() {
            if self.len() + character.len_utf8() <= LINE {
                self.line.insert(self.cursor, character);
                self.cursor += 1;
            }
        }
    }

    fn recall(&mut self, back: usize) {
        if back > self.history.len() || back == self.back {
            return;
        }
        if self.back == 0 {
            self.draft = self.line.clone();
        }
        self.line = match back {
            0 => self.draft.clone(),
            back => self.history[self.history.len() - back].clone(),
        };
        self.back = back;
        self.cursor = self.line.len();
    }

    fn types(&mut self, typed: &Typed) -> Option<String> {
        match typed {
            Typed::Text(text) => self.put(text, false),
            Typed::Left => self.cursor = self.cursor.saturating_sub(1),
            Typed::Right => self.cursor = (self.cursor + 1).min(self.line.len()),
            Typed::Home => self.cursor = 0,
            Typed::End => self.cursor = self.line.len(),
            Typed::Erase => {
                if self.cursor > 0 {
                    self.cursor -= 1;
                    self.line.remove(self.cursor);
                }
            }
            Typed::Delete => {
                if self.cursor < self.line.len() {
                    self.line.remove(self.cursor);
                }
            }
            Typed::KillWord => {
                for blanks in [true, false] {
                    while self.cursor > 0 && (self.line[self.cursor - 1] == ' ') == blanks {
                        self.cursor -= 1;
                        self.line.remove(self.cursor);
                    }
                }
            }
            Typed::KillLine => {
                self.line.clear();
                self.cursor = 0;
            }
            Typed::Former => self.recall(self.back + 1),
            Typed::Next => self.recall(self.back.saturating_sub(1)),
            Typed::Tab => self.complete(),
            Typed::Enter => {
                let line = std::mem::take(&mut self.line);
                let text = line.iter().collect();
                if !line.is_empty() && self.history.last() != Some(&line) {
                    self.history.push(line);
                    if self.history.len() > LINES {
                        self.history.remove(0);
                    }
                }
                (self.cursor, self.back) = (0, 0);
                return Some(text);
            }
            Typed::Show | Typed::Other(_) => {}
        }
        None
    }

    fn complete(&mut self) {
        let before: String = self.line[..self.cursor].iter().collect();
        let word = before.rsplit(' ').next().unwrap();
        let fit: Vec<_> = WORDS.iter().filter(|it| it.starts_with(word)).collect();
        let Some(first) = fit.first() else {
            return;
        };
        let is_common = |len: &usize| fit.iter().all(|it| it.starts_with(&first[..*len]));
        let common = (0..=first.len()).rev().find(is_common).unwrap();
        let rest = first[word.len()..common].to_owned();
        let at_end = self.cursor == self.line.len();
        self.put(&rest, true);
        if fit.len() == 1 && at_end {
            self.put(" ", true);
        }
    }
}

fn typed() -> impl Strategy<Value = Typed> {
    prop_oneof![
        6 => "[a-z .öπ]{1,12}".prop_map(Typed::Text),
        2 => "(help|sta|st|index|index[.]m|x)".prop_map(Typed::Text),
        1 => "[a-z]{30,90}".prop_map(Typed::Text),
        3 => Just(Typed::Left),
        2 => Just(Typed::Right),
        1 => Just(Typed::Home),
        1 => Just(Typed::End),
        3 => Just(Typed::Erase),
        1 => Just(Typed::Delete),
        1 => Just(Typed::KillWord),
        1 => Just(Typed::KillLine),
        2 => Just(Typed::Former),
        2 => Just(Typed::Next),
        2 => Just(Typed::Tab),
        1 => Just(Typed::Show),
        3 => Just(Typed::Enter),
        1 => prop_oneof![
            Just("\x1b[5~"), Just("\x1b[200;3u"), Just("\x1bOP"), Just("\x00"), Just("\x04"),
        ].prop_map(Typed::Other),
    ]
}

/// What stood behind the end of a line is no part of it.
#[test]
fn a_line_that_is_entered_again_is_kept_once() {
    let (mut editor, mut screen) = (Editor::new(), Screen::new());
    let mut types = |text: &str| {
        for byte in text.bytes() {
            editor.feed(byte, &mut words, &mut screen).unwrap();
        }
        editor.line().to_owned()
    };
    types("a\r");
    types("b\r");
    // The former line, a blank that is erased, and Enter.
    types("\x10 \x7f\r");
    assert_eq!(types("\x10"), "b");
    assert_eq!(types("\x10"), "a");
}

proptest! {
    #[test]
    fn what_is_typed_is_what_the_model_has_and_what_the_terminal_shows(
        prompt in prop_oneof![Just(""), Just("> ")],
        all in prop::collection::vec((typed(), any::<bool>()), 1..60),
    ) {
        let mut editor = Editor::new().with_prompt(prompt);
        let (mut model, mut screen) = (Model::default(), Screen::new());
        editor.show(&mut screen).unwrap();
        for (one, way) in all {
            let expected = model.types(&one);
            let mut ended = None;
            for byte in one.bytes(way) {
                let line = editor.feed(byte, &mut words, &mut screen).unwrap();
                ended = ended.or(line);
            }
            prop_assert_eq!(ended.map(|line| line.as_str().to_owned()), expected.clone());
            prop_assert_eq!(editor.line(), model.text());
            let before: String = model.line[..model.cursor].iter().collect();
            prop_assert_eq!(editor.cursor(), before.len());
            if let Some(expected) = expected {
                // Its last rows are the line that was ended, and an empty one.
                let shown: String = screen.rows.iter().rev().skip(1)
                    .take((prompt.len() + expected.chars().count()).div_ceil(Screen::COLUMNS).max(1))
                    .collect::<Vec<_>>().into_iter().rev().flatten().collect();
                let expected = format!("{prompt}{expected}");
                prop_assert_eq!(shown.trim_end(), expected.trim_end());
                editor.show(&mut screen).unwrap();
            }
            check(&editor, &screen, prompt);
        }
    }

    #[test]
    fn whatever_bytes_come_and_whatever_words_are_offered_the_line_is_bounded_and_shown(
        bytes in prop::collection::vec(prop_oneof![
            any::<u8>(), 0x20..0x7f_u8, Just(0x1b), Just(b'['), Just(b'\t'), Just(b'\r'), 0x80..0xff_u8,
        ], 0..400),
    ) {
        typing::run(&bytes);
    }
}

fn shown(typed: &str) -> (Editor, Screen) {
    let (mut editor, mut screen) = (Editor::new(), Screen::new());
    for byte in typed.bytes() {
        editor.feed(byte, &mut words, &mut screen).unwrap();
    }
    (editor, screen)
}

#[test]
fn a_word_is_completed_as_far_as_it_is_certain_and_then_listed() {
    let (editor, _) = shown("to in\t");
    assert_eq!(editor.line(), "to index.");
    let (editor, _) = shown("to in\tm\t1");
    assert_eq!(editor.line(), "to index.middle 1");
    let (editor, screen) = shown("to index.\t");
    assert_eq!(editor.line(), "to index.");
    let rows: Vec<String> = screen.rows.iter().map(|row| row.iter().collect()).collect();
    assert_eq!(
        rows,
        ["to index.", "index.proximal  index.middle", "to index."]
    );
    let (editor, _) = shown("x\t");
    assert_eq!(editor.line(), "x");
}

#[test]
fn the_history_goes_back_and_forth_and_keeps_what_was_begun() {
    let (mut editor, mut screen) = shown("one\rtwo\rtwo\r\rthr");
    for (key, line) in [
        ("\x1b[A", "two"),
        ("\x10", "one"),
        ("\x1b[A", "one"),
        ("\x1b[B", "two"),
        ("\x0e", "thr"),
        ("\x0e", "thr"),
    ] {
        for byte in key.bytes() {
            editor.feed(byte, &mut words, &mut screen).unwrap();
        }
        assert_eq!(editor.line(), line);
        assert_eq!(screen.last(), line);
    }
}

#[test]
fn a_sequence_that_does_not_end_swallows_no_line() {
    let (editor, screen) = shown("a\x1b[\rb\x1b\r");
    assert_eq!(editor.line(), "");
    let rows: Vec<String> = screen.rows.iter().map(|row| row.iter().collect()).collect();
    assert_eq!(rows, ["a", "b", ""]);
}

#[test]
fn a_program_writes_above_the_line_that_is_being_typed() {
    let mut editor = Editor::new().with_prompt("> ");
    let mut screen = Screen::new();
    editor.show(&mut screen).unwrap();
    for byte in *b"stop\x02" {
        editor.feed(byte, &mut words, &mut screen).unwrap();
    }
    screen.write_str("\r\x1b[Ksaid\n").unwrap();
    editor.show(&mut screen).unwrap();
    for byte in *b"-\r" {
        editor.feed(byte, &mut words, &mut screen).unwrap();
    }
    let rows: Vec<String> = screen.rows.iter().map(|row| row.iter().collect()).collect();
    assert_eq!(rows, ["said", "> sto-p", ""]);
}

#[test]
fn the_escape_key_alone_swallows_nothing() {
    for (typed, line) in [
        ("\x1bhelp", "help"),
        ("sta\x1b\x1b\x1btus", "status"),
        ("\x1bé", "é"),
        ("ab\x1b\x1b[Dx", "axb"),
        ("ab\x1b\x1bODx", "axb"),
        ("ab\x1b\x7fc", "ac"),
    ] {
        let (editor, screen) = shown(typed);
        assert_eq!(editor.line(), line, "{typed:?}");
        assert_eq!(screen.last(), line, "{typed:?}");
    }
}

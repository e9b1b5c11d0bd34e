//! [`LineEditor`]: lines that a person edits, with history and completion.

use core::fmt::{self, Write};

/// The columns of a prompt and a line that are shown at a time: a terminal of 80 columns never wraps it.
const WIDTH: usize = 79;

/// An editor for the line that a person types at a program's terminal: it takes one typed byte at a time, and writes
/// the text that the person sees.
///
/// `LINE` is the length of the longest line in bytes, and `LINES` the number of lines that are kept
/// as history. Use it with a terminal of the settings
/// [`TerminalSettings::CBREAK`](crate::TerminalSettings::CBREAK), whose program echoes typed characters.
///
/// | key | effect |
/// |---|---|
/// | Left and Right, ^B and ^F | move by a character |
/// | Home and End, ^A and ^E | move to the ends of the line |
/// | Backspace, Delete | remove the character before, or at, the cursor |
/// | ^W, ^U | remove the word before the cursor, or the whole line |
/// | Up and Down, ^P and ^N | show the former and the next line of the history |
/// | Tab | completes the word before the cursor, or lists what it can be |
/// | ^L | shows the line again |
/// | Enter | ends the line |
///
/// Other control characters and escape sequences have no effect. The Escape key alone has no effect either, except that
/// a `[` or `O` typed after it, however much later, counts as the sequence of another key. A line begins in the first
/// column. If a line with its prompt is longer than 79 columns, only a part of it is shown while it is edited. Each
/// character counts as one column.
///
/// ```
/// use condor_tty::LineEditor;
///
/// let mut editor = LineEditor::<80, 8>::new();
/// let mut shown = String::new();
/// let words = |_before: &str, offer: &mut dyn FnMut(&str)| ["help", "status"].map(offer);
/// let mut typed = None;
/// for byte in *b"st\tnow\n" {
///     let mut complete = |before: &str, offer: &mut dyn FnMut(&str)| {
///         words(before, offer);
///     };
///     typed = editor.feed(byte, &mut complete, &mut shown)?;
/// }
/// assert_eq!(typed.unwrap().as_str(), "status now");
/// assert_eq!(shown, "status now\n");
/// # Ok::<(), core::fmt::Error>(())
/// ```
#[derive(Clone, Debug)]
pub struct LineEditor<const LINE: usize, const LINES: usize> {
    line: InputLine<LINE>,
    /// The place of the next character, in bytes.
    cursor: usize,
    /// The first character that is shown.
    left: usize,
    /// The newest line is the first one.
    history: [InputLine<LINE>; LINES],
    /// The number of lines that the history has.
    kept: usize,
    /// The number of the line of the history that is shown, from 1; 0 for the new one.
    back: usize,
    /// The new line, while another one is shown.
    draft: InputLine<LINE>,
    escape: Escape,
    /// The beginning of a character of several bytes.
    begun: InputLine<4>,
    prompt: &'static str,
}

/// A line of at most `LINE` bytes, which a [`LineEditor`] returns when the person ends it.
#[derive(Clone, Copy, Debug)]
pub struct InputLine<const LINE: usize> {
    /// Those behind `len` are what was there before.
    bytes: [u8; LINE],
    len: usize,
}

impl<const LINE: usize> PartialEq for InputLine<LINE> {
    fn eq(&self, other: &Self) -> bool {
        self.as_str() == other.as_str()
    }
}

impl<const LINE: usize> Eq for InputLine<LINE> {}

/// The part of an escape sequence that has come.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Escape {
    None,
    /// The escape character.
    Begun,
    /// `ESC O`.
    Single,
    /// `ESC [`, and the first number after it.
    Control {
        number: u8,
        /// The number has ended.
        ended: bool,
    },
}

/// The meaning of a byte.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Meaning {
    /// The byte has no effect, or none yet.
    Nothing,
    /// A part of a character.
    Character,
    Key(Key),
}

/// The action of a key.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Key {
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
    Complete,
    Show,
    Enter,
}

/// A callback of a [`LineEditor`] that proposes completions of the word before the cursor. It gets the line up to the
/// cursor, and a function, which it calls with each whole word that could replace the word before the cursor.
pub type Complete<'c> = dyn FnMut(&str, &mut dyn FnMut(&str)) + 'c;

impl<const LINE: usize> InputLine<LINE> {
    const EMPTY: Self = Self {
        bytes: [0; LINE],
        len: 0,
    };

    /// Returns the text of the line, without a newline.
    #[must_use]
    pub fn as_str(&self) -> &str {
        let bytes = self.bytes.get(..self.len).unwrap_or_default();
        // Only whole characters are put in and taken out.
        str::from_utf8(bytes).unwrap_or_default()
    }

    fn split(&self, at: usize) -> (&str, &str) {
        self.as_str().split_at_checked(at).unwrap_or_default()
    }

    /// Puts text in at a place; returns whether there is room.
    fn insert(&mut self, at: usize, text: &str) -> bool {
        let count = text.len();
        if self.len.saturating_add(count) > LINE {
            return false;
        }
        for from in (at..self.len).rev() {
            let moved = self.bytes.get(from).copied().unwrap_or(0);
            if let Some(place) = self.bytes.get_mut(from.saturating_add(count)) {
                *place = moved;
            }
        }
        for (place, byte) in self.bytes.iter_mut().skip(at).zip(text.bytes()) {
            *place = byte;
        }
        self.len = self.len.saturating_add(count);
        true
    }

    /// Takes out `count` bytes from a place on.
    fn remove(&mut self, at: usize, count: usize) {
        let rest = at.saturating_add(count);
        for from in rest..self.len {
            let moved = self.bytes.get(from).copied().unwrap_or(0);
            if let Some(place) = self.bytes.get_mut(from.saturating_sub(count)) {
                *place = moved;
            }
        }
        self.len = self
            .len
            .saturating_sub(count.min(self.len.saturating_sub(at)));
    }

    fn truncate(&mut self, len: usize) {
        self.len = self.len.min(len);
    }
}

impl<const LINE: usize, const LINES: usize> Default for LineEditor<LINE, LINES> {
    fn default() -> Self {
        Self::new()
    }
}

impl<const LINE: usize, const LINES: usize> LineEditor<LINE, LINES> {
    /// Makes an editor with an empty line and an empty history.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            line: InputLine::EMPTY,
            cursor: 0,
            left: 0,
            history: [InputLine::EMPTY; LINES],
            kept: 0,
            back: 0,
            draft: InputLine::EMPTY,
            escape: Escape::None,
            begun: InputLine::EMPTY,
            prompt: "",
        }
    }

    /// Returns the editor with a text that stands before each line, such as `"> "`. The shorter it is, the more of a
    /// long line is seen. Call [`show`](Self::show) before the person types the first line, and after each line that
    /// [`feed`](Self::feed) returns.
    #[must_use]
    pub const fn with_prompt(mut self, prompt: &'static str) -> Self {
        self.prompt = prompt;
        self
    }

    /// Returns the line that is being typed, as far as it has come.
    #[must_use]
    pub fn line(&self) -> &str {
        self.line.as_str()
    }

    /// Returns the position of the cursor, in bytes from the beginning of the line.
    #[must_use]
    pub const fn cursor(&self) -> usize {
        self.cursor
    }

    /// Drops the line that is being typed, and writes nothing to the terminal. Call it when the program was interrupted
    /// from the keyboard, for example.
    pub fn clear(&mut self) {
        (self.line, self.begun, self.escape) = (InputLine::EMPTY, InputLine::EMPTY, Escape::None);
        (self.cursor, self.left, self.back) = (0, 0, 0);
    }

    /// Takes a byte that was typed, and writes the resulting changes of the terminal to `out`. Returns the line if the
    /// byte ends it, otherwise `None`. `complete` is called when Tab was typed; see [`Complete`].
    ///
    /// # Errors
    /// Returns the error of `out` if it fails; the byte has been taken nevertheless.
    pub fn feed(
        &mut self,
        byte: u8,
        complete: &mut Complete<'_>,
        out: &mut dyn Write,
    ) -> Result<Option<InputLine<LINE>>, fmt::Error> {
        match self.meaning(byte) {
            Meaning::Nothing => {}
            Meaning::Character => self.character(byte, out)?,
            Meaning::Key(Key::Enter) => return self.end(out).map(Some),
            Meaning::Key(Key::Complete) => self.complete(complete, out)?,
            Meaning::Key(key) => {
                let at_end = self.cursor == self.line.len;
                let before = self.line;
                let was = self.cursor;
                self.edit(key);
                let has_changed = self.line != before || self.cursor != was;
                if key == Key::Show {
                    self.show(out)?;
                } else if key == Key::Erase && at_end && has_changed && self.left == 0 {
                    out.write_str("\x08 \x08")?;
                } else if has_changed {
                    self.show(out)?;
                }
            }
        }
        Ok(None)
    }

    /// Returns the meaning of a byte.
    fn meaning(&mut self, byte: u8) -> Meaning {
        let escape = core::mem::replace(&mut self.escape, Escape::None);
        let meaning = match (escape, byte) {
            (_, 0x1b) => {
                self.escape = Escape::Begun;
                Meaning::Nothing
            }
            (Escape::Begun, b'[') => {
                let (number, ended) = (0, false);
                self.escape = Escape::Control { number, ended };
                Meaning::Nothing
            }
            (Escape::Begun, b'O') => {
                self.escape = Escape::Single;
                Meaning::Nothing
            }
            (Escape::Control { number, ended }, 0x20..=0x3f) => {
                let digit = byte.wrapping_sub(b'0');
                let goes_on = !ended && digit < 10;
                let number = if goes_on {
                    number.saturating_mul(10).saturating_add(digit)
                } else {
                    number
                };
                // A byte that is not a digit ends the number, and not the sequence.
                let ended = !goes_on;
                self.escape = Escape::Control { number, ended };
                Meaning::Nothing
            }
            (Escape::Single, 0x20..=0x7e) => sequence(0, byte),
            (Escape::Control { number, .. }, 0x20..=0x7e) => sequence(number, byte),
            // A control character counts even within a sequence; and after the escape character alone,
            // which a person has typed, every other one is what it would be without it.
            _ => control(byte),
        };
        if meaning != Meaning::Character {
            self.begun = InputLine::EMPTY;
        }
        meaning
    }

    /// Takes a byte of a character, and puts the character in when it is whole.
    fn character(&mut self, byte: u8, out: &mut dyn Write) -> fmt::Result {
        if byte & 0xc0 != 0x80 {
            // A new one; what there was of another one was none.
            self.begun = InputLine::EMPTY;
        }
        let InputLine { bytes, len } = &mut self.begun;
        if let Some(place) = bytes.get_mut(*len) {
            *place = byte;
            *len = len.saturating_add(1);
        }
        let begun = self.begun;
        let bytes = begun.bytes.get(..begun.len).unwrap_or_default();
        match str::from_utf8(bytes) {
            Ok(text) => {
                self.begun = InputLine::EMPTY;
                // Some of them are control characters, too.
                if text.chars().any(char::is_control) {
                    return Ok(());
                }
                self.put(text, out)
            }
            Err(error) => {
                if error.error_len().is_some() {
                    self.begun = InputLine::EMPTY;
                }
                Ok(())
            }
        }
    }

    /// Puts text in at the cursor.
    fn put(&mut self, text: &str, out: &mut dyn Write) -> fmt::Result {
        let at_end = self.cursor == self.line.len;
        if !self.line.insert(self.cursor, text) {
            return out.write_char('\x07');
        }
        self.cursor = self.cursor.saturating_add(text.len());
        if at_end && self.left == 0 && columns(self.line()) <= self.width() {
            return out.write_str(text);
        }
        self.show(out)
    }

    /// Ends the line.
    fn end(&mut self, out: &mut dyn Write) -> Result<InputLine<LINE>, fmt::Error> {
        let line = self.line;
        let is_cut = columns(line.as_str()) > self.width();
        self.clear();
        let newest = self.history.first().filter(|_| self.kept > 0);
        if line.len > 0 && newest != Some(&line) {
            let mut moved = line;
            for place in &mut self.history {
                core::mem::swap(place, &mut moved);
            }
            self.kept = self.kept.saturating_add(1).min(LINES);
        }
        if is_cut {
            // A line that is ended is shown as a whole.
            write!(out, "\r{}{}", self.prompt, line.as_str())?;
        }
        out.write_str("\n")?;
        Ok(line)
    }

    fn edit(&mut self, key: Key) {
        let (before, after) = self.line.split(self.cursor);
        let one_before = before.chars().next_back().map_or(0, char::len_utf8);
        let one_after = after.chars().next().map_or(0, char::len_utf8);
        match key {
            Key::Left => self.cursor = self.cursor.saturating_sub(one_before),
            Key::Right => self.cursor = self.cursor.saturating_add(one_after),
            Key::Home => self.cursor = 0,
            Key::End => self.cursor = self.line.len,
            Key::Erase => self.remove_before(one_before),
            Key::Delete => self.line.remove(self.cursor, one_after),
            Key::KillWord => {
                let mut bytes = before.bytes().rev();
                let blanks = bytes.by_ref().take_while(|byte| *byte == b' ').count();
                // The first byte of the word has been taken above.
                let word = bytes.take_while(|byte| *byte != b' ').count();
                let count = blanks.saturating_add(word).saturating_add(1);
                self.remove_before(count.min(before.len()));
            }
            Key::KillLine => (self.line, self.cursor) = (InputLine::EMPTY, 0),
            Key::Former => self.recall(self.back.saturating_add(1)),
            Key::Next => self.recall(self.back.saturating_sub(1)),
            Key::Complete | Key::Show | Key::Enter => {}
        }
    }

    fn remove_before(&mut self, count: usize) {
        self.cursor = self.cursor.saturating_sub(count);
        self.line.remove(self.cursor, count);
    }

    /// Takes a line of the history for the present one, from 1; 0 is the new line.
    fn recall(&mut self, back: usize) {
        if back > self.kept || back == self.back {
            return;
        }
        if self.back == 0 {
            self.draft = self.line;
        }
        let recalled = match back.checked_sub(1) {
            Some(number) => self.history.get(number),
            None => Some(&self.draft),
        };
        self.line = recalled.copied().unwrap_or(InputLine::EMPTY);
        (self.back, self.cursor) = (back, self.line.len);
    }

    /// Completes the word before the cursor, or lists what it can be.
    fn complete(&mut self, complete: &mut Complete<'_>, out: &mut dyn Write) -> fmt::Result {
        let line = self.line;
        let (before, after) = line.split(self.cursor);
        let behind = before
            .bytes()
            .rev()
            .take_while(|byte| *byte != b' ')
            .count();
        let begin = before.len().saturating_sub(behind);
        let (_, word) = before.split_at_checked(begin).unwrap_or_default();
        let (mut common, mut count) = (InputLine::<LINE>::EMPTY, 0_usize);
        complete(before, &mut |offered| {
            // Of the others nothing can be made here.
            let is_word = !offered.chars().any(|it| it == ' ' || it.is_control());
            if !offered.starts_with(word) || !is_word {
                return;
            }
            if count == 0 {
                common.insert(0, offered);
                count = usize::from(common.len > 0);
                return;
            }
            if common.as_str() == offered {
                return;
            }
            count = count.saturating_add(1);
            let both = common.as_str().chars().zip(offered.chars());
            let same = both.take_while(|(one, other)| one == other);
            common.truncate(same.map(|(one, _)| one.len_utf8()).sum());
        });
        let rest = common.as_str().strip_prefix(word).unwrap_or_default();
        match (count, rest) {
            (0, _) => out.write_char('\x07'),
            (1, rest) => {
                self.put(rest, out)?;
                if after.is_empty() {
                    self.put(" ", out)?;
                }
                Ok(())
            }
            (_, "") => {
                list(before, word, complete, out)?;
                self.show(out)
            }
            (_, rest) => self.put(rest, out),
        }
    }

    /// Writes the prompt and the line again, with the cursor where it is, over what stands in the terminal's present
    /// line. Call it when the program has written lines of its own. Before that, `"\r\x1b[K"` removes the line that was
    /// being typed.
    ///
    /// # Errors
    /// Returns the error of `out` if it fails.
    pub fn show(&mut self, out: &mut dyn Write) -> fmt::Result {
        let (before, after) = self.line.split(self.cursor);
        let (column, is_at_end) = (columns(before), after.is_empty());
        let width = self.width();
        if columns(self.line()) <= width {
            self.left = 0;
        } else if column < self.left || column > self.left.saturating_add(width) {
            self.left = column.saturating_sub(width / 2);
        }
        write!(out, "\r{}", self.prompt)?;
        for character in self.line().chars().skip(self.left).take(width) {
            out.write_char(character)?;
        }
        out.write_str("\x1b[K")?;
        if is_at_end {
            return Ok(());
        }
        let right = columns(self.prompt).saturating_add(column.saturating_sub(self.left));
        match right {
            0 => out.write_char('\r'),
            right => write!(out, "\r\x1b[{right}C"),
        }
    }

    /// Returns the columns of a line that are shown at a time.
    fn width(&self) -> usize {
        WIDTH.saturating_sub(columns(self.prompt))
    }
}

/// Returns the meaning of an escape sequence by its last byte, and by the first number in it.
fn sequence(number: u8, last: u8) -> Meaning {
    let key = match (last, number) {
        (b'A', _) => Key::Former,
        (b'B', _) => Key::Next,
        (b'C', _) => Key::Right,
        (b'D', _) => Key::Left,
        (b'H', _) | (b'~', 1 | 7) => Key::Home,
        (b'F', _) | (b'~', 4 | 8) => Key::End,
        (b'~', 3) => Key::Delete,
        _ => return Meaning::Nothing,
    };
    Meaning::Key(key)
}

/// Returns the meaning of a byte outside of a sequence.
fn control(byte: u8) -> Meaning {
    let key = match byte {
        b'\r' | b'\n' => Key::Enter,
        b'\t' => Key::Complete,
        0x08 | 0x7f => Key::Erase,
        0x01 => Key::Home,
        0x02 => Key::Left,
        0x05 => Key::End,
        0x06 => Key::Right,
        0x0c => Key::Show,
        0x0e => Key::Next,
        0x10 => Key::Former,
        0x15 => Key::KillLine,
        0x17 => Key::KillWord,
        0..=0x1f => return Meaning::Nothing,
        _ => return Meaning::Character,
    };
    Meaning::Key(key)
}

/// Lists what a word can be, in lines below the one that is typed.
fn list(before: &str, word: &str, complete: &mut Complete<'_>, out: &mut dyn Write) -> fmt::Result {
    let (mut outcome, mut column) = (Ok(()), 0_usize);
    complete(before, &mut |offered| {
        if !offered.starts_with(word) || offered.chars().any(char::is_control) {
            return;
        }
        let width = columns(offered);
        let fits = column > 0 && column.saturating_add(width).saturating_add(2) <= WIDTH;
        let (gap, former) = if fits {
            ("  ", column.saturating_add(2))
        } else {
            ("\n", 0)
        };
        column = former.saturating_add(width);
        outcome = outcome
            .and_then(|()| out.write_str(gap))
            .and_then(|()| out.write_str(offered));
    });
    outcome?;
    out.write_str("\n")
}

fn columns(text: &str) -> usize {
    text.chars().count()
}

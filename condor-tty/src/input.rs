//! [`Input`]: what has been typed, and the editing of the line that is being typed.

use core::array;

use crate::layout::mode;
use crate::settings::{Characters, Mode, Settings};
use crate::sync::{AtomicU16, Ordering, Word};

/// Flags of an element of the queue, above its character.
const LINE_ENDS: u16 = 0x100;
const END_OF_FILE: u16 = 0x200;

const BACKSPACE: u8 = 8;
const BELL: u8 = 7;

/// What became of a character.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Outcome {
    /// It has been taken.
    Taken(Echo),
    /// It interrupts.
    Interrupts(Echo),
    /// There is no room until the program reads.
    Full,
}

/// What is shown for a character.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Echo {
    Nothing,
    Byte(u8),
    /// A control character, as two.
    Caret(u8),
    /// A control character, as two, and the line ends.
    CaretAndNewline(u8),
    Newline,
    /// Columns that are wiped out.
    Wipe(u32),
}

/// What a look at the queue gave.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Taken {
    /// So many bytes, and no more for this read if `last`.
    Bytes { count: usize, last: bool },
    /// The end of the file, or of a line that has none.
    EndOfFile,
    /// There is nothing.
    Nothing,
}

/// A queue of `N` characters, a power of two, whose newest part is the line being edited.
///
/// Every call is made inside of the terminal's exclusive section.
#[derive(Debug)]
pub(crate) struct Input<const N: usize> {
    queue: [AtomicU16; N],
    /// Positions, which count for ever: what the program has read, what it may read, what has been
    /// typed.
    read: Word,
    committed: Word,
    typed: Word,
    settings: [Word; 3],
    stopped: Word,
    /// Whether a character has been refused, and nothing taken out since.
    refused: Word,
    /// Interrupts that the program has not been told of.
    interrupts: Word,
    /// Characters of lines that are longer than the queue.
    overlong: Word,
}

impl<const N: usize> Input<N> {
    const MASK: u32 = {
        assert!(
            N.is_power_of_two() && N >= 2 && N <= 1 << 16,
            "an input queue has a power of two from 2 to 65536 characters"
        );
        N as u32 - 1
    };

    pub(crate) fn new() -> Self {
        let word = || Word::new(0);
        let this = Self {
            queue: array::from_fn(|_| AtomicU16::new(0)),
            read: word(),
            committed: word(),
            typed: word(),
            settings: [word(), word(), word()],
            stopped: word(),
            refused: word(),
            interrupts: word(),
            overlong: word(),
        };
        this.configure(&Settings::COOKED);
        this
    }

    pub(crate) fn configure(&self, settings: &Settings) {
        let Settings {
            mode,
            echo,
            newlines,
            characters,
        } = *settings;
        let flags = [u8::from(mode == Mode::Raw), echo.into(), newlines.into()];
        let c = characters;
        let words = [
            [flags[0], flags[1], flags[2], c.erase],
            [c.kill_word, c.kill_line, c.end_of_file, c.interrupt],
            [c.stop, c.start, 0, 0],
        ];
        for (word, bytes) in self.settings.iter().zip(words) {
            word.set(u32::from_le_bytes(bytes));
        }
        if mode == Mode::Raw {
            self.committed.set(self.typed.get());
            self.stopped.set(0);
        }
    }

    pub(crate) fn settings(&self) -> Settings {
        let [first, second, third] = &self.settings;
        let [raw, echo, newlines, erase] = first.get().to_le_bytes();
        let [kill_word, kill_line, end_of_file, interrupt] = second.get().to_le_bytes();
        let [stop, start, ..] = third.get().to_le_bytes();
        Settings {
            mode: if raw == 0 { Mode::Cooked } else { Mode::Raw },
            echo: echo != 0,
            newlines: newlines != 0,
            characters: Characters {
                erase,
                kill_word,
                kill_line,
                end_of_file,
                interrupt,
                stop,
                start,
            },
        }
    }

    /// The mode, as the host is told.
    pub(crate) fn mode_word(&self) -> u32 {
        let settings = self.settings();
        let flag = |word: &Word, bit| if word.get() == 0 { 0 } else { bit };
        let full = flag(&self.refused, mode::FULL);
        match settings.mode {
            Mode::Raw => full,
            Mode::Cooked => {
                let interrupt = u32::from(settings.characters.interrupt);
                let stopped = flag(&self.stopped, mode::STOPPED);
                mode::COOKED | stopped | full | interrupt << mode::INTERRUPT_SHIFT
            }
        }
    }

    /// Takes a character that was typed.
    pub(crate) fn accept(&self, character: u8) -> Outcome {
        let settings = self.settings();
        let outcome = match settings.mode {
            Mode::Raw => self.accept_raw(character),
            Mode::Cooked => self.accept_cooked(character, settings.characters),
        };
        match outcome {
            Outcome::Taken(_) if !settings.echo => Outcome::Taken(Echo::Nothing),
            Outcome::Interrupts(_) if !settings.echo => Outcome::Interrupts(Echo::Nothing),
            Outcome::Full => {
                self.refused.set(1);
                Outcome::Full
            }
            outcome => outcome,
        }
    }

    fn accept_raw(&self, character: u8) -> Outcome {
        if self.room() == 0 {
            return Outcome::Full;
        }
        self.push(character.into());
        self.committed.set(self.typed.get());
        Outcome::Taken(echo(character))
    }

    fn accept_cooked(&self, character: u8, special: Characters) -> Outcome {
        let is = |one: u8| one != 0 && character == one;
        if is(special.interrupt) {
            self.read.set(self.typed.get());
            self.committed.set(self.typed.get());
            self.stopped.set(0);
            self.refused.set(0);
            self.interrupts.set(self.interrupts.get().wrapping_add(1));
            return Outcome::Interrupts(Echo::CaretAndNewline(character));
        }
        if is(special.stop) || is(special.start) {
            self.stopped.set(is(special.stop).into());
            return Outcome::Taken(Echo::Nothing);
        }
        if is(special.erase) || character == BACKSPACE {
            return Outcome::Taken(wipe(self.erase()));
        }
        if is(special.kill_word) {
            return Outcome::Taken(wipe(self.kill_word()));
        }
        if is(special.kill_line) {
            return Outcome::Taken(wipe(self.kill_line()));
        }
        if is(special.end_of_file) {
            return self.end_line(END_OF_FILE, Echo::Nothing);
        }
        if character == b'\n' || character == b'\r' {
            return self.end_line(u16::from(b'\n') | LINE_ENDS, Echo::Newline);
        }
        // The last place is for the end of the line.
        if self.room() < 2 {
            return self.no_room();
        }
        self.push(character.into());
        Outcome::Taken(echo(character))
    }

    fn end_line(&self, element: u16, echo: Echo) -> Outcome {
        if self.room() == 0 {
            return self.no_room();
        }
        self.push(element);
        self.committed.set(self.typed.get());
        Outcome::Taken(echo)
    }

    /// Waiting for the program helps only if there is something for it to read.
    fn no_room(&self) -> Outcome {
        if self.is_ready() {
            return Outcome::Full;
        }
        self.overlong.set(self.overlong.get().wrapping_add(1));
        Outcome::Taken(Echo::Byte(BELL))
    }

    /// Takes back a character, which may be several bytes of UTF-8; gives its columns.
    fn erase(&self) -> u32 {
        while let Some(byte) = self.last() {
            self.typed.set(self.typed.get().wrapping_sub(1));
            if !is_continuation(byte) {
                return columns(byte);
            }
        }
        0
    }

    fn kill_word(&self) -> u32 {
        let mut wiped = 0;
        for blanks in [true, false] {
            while self
                .last()
                .is_some_and(|byte| byte.is_ascii_whitespace() == blanks)
            {
                wiped += self.erase();
            }
        }
        wiped
    }

    fn kill_line(&self) -> u32 {
        let mut wiped = 0;
        while self.last().is_some() {
            wiped += self.erase();
        }
        wiped
    }

    /// The last byte of the line that is being edited.
    fn last(&self) -> Option<u8> {
        let typed = self.typed.get();
        (typed != self.committed.get())
            .then(|| self.element(typed.wrapping_sub(1)).to_le_bytes()[0])
    }

    /// Whether there is something for the program to read.
    pub(crate) fn is_ready(&self) -> bool {
        self.read.get() != self.committed.get()
    }

    /// Takes out what there is, to the end of a line at most.
    ///
    /// `begun` if this read has bytes already: then the end of the file that follows them ends it,
    /// too.
    pub(crate) fn take(&self, into: &mut [u8], begun: bool) -> Taken {
        let mut count = 0;
        if self.is_ready() {
            self.refused.set(0);
        }
        for place in into {
            if !self.is_ready() {
                break;
            }
            let element = self.element(self.read.get());
            self.read.set(self.read.get().wrapping_add(1));
            if element & END_OF_FILE != 0 {
                return if begun || count > 0 {
                    Taken::Bytes { count, last: true }
                } else {
                    Taken::EndOfFile
                };
            }
            *place = element.to_le_bytes()[0];
            count += 1;
            if element & LINE_ENDS != 0 {
                return Taken::Bytes { count, last: true };
            }
        }
        if count == 0 {
            return Taken::Nothing;
        }
        // What ends the line here is not the end of the file to the next read.
        let last = self.is_ready() && self.element(self.read.get()) & END_OF_FILE != 0;
        if last {
            self.read.set(self.read.get().wrapping_add(1));
        }
        Taken::Bytes { count, last }
    }

    /// Whether a character has been refused, and nothing taken out since.
    pub(crate) fn is_full(&self) -> bool {
        self.refused.get() != 0
    }

    /// Whether there were interrupts since the last time.
    pub(crate) fn take_interrupt(&self) -> bool {
        let interrupted = self.is_interrupted();
        self.interrupts.set(0);
        interrupted
    }

    pub(crate) fn is_interrupted(&self) -> bool {
        self.interrupts.get() != 0
    }

    pub(crate) fn overlong(&self) -> u32 {
        self.overlong.get()
    }

    fn room(&self) -> u32 {
        (N as u32).wrapping_sub(self.typed.get().wrapping_sub(self.read.get()))
    }

    fn push(&self, element: u16) {
        let typed = self.typed.get();
        if let Some(place) = self.queue.get((typed & Self::MASK) as usize) {
            place.store(element, Ordering::Relaxed);
        }
        self.typed.set(typed.wrapping_add(1));
    }

    fn element(&self, position: u32) -> u16 {
        self.queue
            .get((position & Self::MASK) as usize)
            .map_or(0, |place| place.load(Ordering::Relaxed))
    }
}

const fn echo(character: u8) -> Echo {
    match character {
        b'\n' | b'\r' => Echo::Newline,
        // A blank has a width that can be wiped out again.
        b'\t' => Echo::Byte(b' '),
        0..=0x1f | 0x7f => Echo::Caret(character),
        _ => Echo::Byte(character),
    }
}

const fn wipe(columns: u32) -> Echo {
    if columns == 0 {
        Echo::Nothing
    } else {
        Echo::Wipe(columns)
    }
}

/// Columns that [`echo`] takes for the first byte of a character.
const fn columns(first: u8) -> u32 {
    match echo(first) {
        Echo::Caret(_) => 2,
        _ => 1,
    }
}

const fn is_continuation(byte: u8) -> bool {
    byte & 0xc0 == 0x80
}

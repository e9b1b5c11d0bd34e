//! [`Input`]: what has been typed, and the editing of the line that is being typed.

use core::array;

use crate::layout::mode;
use crate::settings::{Characters, InputMode, TerminalSettings};
use crate::sync::{AtomicU16, Ordering, Word};

/// Flags of an element of the queue, above its character.
const LINE_ENDS: u16 = 0x100;
const END_OF_FILE: u16 = 0x200;

const RAW: u8 = InputMode::Raw as u8;
const CBREAK: u8 = InputMode::Cbreak as u8;
const CLOSED: u8 = InputMode::Closed as u8;

const BACKSPACE: u8 = 8;
const BELL: u8 = 7;

/// The result of [`Terminal::accept`](crate::Terminal::accept), which passes a typed character to a
/// terminal.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum InputResult {
    /// The terminal has taken the character.
    Taken,
    /// The terminal has taken the character, which interrupts the program.
    Interrupts,
    /// There is no room until the program reads: the caller must keep the character.
    Full,
}

/// The echo of a character: the first bytes of `text`, so many times.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Echo {
    text: [u8; 4],
    len: usize,
    pub(crate) times: u32,
}

impl Echo {
    const NOTHING: Self = Self {
        text: [0; 4],
        len: 0,
        times: 0,
    };

    const fn once(text: [u8; 4], len: usize) -> Self {
        let times = 1;
        Self { text, len, times }
    }

    /// Returns the display of a character that has no effect.
    const fn of(character: u8) -> Self {
        match character {
            b'\n' | b'\r' => Self::once(*b"\r\n\0\0", 2),
            // A blank has a width that can be wiped out again.
            b'\t' => Self::once(*b" \0\0\0", 1),
            0..=0x1f | 0x7f => Self::once([b'^', character ^ 0x40, 0, 0], 2),
            _ => Self::once([character, 0, 0, 0], 1),
        }
    }

    /// Wipes out columns.
    const fn wipe(columns: u32) -> Self {
        Self {
            text: *b"\x08 \x08\0",
            len: 3,
            times: columns,
        }
    }

    pub(crate) fn text(&self) -> &[u8] {
        self.text.get(..self.len).unwrap_or_default()
    }
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
    /// Interrupts that have not been reported to the program yet.
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
        this.configure(&TerminalSettings::COOKED);
        this
    }

    pub(crate) fn configure(&self, settings: &TerminalSettings) {
        let TerminalSettings {
            mode,
            echo,
            newlines,
            characters,
        } = *settings;
        let flags = [mode as u8, echo.into(), newlines.into()];
        let c = characters;
        let words = [
            [flags[0], flags[1], flags[2], c.erase],
            [c.kill_word, c.kill_line, c.end_of_file, c.interrupt],
            [c.stop, c.start, 0, 0],
        ];
        for (word, bytes) in self.settings.iter().zip(words) {
            word.set(u32::from_le_bytes(bytes));
        }
        if matches!(mode, InputMode::Raw | InputMode::Cbreak) {
            self.committed.set(self.typed.get());
        }
        if mode == InputMode::Raw {
            self.stopped.set(0);
        }
    }

    pub(crate) fn settings(&self) -> TerminalSettings {
        let [first, second, third] = &self.settings;
        let [mode, echo, newlines, erase] = first.get().to_le_bytes();
        let [kill_word, kill_line, end_of_file, interrupt] = second.get().to_le_bytes();
        let [stop, start, ..] = third.get().to_le_bytes();
        TerminalSettings {
            mode: match mode {
                RAW => InputMode::Raw,
                CBREAK => InputMode::Cbreak,
                CLOSED => InputMode::Closed,
                _ => InputMode::Cooked,
            },
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
            InputMode::Raw => full,
            InputMode::Closed => mode::FULL,
            InputMode::Cooked | InputMode::Cbreak => {
                let cooked = u32::from(settings.mode == InputMode::Cooked) * mode::COOKED;
                let interrupt = u32::from(settings.characters.interrupt);
                let stopped = flag(&self.stopped, mode::STOPPED);
                cooked | stopped | full | interrupt << mode::INTERRUPT_SHIFT
            }
        }
    }

    /// Takes a character that was typed.
    pub(crate) fn accept(&self, character: u8) -> (InputResult, Echo) {
        let settings = self.settings();
        let (accepted, echo) = match settings.mode {
            InputMode::Raw => self.accept_raw(character),
            InputMode::Cooked => self.accept_cooked(character, settings.characters),
            InputMode::Cbreak => self
                .accept_special(character, settings.characters)
                .unwrap_or_else(|| self.accept_raw(character)),
            InputMode::Closed => return (InputResult::Full, Echo::NOTHING),
        };
        if accepted == InputResult::Full {
            self.refused.set(1);
        }
        (accepted, if settings.echo { echo } else { Echo::NOTHING })
    }

    fn accept_raw(&self, character: u8) -> (InputResult, Echo) {
        if self.room() == 0 {
            return (InputResult::Full, Echo::NOTHING);
        }
        self.push(character.into());
        self.committed.set(self.typed.get());
        (InputResult::Taken, Echo::of(character))
    }

    /// Takes a character that interrupts, stops or starts; `None` if it is another one.
    fn accept_special(&self, character: u8, special: Characters) -> Option<(InputResult, Echo)> {
        let is = |one: u8| one != 0 && character == one;
        if is(special.interrupt) {
            self.read.set(self.typed.get());
            self.committed.set(self.typed.get());
            self.stopped.set(0);
            self.refused.set(0);
            self.interrupts.set(self.interrupts.get().wrapping_add(1));
            let shown = [b'^', character ^ 0x40, b'\r', b'\n'];
            return Some((InputResult::Interrupts, Echo::once(shown, 4)));
        }
        if is(special.stop) || is(special.start) {
            self.stopped.set(is(special.stop).into());
            return Some((InputResult::Taken, Echo::NOTHING));
        }
        None
    }

    fn accept_cooked(&self, character: u8, special: Characters) -> (InputResult, Echo) {
        let is = |one: u8| one != 0 && character == one;
        if let Some(accepted) = self.accept_special(character, special) {
            return accepted;
        }
        let echo = if is(special.erase) || character == BACKSPACE {
            Echo::wipe(self.erase())
        } else if is(special.kill_word) {
            Echo::wipe(self.kill_word())
        } else if is(special.kill_line) {
            Echo::wipe(self.kill_line())
        } else if is(special.end_of_file) {
            return self.end_line(END_OF_FILE, Echo::NOTHING);
        } else if character == b'\n' || character == b'\r' {
            return self.end_line(u16::from(b'\n') | LINE_ENDS, Echo::of(character));
        } else if self.room() < 2 {
            // The last place is for the end of the line.
            return self.no_room();
        } else {
            self.push(character.into());
            Echo::of(character)
        };
        (InputResult::Taken, echo)
    }

    fn end_line(&self, element: u16, echo: Echo) -> (InputResult, Echo) {
        if self.room() == 0 {
            return self.no_room();
        }
        self.push(element);
        self.committed.set(self.typed.get());
        (InputResult::Taken, echo)
    }

    /// Waiting for the program helps only if there is something for it to read.
    fn no_room(&self) -> (InputResult, Echo) {
        if self.is_ready() {
            return (InputResult::Full, Echo::NOTHING);
        }
        self.overlong.set(self.overlong.get().wrapping_add(1));
        (InputResult::Taken, Echo::once([BELL, 0, 0, 0], 1))
    }

    /// Removes the last character, which may be several bytes of UTF-8; returns its width in
    /// columns.
    fn erase(&self) -> u32 {
        while let Some(byte) = self.last() {
            self.typed.set(self.typed.get().wrapping_sub(1));
            if !is_continuation(byte) {
                return Echo::of(byte).len as u32;
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

    /// Returns true if there is something for the program to read.
    pub(crate) fn is_ready(&self) -> bool {
        self.read.get() != self.committed.get()
    }

    /// Takes out what there is, to the end of a line at most: how many bytes, and whether they are
    /// the last ones for this read. No bytes, and these the last ones, are the end of the file.
    pub(crate) fn take(&self, into: &mut [u8]) -> (usize, bool) {
        if self.is_ready() {
            self.refused.set(0);
        }
        for (count, place) in into.iter_mut().enumerate() {
            let Some(element) = self.next() else {
                return (count, false);
            };
            self.read.set(self.read.get().wrapping_add(1));
            if element & END_OF_FILE != 0 {
                return (count, true);
            }
            *place = element.to_le_bytes()[0];
            if element & LINE_ENDS != 0 {
                return (count + 1, true);
            }
        }
        // A mark that ends the line here is not the end of the file to the next read.
        let ends = self.next().is_some_and(|next| next & END_OF_FILE != 0);
        self.read.set(self.read.get().wrapping_add(u32::from(ends)));
        (into.len(), ends)
    }

    fn next(&self) -> Option<u16> {
        self.is_ready().then(|| self.element(self.read.get()))
    }

    /// Returns true if a character has been refused, and nothing taken out since.
    pub(crate) fn is_full(&self) -> bool {
        self.refused.get() != 0
    }

    /// Returns true if there were interrupts since the last time.
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

const fn is_continuation(byte: u8) -> bool {
    byte & 0xc0 == 0x80
}

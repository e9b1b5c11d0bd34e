//! [`Window`]: a terminal, as far as a person sees it.

use std::fs::File;
use std::io::Write;
use std::num::NonZero;
use std::os::fd::OwnedFd;

use condor_tty::linux::{Screen, Sink};

use condor_host::services::terminals::Keyboard;

/// Lines that are kept after they have left the screen.
const HISTORY: usize = 2000;
/// Bytes that are kept to be shown again at another width.
const PAST: usize = 128 * 1024;
/// Bytes that are kept for a terminal that is full, or whose service is not there.
const EARLY: usize = 64 * 1024;

/// The destination of typed characters.
#[derive(Debug)]
pub(super) enum Input {
    /// A terminal of a processor, which takes them while there is room.
    Terminal(Keyboard),
    /// The pseudo-terminal of a tool.
    Tool(File),
}

impl From<OwnedFd> for Input {
    fn from(tool: OwnedFd) -> Self {
        Self::Tool(tool.into())
    }
}

impl Input {
    fn take(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        match self {
            Self::Terminal(keyboard) => keyboard.type_in(bytes),
            Self::Tool(tool) => tool.write_all(bytes).map(|()| bytes.len()),
        }
    }
}

/// Which window.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(super) struct WindowId(pub(super) u32);

/// A terminal of a processor, or a tool.
#[derive(Debug)]
pub(super) struct Window {
    pub(super) id: WindowId,
    pub(super) title: String,
    /// The number of the processor that it is about.
    pub(super) processor: u8,
    pub(super) is_tool: bool,
    screen: Screen,
    size: (u16, u16),
    /// The latest output; it begins at the beginning of a line.
    past: Vec<u8>,
    /// The destination of typed characters, while the window is connected.
    input: Option<Input>,
    /// Characters that were typed while the window was not connected, or its terminal was full.
    early: Vec<u8>,
}

impl Window {
    pub(super) fn new(id: WindowId, title: String, processor: u8, is_tool: bool) -> Self {
        Self {
            id,
            title,
            processor,
            is_tool,
            screen: blank(80, 24),
            size: (80, 24),
            past: Vec::new(),
            input: None,
            early: Vec::new(),
        }
    }

    pub(super) fn screen(&self) -> &vt100::Screen {
        self.screen.screen()
    }

    pub(super) fn is_connected(&self) -> bool {
        self.input.is_some()
    }

    /// Connects the window to `input`, and clears the screen: the earlier output comes again.
    pub(super) fn open(&mut self, input: Input) {
        self.screen = blank(self.size.0, self.size.1);
        self.past.clear();
        self.input = Some(input);
        self.tell_size();
        self.pass_on();
    }

    pub(super) fn close(&mut self) {
        self.input = None;
    }

    pub(super) fn write(&mut self, bytes: &[u8]) {
        // A program that writes may have read, too.
        self.pass_on();
        // A screen takes everything.
        let _ = self.screen.take(bytes.into());
        self.past.extend_from_slice(bytes);
        if self.past.len() > 2 * PAST {
            let from = self.past.len() - PAST;
            let line = self.past.iter().skip(from).position(|&byte| byte == b'\n');
            self.past.drain(..line.map_or(from, |line| from + line + 1));
        }
    }

    /// Sends typed bytes; returns false if some wait until the window is connected and its terminal
    /// has room.
    pub(super) fn type_in(&mut self, bytes: &[u8]) -> bool {
        self.screen.screen_mut().set_scrollback(0);
        self.early.extend_from_slice(bytes);
        self.pass_on();
        self.early.truncate(EARLY);
        self.early.is_empty()
    }

    /// Sends what waits, as far as possible now.
    fn pass_on(&mut self) {
        if let (Some(input), false) = (&mut self.input, self.early.is_empty()) {
            // Characters that cannot be written are kept for the next service.
            let taken = input.take(&self.early).unwrap_or(0);
            self.early.drain(..taken);
        }
    }

    pub(super) fn resize(&mut self, columns: u16, rows: u16) {
        if self.size == (columns, rows) {
            return;
        }
        self.size = (columns, rows);
        // Written again: a screen forgets what is beyond its edge.
        self.screen = blank(columns, rows);
        let _ = self.screen.take((&self.past).into());
        self.tell_size();
    }

    /// Shows what is so many lines further up, or down.
    pub(super) fn scroll(&mut self, lines: i32) {
        let screen = self.screen.screen_mut();
        let at = i32::try_from(screen.scrollback()).unwrap_or(0);
        let to = usize::try_from(at.saturating_add(lines)).unwrap_or(0);
        screen.set_scrollback(to);
    }

    /// Returns all rows that are kept, the oldest first.
    pub(super) fn rows(&mut self) -> Vec<String> {
        let (columns, screen) = (self.size.0, self.screen.screen_mut());
        let at = screen.scrollback();
        screen.set_scrollback(usize::MAX);
        let mut rows = Vec::new();
        for above in (1..=screen.scrollback()).rev() {
            screen.set_scrollback(above);
            rows.extend(screen.rows(0, columns).next());
        }
        screen.set_scrollback(0);
        rows.extend(screen.rows(0, columns));
        screen.set_scrollback(at);
        rows
    }

    /// A pseudo-terminal has a size, a socket has none.
    fn tell_size(&self) {
        if let Some(Input::Tool(input)) = &self.input {
            let size = rustix::termios::Winsize {
                ws_col: self.size.0,
                ws_row: self.size.1,
                ws_xpixel: 0,
                ws_ypixel: 0,
            };
            // A tool that has ended needs no size.
            let _ = rustix::termios::tcsetwinsize(input, size);
        }
    }
}

fn blank(columns: u16, rows: u16) -> Screen {
    Screen::new(at_least_one(rows), at_least_one(columns), HISTORY)
}

fn at_least_one(count: u16) -> NonZero<u16> {
    NonZero::new(count).unwrap_or(NonZero::<u16>::MIN)
}

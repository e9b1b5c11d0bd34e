//! [`TerminalSettings`]: the treatment of input and output by a terminal.

/// The way in which a program gets the characters that are typed at its terminal.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum InputMode {
    /// The program gets whole lines, after a person has edited them; [`Characters`] have their
    /// effects.
    Cooked,
    /// The program gets every character as it is, at once.
    Raw,
    /// The program gets every character at once, but those of [`Characters`] that interrupt, stop
    /// and start have their effects.
    Cbreak,
    /// The program gets nothing: the host keeps typed characters until the mode changes, or a
    /// program makes the terminal anew.
    Closed,
}

/// The characters that have a special effect when they are typed: all of them in
/// [`InputMode::Cooked`], and `interrupt`, `stop` and `start` in [`InputMode::Cbreak`]. A field of
/// 0 means that no character has this effect.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Characters {
    /// Deletes the last character; backspace (8) always does so, too.
    pub erase: u8,
    /// Deletes the last word, and the blanks after it.
    pub kill_word: u8,
    /// Deletes the unfinished line.
    pub kill_line: u8,
    /// Passes the unfinished line to the program; at the beginning of a line, it is the end of the
    /// file.
    pub end_of_file: u8,
    /// Interrupts: drops the typed characters that wait, and notifies the program, even if the
    /// queue is full.
    pub interrupt: u8,
    /// Stops the output on the host.
    pub stop: u8,
    /// Continues the output after the character `stop`.
    pub start: u8,
}

impl Characters {
    /// The usual characters of Unix, in the order of the fields: delete, ^W, ^U, ^D, ^C, ^S, ^Q.
    pub const UNIX: Self = Self {
        erase: 0x7f,
        kill_word: 0x17,
        kill_line: 0x15,
        end_of_file: 0x04,
        interrupt: 0x03,
        stop: 0x13,
        start: 0x11,
    };
}

/// The settings of a [`Terminal`](crate::Terminal): how it treats typed characters and output.
///
/// ```
/// use condor_tty::TerminalSettings;
///
/// /// Typed characters are not shown, as for a secret.
/// const SECRET: TerminalSettings = TerminalSettings { echo: false, ..TerminalSettings::COOKED };
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TerminalSettings {
    /// The form in which the program gets typed characters.
    pub mode: InputMode,
    /// Whether typed characters are written to the output, so that they are shown.
    pub echo: bool,
    /// Whether a newline is sent to the host as carriage return and newline.
    pub newlines: bool,
    /// The characters that have a special effect when they are typed.
    pub characters: Characters,
}

impl TerminalSettings {
    /// The default settings: the program gets edited lines, typed characters are echoed, and
    /// newlines are sent as carriage return and newline.
    pub const COOKED: Self = Self {
        mode: InputMode::Cooked,
        echo: true,
        newlines: true,
        characters: Characters::UNIX,
    };

    /// The settings of a terminal with output only: typed characters stay at the host. A program
    /// can begin with them, and change them when it wants input.
    pub const OUTPUT: Self = Self {
        mode: InputMode::Closed,
        ..Self::COOKED
    };

    /// The settings of a terminal whose program edits lines itself, as a
    /// [`LineEditor`](crate::LineEditor) does: every character at once, without echo.
    pub const CBREAK: Self = Self {
        mode: InputMode::Cbreak,
        echo: false,
        ..Self::COOKED
    };

    /// The settings of a terminal that passes bytes on unchanged in both directions, without echo.
    pub const RAW: Self = Self {
        mode: InputMode::Raw,
        echo: false,
        newlines: false,
        characters: Characters::UNIX,
    };
}

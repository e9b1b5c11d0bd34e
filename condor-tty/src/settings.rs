//! [`TerminalSettings`]: the treatment of input and output by a terminal.

/// The form in which a program gets typed characters.
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

/// The characters that have effects in [`InputMode::Cooked`], and some of them in [`InputMode::Cbreak`]; 0
/// means that there is no such character.
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
    /// The characters of Unix: delete, ^W, ^U, ^D, ^C, ^S, ^Q.
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

/// The treatment of input and output by a terminal.
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
    /// The characters with effects.
    pub characters: Characters,
}

impl TerminalSettings {
    /// The default settings: edited lines, echo, and newlines as terminals need them.
    pub const COOKED: Self = Self {
        mode: InputMode::Cooked,
        echo: true,
        newlines: true,
        characters: Characters::UNIX,
    };

    /// The settings of a terminal with output only, such as that of a program that reads its
    /// configuration before it begins.
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

    /// The settings of a terminal with unchanged bytes in both directions, without echo.
    pub const RAW: Self = Self {
        mode: InputMode::Raw,
        echo: false,
        newlines: false,
        characters: Characters::UNIX,
    };
}

//! [`Settings`]: how a terminal treats what is typed and what is written.

/// Whether lines are edited before the program gets them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mode {
    /// The program gets whole lines, which a person could edit; [`Characters`] have their effects.
    Cooked,
    /// The program gets every character as it is, at once.
    Raw,
}

/// The characters that do something in [`Mode::Cooked`]; 0 stands for none.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Characters {
    /// Takes back the last character; backspace (8) always does, too.
    pub erase: u8,
    /// Takes back the last word, and the blanks after it.
    pub kill_word: u8,
    /// Takes back the line.
    pub kill_line: u8,
    /// Gives the program the line as it stands; at its beginning, the end of the file.
    pub end_of_file: u8,
    /// Interrupts: drops what has been typed, and tells the program, even if the queue is full.
    pub interrupt: u8,
    /// Stops the output on the host.
    pub stop: u8,
    /// Lets it go on.
    pub start: u8,
}

impl Characters {
    /// Those of Unix: delete, ^W, ^U, ^D, ^C, ^S, ^Q.
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

/// How a terminal treats what is typed and what is written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Settings {
    /// Whether lines are edited.
    pub mode: Mode,
    /// Whether what is typed is shown.
    pub echo: bool,
    /// Whether a newline is sent to the host as carriage return and newline.
    pub newlines: bool,
    /// The characters that edit.
    pub characters: Characters,
}

impl Settings {
    /// Lines, echo, newlines as terminals want them: what a terminal begins with.
    pub const COOKED: Self = Self {
        mode: Mode::Cooked,
        echo: true,
        newlines: true,
        characters: Characters::UNIX,
    };

    /// Every byte as it is, in both directions, and no echo.
    pub const RAW: Self = Self {
        mode: Mode::Raw,
        echo: false,
        newlines: false,
        characters: Characters::UNIX,
    };
}

//! The standard input and output of a program, and the macros that print.

use core::cell::Cell;
use core::fmt;

use critical_section::Mutex;
use embedded_io::{ErrorType, Read, Write};

use super::input::{InputError, StandardInput};
use super::output::{OutputError, StandardOutput};
use super::read::{LineError, Taken, UntilError};

type Place<T> = Mutex<Cell<Option<&'static T>>>;

static OUTPUT: Place<dyn StandardOutput> = Mutex::new(Cell::new(None));
static INPUT: Place<dyn StandardInput> = Mutex::new(Cell::new(None));
/// Bytes that were printed while there was no output.
static UNHEARD: Mutex<Cell<u32>> = Mutex::new(Cell::new(0));

/// A program has its standard input or output already.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("it is set once, and has been")]
pub struct AlreadySet;

fn set<T: ?Sized>(place: &Place<T>, value: &'static T) -> Result<(), AlreadySet> {
    critical_section::with(|section| {
        let place = place.borrow(section);
        if place.get().is_some() {
            return Err(AlreadySet);
        }
        place.set(Some(value));
        Ok(())
    })
}

fn get<T: ?Sized>(place: &Place<T>) -> Option<&'static T> {
    critical_section::with(|section| place.borrow(section).get())
}

/// Makes `output` the program's standard output.
///
/// # Errors
/// [`AlreadySet`].
pub fn set_output(output: &'static dyn StandardOutput) -> Result<(), AlreadySet> {
    set(&OUTPUT, output)
}

/// Makes `input` the program's standard input.
///
/// # Errors
/// [`AlreadySet`].
pub fn set_input(input: &'static dyn StandardInput) -> Result<(), AlreadySet> {
    set(&INPUT, input)
}

/// The program's standard output, for code that is generic over [`Write`].
#[derive(Clone, Copy, Debug, Default)]
pub struct Stdout;

/// The program's standard output.
#[must_use]
pub const fn stdout() -> Stdout {
    Stdout
}

impl ErrorType for Stdout {
    type Error = OutputError;
}

impl Write for Stdout {
    fn write(&mut self, from: &[u8]) -> Result<usize, OutputError> {
        get(&OUTPUT).ok_or(OutputError::NotOpen)?.write(from)
    }

    fn flush(&mut self) -> Result<(), OutputError> {
        flush()
    }
}

/// The program's standard input.
#[derive(Clone, Copy, Debug, Default)]
pub struct Stdin;

/// The program's standard input.
#[must_use]
pub const fn stdin() -> Stdin {
    Stdin
}

impl ErrorType for Stdin {
    type Error = InputError;
}

impl Read for Stdin {
    fn read(&mut self, into: &mut [u8]) -> Result<usize, InputError> {
        get(&INPUT).ok_or(InputError::NotOpen)?.read(into)
    }
}

impl Stdin {
    /// [`StandardInput::read_until`].
    ///
    /// # Errors
    /// [`InputError`], with what was read before.
    pub fn read_until(
        self,
        delimiter: u8,
        into: &mut [u8],
    ) -> Result<Taken, UntilError<InputError>> {
        match get(&INPUT) {
            Some(input) => input.read_until(delimiter, into),
            None => Err(UntilError {
                read: 0,
                error: InputError::NotOpen,
            }),
        }
    }

    /// [`StandardInput::read_line`].
    ///
    /// # Errors
    /// [`LineError`].
    pub fn read_line(self, into: &mut [u8]) -> Result<&str, LineError<InputError>> {
        match get(&INPUT) {
            Some(input) => input.read_line(into),
            None => Err(LineError::Reader {
                read: 0,
                error: InputError::NotOpen,
            }),
        }
    }
}

/// [`StandardOutput::print`] of the standard output; what [`print!`](crate::print!) calls.
pub fn print(text: fmt::Arguments<'_>) {
    match get(&OUTPUT) {
        Some(output) => output.print(text),
        None => unheard(text),
    }
}

/// [`StandardOutput::post`] of the standard output; what [`post!`](crate::post!) calls.
pub fn post(text: fmt::Arguments<'_>) {
    match get(&OUTPUT) {
        Some(output) => output.post(text),
        None => unheard(text),
    }
}

/// [`StandardOutput::flush`] of the standard output.
///
/// # Errors
/// [`OutputError`].
pub fn flush() -> Result<(), OutputError> {
    get(&OUTPUT).ok_or(OutputError::NotOpen)?.flush()
}

/// Bytes that the program printed and that were lost, also before it had an output; the count
/// wraps.
#[must_use]
pub fn lost() -> u32 {
    let unheard = critical_section::with(|section| UNHEARD.borrow(section).get());
    unheard.wrapping_add(get(&OUTPUT).map_or(0, StandardOutput::lost))
}

/// Counts what nobody hears.
#[cold]
fn unheard(text: fmt::Arguments<'_>) {
    struct Count(u32);

    impl fmt::Write for Count {
        fn write_str(&mut self, text: &str) -> fmt::Result {
            self.0 = self.0.wrapping_add(text.len() as u32);
            Ok(())
        }
    }

    let mut count = Count(0);
    let _ = fmt::write(&mut count, text);
    critical_section::with(|section| {
        let unheard = UNHEARD.borrow(section);
        unheard.set(unheard.get().wrapping_add(count.0));
    });
}

/// Prints to the [standard output](crate::stdio), and may wait for it: for the background.
#[macro_export]
macro_rules! print {
    ($($text:tt)*) => {
        $crate::stdio::print(::core::format_args!($($text)*))
    };
}

/// [`print!`](crate::print!), and a newline.
#[macro_export]
macro_rules! println {
    () => {
        $crate::stdio::print(::core::format_args!("\n"))
    };
    ($($text:tt)*) => {
        $crate::stdio::print(::core::format_args!("{}\n", ::core::format_args!($($text)*)))
    };
}

/// Leaves text to be written to the [standard output](crate::stdio) later, by the next print or
/// flush, and never waits: for servo loops and handlers.
#[macro_export]
macro_rules! post {
    ($($text:tt)*) => {
        $crate::stdio::post(::core::format_args!($($text)*))
    };
}

/// [`post!`](crate::post!), and a newline.
#[macro_export]
macro_rules! postln {
    () => {
        $crate::stdio::post(::core::format_args!("\n"))
    };
    ($($text:tt)*) => {
        $crate::stdio::post(::core::format_args!("{}\n", ::core::format_args!($($text)*)))
    };
}

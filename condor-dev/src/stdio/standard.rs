//! The standard input and output of a program, and the macros that print.

use core::cell::Cell;
use core::fmt;

use critical_section::Mutex;

use super::error::StdioError;
use super::input::StandardInput;
use super::output::StandardOutput;

type Registered<T> = Mutex<Cell<Option<&'static T>>>;

static OUTPUT: Registered<dyn StandardOutput> = Mutex::new(Cell::new(None));
static INPUT: Registered<dyn StandardInput> = Mutex::new(Cell::new(None));
/// Bytes that were printed while there was no output.
static UNHEARD: Mutex<Cell<u32>> = Mutex::new(Cell::new(0));

/// The error of [`set_output`] or [`set_input`] if the program has a standard output or input
/// already.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("the standard input or output of this program is set already, and can be set only once")]
pub struct AlreadySet;

fn set<T: ?Sized>(place: &Registered<T>, value: &'static T) -> Result<(), AlreadySet> {
    critical_section::with(|section| {
        let place = place.borrow(section);
        if place.get().is_some() {
            return Err(AlreadySet);
        }
        place.set(Some(value));
        Ok(())
    })
}

fn get<T: ?Sized>(place: &Registered<T>) -> Option<&'static T> {
    critical_section::with(|section| place.borrow(section).get())
}

/// Makes `output` the program's standard output, to which [`print!`](crate::print!) and
/// [`post!`](crate::post!) write. It stays for the whole program.
///
/// # Errors
/// [`AlreadySet`] if the program has a standard output already.
pub fn set_output(output: &'static dyn StandardOutput) -> Result<(), AlreadySet> {
    set(&OUTPUT, output)
}

/// Makes `input` the program's standard input, which [`stdin`] returns. It stays for the whole
/// program.
///
/// # Errors
/// [`AlreadySet`] if the program has a standard input already.
pub fn set_input(input: &'static dyn StandardInput) -> Result<(), AlreadySet> {
    set(&INPUT, input)
}

/// Returns the program's standard output.
///
/// # Errors
/// [`StdioError::NotOpen`] if [`set_output`] has not been called.
pub fn stdout() -> Result<&'static dyn StandardOutput, StdioError> {
    get(&OUTPUT).ok_or(StdioError::NotOpen)
}

/// Returns the program's standard input.
///
/// # Errors
/// [`StdioError::NotOpen`] if [`set_input`] has not been called.
pub fn stdin() -> Result<&'static dyn StandardInput, StdioError> {
    get(&INPUT).ok_or(StdioError::NotOpen)
}

/// Writes text to the standard output, and may wait once for its writer, as
/// [`StandardOutput::print`] does. Bytes that cannot be written count as [`lost`], and so do all
/// bytes while the program has no standard output. [`print!`](crate::print!) calls this function.
pub fn print(text: fmt::Arguments<'_>) {
    match get(&OUTPUT) {
        Some(output) => output.print(text),
        None => unheard(text),
    }
}

/// Puts text into the ring of the standard output for a later write, and never waits, as
/// [`StandardOutput::post`] does. Bytes for which the ring has no room count as [`lost`], and so do
/// all bytes while the program has no standard output. [`post!`](crate::post!) calls this function.
pub fn post(text: fmt::Arguments<'_>) {
    match get(&OUTPUT) {
        Some(output) => output.post(text),
        None => unheard(text),
    }
}

/// Writes all bytes in the ring of the standard output, and flushes its writer.
///
/// # Errors
/// [`StdioError::NotOpen`] if no output is set or it has no writer, [`StdioError::InUse`] if
/// another context uses the writer, [`StdioError::Failed`] if the writer fails.
pub fn flush() -> Result<(), StdioError> {
    stdout()?.flush()
}

/// Returns how many bytes that the program printed or posted were lost; wraps. Bytes from before
/// the program had a standard output are included.
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

/// Prints on the [standard output](crate::stdio), and may wait for it. Use it in the background.
#[macro_export]
macro_rules! print {
    ($($text:tt)*) => {
        $crate::stdio::print(::core::format_args!($($text)*))
    };
}

/// Prints as [`print!`](crate::print!) does, with a newline.
#[macro_export]
macro_rules! println {
    () => {
        $crate::stdio::print(::core::format_args!("\n"))
    };
    ($($text:tt)*) => {
        $crate::stdio::print(::core::format_args!("{}\n", ::core::format_args!($($text)*)))
    };
}

/// Puts text into the ring of the [standard output](crate::stdio) without waiting; the next print
/// or flush writes it. Use it in servo loops and handlers.
#[macro_export]
macro_rules! post {
    ($($text:tt)*) => {
        $crate::stdio::post(::core::format_args!($($text)*))
    };
}

/// Posts as [`post!`](crate::post!) does, with a newline.
#[macro_export]
macro_rules! postln {
    () => {
        $crate::stdio::post(::core::format_args!("\n"))
    };
    ($($text:tt)*) => {
        $crate::stdio::post(::core::format_args!("{}\n", ::core::format_args!($($text)*)))
    };
}

//! Buffered input and output over any type that implements `embedded-io`: devices through a
//! [`DeviceStream`](crate::stream::DeviceStream), terminals, files (A. I. Memo 977, section 3.1).
//!
//! * [`BufReader`] and [`BufWriter`] belong to one context, like any value. [`ReadLine`] reads
//!   lines and pieces into the caller's memory.
//! * [`BufferedOutput`] and [`BufferedInput`] are shared: each is a `static`, installed once as the program's
//!   standard output and input with [`set_output`] and [`set_input`]. [`print!`](crate::print!) and
//!   [`println!`](crate::println!) write to the output and may wait for it; [`post!`](crate::post!)
//!   and [`postln!`](crate::postln!) never wait.
//!
//! ```
//! use condor_dev::stdio::{self, Buffering, BufferedOutput};
//! # struct Console;
//! # impl embedded_io::ErrorType for Console { type Error = core::convert::Infallible; }
//! # impl embedded_io::Write for Console {
//! #     fn write(&mut self, from: &[u8]) -> Result<usize, Self::Error> { Ok(from.len()) }
//! #     fn flush(&mut self) -> Result<(), Self::Error> { Ok(()) }
//! # }
//!
//! static OUTPUT: BufferedOutput<Console, 256> = BufferedOutput::new(Buffering::Line);
//!
//! // At start-up, with a `DeviceStream` of an open descriptor for example:
//! OUTPUT.open(Console).ok().unwrap();
//! stdio::set_output(&OUTPUT).unwrap();
//!
//! // In the background:
//! condor_dev::println!("joint {} is at {:.3} rad", 3, 0.25);
//! // In a servo loop or an interrupt's handler:
//! condor_dev::postln!("joint {} is at its end", 3);
//! stdio::flush().unwrap();
//! assert_eq!(stdio::lost(), 0);
//! ```
//!
//! # Printing in different contexts
//!
//! Text is copied into the output's ring, at most 16 bytes in one critical section, and from there
//! to its writer. A context claims the writer for that, 64 bytes at a time. No context ever waits
//! for the claim, so nothing deadlocks.
//!
//! | context | `print!` | `post!` |
//! |---|---|---|
//! | background | fills the ring; empties it at the end of a line, or as the [`Buffering`] says, and when it is full, waiting as long as the writer does | fills the ring; text without room is lost |
//! | loop or handler that does not interrupt a write | does the same as in the background, so use it only if the writer does not wait | the same |
//! | loop or handler that interrupts a write | does the same as `post!`; the interrupted context then writes the text, too | the same |
//!
//! If a print interrupts another print, its text appears in the middle of the other, between two
//! pieces of at most 16 bytes; no byte of either is lost or repeated by that. A byte is lost only
//! if the ring is full and the writer fails, is claimed by another context, or must not be waited
//! for. Each lost byte is counted once, in [`lost`].

mod claim;
mod error;
mod input;
mod output;
mod read;
mod ring;
mod standard;
mod write;

pub use claim::{ClaimCell, ClaimGuard};
pub use error::StdioError;
pub use input::{BufferedInput, StandardInput};
pub use output::{BufferedOutput, StandardOutput};
pub use read::{BufReader, LineError, ReadLine, UntilError};
pub use standard::{AlreadySet, flush, lost, post, print, set_input, set_output, stdin, stdout};
pub use write::{BufWriter, Buffering, WriteError};

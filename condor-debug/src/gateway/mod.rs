//! The server of GDB's remote protocol for one processor.
//!
//! A [`Session`] attaches to a program. [`Session::serve`] stops it, serves one connection of GDB, and,
//! however the connection ends, leaves the program running and without breakpoints.

mod connection;
mod lock;
pub mod riscv;
mod session;
mod target;

pub use connection::Stream;
pub use lock::{Cleaner, DebuggerLock};
pub use session::{Debuggee, Ended, Session, SessionError};

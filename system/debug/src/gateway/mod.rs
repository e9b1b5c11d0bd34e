//! The server of GDB's remote protocol.
//!
//! A [`Session`] attaches to the programs of processors, each of which is a thread of one inferior.
//! [`Session::serve`] serves one connection of GDB and, however the connection ends, leaves the programs running
//! and without breakpoints.
//!
//! The protocol is written here and not taken from `gdbstub`, whose 0.7 has no non-stop mode: only in that
//! mode does GDB read memory while programs run, and stop one of several.

mod answers;
mod connection;
mod conversation;
mod lock;
pub mod riscv;
mod session;
mod step;

pub use connection::PacketStream;
pub use lock::{Cleaner, DebuggerLock};
pub use session::{DebuggedProgram, Debuggee, ProgramEnd, ProgramHost, Session, SessionError};

//! The host's side on Linux: terminals on ptys, on screens and in logs.
//!
//! A [`TerminalHost`] reads one terminal into a [`Sink`], and sends the characters that are typed there.
//! Sinks are a [`Pty`], to which any terminal program attaches, with feature `screen` a `Screen` for
//! user interfaces, your own types, and a [`TerminalLog`] around any of these, with the time of each line.
//!
//! Bytes that a sink has taken are acknowledged. Other bytes stay in the ring; when it is full, the
//! terminal's policy decides about new output. So nothing is lost here, even if the host is killed: the
//! next host continues, and repeats at most what the killed one had not acknowledged.

mod host;
mod log;
mod pty;
#[cfg(feature = "screen")]
mod screen;
mod sink;

pub use host::{HostError, ServedTerminal, TerminalHost};
pub use log::TerminalLog;
pub use pty::Pty;
#[cfg(feature = "screen")]
pub use screen::Screen;
pub use sink::{Piece, Sink};

//! The host's end on Linux: terminals on ptys, on screens and in logs.
//!
//! A [`Host`] reads one terminal into a [`Sink`], and sends what is typed there. Sinks are a
//! [`Pty`], to which any terminal program attaches, a [`Log`] with the time of each line, with
//! feature `screen` a `Screen` for user interfaces, one's own, and any two of them as a [`Tee`].
//!
//! What a sink has taken is acknowledged; what it has not stays in the ring, and after that the
//! terminal's policy says what happens. So nothing is lost here, also when the host is killed:
//! the next one goes on, and shows again at most what the one before had not acknowledged.

mod host;
mod log;
mod pty;
#[cfg(feature = "screen")]
mod screen;
mod sink;

pub use host::{Host, HostError, Served};
pub use log::Log;
pub use pty::{Pty, Unwatched};
#[cfg(feature = "screen")]
pub use screen::Screen;
pub use sink::{Sink, Tee};

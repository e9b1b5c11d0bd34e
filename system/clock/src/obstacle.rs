//! [`Obstacle`]: what time waits for.

use core::fmt;

/// The reason why simulated time does not pass. It is a snapshot, which is out of date as
/// soon as time passes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Obstacle {
    /// A processor, or a part of the host, has the turn and keeps it until it waits.
    Turn {
        /// The number of that participant.
        holder: u8,
        /// The service whose answer the holder waits for, if it waits for one.
        asks: Option<u8>,
    },
    /// The program of a processor has not announced itself yet, and all participants wait for it.
    Entry {
        /// The number of the processor.
        of: u8,
    },
    /// A service has not yet taken all messages that were sent to it.
    Service {
        /// The number of the service.
        number: u8,
    },
    /// The system is paused, or has come to the end of a step.
    Limit,
    /// The real time: a speed is set, and the next instant is still ahead.
    Pace,
    /// No processor has anything to do at any instant.
    Idle,
}

impl fmt::Display for Obstacle {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Turn { holder, asks: None } => {
                write!(f, "processor {holder}, which has the turn")
            }
            Self::Turn {
                holder,
                asks: Some(service),
            } => write!(
                f,
                "service {service}, of which processor {holder} awaits a reply"
            ),
            Self::Entry { of } => {
                write!(f, "the program of processor {of}, which does not run yet")
            }
            Self::Service { number } => {
                write!(f, "service {number}, which has not taken all messages yet")
            }
            Self::Limit => f.write_str("`resume` or `step`"),
            Self::Pace => f.write_str("the real time"),
            Self::Idle => f.write_str("a message or a loop: no processor has anything to do"),
        }
    }
}

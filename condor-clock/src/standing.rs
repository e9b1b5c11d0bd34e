//! [`Standing`]: what time waits for.

use core::fmt;

/// What the time of a system waits for. It is a snapshot, and old at once while time passes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Standing {
    /// A processor, or a part of the host, has the turn and keeps it until it waits.
    Turn {
        /// Its number.
        holder: u8,
        /// The service whose answer it waits for meanwhile.
        asks: Option<u8>,
    },
    /// A program has not entered yet.
    Entry {
        /// The number of its processor.
        of: u8,
    },
    /// A service has not taken yet all that was sent to it.
    Service {
        /// Its number.
        number: u8,
    },
    /// The system is paused, or has come to the end of a step.
    Limit,
    /// Nobody: it keeps pace with the real time.
    Pace,
    /// No processor has anything to do at any instant.
    Idle,
}

impl fmt::Display for Standing {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Turn { holder, asks: None } => {
                write!(f, "processor {holder}, which has the turn")
            }
            Self::Turn {
                holder,
                asks: Some(service),
            } => write!(f, "service {service}, which processor {holder} has asked"),
            Self::Entry { of } => write!(f, "the program of processor {of}, which has not entered"),
            Self::Service { number } => {
                write!(
                    f,
                    "service {number}, which has not taken all that was sent to it"
                )
            }
            Self::Limit => f.write_str("`resume` or `step`"),
            Self::Pace => f.write_str("the real time"),
            Self::Idle => f.write_str("nobody: no processor has anything to do"),
        }
    }
}

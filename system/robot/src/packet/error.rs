use core::time::Duration;

use condor_hand::decimal::Decimal;
use condor_hand::servo::ServoRefusal;
use condor_hand::trajectory::JointStreamError;
use condor_mbox::Processor;
use condor_mbox::exchange::ExchangeError;
use thiserror::Error;

use super::PacketError;
use crate::queue::InControl;

/// The reason why a client of another processor has no answer, or one that refuses its request.
#[derive(Clone, Debug, PartialEq, Error)]
#[non_exhaustive]
pub enum ClientError {
    /// The request could not be sent, or was not answered.
    #[error(transparent)]
    Exchange(#[from] ExchangeError),
    /// The processor was busy, or has not decided, until the end of the call; ask again.
    #[error("{to} has not answered within {timeout} s; ask again", timeout = Decimal(.timeout.as_secs_f64()))]
    TimedOut {
        /// The number of the processor that was asked.
        to: Processor,
        /// The timeout of the call.
        timeout: Duration,
    },
    /// The processor has another version of the protocol.
    #[error(
        "{to} has version {found} of the protocol, this program {wanted}; build both from the same sources"
    )]
    Version {
        /// The number of the processor that was asked.
        to: Processor,
        /// The version of the protocol there.
        found: u32,
        /// The version of the protocol here.
        wanted: u32,
    },
    /// The processor has not understood the request, or its answer is none to this request.
    #[error(
        "{to} and this program do not understand each other's messages; build both from the same sources"
    )]
    Protocol {
        /// The number of the processor that was asked.
        to: Processor,
    },
    /// The servo refuses the request.
    #[error(transparent)]
    Refused(#[from] ServoRefusal),
    /// A later order of another sender replaced this one, before or after it was carried out.
    #[error(
        "a later order of another sender replaced order {number}, which may have been carried out before"
    )]
    Superseded {
        /// The number of the order.
        number: u32,
    },
    /// The servo loop has not processed the order in time; it may still do so.
    #[error(
        "the servo loop of {to} has not processed order {number} within {timeout} s; it may still do so",
        timeout = Decimal(.timeout.as_secs_f64())
    )]
    NotDone {
        /// The number of the servo processor.
        to: Processor,
        /// The number of the order.
        number: u32,
        /// The timeout of the call.
        timeout: Duration,
    },
    /// The content does not fit into one request.
    #[error("the request has more than the {most} bytes for which there is room")]
    Length {
        /// The greatest number of bytes.
        most: usize,
    },
    /// Another session is in control, or none is.
    #[error("{0}")]
    NotInControl(InControl),
    /// The session is that of another processor, or of an earlier incarnation of this one: open another.
    #[error(
        "the session belongs to another processor, or was opened before this processor restarted; open a new session"
    )]
    NotYours,
    /// The ledger of the controller of motions has the last number that a session can have.
    #[error(
        "the ledger of the motion controller (its file motions.ledger) has the last number that a session can have; stop \
         the controller's program, remove the file, and start the program again"
    )]
    Exhausted,
    /// All points of the batch are refused.
    #[error(transparent)]
    Points(#[from] JointStreamError),
}

impl ClientError {
    /// The error of a packet to or from a processor.
    pub(crate) const fn packet(to: Processor, error: PacketError) -> Self {
        match error {
            PacketError::Version { found, wanted } => Self::Version { to, found, wanted },
            PacketError::Length { most } => Self::Length { most },
            PacketError::Malformed => Self::Protocol { to },
        }
    }
}

use core::time::Duration;

use condor_mbox::Processor;
use condor_mbox::exchange::ExchangeError;
use thiserror::Error;

use crate::decimal::Decimal;
use crate::servo::ServoRefusal;
use crate::trajectory::JointStreamError;

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
    /// No program of this version sends such an answer.
    #[error(
        "{to} answered with the word {word:#x}, which this version does not know; build both from the same sources"
    )]
    Protocol {
        /// The number of the processor that was asked.
        to: Processor,
        /// The invalid word of the answer.
        word: u32,
    },
    /// The servo refuses the request.
    #[error(transparent)]
    Refused(#[from] ServoRefusal),
    /// A later order of another sender replaced this one, before or after it was carried out.
    #[error("another order took the place of order {number}")]
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
    /// The body of a request for motions does not fit.
    #[error("{length} bytes of motions; at most {most} fit in a request")]
    Length {
        /// The number of bytes.
        length: usize,
        /// The greatest number of bytes.
        most: usize,
    },
    /// The session is that of another processor, or of an earlier incarnation of this one: open another.
    #[error(
        "the session was opened by another processor, or in an earlier incarnation of this one; open another"
    )]
    NotYours,
    /// The ledger of the controller of motions has the last number that a session can have.
    #[error(
        "the controller's ledger has the last number that a session can have; stop the controller's program, remove \
         its ledger, and start the program again"
    )]
    Exhausted,
    /// All points of the batch are refused.
    #[error(transparent)]
    Points(#[from] JointStreamError),
}

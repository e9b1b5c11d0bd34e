//! Errors of mailboxes, each with the values that caused it.

use core::fmt;

use crate::id::{Processor, Vector};
use crate::window::WindowErrorKind;

/// One of the two pieces of shared memory that each processor has.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MemoryObject {
    /// The `mail` of the processor, which only the processor itself writes.
    Mail,
    /// The `data` of the processor, which every processor writes.
    Data,
}

impl fmt::Display for MemoryObject {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Mail => "mail",
            Self::Data => "data",
        })
    }
}

/// A property of shared memory on which both sides must agree; [`MailboxError::Layout`] names the
/// one that differs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum LayoutField {
    /// The number that marks a `mail`.
    Magic,
    /// The version of the layout.
    Version,
    /// The number of processors in the system.
    Processors,
    /// The processor's own number.
    Number,
    /// The number of slots of a ring.
    Slots,
    /// The number of vectors of a processor.
    Vectors,
    /// The size of `mail`, in bytes.
    MailSize,
    /// The size of `data`, in bytes.
    DataSize,
}

impl fmt::Display for LayoutField {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Magic => "magic number",
            Self::Version => "layout version",
            Self::Processors => "number of processors",
            Self::Number => "processor number",
            Self::Slots => "number of slots",
            Self::Vectors => "number of vectors",
            Self::MailSize => "size of `mail`",
            Self::DataSize => "size of `data`",
        })
    }
}

/// A word in the memory of a peer that can have a value that no correct peer writes;
/// [`MailboxError::Protocol`] names it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum ProtocolWord {
    /// The count of requests of this processor that the peer has taken.
    Taken,
    /// The word that tells whether the handler of a request succeeded.
    ReplyStatus,
}

impl fmt::Display for ProtocolWord {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Taken => "count of taken requests",
            Self::ReplyStatus => "status of a reply",
        })
    }
}

/// The progress of a request at the moment when its sender stops waiting: whether the receiver has
/// run it, or may run it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SendProgress {
    /// The request did not run and never will: it was not sent, or its receiver ended before it
    /// took it.
    Never,
    /// The receiver is not known to have taken the request. It may have run, or may run later; at
    /// most once in all.
    MayRun,
    /// The receiver has taken the request: its handler has been started, or is about to be.
    Taken,
}

impl fmt::Display for SendProgress {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Never => "the request will never run",
            Self::MayRun => "the request may still run",
            Self::Taken => "the request was taken",
        })
    }
}

/// The error of an operation of a [`Mailbox`](crate::Mailbox) or another messenger.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum MailboxError {
    /// The number is not below the number of processors of the system.
    #[error("{number} does not exist: the system has {processors} processors, numbered from 0")]
    NoSuchProcessor {
        /// The number that was given.
        number: Processor,
        /// The number of processors in the system.
        processors: u8,
    },
    /// The vector's number is not below [`Vector::COUNT`].
    #[error("{vector} does not exist: a processor has {count} vectors, numbered from 0", count = Vector::COUNT)]
    NoSuchVector {
        /// The vector that was given.
        vector: Vector,
    },
    /// The vector has a handler already.
    #[error("{vector} has a handler already")]
    VectorTaken {
        /// The vector that was given.
        vector: Vector,
    },
    /// The name of a vector is longer than [`NAME_BYTES`](crate::layout::NAME_BYTES) bytes.
    #[error("the name of {vector} has {len} bytes, more than {max}", max = crate::layout::NAME_BYTES)]
    NameTooLong {
        /// The vector that was to be named.
        vector: Vector,
        /// The length of the name in bytes.
        len: usize,
    },
    /// The receiver has no handler for the vector.
    #[error("{to} has no handler for {vector}")]
    NoHandler {
        /// The processor to which the message was sent.
        to: Processor,
        /// The vector to which the message was sent.
        vector: Vector,
    },
    /// The receiver's handler did not return: it panicked.
    #[error("the handler of {to} for {vector} panicked")]
    HandlerFailed {
        /// The processor to which the message was sent.
        to: Processor,
        /// The vector to which the message was sent.
        vector: Vector,
    },
    /// The receiver's handler refused the request.
    #[error("the handler of {to} for {vector} refused: error code {code}")]
    Refused {
        /// The processor to which the message was sent.
        to: Processor,
        /// The vector to which the message was sent.
        vector: Vector,
        /// The handler's error code.
        code: u32,
    },
    /// The mailbox has not joined the system.
    #[error("{number} has not joined the system")]
    NotJoined {
        /// The mailbox's own number.
        number: Processor,
    },
    /// A mailbox was told to listen to its own number. It gets the messages to that number anyway.
    #[error("{number} cannot listen to its own number: it gets the messages to that number anyway")]
    ListensToItself {
        /// The mailbox's own number.
        number: Processor,
    },
    /// The receiver has not joined, or has not yet noticed that the sender has.
    #[error("{to} is not connected: its program has not joined the system, or has just begun")]
    NotConnected {
        /// The processor to which the message was sent.
        to: Processor,
    },
    /// The receiver, or an earlier program with the sender's number, was built for another system:
    /// a word of its memory's layout differs.
    #[error(
        "the {field} in the {object} of {processor} is {found:#x}, expected {expected:#x}: its program was built \
         for another system or layout"
    )]
    Layout {
        /// The processor whose window it is.
        processor: Processor,
        /// The memory object of that processor.
        object: MemoryObject,
        /// The word that differs.
        field: LayoutField,
        /// The value that was found.
        found: u32,
        /// The value that is required.
        expected: u32,
    },
    /// Every slot for messages to the receiver is in use: its ring is full, or as many calls to it
    /// are unanswered as there are slots.
    #[error("all message slots to {to} are in use: wait for its replies, or try again")]
    NoSlot {
        /// The processor to which the message was sent.
        to: Processor,
    },
    /// The deadline passed; the receiver's heartbeat went on meanwhile.
    #[error("{to} did not answer {vector} in time ({progress})")]
    TimedOut {
        /// The processor to which the message was sent.
        to: Processor,
        /// The vector of the request.
        vector: Vector,
        /// The state that the request had reached.
        progress: SendProgress,
    },
    /// The deadline passed, and the receiver's heartbeat stood still all the while.
    ///
    /// The receiver is stopped, in a breakpoint, or busy without serving messages; it may recover.
    #[error("{to} is stalled and did not answer {vector} ({progress})")]
    Stalled {
        /// The processor to which the message was sent.
        to: Processor,
        /// The vector of the request.
        vector: Vector,
        /// The state that the request had reached.
        progress: SendProgress,
    },
    /// The program that held the receiver's number ended.
    #[error("{to} died ({progress})")]
    PeerDied {
        /// The processor to which the message was sent.
        to: Processor,
        /// The state that the request had reached.
        progress: SendProgress,
    },
    /// The receiver left the system in an orderly way, or was reset by the host.
    #[error("{to} left the system ({progress})")]
    PeerLeft {
        /// The processor to which the message was sent.
        to: Processor,
        /// The state that the request had reached.
        progress: SendProgress,
    },
    /// The receiver has joined anew, with a new incarnation, since the request was sent. The
    /// request is gone.
    #[error("{to} restarted ({progress})")]
    PeerRestarted {
        /// The processor to which the message was sent.
        to: Processor,
        /// The state that the request had reached.
        progress: SendProgress,
    },
    /// A handler waited for a reply although [`Call::MAX_DEPTH`](crate::Call::MAX_DEPTH) handlers
    /// are in progress, each nested in the one before.
    #[error(
        "{depth} handlers are in progress, each called by the one before: no deeper call is allowed"
    )]
    TooDeep {
        /// The number of handlers in progress.
        depth: u32,
    },
    /// The receiver wrote a value that no correct peer writes.
    #[error("{peer} broke the protocol: its {word} is {found:#x}")]
    Protocol {
        /// The processor to which the message was sent.
        peer: Processor,
        /// The word that has a wrong value.
        word: ProtocolWord,
        /// The value of the word.
        found: u32,
    },
    /// An access to a processor's shared memory (a window) failed.
    #[error("cannot access the {object} of {processor}: {kind}")]
    Window {
        /// The processor whose window it is.
        processor: Processor,
        /// The memory object of that processor.
        object: MemoryObject,
        /// The kind of error.
        kind: WindowErrorKind,
    },
}

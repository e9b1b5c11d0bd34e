//! The motion queue of a controller, served by message.
//!
//! A client opens a session and takes control. Then it offers motions, each with a [`RequestIdentity`] of its
//! own, and asks for their states. If a message is lost, the client sends the same request again: the
//! [queue](crate::queue) runs no identity twice. [`MotionsClient`] does this.
//!
//! The controller has a [`MotionsPost`], whose [`answer`](MotionsPost::answer) is the handler of [`MOTIONS`],
//! and a [`MotionsServer`] in its background. The handler answers requests that can be answered at once, and
//! keeps the others for the background, which may wait while the ledger is written. The controller knows the
//! motions and joints of its robot, and moves them: it makes the data of a request from an [`Offer`], and
//! begins and ends the [next request](MotionsServer::next_request).
//!
//! | operation | request | answer |
//! |---|---|---|
//! | [`Open`](MotionOperation::Open) | | [`Code::Done`] with the session as value; until then [`Code::Pending`]; [`Code::Exhausted`] if there is no number for one |
//! | [`Control`](MotionOperation::Control) | session; number 1 to take control from another session, too | [`Code::Done`], with the session in control |
//! | [`Offer`](MotionOperation::Offer) | session, number, body: motions, as the controller reads them | as [`Look`](MotionOperation::Look), and [`Code::Pending`] until it is accepted or refused |
//! | [`Look`](MotionOperation::Look) | session, number | [`Code::Known`], [`Code::New`], [`Code::Never`], [`Code::Forgotten`], [`Code::NoSession`]; [`Code::Pending`] while the controller has it and has not decided |
//! | [`Abort`](MotionOperation::Abort) | session, which is in control | [`Code::Done`], with the session in control; [`Code::Pending`] until the controller has ended all motion and recorded it in the ledger |
//! | [`GiveUp`](MotionOperation::GiveUp) | session | [`Code::Done`] |
//! | [`Stream`](MotionOperation::Stream) | session, number, body: the mask of the joints | as [`Offer`](MotionOperation::Offer) |
//! | [`Points`](MotionOperation::Points) | session, number, body: a [`Batch`] | [`Code::Done`] with the time until which there are points, ms; [`Code::Busy`] with that time if there is no room; [`Code::Pending`] until the stream begins; [`Code::Refused`] with the reason; [`Code::Known`] once the stream has ended |
//!
//! A request is a [`MotionRequest`], and its answer a [`MotionResponse`], in the [blocks](Blocks) of the
//! controller: words of 32 bits, little-endian.
//!
//! A stream is a request like any other, but its points come while it runs: batches with numbers, so
//! that one that is sent again changes nothing. The time of the points begins with the first batch. A
//! batch is refused as a whole if a joint would leave its limits
//! ([`JointStream`](crate::trajectory::JointStream)). When the next point has not come in time, the
//! joints brake from the last one within their limits, and the request is aborted with
//! [`RefusalReason::Starved`]. A [`StreamRequest`] takes the points.
//!
//! A session belongs to the processor that opened it, and to its incarnation: other processors get
//! [`Code::NotYours`], except for `Look`, and for an `Offer` of a request that the controller has already. When
//! that incarnation ends, the controller closes the session, and its control with it; the next incarnation of
//! the processor cannot use it even before that. The session's requests in the queue go on. A request that the
//! controller has not received by then never runs ([`Code::Never`]). When the controller's program ends, the
//! requests that it had accepted are lost or broken off; the sessions stay.

mod batch;
mod client;
mod post;
mod refusal;
mod server;
mod stream;

pub use batch::{BATCH, Batch};
pub use client::{MotionsClient, RequestProgress, SentPoints};
pub use post::{MotionsPost, Offer};
pub use refusal::StreamRefusal;
pub use server::{LedgerStore, MotionsEvent, MotionsServer};
pub use stream::StreamRequest;

use condor_mbox::Vector;
use condor_mbox::exchange::Blocks;
use zerocopy::{FromBytes, Immutable, IntoBytes};

use crate::queue::{QueueAnswer, RefusalReason, RequestIdentity, RequestState};

/// The vector of the messages that carry requests to the motion queue of a controller.
pub const MOTIONS: Vector = Vector(33);
/// The version of this protocol of motions. A controller answers a request of another version with
/// [`Code::Wrong`].
pub const VERSION: u32 = 3;
/// The size of the body of a [`MotionRequest`], in bytes.
pub const BODY_BYTES: usize = 480;

/// The blocks in the `data` of a controller through which clients send their requests and get the
/// answers; one for each processor.
pub type MotionsBlocks = Blocks<MotionRequest, MotionResponse>;

/// The greatest [`MotionResponse::progress`].
const WHOLE: u32 = 1000;

/// The operation that a [`MotionRequest`] asks for. The [module](self) lists the answers to each
/// one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u32)]
#[non_exhaustive]
pub enum MotionOperation {
    /// Opens a session.
    Open = 1,
    /// Takes control.
    Control = 2,
    /// Enqueues motions.
    Offer = 3,
    /// Asks for the state of a request.
    Look = 4,
    /// Ends all motion.
    Abort = 5,
    /// Ends the control of the session.
    GiveUp = 6,
    /// Enqueues a stream.
    Stream = 7,
    /// Sends points of the stream that runs.
    Points = 8,
}

impl MotionOperation {
    fn from_number(number: u32) -> Option<Self> {
        use MotionOperation::{Abort, Control, GiveUp, Look, Offer, Open, Points, Stream};
        let all = [Open, Control, Offer, Look, Abort, GiveUp, Stream, Points];
        all.into_iter()
            .find(|operation| *operation as u32 == number)
    }
}

/// The kind of an answer, which says what has become of the request or the operation.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u32)]
#[non_exhaustive]
pub enum Code {
    /// The operation is done.
    Done = 1,
    /// The request is in this state.
    Known = 2,
    /// The queue does not have the request.
    New = 3,
    /// The request was answered, and the answer is forgotten, or it was passed over by one with a greater
    /// number. It will not run.
    Forgotten = 4,
    /// The session does not exist, or no longer exists.
    NoSession = 5,
    /// The controller has the request, and has not decided: ask again.
    Pending = 6,
    /// The controller has no time or no room for the request: ask again.
    Busy = 7,
    /// The message is not a request.
    Wrong = 8,
    /// The session is that of another processor, or of an earlier incarnation of this one.
    NotYours = 9,
    /// The session's client was gone before the controller had the request, which never runs.
    Never = 10,
    /// All points of the batch are refused.
    Refused = 11,
    /// The ledger has the last number that a session can have: none can be opened until the ledger is removed.
    Exhausted = 12,
}

impl Code {
    fn from_number(number: u32) -> Option<Self> {
        let all = [
            Self::Done,
            Self::Known,
            Self::New,
            Self::Forgotten,
            Self::NoSession,
            Self::Pending,
            Self::Busy,
            Self::Wrong,
            Self::NotYours,
            Self::Never,
            Self::Refused,
            Self::Exhausted,
        ];
        all.into_iter().find(|code| *code as u32 == number)
    }
}

/// A request to a motion queue, in the form in which it is written into a block of shared memory.
#[derive(Clone, Copy, Debug, PartialEq, FromBytes, IntoBytes, Immutable)]
#[repr(C)]
pub struct MotionRequest {
    /// The [`VERSION`] of the client.
    pub version: u32,
    /// The number of a [`MotionOperation`].
    pub operation: u32,
    /// The number of the session; 0 if the operation is [`MotionOperation::Open`].
    pub session: u32,
    /// The number of the request in the session.
    pub number: u32,
    /// The number of bytes of the body that count.
    pub length: u32,
    /// Motions, the mask of a stream, or a [`Batch`].
    pub body: [u8; BODY_BYTES],
}

impl MotionRequest {
    fn new(operation: MotionOperation, session: u32, number: u32) -> Self {
        Self {
            version: VERSION,
            operation: operation as u32,
            session,
            number,
            length: 0,
            body: [0; BODY_BYTES],
        }
    }

    const fn identity(&self) -> RequestIdentity {
        RequestIdentity {
            session: self.session,
            number: self.number,
        }
    }

    fn body(&self) -> Option<&[u8]> {
        self.body.get(..self.length as usize)
    }
}

/// The answer to a [`MotionRequest`], in the form in which it is written into a block of shared
/// memory.
#[derive(Clone, Copy, Debug, Default, PartialEq, FromBytes, IntoBytes, Immutable)]
#[repr(C)]
pub struct MotionResponse {
    /// The [`VERSION`] of the controller.
    pub version: u32,
    /// The number of a [`Code`].
    pub code: u32,
    /// The number of a [`RequestState`], of [`Code::Known`].
    pub state: u32,
    /// The number of a [`RefusalReason`], of [`Code::Known`].
    pub reason: u32,
    /// A session; the number of requests before one that waits; or the time until which a stream has points,
    /// ms.
    pub value: u32,
    /// The part of the running request that is done, in thousandths, 1..=1000; 0 if the request does not run,
    /// or if the controller does not know the part, as for a stream.
    pub progress: u32,
    /// The reason of [`Code::Refused`].
    pub refusal: StreamRefusal,
}

impl MotionResponse {
    fn new(code: Code, value: u32) -> Self {
        Self {
            version: VERSION,
            code: code as u32,
            value,
            ..Self::default()
        }
    }

    fn of(answer: QueueAnswer) -> Self {
        let (code, state, reason) = match answer {
            QueueAnswer::Known(state, reason) => (Code::Known, state as u32, reason as u32),
            QueueAnswer::New => (Code::New, 0, 0),
            QueueAnswer::Never => (Code::Never, 0, 0),
            QueueAnswer::Forgotten => (Code::Forgotten, 0, 0),
            QueueAnswer::NoSession => (Code::NoSession, 0, 0),
        };
        Self {
            state,
            reason,
            ..Self::new(code, 0)
        }
    }

    /// Returns the answer of the queue; `None` if the response has none.
    fn answer(&self) -> Option<QueueAnswer> {
        Some(match Code::from_number(self.code)? {
            Code::Known => QueueAnswer::Known(
                RequestState::from_number(self.state)?,
                RefusalReason::from_number(self.reason)?,
            ),
            Code::New => QueueAnswer::New,
            Code::Never => QueueAnswer::Never,
            Code::Forgotten => QueueAnswer::Forgotten,
            Code::NoSession => QueueAnswer::NoSession,
            _ => return None,
        })
    }
}

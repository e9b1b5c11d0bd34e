//! The motion queue of a controller, served by message.
//!
//! A client opens a session and takes control. Then it offers motions, each with an [`Identity`] of
//! its own, and asks what has become of them. Whatever is lost on the way, it asks the same again:
//! the [queue](crate::queue) runs no identity twice. [`MotionsClient`] does this.
//!
//! The controller has a [`MotionsPost`], whose [`answer`](MotionsPost::answer) is the handler of
//! [`MOTIONS`], and a [`MotionsServer`] in its background. The handler answers what can be answered
//! at once, and keeps the rest for the background, which may wait while the ledger is written. What
//! motions and joints a robot has, and how it moves, is the controller's: it makes the data of a
//! request from an [`Offer`], and begins and ends what is [next](MotionsServer::next_request).
//!
//! | verb | request | answer |
//! |---|---|---|
//! | [`Open`](Verb::Open) | | [`Code::Done`] with the session as value; until then [`Code::Pending`]; [`Code::Exhausted`] if there is no number for one |
//! | [`Control`](Verb::Control) | session; number 1: from another one, too | [`Code::Done`], with the session in control |
//! | [`Offer`](Verb::Offer) | session, number, body: motions, as the controller reads them | as [`Look`](Verb::Look), and [`Code::Pending`] until it is accepted or refused |
//! | [`Look`](Verb::Look) | session, number | [`Code::Known`], [`Code::New`], [`Code::Never`], [`Code::Forgotten`], [`Code::NoSession`]; [`Code::Pending`] while the controller has it and has not decided |
//! | [`Abort`](Verb::Abort) | session, which is in control | [`Code::Done`], with the session in control; until the controller has ended all motion and written so, [`Code::Pending`] |
//! | [`GiveUp`](Verb::GiveUp) | session | [`Code::Done`] |
//! | [`Stream`](Verb::Stream) | session, number, body: the mask of the joints | as [`Offer`](Verb::Offer) |
//! | [`Points`](Verb::Points) | session, number, body: a [`Batch`] | [`Code::Done`] with the time until which there are points, ms; [`Code::Busy`] with that time if there is no room; [`Code::Pending`] until the stream begins; [`Code::Refused`] with the reason; [`Code::Known`] once the stream has ended |
//!
//! A request is a [`Request`], and its answer a [`Response`], in the [blocks](Blocks) of the
//! controller: words of 32 bits, little-endian.
//!
//! A stream is a request like any other, but its points come while it runs: batches with numbers, so
//! that one that is sent again changes nothing. The time of the points begins with the first batch. A
//! batch is refused as a whole if a joint would leave its limits
//! ([`JointStream`](crate::trajectory::JointStream)). When the next point has not come in time, the
//! joints brake from the last one within their limits, and the request is aborted with
//! [`Reason::Starved`]. A [`StreamRequest`] takes the points.
//!
//! A session belongs to the processor that opened it, and to its life: other processors get
//! [`Code::NotYours`], but for `Look`, and for an `Offer` of a request that the controller has
//! already. When that life ends, the controller closes the session, and its control with it; the next
//! life of the processor cannot use it even before that. What it had enqueued goes on. A request of it that
//! the controller has not got then never runs ([`Code::Never`]). When the controller's program ends,
//! what it had accepted is lost or broken off; the sessions stay.

mod batch;
mod client;
mod post;
mod refusal;
mod server;
mod stream;

pub use batch::{BATCH, Batch};
pub use client::{MotionsClient, MotionsError, Seen, Sent};
pub use post::{MotionsPost, Offer};
pub use refusal::Refusal;
pub use server::{LedgerStore, MotionsServer, News};
pub use stream::StreamRequest;

use condor_mbox::Vector;
use condor_mbox::exchange::Blocks;
use zerocopy::{FromBytes, Immutable, IntoBytes};

use crate::queue::{Answer, Identity, Reason, State};

/// The vector of a controller for requests of motions.
pub const MOTIONS: Vector = Vector(33);
/// The version of requests and answers. A request of another version is answered with
/// [`Code::Wrong`].
pub const VERSION: u32 = 3;
/// The size of the body of a request, in bytes.
pub const BODY_BYTES: usize = 480;

/// The blocks of requests and answers in the window of a controller.
pub type MotionsBlocks = Blocks<Request, Response>;

/// The greatest [`Response::progress`].
const WHOLE: u32 = 1000;

/// The verb of a request.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u32)]
#[non_exhaustive]
pub enum Verb {
    /// Opens a session.
    Open = 1,
    /// Takes control.
    Control = 2,
    /// Enqueues motions.
    Offer = 3,
    /// Asks what has become of a request.
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

impl Verb {
    fn from_number(number: u32) -> Option<Self> {
        use Verb::{Abort, Control, GiveUp, Look, Offer, Open, Points, Stream};
        let all = [Open, Control, Offer, Look, Abort, GiveUp, Stream, Points];
        all.into_iter().find(|verb| *verb as u32 == number)
    }
}

/// The kind of an answer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u32)]
#[non_exhaustive]
pub enum Code {
    /// It is done.
    Done = 1,
    /// The request is in this state.
    Known = 2,
    /// The queue has not got the request.
    New = 3,
    /// The request was answered, and the answer is forgotten, or it was passed over by one with a greater
    /// number. It will not run.
    Forgotten = 4,
    /// There is no such session, or no longer.
    NoSession = 5,
    /// The controller has it, and has not decided: ask again.
    Pending = 6,
    /// The controller has no time or no room for it: ask again.
    Busy = 7,
    /// The message is not a request.
    Wrong = 8,
    /// The session is that of another processor, or of an earlier life of this one.
    NotYours = 9,
    /// The session's client was gone before the controller had the request, which never runs.
    Never = 10,
    /// The points are refused, all of the batch.
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

/// A request as it lies in its block.
#[derive(Clone, Copy, Debug, PartialEq, FromBytes, IntoBytes, Immutable)]
#[repr(C)]
pub struct Request {
    /// The [`VERSION`] of the client.
    pub version: u32,
    /// The number of a [`Verb`].
    pub verb: u32,
    /// The session.
    pub session: u32,
    /// The number of the request in the session.
    pub number: u32,
    /// The number of bytes of the body that count.
    pub length: u32,
    /// Motions, the mask of a stream, or a [`Batch`].
    pub body: [u8; BODY_BYTES],
}

impl Request {
    fn new(verb: Verb, session: u32, number: u32) -> Self {
        Self {
            version: VERSION,
            verb: verb as u32,
            session,
            number,
            length: 0,
            body: [0; BODY_BYTES],
        }
    }

    const fn identity(&self) -> Identity {
        Identity {
            session: self.session,
            number: self.number,
        }
    }

    fn body(&self) -> Option<&[u8]> {
        self.body.get(..self.length as usize)
    }
}

/// An answer as it lies in its block.
#[derive(Clone, Copy, Debug, Default, PartialEq, FromBytes, IntoBytes, Immutable)]
#[repr(C)]
pub struct Response {
    /// The [`VERSION`] of the controller.
    pub version: u32,
    /// The number of a [`Code`].
    pub code: u32,
    /// The number of a [`State`], of [`Code::Known`].
    pub state: u32,
    /// The number of a [`Reason`], of [`Code::Known`].
    pub reason: u32,
    /// A session; the number of requests before one that waits; or the time of points, ms.
    pub value: u32,
    /// How far a request is that runs, in 1..=1000; 0 if it does not run, or if nobody knows: of a
    /// stream.
    pub progress: u32,
    /// The reason of [`Code::Refused`].
    pub refusal: Refusal,
}

impl Response {
    fn new(code: Code, value: u32) -> Self {
        Self {
            version: VERSION,
            code: code as u32,
            value,
            ..Self::default()
        }
    }

    fn of(answer: Answer) -> Self {
        let (code, state, reason) = match answer {
            Answer::Known(state, reason) => (Code::Known, state as u32, reason as u32),
            Answer::New => (Code::New, 0, 0),
            Answer::Never => (Code::Never, 0, 0),
            Answer::Forgotten => (Code::Forgotten, 0, 0),
            Answer::NoSession => (Code::NoSession, 0, 0),
        };
        Self {
            state,
            reason,
            ..Self::new(code, 0)
        }
    }

    /// The answer of the queue; `None` if the response has none.
    fn answer(&self) -> Option<Answer> {
        Some(match Code::from_number(self.code)? {
            Code::Known => Answer::Known(
                State::from_number(self.state)?,
                Reason::from_number(self.reason)?,
            ),
            Code::New => Answer::New,
            Code::Never => Answer::Never,
            Code::Forgotten => Answer::Forgotten,
            Code::NoSession => Answer::NoSession,
            _ => return None,
        })
    }
}

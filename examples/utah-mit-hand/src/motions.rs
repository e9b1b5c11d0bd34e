//! Motions by message: what the master is asked about its queue, and what it answers.
//!
//! A client opens a session and takes control. Then it offers motions, each with an
//! [`Identity`] of its own, and asks what has become of them. Whatever
//! is lost on the way, it asks the same again: the [queue](condor_hand::queue) runs no identity twice.
//!
//! | verb | request | answer |
//! |---|---|---|
//! | [`Open`](Verb::Open) | | [`Code::Done`] with the session as value; until then [`Code::Pending`] |
//! | [`Control`](Verb::Control) | session; number 1: from another one, too | [`Code::Done`], with the session in control |
//! | [`Offer`](Verb::Offer) | session, number, body: the name of a motion, or the image of motions | as [`Look`](Verb::Look), and [`Code::Pending`] until it is accepted or refused |
//! | [`Look`](Verb::Look) | session, number | [`Code::Known`], [`Code::New`], [`Code::Never`], [`Code::Forgotten`], [`Code::NoSession`]; [`Code::Pending`] while the master has it and has not decided |
//! | [`Abort`](Verb::Abort) | session, which is in control | [`Code::Done`], with the session in control |
//! | [`GiveUp`](Verb::GiveUp) | session | [`Code::Done`] |
//! | [`Stream`](Verb::Stream) | session, number, body: the mask of the joints | as [`Offer`](Verb::Offer) |
//! | [`Points`](Verb::Points) | session, number, body: a [`Batch`] | [`Code::Done`] with the time until which there are points, ms; [`Code::Busy`] with that time if there is no room; [`Code::Pending`] until the stream begins; [`Code::Refused`] with the joint; [`Code::Known`] once the stream has ended |
//!
//! A stream is a request like any other, but its points come while it runs: batches with numbers, so that
//! one that is sent again changes nothing. The time of the points begins with the first batch, which must
//! come within 2 s. The master has room for [`HORIZON`] points that are ahead. A batch is refused as a
//! whole if a joint would leave its limits ([`JointStream`](condor_hand::trajectory::JointStream)). When the
//! next point has not come in time, the joints brake from the last one within their limits, and the request
//! is aborted with [`Reason::Starved`]. `pause` at the terminal ends a stream, too.
//!
//! A session belongs to the processor that opened it, and to its life: other processors get
//! [`Code::NotYours`], but for `Look`, and for an `Offer` of a request that the master has already. When
//! that life ends, the master closes the session, and its control with it. What it had enqueued goes on.
//! A request of it that the master has not got then never runs ([`Code::Never`]). When the master's
//! program ends, what it had accepted is lost or broken off; the sessions stay.

mod points;

pub use points::{ALL, BATCH, Batch, HORIZON};

use core::time::Duration;

use condor_hand::queue::{Answer, Identity, Reason, State};
use condor_mbox::exchange::{Blocks, ExchangeError};
use condor_mbox::{AccessError, Exchange, MemoryWindow, Messenger, Processor, Region, Vector};
use thiserror::Error;
use zerocopy::{FromBytes, Immutable, IntoBytes};

/// The name of the blocks in the master's object table.
pub const NAME: &str = "motions";
/// Where the master is asked.
pub const MOTIONS: Vector = Vector(5);
/// The version of requests and answers. A request of another version is answered with
/// [`Code::Wrong`].
pub const VERSION: u32 = 2;
/// Bytes of the body of a request, at most.
pub const BODY_BYTES: usize = 480;

/// [`Response::progress`] of a request that is done.
pub(crate) const WHOLE: u32 = 1000;
/// How often a client asks again.
const PAUSE: Duration = Duration::from_millis(2);
/// The longest time of one request: a master in the middle of something answers after it.
const ANSWER: Duration = Duration::from_millis(500);

/// What a request is about.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u32)]
#[non_exhaustive]
pub enum Verb {
    /// To open a session.
    Open = 1,
    /// To be in control.
    Control = 2,
    /// To enqueue motions.
    Offer = 3,
    /// To know what has become of a request.
    Look = 4,
    /// To end all motion.
    Abort = 5,
    /// To be in control no longer.
    GiveUp = 6,
    /// To enqueue a stream.
    Stream = 7,
    /// To send points of the stream that runs.
    Points = 8,
}

impl Verb {
    pub(crate) fn from_number(number: u32) -> Option<Self> {
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
    /// The request was answered, and the answer is forgotten.
    Forgotten = 4,
    /// There is no such session, or no longer.
    NoSession = 5,
    /// The master has it, and has not decided: ask again.
    Pending = 6,
    /// The master has no time or no room for it: ask again.
    Busy = 7,
    /// It is no request.
    Wrong = 8,
    /// The session is that of another processor, or of an earlier life of this one.
    NotYours = 9,
    /// The session's client was gone before the master had the request, which never runs.
    Never = 10,
    /// The points are refused, all of the batch.
    Refused = 11,
}

/// A request.
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
    /// How many bytes of the body count.
    pub length: u32,
    /// The name of a motion, or the image of motions.
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

    pub(crate) fn identity(&self) -> Identity {
        Identity {
            session: self.session,
            number: self.number,
        }
    }

    pub(crate) fn body(&self) -> Option<&[u8]> {
        self.body.get(..self.length as usize)
    }
}

/// An answer.
#[derive(Clone, Copy, Debug, Default, PartialEq, FromBytes, IntoBytes, Immutable)]
#[repr(C)]
pub struct Response {
    /// The [`VERSION`] of the master.
    pub version: u32,
    /// The number of a [`Code`].
    pub code: u32,
    /// The number of a [`State`], of [`Code::Known`].
    pub state: u32,
    /// The number of a [`Reason`], of [`Code::Known`].
    pub reason: u32,
    /// A session; how many requests are before one that waits; the time of points, ms; or a joint.
    pub value: u32,
    /// How far a request is that runs, in thousandths.
    pub progress: u32,
}

/// What has become of a request, and how far it is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Seen {
    /// What has become of it.
    pub answer: Answer,
    /// The number of requests that run or wait before it, while it waits.
    pub before: u32,
    /// How far it is, in 0..=1, while it runs.
    pub progress: f64,
}

impl Response {
    pub(crate) fn new(code: Code, value: u32) -> Self {
        Self {
            version: VERSION,
            code: code as u32,
            value,
            ..Self::default()
        }
    }

    pub(crate) fn of(answer: Answer, before: usize) -> Self {
        match answer {
            Answer::Known(state, reason) => Self {
                state: state as u32,
                reason: reason as u32,
                ..Self::new(Code::Known, before as u32)
            },
            Answer::New => Self::new(Code::New, 0),
            Answer::Never => Self::new(Code::Never, 0),
            Answer::Forgotten => Self::new(Code::Forgotten, 0),
            Answer::NoSession => Self::new(Code::NoSession, 0),
        }
    }

    /// The answer of the queue; `None` if there is none yet.
    fn answer(&self) -> Result<Option<Answer>, MotionsError> {
        let strange = || MotionsError::Strange { response: *self };
        Ok(Some(match self.code {
            code if code == Code::Known as u32 => Answer::Known(
                State::from_number(self.state).ok_or_else(strange)?,
                Reason::from_number(self.reason).ok_or_else(strange)?,
            ),
            code if code == Code::New as u32 => Answer::New,
            code if code == Code::Never as u32 => Answer::Never,
            code if code == Code::Forgotten as u32 => Answer::Forgotten,
            code if code == Code::NoSession as u32 => Answer::NoSession,
            code if code == Code::NotYours as u32 => return Err(MotionsError::NotYours),
            _ if self.is_open() => return Ok(None),
            _ => return Err(strange()),
        }))
    }

    fn is_open(&self) -> bool {
        self.code == Code::Pending as u32 || self.code == Code::Busy as u32
    }
}

/// What has become of points that were sent.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Sent {
    /// The master has them, and points until this time of the stream.
    Until(Duration),
    /// The stream has ended before, as this says.
    Ended(Answer),
}

/// The reason for which a client has no answer.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum MotionsError {
    /// The master cannot be asked.
    #[error(transparent)]
    Exchange(#[from] ExchangeError),
    /// The client's mailbox cannot wait.
    #[error(transparent)]
    Mailbox(#[from] condor_mbox::Error),
    /// The master has not decided within the time: ask again.
    #[error("the master has not answered within {timeout:?}")]
    TimedOut {
        /// The time that it had.
        timeout: Duration,
    },
    /// The body of a request does not fit.
    #[error("{length} bytes of motions; at most {BODY_BYTES} fit in a request")]
    Length {
        /// How many there are.
        length: usize,
    },
    /// The master has another version of requests.
    #[error("the master reads requests of version {found}, this program writes {VERSION}")]
    Version {
        /// The master's version.
        found: u32,
    },
    /// The session is that of another processor, or of an earlier life of this one: open another.
    #[error("the session was opened by another processor, or in an earlier life of this one")]
    NotYours,
    /// The points of a batch are not possible: this joint, from 0, would leave its limits.
    #[error("joint {joint} would leave its limits of position, velocity or acceleration")]
    Limits {
        /// The joint.
        joint: u32,
    },
    /// The points of a batch are not possible: they are not in the order of time, or it is not the next
    /// batch, or the stream has its last point.
    #[error("points must come batch by batch, in the order of time, and none after the last one")]
    Order,
    /// The answer is none that a master gives.
    #[error("an answer that no master gives: {response:?}")]
    Strange {
        /// The answer.
        response: Response,
    },
}

/// Asks the queue of a master.
#[derive(Debug)]
pub struct MotionsClient<'m, M: Messenger + ?Sized, W: MemoryWindow> {
    messenger: &'m M,
    master: Processor,
    exchange: Exchange<'m, M, Region<W>, Request, Response>,
}

impl<'m, M: Messenger + ?Sized, W: MemoryWindow + Clone> MotionsClient<'m, M, W> {
    /// Makes a client of the master `master`, in whose region are `blocks`, which
    /// [`objects::motions`](crate::objects::motions) finds.
    ///
    /// # Errors
    /// [`AccessError`] if the blocks are not in the region.
    pub fn new(
        messenger: &'m M,
        master: Processor,
        blocks: &Blocks<Request, Response>,
        region: &Region<W>,
    ) -> Result<Self, AccessError> {
        Ok(Self {
            messenger,
            master,
            exchange: blocks.client(messenger, region)?,
        })
    }

    /// Opens a session, and returns its number.
    ///
    /// # Errors
    /// [`MotionsError`]; a session that was opened all the same is never used.
    pub fn open(&mut self, timeout: Duration) -> Result<u32, MotionsError> {
        let response = self.ask(&Request::new(Verb::Open, 0, 0), timeout)?;
        Self::done(response)
    }

    /// Puts the session in control if no other one is, or in any case with `from_other`; returns the
    /// session that is in control then.
    ///
    /// # Errors
    /// [`MotionsError`].
    pub fn control(
        &mut self,
        session: u32,
        from_other: bool,
        timeout: Duration,
    ) -> Result<u32, MotionsError> {
        let request = Request::new(Verb::Control, session, from_other.into());
        Self::done(self.ask(&request, timeout)?)
    }

    /// Offers the motion of this name, or the motions of an
    /// [image](condor_hand::trajectory::image), until they are accepted or refused.
    ///
    /// # Errors
    /// [`MotionsError`]; offer the same again, or [look](Self::look).
    pub fn offer(
        &mut self,
        identity: Identity,
        motions: &[u8],
        timeout: Duration,
    ) -> Result<Answer, MotionsError> {
        self.offer_as(Verb::Offer, identity, motions, timeout)
    }

    /// Offers a stream of the joints in `mask` (bit *i* is joint *i*), until it is accepted or refused.
    ///
    /// # Errors
    /// [`MotionsError`]; offer the same again, or [look](Self::look).
    pub fn stream(
        &mut self,
        identity: Identity,
        mask: u32,
        timeout: Duration,
    ) -> Result<Answer, MotionsError> {
        self.offer_as(Verb::Stream, identity, &mask.to_le_bytes(), timeout)
    }

    /// Sends points of a stream of the joints in `mask`, until it has begun and there is room for them.
    ///
    /// # Errors
    /// [`MotionsError::Limits`] or [`MotionsError::Order`] if the points are refused,
    /// [`MotionsError::TimedOut`] if there was no room; another [`MotionsError`]. Send the same again.
    pub fn points(
        &mut self,
        identity: Identity,
        mask: u32,
        batch: &Batch,
        timeout: Duration,
    ) -> Result<Sent, MotionsError> {
        let Identity { session, number } = identity;
        let mut request = Request::new(Verb::Points, session, number);
        let length = batch.write(mask, &mut request.body);
        let length = length.ok_or(MotionsError::Length {
            length: batch.points.len() * (8 + 16 * mask.count_ones() as usize),
        })?;
        request.length = length as u32;
        let response = self.ask(&request, timeout)?;
        match response.code {
            code if code == Code::Done as u32 => {
                Ok(Sent::Until(Duration::from_millis(response.value.into())))
            }
            code if code == Code::Refused as u32 && (response.value as usize) < ALL => {
                let joint = response.value;
                Err(MotionsError::Limits { joint })
            }
            code if code == Code::Refused as u32 => Err(MotionsError::Order),
            _ => match response.answer()? {
                Some(answer) => Ok(Sent::Ended(answer)),
                None => Err(MotionsError::Strange { response }),
            },
        }
    }

    fn offer_as(
        &mut self,
        verb: Verb,
        identity: Identity,
        body: &[u8],
        timeout: Duration,
    ) -> Result<Answer, MotionsError> {
        let (motions, Identity { session, number }) = (body, identity);
        let length = motions.len();
        let mut request = Request::new(verb, session, number);
        let body = request.body.get_mut(..length);
        let body = body.ok_or(MotionsError::Length { length })?;
        body.copy_from_slice(motions);
        request.length = length as u32;
        let response = self.ask(&request, timeout)?;
        response.answer()?.ok_or(MotionsError::Strange { response })
    }

    /// Returns what has become of a request, of whichever client, and how far it is.
    ///
    /// # Errors
    /// [`MotionsError`].
    pub fn look(&mut self, identity: Identity, timeout: Duration) -> Result<Seen, MotionsError> {
        let Identity { session, number } = identity;
        let response = self.ask(&Request::new(Verb::Look, session, number), timeout)?;
        let answer = response.answer()?;
        Ok(Seen {
            answer: answer.ok_or(MotionsError::Strange { response })?,
            before: response.value,
            progress: f64::from(response.progress) / f64::from(WHOLE),
        })
    }

    /// Ends all motion, if the session is in control. Returns the session that is.
    ///
    /// # Errors
    /// [`MotionsError`].
    pub fn abort(&mut self, session: u32, timeout: Duration) -> Result<u32, MotionsError> {
        Self::done(self.ask(&Request::new(Verb::Abort, session, 0), timeout)?)
    }

    /// Ends the control of the session, so that any other one can take it.
    ///
    /// # Errors
    /// [`MotionsError`].
    pub fn give_up_control(&mut self, session: u32, timeout: Duration) -> Result<(), MotionsError> {
        Self::done(self.ask(&Request::new(Verb::GiveUp, session, 0), timeout)?).map(drop)
    }

    /// Asks until the master has decided.
    fn ask(&mut self, request: &Request, timeout: Duration) -> Result<Response, MotionsError> {
        let deadline = self.messenger.now().after(timeout);
        loop {
            let answer = self.exchange.call(self.master, MOTIONS, request, ANSWER);
            let left = Duration::from_nanos(deadline.ns_since(self.messenger.now()));
            match answer {
                Ok(response) if response.version != VERSION => {
                    let found = response.version;
                    return Err(MotionsError::Version { found });
                }
                Ok(response) if !response.is_open() => return Ok(response),
                Ok(_) if left.is_zero() => return Err(MotionsError::TimedOut { timeout }),
                Err(error) if left.is_zero() => return Err(error.into()),
                // A master that ends may be about to come back.
                Ok(_) | Err(_) => {}
            }
            self.messenger.serve(left.min(PAUSE))?;
        }
    }

    fn done(response: Response) -> Result<u32, MotionsError> {
        match response.code {
            code if code == Code::Done as u32 => Ok(response.value),
            code if code == Code::NotYours as u32 => Err(MotionsError::NotYours),
            _ => Err(MotionsError::Strange { response }),
        }
    }
}

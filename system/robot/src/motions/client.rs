use core::time::Duration;

use condor_mbox::exchange::ExchangeError;
use condor_mbox::{AccessError, Exchange, MemoryWindow, Messenger, Processor, Region};
use heapless::Vec;

use super::{
    BODY_BYTES, Batch, MOTIONS, MotionRequest, MotionRequestPacket, MotionResponse,
    MotionResponsePacket, MotionsBlocks, Offer, RequestProgress,
};
use crate::packet::{self, ClientError};
use crate::queue::{QueueAnswer, RequestIdentity, RequestState};

/// The time after which a client asks again.
const PAUSE: Duration = Duration::from_millis(2);
/// The longest time that one request waits for its answer. A controller that is busy for longer is asked again.
const ANSWER: Duration = Duration::from_millis(500);

/// The outcome of [`MotionsClient::points`], which sends points of a stream.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum SentPoints {
    /// The controller has the points, and now has points until this time of the stream.
    Until(Duration),
    /// The stream has ended before, with this answer of the queue.
    Ended(QueueAnswer),
}

/// A client of the motion queue of another processor, the controller. Use it in the background of
/// this processor, since calls wait for answers.
#[derive(Debug)]
pub struct MotionsClient<'m, M: Messenger + ?Sized, W: MemoryWindow> {
    messenger: &'m M,
    to: Processor,
    exchange: Exchange<'m, M, Region<W>, MotionRequestPacket, MotionResponsePacket>,
}

impl<'m, M: Messenger + ?Sized, W: MemoryWindow + Clone> MotionsClient<'m, M, W> {
    /// Makes a client of the motion queue of the processor `to`.
    ///
    /// `region` is the users' region of that processor's `data` ([`Region::users`]), and `blocks` are the controller's
    /// blocks there. There must be only one client on this processor at a time.
    ///
    /// # Errors
    /// Returns [`AccessError`] of the kind `OutOfBounds` if there is no block for this processor, or if it does
    /// not lie in the region.
    pub fn new(
        messenger: &'m M,
        to: Processor,
        blocks: &MotionsBlocks,
        region: &Region<W>,
    ) -> Result<Self, AccessError> {
        Ok(Self {
            messenger,
            to,
            exchange: blocks.client(messenger, region)?,
        })
    }

    /// Opens a session in the queue, and returns its number. The session belongs to the present incarnation of this
    /// processor.
    ///
    /// # Errors
    /// Returns [`ClientError::Exhausted`] if the controller has used all session numbers. All calls also
    /// return [`ClientError::Exchange`] if the controller cannot be asked, [`ClientError::TimedOut`] if it has not
    /// decided within `timeout`, [`ClientError::Version`] if it has another version, and [`ClientError::Protocol`]
    /// if the answer is invalid. The session may be open all the same; then the next call returns it, or opens another.
    pub fn open(&mut self, timeout: Duration) -> Result<u32, ClientError> {
        match self.ask(&MotionRequest::Open, timeout)? {
            MotionResponse::Opened(session) => Ok(session),
            _ => Err(self.protocol()),
        }
    }

    /// Takes control of the queue, so that this session can enqueue motions. If another session is in control, it
    /// stays so, unless `from_other` is true.
    ///
    /// # Errors
    /// Returns [`ClientError::NotInControl`] if another session stays in control, or if the session is gone;
    /// [`ClientError::NotYours`] if the session is of another processor or incarnation; and the errors of
    /// all calls (see [`open`](Self::open)).
    pub fn take_control(
        &mut self,
        session: u32,
        from_other: bool,
        timeout: Duration,
    ) -> Result<(), ClientError> {
        let request = MotionRequest::Control {
            session,
            from_other,
        };
        self.done(&request, timeout)
    }

    /// Offers motions to the queue, and waits until they are accepted or refused. Returns the queue's answer.
    ///
    /// `motions` are bytes in a form that the controller reads. Choose a new [`RequestIdentity`] for new motions: the
    /// queue runs no identity twice.
    ///
    /// # Errors
    /// Returns [`ClientError::Length`] if there are more than [`BODY_BYTES`] bytes, [`ClientError::NotYours`]
    /// if the session is of another processor or incarnation, and the errors of all calls (see
    /// [`open`](Self::open)). After a failed exchange or a timeout, offer the same again, or
    /// [look](Self::look).
    pub fn offer(
        &mut self,
        identity: RequestIdentity,
        motions: &[u8],
        timeout: Duration,
    ) -> Result<QueueAnswer, ClientError> {
        let motions = Vec::from_slice(motions);
        let motions = motions.map_err(|_| ClientError::Length { most: BODY_BYTES })?;
        let request = MotionRequest::Offer(identity, Offer::Motions(motions));
        Ok(self.request(&request, timeout)?.answer)
    }

    /// Withdraws a request: if the queue does not have it yet, it never runs, even if it comes later. Otherwise nothing
    /// changes. Returns the queue's answer, which is never [`QueueAnswer::New`].
    ///
    /// # Errors
    /// Returns [`ClientError::NotYours`] if the session is of another processor or incarnation, and the errors of all
    /// calls (see [`open`](Self::open)).
    pub fn withdraw(
        &mut self,
        identity: RequestIdentity,
        timeout: Duration,
    ) -> Result<QueueAnswer, ClientError> {
        let request = MotionRequest::Withdraw(identity);
        Ok(self.request(&request, timeout)?.answer)
    }

    /// Binds the requests of a session to it, until the controller's program ends: if this processor's incarnation ends
    /// while one of them waits or runs, the controller ends all motion. Otherwise they run on.
    ///
    /// # Errors
    /// Returns [`ClientError::NotYours`] if the session is of another processor or incarnation, and the errors of all
    /// calls (see [`open`](Self::open)).
    pub fn bind(&mut self, session: u32, timeout: Duration) -> Result<(), ClientError> {
        self.done(&MotionRequest::Bind { session }, timeout)
    }

    /// Offers a stream of the joints in `mask` (bit *i* is joint *i*) to the queue, and waits until it is accepted or
    /// refused. Returns the queue's answer. Then send the points of the stream with [`points`](Self::points).
    ///
    /// # Errors
    /// Returns [`ClientError::NotYours`] if the session is of another processor or incarnation, and the errors
    /// of all calls (see [`open`](Self::open)). After a failed exchange or a timeout, offer the same again, or
    /// [look](Self::look).
    pub fn stream(
        &mut self,
        identity: RequestIdentity,
        mask: u32,
        timeout: Duration,
    ) -> Result<QueueAnswer, ClientError> {
        let request = MotionRequest::Offer(identity, Offer::Stream(mask));
        Ok(self.request(&request, timeout)?.answer)
    }

    /// Sends a batch of points of a stream. Waits until the stream has begun and the controller has room for the
    /// points.
    ///
    /// `identity` and `mask` are those with which the stream was offered; see [`stream`](Self::stream). Returns the
    /// time until which the controller now has points, or the queue's answer if the stream has ended.
    ///
    /// # Errors
    /// Returns [`ClientError::Points`] if the points are refused, [`ClientError::TimedOut`] if the stream did
    /// not begin or had no room within `timeout`, [`ClientError::Length`] if the batch has more points than
    /// [`Batch::room`], [`ClientError::NotYours`] if the session is of another processor or incarnation, and
    /// the errors of all calls (see [`open`](Self::open)). After a failed exchange or a timeout, send the same
    /// batch again.
    pub fn points<const J: usize>(
        &mut self,
        identity: RequestIdentity,
        mask: u32,
        batch: &Batch<J>,
        timeout: Duration,
    ) -> Result<SentPoints, ClientError> {
        let batch = batch.pack(mask);
        let batch = batch.ok_or(ClientError::Length { most: BODY_BYTES })?;
        match self.ask(&MotionRequest::Points(identity, batch), timeout)? {
            MotionResponse::Points(until) => {
                Ok(SentPoints::Until(Duration::from_millis(until.into())))
            }
            MotionResponse::Refused(error) => Err(error.into()),
            MotionResponse::Request(ended) => Ok(SentPoints::Ended(ended.answer)),
            _ => Err(self.protocol()),
        }
    }

    /// Returns the state of a request, which may be that of another client, and the part of it that
    /// is done.
    ///
    /// # Errors
    /// Returns only the errors that all calls return; see [`open`](Self::open).
    pub fn look(
        &mut self,
        identity: RequestIdentity,
        timeout: Duration,
    ) -> Result<RequestProgress, ClientError> {
        self.request(&MotionRequest::Look(identity), timeout)
    }

    /// Ends all motion of the controller, and waits until that is done.
    ///
    /// # Errors
    /// Returns [`ClientError::NotInControl`] if the session is not in control, [`ClientError::NotYours`] if it is of
    /// another processor or incarnation, and the errors of all calls (see [`open`](Self::open)). The controller may end
    /// all motion all the same once it has the request; call again to learn that it has.
    pub fn abort(&mut self, session: u32, timeout: Duration) -> Result<(), ClientError> {
        self.done(&MotionRequest::Abort { session }, timeout)
    }

    /// Ends the control of the session, if it is in control, so that any other session can take control.
    ///
    /// # Errors
    /// Returns [`ClientError::NotYours`] if the session is of another processor or incarnation, and the errors of
    /// all calls (see [`open`](Self::open)).
    pub fn give_up_control(&mut self, session: u32, timeout: Duration) -> Result<(), ClientError> {
        self.done(&MotionRequest::GiveUp { session }, timeout)
    }

    /// Sends a request until the controller has carried it out.
    fn done(&mut self, request: &MotionRequest, timeout: Duration) -> Result<(), ClientError> {
        match self.ask(request, timeout)? {
            MotionResponse::Done => Ok(()),
            _ => Err(self.protocol()),
        }
    }

    /// Sends a request about a request in the queue, until the controller has decided.
    fn request(
        &mut self,
        request: &MotionRequest,
        timeout: Duration,
    ) -> Result<RequestProgress, ClientError> {
        match self.ask(request, timeout)? {
            MotionResponse::Request(mut progress) => {
                let runs = matches!(
                    progress.answer,
                    QueueAnswer::Known(RequestState::Started, _)
                );
                let done = progress.progress.filter(|it| (0.0..=1.0).contains(it));
                progress.progress = done.filter(|_| runs);
                Ok(progress)
            }
            _ => Err(self.protocol()),
        }
    }

    /// Sends a request until the controller has decided, and returns its answer.
    fn ask(
        &mut self,
        request: &MotionRequest,
        timeout: Duration,
    ) -> Result<MotionResponse, ClientError> {
        let to = self.to;
        let deadline = self.messenger.now().after(timeout);
        loop {
            let left = Duration::from_nanos(deadline.ns_since(self.messenger.now()));
            let answer = packet::ask(&mut self.exchange, to, MOTIONS, request, ANSWER.min(left));
            let left = Duration::from_nanos(deadline.ns_since(self.messenger.now()));
            match answer {
                Ok(MotionResponse::Busy | MotionResponse::Pending) if left <= PAUSE => {
                    return Err(ClientError::TimedOut { to, timeout });
                }
                Ok(MotionResponse::Busy | MotionResponse::Pending) => {}
                Ok(MotionResponse::NotYours) => return Err(ClientError::NotYours),
                Ok(MotionResponse::Exhausted) => return Err(ClientError::Exhausted),
                Ok(MotionResponse::InControl(who)) => return Err(ClientError::NotInControl(who)),
                Ok(response) => return Ok(response),
                // A controller whose program has ended may start again.
                Err(ClientError::Exchange(_)) if left > PAUSE => {}
                Err(error) => return Err(error),
            }
            self.messenger.serve(PAUSE).map_err(ExchangeError::from)?;
        }
    }

    /// The error that the controller has answered with another kind of response.
    const fn protocol(&self) -> ClientError {
        ClientError::Protocol { to: self.to }
    }
}

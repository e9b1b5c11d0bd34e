use core::time::Duration;

use condor_mbox::exchange::ExchangeError;
use condor_mbox::{AccessError, Exchange, MemoryWindow, Messenger, Processor, Region};
use thiserror::Error;

use super::{
    BODY_BYTES, Batch, Code, MOTIONS, MotionOperation, MotionRequest, MotionResponse,
    MotionsBlocks, VERSION, WHOLE,
};
use crate::queue::{QueueAnswer, RequestIdentity, RequestState};
use crate::trajectory::JointStreamError;

/// The time after which a client asks again.
const PAUSE: Duration = Duration::from_millis(2);
/// The longest time that one request waits for its answer. A controller that is busy for longer is asked again.
const ANSWER: Duration = Duration::from_millis(500);

/// The state of a request in the queue, and the part of its motion that is done.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RequestProgress {
    /// The queue's answer about the request.
    pub answer: QueueAnswer,
    /// The number of requests that run or wait before it, while it waits.
    pub before: u32,
    /// The part of the request that is done, in 0..=1; `None` if the request does not run, or if the controller
    /// does not know the part. It does not for a stream: only the client knows how many points are still to
    /// come.
    pub progress: Option<f64>,
}

/// The outcome of [`MotionsClient::points`], which sends points of a stream.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum SentPoints {
    /// The controller has the points, and now has points until this time of the stream.
    Until(Duration),
    /// The stream has ended before, with this answer of the queue.
    Ended(QueueAnswer),
}

/// The reason why a client has no answer.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum MotionsError {
    /// The controller cannot be asked.
    #[error(transparent)]
    Exchange(#[from] ExchangeError),
    /// The client's mailbox cannot wait.
    #[error(transparent)]
    Mailbox(#[from] condor_mbox::MailboxError),
    /// The controller has not decided within the time: ask again.
    #[error("the controller has not answered within {timeout:?}")]
    TimedOut {
        /// The timeout of the call.
        timeout: Duration,
    },
    /// The body of a request does not fit.
    #[error("{length} bytes of motions; at most {BODY_BYTES} fit in a request")]
    Length {
        /// The number of bytes.
        length: usize,
    },
    /// The controller has another version of requests.
    #[error("the controller reads requests of version {found}, this program writes {VERSION}")]
    Version {
        /// The controller's version.
        found: u32,
    },
    /// The session is that of another processor, or of an earlier incarnation of this one: open another.
    #[error(
        "the session was opened by another processor, or in an earlier incarnation of this one"
    )]
    NotYours,
    /// The ledger of the controller has the last number that a session can have.
    #[error(
        "the controller's ledger has the last number that a session can have; stop the controller's program, remove \
         its ledger, and start the program again"
    )]
    Exhausted,
    /// All points of the batch are refused.
    #[error(transparent)]
    Points(#[from] JointStreamError),
    /// The response is invalid.
    #[error("an answer that no controller gives, with the code {}", response.code)]
    Strange {
        /// The invalid answer.
        response: MotionResponse,
    },
}

/// A client of the motion queue of another processor, the controller. Use it in the background of
/// this processor, since calls wait for answers.
#[derive(Debug)]
pub struct MotionsClient<'m, M: Messenger + ?Sized, W: MemoryWindow> {
    messenger: &'m M,
    to: Processor,
    exchange: Exchange<'m, M, Region<W>, MotionRequest, MotionResponse>,
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
    /// Returns [`MotionsError::Exhausted`] if the controller has used all session numbers. All calls also
    /// return [`MotionsError::Exchange`] if the controller cannot be asked, [`MotionsError::Mailbox`] if the
    /// mailbox cannot wait, [`MotionsError::TimedOut`] if the controller has not decided within `timeout`,
    /// [`MotionsError::Version`] if it has another version, and [`MotionsError::Strange`] if the answer is
    /// invalid. The session may be open all the same; then the next call returns it, or opens another.
    pub fn open(&mut self, timeout: Duration) -> Result<u32, MotionsError> {
        self.done(&MotionRequest::new(MotionOperation::Open, 0, 0), timeout)
    }

    /// Asks for control of the queue, so that this session can enqueue motions. If another session is in control, it
    /// stays so, unless `from_other` is true.
    ///
    /// Returns the number of the session that is in control after the call, or 0 if none is.
    ///
    /// # Errors
    /// Returns [`MotionsError::NotYours`] if the session is of another processor or incarnation, and the errors of
    /// all calls (see [`open`](Self::open)).
    pub fn control(
        &mut self,
        session: u32,
        from_other: bool,
        timeout: Duration,
    ) -> Result<u32, MotionsError> {
        let request = MotionRequest::new(MotionOperation::Control, session, from_other.into());
        self.done(&request, timeout)
    }

    /// Offers motions to the queue, and waits until they are accepted or refused. Returns the queue's answer.
    ///
    /// `motions` are bytes in a form that the controller reads. Choose a new [`RequestIdentity`] for new motions: the
    /// queue runs no identity twice.
    ///
    /// # Errors
    /// Returns [`MotionsError::Length`] if there are more than [`BODY_BYTES`] bytes, [`MotionsError::NotYours`]
    /// if the session is of another processor or incarnation, and the errors of all calls (see
    /// [`open`](Self::open)). After a failed exchange or a timeout, offer the same again, or
    /// [look](Self::look).
    pub fn offer(
        &mut self,
        identity: RequestIdentity,
        motions: &[u8],
        timeout: Duration,
    ) -> Result<QueueAnswer, MotionsError> {
        self.offer_as(MotionOperation::Offer, identity, motions, timeout)
    }

    /// Offers a stream of the joints in `mask` (bit *i* is joint *i*) to the queue, and waits until it is accepted or
    /// refused. Returns the queue's answer. Then send the points of the stream with [`points`](Self::points).
    ///
    /// # Errors
    /// Returns [`MotionsError::NotYours`] if the session is of another processor or incarnation, and the errors
    /// of all calls (see [`open`](Self::open)). After a failed exchange or a timeout, offer the same again, or
    /// [look](Self::look).
    pub fn stream(
        &mut self,
        identity: RequestIdentity,
        mask: u32,
        timeout: Duration,
    ) -> Result<QueueAnswer, MotionsError> {
        self.offer_as(
            MotionOperation::Stream,
            identity,
            &mask.to_le_bytes(),
            timeout,
        )
    }

    /// Sends a batch of points of a stream. Waits until the stream has begun and the controller has room for the
    /// points.
    ///
    /// `identity` and `mask` are those with which the stream was offered; see [`stream`](Self::stream). Returns the
    /// time until which the controller now has points, or the queue's answer if the stream has ended.
    ///
    /// # Errors
    /// Returns [`MotionsError::Points`] if the points are refused, [`MotionsError::TimedOut`] if the stream did
    /// not begin or had no room within `timeout`, [`MotionsError::Length`] if the batch has more points than
    /// [`Batch::room`], [`MotionsError::NotYours`] if the session is of another processor or incarnation, and
    /// the errors of all calls (see [`open`](Self::open)). After a failed exchange or a timeout, send the same
    /// batch again.
    pub fn points<const J: usize>(
        &mut self,
        identity: RequestIdentity,
        mask: u32,
        batch: &Batch<J>,
        timeout: Duration,
    ) -> Result<SentPoints, MotionsError> {
        let RequestIdentity { session, number } = identity;
        let mut request = MotionRequest::new(MotionOperation::Points, session, number);
        let length = batch.write(mask, &mut request.body);
        let length = length.ok_or(MotionsError::Length {
            length: batch.points.len() * (8 + 16 * mask.count_ones() as usize),
        })?;
        request.length = length as u32;
        let response = self.ask(&request, timeout)?;
        match Code::from_number(response.code) {
            Some(Code::Done) => Ok(SentPoints::Until(Duration::from_millis(
                response.value.into(),
            ))),
            Some(Code::Refused) => Err(match response.refusal.error() {
                Some(error) => MotionsError::Points(error),
                None => MotionsError::Strange { response },
            }),
            _ => answer(&response).map(SentPoints::Ended),
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
    ) -> Result<RequestProgress, MotionsError> {
        let RequestIdentity { session, number } = identity;
        let response = self.ask(
            &MotionRequest::new(MotionOperation::Look, session, number),
            timeout,
        )?;
        let (answer, progress) = (answer(&response)?, response.progress.min(WHOLE));
        let runs = matches!(answer, QueueAnswer::Known(RequestState::Started, _));
        Ok(RequestProgress {
            answer,
            before: response.value,
            progress: (runs && progress > 0).then(|| f64::from(progress) / f64::from(WHOLE)),
        })
    }

    /// Ends all motion of the controller, and waits until that is done. Nothing happens unless the session is in
    /// control.
    ///
    /// Returns the number of the session that is in control, or 0 if none is.
    ///
    /// # Errors
    /// Returns [`MotionsError::NotYours`] if the session is of another processor or incarnation, and the errors
    /// of all calls (see [`open`](Self::open)). The controller ends all motion all the same once it has the
    /// request; call again to learn that it has.
    pub fn abort(&mut self, session: u32, timeout: Duration) -> Result<u32, MotionsError> {
        self.done(
            &MotionRequest::new(MotionOperation::Abort, session, 0),
            timeout,
        )
    }

    /// Ends the control of the session, if it is in control, so that any other session can take control.
    ///
    /// # Errors
    /// Returns [`MotionsError::NotYours`] if the session is of another processor or incarnation, and the errors of
    /// all calls (see [`open`](Self::open)).
    pub fn give_up_control(&mut self, session: u32, timeout: Duration) -> Result<(), MotionsError> {
        self.done(
            &MotionRequest::new(MotionOperation::GiveUp, session, 0),
            timeout,
        )
        .map(drop)
    }

    fn offer_as(
        &mut self,
        operation: MotionOperation,
        identity: RequestIdentity,
        body: &[u8],
        timeout: Duration,
    ) -> Result<QueueAnswer, MotionsError> {
        let (length, RequestIdentity { session, number }) = (body.len(), identity);
        let mut request = MotionRequest::new(operation, session, number);
        let place = request.body.get_mut(..length);
        let place = place.ok_or(MotionsError::Length { length })?;
        place.copy_from_slice(body);
        request.length = length as u32;
        answer(&self.ask(&request, timeout)?)
    }

    /// Sends a request until the controller has decided, and returns the value of the answer.
    fn done(&mut self, request: &MotionRequest, timeout: Duration) -> Result<u32, MotionsError> {
        let response = self.ask(request, timeout)?;
        match Code::from_number(response.code) {
            Some(Code::Done) => Ok(response.value),
            Some(Code::NotYours) => Err(MotionsError::NotYours),
            Some(Code::Exhausted) => Err(MotionsError::Exhausted),
            _ => Err(MotionsError::Strange { response }),
        }
    }

    /// Sends a request until the controller has decided, and returns its answer.
    fn ask(
        &mut self,
        request: &MotionRequest,
        timeout: Duration,
    ) -> Result<MotionResponse, MotionsError> {
        let deadline = self.messenger.now().after(timeout);
        loop {
            let left = Duration::from_nanos(deadline.ns_since(self.messenger.now()));
            let answer = (self.exchange).call(self.to, MOTIONS, request, ANSWER.min(left));
            let left = Duration::from_nanos(deadline.ns_since(self.messenger.now()));
            match answer {
                Ok(response) if response.version != VERSION => {
                    let found = response.version;
                    return Err(MotionsError::Version { found });
                }
                Ok(response) if !is_open(&response) => return Ok(response),
                Ok(_) if left <= PAUSE => return Err(MotionsError::TimedOut { timeout }),
                Err(error) if left <= PAUSE => return Err(error.into()),
                // A controller whose program has ended may start again.
                Ok(_) | Err(_) => {}
            }
            self.messenger.serve(PAUSE)?;
        }
    }
}

/// Returns true if the request must be sent again.
fn is_open(response: &MotionResponse) -> bool {
    let code = Code::from_number(response.code);
    matches!(code, Some(Code::Pending | Code::Busy))
}

/// Returns the answer of the queue.
fn answer(response: &MotionResponse) -> Result<QueueAnswer, MotionsError> {
    let strange = MotionsError::Strange {
        response: *response,
    };
    match Code::from_number(response.code) {
        Some(Code::NotYours) => Err(MotionsError::NotYours),
        _ => response.answer().ok_or(strange),
    }
}

use core::time::Duration;

use condor_mbox::exchange::ExchangeError;
use condor_mbox::{AccessError, Exchange, MemoryWindow, Messenger, Processor, Region};

use super::super::ClientError;
use super::{
    BODY_BYTES, Batch, Code, MOTIONS, MotionOperation, MotionRequest, MotionResponse,
    MotionsBlocks, VERSION, WHOLE,
};
use crate::queue::{QueueAnswer, RequestIdentity, RequestState};

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
    /// Returns [`ClientError::Exhausted`] if the controller has used all session numbers. All calls also
    /// return [`ClientError::Exchange`] if the controller cannot be asked, [`ClientError::TimedOut`] if it has not
    /// decided within `timeout`, [`ClientError::Version`] if it has another version, and [`ClientError::Protocol`]
    /// if the answer is invalid. The session may be open all the same; then the next call returns it, or opens another.
    pub fn open(&mut self, timeout: Duration) -> Result<u32, ClientError> {
        self.done(&MotionRequest::new(MotionOperation::Open, 0, 0), timeout)
    }

    /// Asks for control of the queue, so that this session can enqueue motions. If another session is in control, it
    /// stays so, unless `from_other` is true.
    ///
    /// Returns the number of the session that is in control after the call, or 0 if none is.
    ///
    /// # Errors
    /// Returns [`ClientError::NotYours`] if the session is of another processor or incarnation, and the errors of
    /// all calls (see [`open`](Self::open)).
    pub fn control(
        &mut self,
        session: u32,
        from_other: bool,
        timeout: Duration,
    ) -> Result<u32, ClientError> {
        let request = MotionRequest::new(MotionOperation::Control, session, from_other.into());
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
        self.offer_as(MotionOperation::Offer, identity, motions, timeout)
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
        let RequestIdentity { session, number } = identity;
        let mut request = MotionRequest::new(MotionOperation::Points, session, number);
        let length = batch.write(mask, &mut request.body);
        let length = length.ok_or(ClientError::Length {
            length: batch.points.len() * (8 + 16 * mask.count_ones() as usize),
            most: BODY_BYTES,
        })?;
        request.length = length as u32;
        let response = self.ask(&request, timeout)?;
        match Code::from_number(response.code) {
            Some(Code::Done) => Ok(SentPoints::Until(Duration::from_millis(
                response.value.into(),
            ))),
            Some(Code::Refused) => Err(match response.refusal.error() {
                Some(error) => ClientError::Points(error),
                None => self.strange(&response),
            }),
            _ => self.answer(&response).map(SentPoints::Ended),
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
        let RequestIdentity { session, number } = identity;
        let response = self.ask(
            &MotionRequest::new(MotionOperation::Look, session, number),
            timeout,
        )?;
        let (answer, progress) = (self.answer(&response)?, response.progress.min(WHOLE));
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
    /// Returns [`ClientError::NotYours`] if the session is of another processor or incarnation, and the errors
    /// of all calls (see [`open`](Self::open)). The controller ends all motion all the same once it has the
    /// request; call again to learn that it has.
    pub fn abort(&mut self, session: u32, timeout: Duration) -> Result<u32, ClientError> {
        self.done(
            &MotionRequest::new(MotionOperation::Abort, session, 0),
            timeout,
        )
    }

    /// Ends the control of the session, if it is in control, so that any other session can take control.
    ///
    /// # Errors
    /// Returns [`ClientError::NotYours`] if the session is of another processor or incarnation, and the errors of
    /// all calls (see [`open`](Self::open)).
    pub fn give_up_control(&mut self, session: u32, timeout: Duration) -> Result<(), ClientError> {
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
    ) -> Result<QueueAnswer, ClientError> {
        let (length, RequestIdentity { session, number }) = (body.len(), identity);
        let mut request = MotionRequest::new(operation, session, number);
        let place = request.body.get_mut(..length);
        let place = place.ok_or(ClientError::Length {
            length,
            most: BODY_BYTES,
        })?;
        place.copy_from_slice(body);
        request.length = length as u32;
        let response = self.ask(&request, timeout)?;
        self.answer(&response)
    }

    /// Sends a request until the controller has decided, and returns the value of the answer.
    fn done(&mut self, request: &MotionRequest, timeout: Duration) -> Result<u32, ClientError> {
        let response = self.ask(request, timeout)?;
        match Code::from_number(response.code) {
            Some(Code::Done) => Ok(response.value),
            Some(Code::NotYours) => Err(ClientError::NotYours),
            Some(Code::Exhausted) => Err(ClientError::Exhausted),
            _ => Err(self.strange(&response)),
        }
    }

    /// Sends a request until the controller has decided, and returns its answer.
    fn ask(
        &mut self,
        request: &MotionRequest,
        timeout: Duration,
    ) -> Result<MotionResponse, ClientError> {
        let deadline = self.messenger.now().after(timeout);
        loop {
            let left = Duration::from_nanos(deadline.ns_since(self.messenger.now()));
            let answer = (self.exchange).call(self.to, MOTIONS, request, ANSWER.min(left));
            let left = Duration::from_nanos(deadline.ns_since(self.messenger.now()));
            match answer {
                Ok(response) if response.version != VERSION => {
                    let found = response.version;
                    return Err(ClientError::Version {
                        to: self.to,
                        found,
                        wanted: VERSION,
                    });
                }
                Ok(response) if !is_open(&response) => return Ok(response),
                Ok(_) if left <= PAUSE => {
                    return Err(ClientError::TimedOut {
                        to: self.to,
                        timeout,
                    });
                }
                Err(error) if left <= PAUSE => return Err(error.into()),
                // A controller whose program has ended may start again.
                Ok(_) | Err(_) => {}
            }
            self.messenger.serve(PAUSE).map_err(ExchangeError::from)?;
        }
    }
    /// Returns the answer of the queue.
    fn answer(&self, response: &MotionResponse) -> Result<QueueAnswer, ClientError> {
        match Code::from_number(response.code) {
            Some(Code::NotYours) => Err(ClientError::NotYours),
            _ => response.answer().ok_or(self.strange(response)),
        }
    }

    fn strange(&self, response: &MotionResponse) -> ClientError {
        ClientError::Protocol {
            to: self.to,
            word: response.code,
        }
    }
}

/// Returns true if the request must be sent again.
fn is_open(response: &MotionResponse) -> bool {
    let code = Code::from_number(response.code);
    matches!(code, Some(Code::Pending | Code::Busy))
}

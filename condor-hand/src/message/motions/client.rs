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
/// The longest time of one request: a controller that is busy with something else answers after it.
const ANSWER: Duration = Duration::from_millis(500);

/// The state of a request, and how much of it is done.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RequestProgress {
    /// What has become of it.
    pub answer: QueueAnswer,
    /// The number of requests that run or wait before it, while it waits.
    pub before: u32,
    /// How far it is, in 0..=1, while it runs. A stream has none: only its client knows how many points
    /// are still to come.
    pub progress: Option<f64>,
}

/// The outcome of sending points.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum SentPoints {
    /// The controller has them, and points until this time of the stream.
    Until(Duration),
    /// The stream has ended before, as this says.
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
        /// The time that it had.
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
    /// The points of a batch are refused, all of them.
    #[error(transparent)]
    Points(#[from] JointStreamError),
    /// The response is invalid.
    #[error("an answer that no controller gives, with the code {}", response.code)]
    Strange {
        /// The answer.
        response: MotionResponse,
    },
}

/// A client of the motion queue of another processor, for the background of this one.
#[derive(Debug)]
pub struct MotionsClient<'m, M: Messenger + ?Sized, W: MemoryWindow> {
    messenger: &'m M,
    to: Processor,
    exchange: Exchange<'m, M, Region<W>, MotionRequest, MotionResponse>,
}

impl<'m, M: Messenger + ?Sized, W: MemoryWindow + Clone> MotionsClient<'m, M, W> {
    /// Makes a client of the controller `to`. `region` is the users' region of that processor's `data`,
    /// in which its `blocks` are.
    ///
    /// There must be only one client on this processor at a time.
    ///
    /// # Errors
    /// [`AccessError`] of the kind `OutOfBounds` if there is no block for this processor, or if it does
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

    /// Opens a session, and returns its number.
    ///
    /// # Errors
    /// [`MotionsError`]; a session that was opened all the same is never used.
    pub fn open(&mut self, timeout: Duration) -> Result<u32, MotionsError> {
        self.done(&MotionRequest::new(MotionOperation::Open, 0, 0), timeout)
    }

    /// Puts the session in control if no other one is, or in any case with `from_other`; returns the
    /// session that is in control then, 0 for none.
    ///
    /// # Errors
    /// [`MotionsError`].
    pub fn control(
        &mut self,
        session: u32,
        from_other: bool,
        timeout: Duration,
    ) -> Result<u32, MotionsError> {
        let request = MotionRequest::new(MotionOperation::Control, session, from_other.into());
        self.done(&request, timeout)
    }

    /// Offers motions, in bytes that the controller reads, until they are accepted or refused.
    ///
    /// # Errors
    /// [`MotionsError`]; offer the same again, or [look](Self::look).
    pub fn offer(
        &mut self,
        identity: RequestIdentity,
        motions: &[u8],
        timeout: Duration,
    ) -> Result<QueueAnswer, MotionsError> {
        self.offer_as(MotionOperation::Offer, identity, motions, timeout)
    }

    /// Offers a stream of the joints in `mask` (bit *i* is joint *i*), until it is accepted or refused.
    ///
    /// # Errors
    /// [`MotionsError`]; offer the same again, or [look](Self::look).
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

    /// Sends points of a stream of the joints in `mask`, until it has begun and there is room for them.
    ///
    /// # Errors
    /// [`MotionsError::Points`] if the points are refused, [`MotionsError::TimedOut`] if there was no
    /// room; another [`MotionsError`]. Send the same again.
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

    /// Returns what has become of a request, of whichever client, and how far it is.
    ///
    /// # Errors
    /// [`MotionsError`].
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

    /// Ends all motion, if the session is in control, and waits until the controller has done so. Returns
    /// the session that is in control, 0 for none.
    ///
    /// # Errors
    /// [`MotionsError`]; the controller ends all motion all the same once it has the request. Ask again to
    /// know that it has.
    pub fn abort(&mut self, session: u32, timeout: Duration) -> Result<u32, MotionsError> {
        self.done(
            &MotionRequest::new(MotionOperation::Abort, session, 0),
            timeout,
        )
    }

    /// Ends the control of the session, so that any other one can take it.
    ///
    /// # Errors
    /// [`MotionsError`].
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

    /// Asks, and returns the value of the answer.
    fn done(&mut self, request: &MotionRequest, timeout: Duration) -> Result<u32, MotionsError> {
        let response = self.ask(request, timeout)?;
        match Code::from_number(response.code) {
            Some(Code::Done) => Ok(response.value),
            Some(Code::NotYours) => Err(MotionsError::NotYours),
            Some(Code::Exhausted) => Err(MotionsError::Exhausted),
            _ => Err(MotionsError::Strange { response }),
        }
    }

    /// Asks until the controller has decided.
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
                // A controller that ends may be about to come back.
                Ok(_) | Err(_) => {}
            }
            self.messenger.serve(PAUSE)?;
        }
    }
}

/// Whether a request must be asked again.
fn is_open(response: &MotionResponse) -> bool {
    let code = Code::from_number(response.code);
    matches!(code, Some(Code::Pending | Code::Busy))
}

/// The answer of the queue.
fn answer(response: &MotionResponse) -> Result<QueueAnswer, MotionsError> {
    let strange = MotionsError::Strange {
        response: *response,
    };
    match Code::from_number(response.code) {
        Some(Code::NotYours) => Err(MotionsError::NotYours),
        _ => response.answer().ok_or(strange),
    }
}

use core::cell::RefCell;

use condor_mbox::{Call, MemoryWindow, Processor, Region};
use critical_section::Mutex;
use heapless::Deque;

use super::{Code, MotionOperation, MotionRequest, MotionResponse, MotionsBlocks, VERSION};
use crate::queue::{MotionQueue, QueueAnswer, RefusalReason, RequestState, SessionOwner};

/// The greatest number of offers that wait for the background, each of another processor.
const INBOX: usize = 8;

/// The motions or the stream that a client offers to the queue, as the controller gets them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Offer<'a> {
    /// Motions, in bytes that the controller reads.
    Motions(&'a [u8]),
    /// A stream of the joints in this mask: bit *i* is joint *i*. The mask is not checked: the robot may not
    /// have these joints.
    Stream(u32),
}

/// The motion queue and the open requests of a controller, which the handler of [`MOTIONS`](super::MOTIONS) and the
/// [`MotionsServer`](super::MotionsServer) in the background share.
///
/// `P` is the type of the data of a request, and `N` the number of requests that can wait, as in [`MotionQueue`].
#[derive(Debug)]
pub struct MotionsPost<P, const N: usize>(Mutex<RefCell<MotionsState<P, N>>>);

/// The state of the abort for which the session in control has asked.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Abort {
    No,
    /// The background has not ended all motion.
    Asked,
    /// Nothing has begun since the background ended all motion. The client has not been told.
    Done,
}

impl Abort {
    /// Returns the state after the background has ended all motion.
    pub(super) fn done(self) -> Self {
        match self {
            Self::No => Self::No,
            Self::Asked | Self::Done => Self::Done,
        }
    }

    /// Returns the state after a motion has begun, whose end must be asked for anew.
    pub(super) fn over(self) -> Self {
        match self {
            Self::Asked => Self::Asked,
            Self::No | Self::Done => Self::No,
        }
    }
}

/// State shared by the handler and the background.
#[derive(Debug)]
pub(super) struct MotionsState<P, const N: usize> {
    /// `None` while the background works on it.
    pub(super) queue: Option<MotionQueue<P, N>>,
    /// At most one offer of each processor.
    pub(super) inbox: Deque<(SessionOwner, MotionRequest), INBOX>,
    /// For each processor that has asked for a session, the one that was opened for it, or 0 if none is open
    /// yet.
    opened: [Option<u32>; Processor::MAX_COUNT],
    /// The index of the processor that comes first in the search for one to get a session.
    next: usize,
    /// The session that took control, until the controller has been told.
    pub(super) taken_by: Option<u32>,
    pub(super) abort: Abort,
    /// The progress of the request that runs, as in [`MotionResponse::progress`].
    pub(super) progress: u32,
}

impl<P, const N: usize> MotionsPost<P, N> {
    /// Makes the state that message handler and background share, still without a queue. A
    /// [`MotionsServer`](super::MotionsServer) restores the queue from its ledger; until then
    /// clients are told to ask again.
    #[must_use]
    pub const fn new() -> Self {
        Self(Mutex::new(RefCell::new(MotionsState {
            queue: None,
            inbox: Deque::new(),
            opened: [None; Processor::MAX_COUNT],
            next: 0,
            taken_by: None,
            abort: Abort::No,
            progress: 0,
        })))
    }

    /// Answers a message of a client, and returns the reply. Register a handler for the vector
    /// [`MOTIONS`](super::MOTIONS) that calls this and does nothing else.
    ///
    /// `own` is the users' region of the controller's own `data`, in which `blocks` are. `points` gets the requests
    /// that contain points of a stream: pass them to [`StreamRequest::take`](super::StreamRequest::take), and return
    /// its result, or `None` if no stream runs.
    pub fn answer<W: MemoryWindow>(
        &self,
        call: &Call<'_>,
        blocks: &MotionsBlocks,
        own: &Region<W>,
        points: impl FnOnce(SessionOwner, &MotionRequest) -> Option<MotionResponse>,
    ) -> u32 {
        let sender = SessionOwner {
            processor: call.sender().0.into(),
            incarnation: call.sender_incarnation(),
        };
        blocks.answer(call, own, |request: MotionRequest| {
            let taken = (request.operation == MotionOperation::Points as u32)
                .then(|| points(sender, &request))
                .flatten();
            taken
                .or_else(|| self.with(|desk| desk.receive(sender, &request)))
                .unwrap_or(MotionResponse::busy())
        })
    }

    /// Runs `work` on the shared state; returns `None` if it is already borrowed.
    pub(super) fn with<T>(&self, work: impl FnOnce(&mut MotionsState<P, N>) -> T) -> Option<T> {
        critical_section::with(|section| {
            let mut desk = self.0.borrow(section).try_borrow_mut().ok()?;
            Some(work(&mut desk))
        })
    }
}

impl<P, const N: usize> Default for MotionsPost<P, N> {
    fn default() -> Self {
        Self::new()
    }
}

impl MotionResponse {
    /// Returns an answer with [`Code::Busy`]: the controller has no time now, and the client must ask again.
    #[must_use]
    pub fn busy() -> Self {
        Self::new(Code::Busy, 0)
    }
}

impl MotionRequest {
    /// Returns the content of an offer.
    pub(super) fn offer(&self) -> Result<Offer<'_>, RefusalReason> {
        let body = self.body().ok_or(RefusalReason::NoMotion)?;
        if self.operation != MotionOperation::Stream as u32 {
            return Ok(Offer::Motions(body));
        }
        let mask = body.first_chunk().ok_or(RefusalReason::NoMotion)?;
        Ok(Offer::Stream(u32::from_le_bytes(*mask)))
    }
}

impl<P, const N: usize> MotionsState<P, N> {
    /// Returns the processor whose turn it is to get a session, if any asks for one.
    pub(super) fn next_to_open(&mut self) -> Option<Processor> {
        let places = self.opened.iter().enumerate().cycle();
        let mut places = places.skip(self.next).take(Processor::MAX_COUNT);
        let (place, _) = places.find(|(_, it)| **it == Some(0))?;
        self.next = (place + 1) % Processor::MAX_COUNT;
        Some(Processor(place as u8))
    }

    /// Records the session that was opened for a processor; with `None` the processor asks again.
    pub(super) fn open(&mut self, asks: Processor, session: Option<u32>) {
        if let Some(place) = self.opened.get_mut(asks.index()) {
            *place = session;
        }
    }

    /// Answers a request that can be answered at once, and keeps any other for the background.
    fn receive(&mut self, sender: SessionOwner, request: &MotionRequest) -> MotionResponse {
        let Some(queue) = &mut self.queue else {
            return MotionResponse::busy();
        };
        let (identity, session) = (request.identity(), request.session);
        let done = |session: Option<u32>| MotionResponse::new(Code::Done, session.unwrap_or(0));
        let is_of_sender = |queue: &MotionQueue<P, N>, session| {
            queue.owner(session) == Some(sender) && !queue.is_closed(session)
        };
        // False for a session that is gone: the queue answers that it is.
        let is_of_other = queue.owner(session).is_some() && !is_of_sender(queue, session);
        let answer = |code| MotionResponse::new(code, 0);
        let (not_yours, pending) = (answer(Code::NotYours), answer(Code::Pending));
        let operation = MotionOperation::from_number(request.operation);
        match operation.filter(|_| request.version == VERSION) {
            Some(MotionOperation::Open) => {
                let Some(opened) = self.opened.get_mut(sender.processor as usize) else {
                    return MotionResponse::new(Code::Wrong, 0);
                };
                match opened.take() {
                    Some(session) if session != 0 && is_of_sender(queue, session) => {
                        done(Some(session))
                    }
                    _ if queue.is_exhausted() => MotionResponse::new(Code::Exhausted, 0),
                    _ => {
                        *opened = Some(0);
                        pending
                    }
                }
            }
            Some(MotionOperation::Control | MotionOperation::Abort | MotionOperation::GiveUp)
                if is_of_other =>
            {
                not_yours
            }
            Some(MotionOperation::Control) => {
                let before = queue.in_control();
                queue.take_control(session, request.number == 1);
                let now = queue.in_control();
                if now != before {
                    self.taken_by = now;
                    // The session that was in control before may have moved the robot by other means.
                    self.abort = self.abort.over();
                }
                done(now)
            }
            Some(MotionOperation::Offer | MotionOperation::Stream | MotionOperation::Look)
                if request.number == 0 =>
            {
                MotionResponse::new(Code::Wrong, 0)
            }
            Some(MotionOperation::Offer | MotionOperation::Stream | MotionOperation::Look) => {
                let answer = queue.answer(identity);
                if !matches!(answer, QueueAnswer::New | QueueAnswer::Never) {
                    let runs = matches!(answer, QueueAnswer::Known(RequestState::Started, _));
                    MotionResponse {
                        value: queue.before(identity).unwrap_or(0) as u32,
                        progress: if runs { self.progress } else { 0 },
                        ..MotionResponse::of(answer)
                    }
                } else if self.inbox.iter().any(|(_, it)| it.identity() == identity) {
                    pending
                } else if operation == Some(MotionOperation::Look) || answer == QueueAnswer::Never {
                    MotionResponse::of(answer)
                } else if is_of_other {
                    not_yours
                } else if request.body().is_none() {
                    MotionResponse::new(Code::Wrong, 0)
                } else if self
                    .inbox
                    .iter()
                    .all(|(from, _)| from.processor != sender.processor)
                    && self.inbox.push_back((sender, *request)).is_ok()
                {
                    pending
                } else {
                    MotionResponse::busy()
                }
            }
            Some(MotionOperation::Abort) => {
                let in_control = queue.in_control();
                if in_control != Some(session) {
                    return done(in_control);
                }
                if self.abort == Abort::Done {
                    self.abort = Abort::No;
                    return done(in_control);
                }
                self.abort = Abort::Asked;
                // Offers that are not decided count as new again.
                self.inbox.clear();
                pending
            }
            // The points of a stream that runs do not come here: `answer` passes them to the stream.
            Some(MotionOperation::Points) => match queue.answer(identity) {
                _ if is_of_other => not_yours,
                QueueAnswer::Known(RequestState::Accepted | RequestState::Started, _) => pending,
                answer => MotionResponse::of(answer),
            },
            Some(MotionOperation::GiveUp) => {
                queue.give_up_control(session);
                done(None)
            }
            None => MotionResponse::new(Code::Wrong, 0),
        }
    }
}

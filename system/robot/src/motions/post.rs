use core::cell::RefCell;

use condor_mbox::{Call, MemoryWindow, Processor, Region};
use critical_section::Mutex;
use heapless::Deque;

use super::{MotionRequest, MotionResponse, MotionsBlocks, Offer, PackedBatch, RequestProgress};
use crate::packet;
use crate::queue::{
    InControl, MotionQueue, OWN, QueueAnswer, RequestIdentity, RequestState, SessionOwner,
};

/// The greatest number of offers and withdrawals that wait for the background, each of another processor.
const INBOX: usize = 8;

/// The motion queue and the open requests of a controller, which the handler of [`MOTIONS`](super::MOTIONS) and the
/// [`MotionsServer`](super::MotionsServer) in the background share.
///
/// `P` is the type of the data of a request, and `N` the number of requests that can wait, as in [`MotionQueue`].
#[derive(Debug)]
pub struct MotionsPost<P, const N: usize>(Mutex<RefCell<MotionsState<P, N>>>);

/// The state of the abort for which the session in control has asked, or that a client causes that is gone.
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
    /// At most one offer of each processor; `None` withdraws the request.
    pub(super) inbox: Deque<(SessionOwner, RequestIdentity, Option<Offer>), INBOX>,
    /// For each processor that has asked for a session, the one that was opened for it, or 0 if none is open
    /// yet.
    opened: [Option<u32>; Processor::MAX_COUNT],
    /// The index of the processor that comes first in the search for one to get a session.
    next: usize,
    /// The session that took control, until the controller has been told.
    pub(super) taken_by: Option<u32>,
    pub(super) abort: Abort,
    /// The progress of the request that runs, as in [`RequestProgress::progress`].
    pub(super) progress: Option<f64>,
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
            progress: None,
        })))
    }

    /// Answers a message of a client, and returns the reply. Register a handler for the vector
    /// [`MOTIONS`](super::MOTIONS) that calls this and does nothing else.
    ///
    /// `own` is the users' region of the controller's own `data`, in which `blocks` are. `points` gets the points of
    /// streams, with their sender: pass them to [`StreamRequest::take`](super::StreamRequest::take), and return
    /// its result, or `None` if no stream runs.
    pub fn answer<W: MemoryWindow>(
        &self,
        call: &Call<'_>,
        blocks: &MotionsBlocks,
        own: &Region<W>,
        points: impl FnOnce(SessionOwner, RequestIdentity, &PackedBatch) -> Option<MotionResponse>,
    ) -> u32 {
        let sender = SessionOwner {
            processor: call.sender().0.into(),
            incarnation: call.sender_incarnation(),
        };
        packet::answer(*blocks, call, own, |request| {
            let taken = match &request {
                MotionRequest::Points(identity, batch) => points(sender, *identity, batch),
                _ => None,
            };
            taken
                .or_else(|| self.with(|desk| desk.receive(sender, request)))
                .unwrap_or(MotionResponse::Busy)
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
    fn receive(&mut self, sender: SessionOwner, request: MotionRequest) -> MotionResponse {
        let Some(queue) = &mut self.queue else {
            return MotionResponse::Busy;
        };
        let is_of_sender = |queue: &MotionQueue<P, N>, session| {
            queue.ledger().owner(session) == Some(sender) && !queue.ledger().is_closed(session)
        };
        // False for a session that is gone: the queue answers that it is.
        let is_of_other = request.session().is_some_and(|session| {
            session == OWN
                || queue.ledger().owner(session).is_some() && !is_of_sender(queue, session)
        });
        match request {
            MotionRequest::Open => {
                let Some(opened) = self.opened.get_mut(sender.processor as usize) else {
                    return MotionResponse::Invalid;
                };
                match opened.take() {
                    Some(session) if session != 0 && is_of_sender(queue, session) => {
                        MotionResponse::Opened(session)
                    }
                    _ if queue.ledger().is_exhausted() => MotionResponse::Exhausted,
                    _ => {
                        *opened = Some(0);
                        MotionResponse::Pending
                    }
                }
            }
            MotionRequest::Control { .. }
            | MotionRequest::Abort { .. }
            | MotionRequest::GiveUp { .. }
            | MotionRequest::Bind { .. }
                if is_of_other =>
            {
                MotionResponse::NotYours
            }
            MotionRequest::Control {
                session,
                from_other,
            } => {
                let before = queue.in_control();
                let is_taken = queue.take_control(session, from_other);
                let now = queue.in_control();
                if now != before {
                    self.taken_by = Some(session);
                    // The session that was in control before may have moved the robot by other means.
                    self.abort = self.abort.over();
                }
                if is_taken {
                    MotionResponse::Done
                } else {
                    MotionResponse::InControl(now)
                }
            }
            MotionRequest::Look(RequestIdentity { number: 0, .. })
            | MotionRequest::Offer(RequestIdentity { number: 0, .. }, _)
            | MotionRequest::Withdraw(RequestIdentity { number: 0, .. }) => MotionResponse::Invalid,
            MotionRequest::Look(identity) => match queue.answer(identity) {
                QueueAnswer::New if self.has(identity) => MotionResponse::Pending,
                answer => self.state(identity, answer),
            },
            MotionRequest::Offer(identity, offer) => {
                self.enter(sender, is_of_other, identity, Some(offer))
            }
            MotionRequest::Withdraw(identity) => self.enter(sender, is_of_other, identity, None),
            MotionRequest::Abort { session } => {
                let in_control = queue.in_control();
                if in_control != InControl::Session(session) {
                    return MotionResponse::InControl(in_control);
                }
                if self.abort == Abort::Done {
                    self.abort = Abort::No;
                    return MotionResponse::Done;
                }
                self.abort = Abort::Asked;
                // Offers that are not decided count as new again.
                self.inbox.clear();
                MotionResponse::Pending
            }
            // The points of a stream that runs do not come here: `answer` passes them to the stream.
            MotionRequest::Points(identity, _) => match queue.answer(identity) {
                _ if is_of_other => MotionResponse::NotYours,
                QueueAnswer::Known(RequestState::Accepted | RequestState::Started, _) => {
                    MotionResponse::Pending
                }
                answer => MotionResponse::Request(RequestProgress::of(answer)),
            },
            MotionRequest::Bind { session } => {
                queue.bind(session);
                MotionResponse::Done
            }
            MotionRequest::GiveUp { session } => {
                queue.give_up_control(session);
                MotionResponse::Done
            }
        }
    }

    /// Has the background decide about an offer, or a request that is withdrawn, if the queue does not have it.
    fn enter(
        &mut self,
        sender: SessionOwner,
        is_of_other: bool,
        identity: RequestIdentity,
        offer: Option<Offer>,
    ) -> MotionResponse {
        let answer = self.queue.as_ref().map(|queue| queue.answer(identity));
        match answer.unwrap_or(QueueAnswer::New) {
            QueueAnswer::New if self.has(identity) => MotionResponse::Pending,
            QueueAnswer::New if is_of_other => MotionResponse::NotYours,
            QueueAnswer::New => {
                let mut waiting = self.inbox.iter();
                let is_first = waiting.all(|(from, ..)| from.processor != sender.processor);
                if is_first && self.inbox.push_back((sender, identity, offer)).is_ok() {
                    MotionResponse::Pending
                } else {
                    MotionResponse::Busy
                }
            }
            answer => self.state(identity, answer),
        }
    }

    /// Returns true if the background has not decided about a request that has come.
    fn has(&self, identity: RequestIdentity) -> bool {
        self.inbox.iter().any(|(_, it, _)| *it == identity)
    }

    /// Returns the queue's answer about a request, with how far the request is.
    fn state(&self, identity: RequestIdentity, answer: QueueAnswer) -> MotionResponse {
        let mut progress = RequestProgress::of(answer);
        match answer {
            QueueAnswer::Known(RequestState::Accepted, _) => {
                let before = self.queue.as_ref().and_then(|it| it.before(identity));
                progress.before = before.unwrap_or(0) as u32;
            }
            QueueAnswer::Known(RequestState::Started, _) => progress.progress = self.progress,
            _ => {}
        }
        MotionResponse::Request(progress)
    }
}

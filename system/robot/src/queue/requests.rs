use core::fmt;

use condor_hand::ImageError;
use heapless::Deque;
use serde::{Deserialize, Serialize};
use thiserror::Error;

use super::{Ledger, LedgerRow, RefusalReason, RequestIdentity, RequestState, SessionOwner};

/// The session of the program itself. No client can have it, and its requests are not in the ledger: nobody can ask for
/// them after the program has ended.
pub const OWN: u32 = 0;

/// The session that is in control of a [`MotionQueue`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum InControl {
    /// No session is in control.
    Nobody,
    /// The program that has the queue is in control, such as by its terminal.
    Program,
    /// The session of this number is in control.
    Session(u32),
}

impl fmt::Display for InControl {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Nobody => f.write_str("nobody is in control"),
            Self::Program => f.write_str("the terminal of the robot is in control"),
            Self::Session(session) => {
                write!(f, "another program is in control, by session {session}")
            }
        }
    }
}

/// The answer of a [`MotionQueue`] to the question what has become of a request.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum QueueAnswer {
    /// The request has this state, for this reason.
    Known(RequestState, RefusalReason),
    /// The queue does not have the request: it has not run, and can be sent.
    New,
    /// The request was answered or passed over by one with a greater number, and nobody knows which. It will not run.
    Forgotten,
    /// The owner of the session was gone before the queue had the request, or one with a greater number came first: it
    /// has not run, and never will.
    Never,
    /// The session does not exist, or no longer exists.
    NoSession,
}

impl QueueAnswer {
    /// Returns the answer in a word, for programs that read it: that of the [`RequestState`], `unknown` if the queue
    /// does not have the request, `refused` if it never runs, `forgotten` if nobody knows.
    #[must_use]
    pub const fn word(self) -> &'static str {
        match self {
            Self::Known(state, _) => state.word(),
            Self::New => "unknown",
            Self::Never => "refused",
            Self::Forgotten | Self::NoSession => "forgotten",
        }
    }

    /// Returns the reason why the request was refused or has ended early, if there is one.
    #[must_use]
    pub fn reason(self) -> Option<RefusalReason> {
        match self {
            Self::Known(_, reason) => Some(reason).filter(|it| *it != RefusalReason::None),
            _ => None,
        }
    }

    /// Returns true if the answer does not change any more: the request has ended, or never runs.
    #[must_use]
    pub const fn is_final(self) -> bool {
        match self {
            Self::Known(state, _) => state.is_final(),
            Self::New => false,
            Self::Never | Self::Forgotten | Self::NoSession => true,
        }
    }
}

impl fmt::Display for QueueAnswer {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Known(state, RefusalReason::None) => return write!(f, "{state}"),
            Self::Known(state, reason) => return write!(f, "{state}: {reason}"),
            Self::New => "the queue does not have the request",
            Self::Forgotten => "the queue has forgotten what became of the request",
            Self::Never => "the request has not run, and never will",
            Self::NoSession => "there is no such session",
        })
    }
}

/// The reason why a queue cannot be restored.
#[derive(Debug, Error)]
pub enum RestoreError<E> {
    /// The bytes are not those of the queue's ledger.
    #[error("cannot use the ledger of motions: {0}")]
    Ledger(#[from] ImageError),
    /// The store of the ledger cannot be read or written.
    #[error("cannot read or write the ledger of motions: {0}")]
    Write(E),
}

/// A queue of motion requests of several clients, which runs no request twice. Up to `N` requests wait, from up to
/// `2 * N` sessions, and the outcomes of the last `4 * N` requests are remembered.
///
/// `P` is the type of the data that the program needs to run a request. The queue takes `N` times the size of `P` and
/// about 250 bytes of memory, and its ledger `192 * N + 32` bytes.
///
/// The argument `write` of the methods is a function that stores one row of the ledger: it gets the index and the bytes
/// of the row. After an error, store all [rows](Ledger::rows) anew; then the method can be called again.
#[derive(Clone, Debug)]
pub struct MotionQueue<P, const N: usize> {
    ledger: Ledger<N>,
    waiting: Deque<(RequestIdentity, P), N>,
    running: Option<RequestIdentity>,
    in_control: Option<u32>,
    /// The number of the last request of the program itself.
    own: u32,
}

impl<P, const N: usize> MotionQueue<P, N> {
    /// The number of rows of the queue's ledger, which the program must be able to store.
    pub const ROWS: usize = Ledger::<N>::ROWS;

    /// Makes the queue from the bytes of the ledger that an earlier run of the program stored, or from no bytes in the
    /// first run. No request waits, and no session is in control.
    ///
    /// The next session has at least the number `least`, as [`Ledger::read`] says. `write` stores all rows again, since
    /// requests that had not ended have changed.
    ///
    /// # Errors
    /// Returns [`RestoreError::Ledger`] if the bytes are not those of such a ledger, [`RestoreError::Write`]
    /// with the error of `write` if a row cannot be written.
    pub fn restore<E>(
        bytes: &[u8],
        least: u32,
        write: impl FnMut(usize, &LedgerRow) -> Result<(), E>,
    ) -> Result<Self, RestoreError<E>> {
        const { assert!(N > 0, "a queue has room for a request") };
        let ledger = Ledger::read(bytes, least)?;
        ledger.write_all(write).map_err(RestoreError::Write)?;
        Ok(Self {
            ledger,
            waiting: Deque::new(),
            running: None,
            in_control: None,
            // Servos tell motions apart by their numbers: those of the next incarnation are others.
            own: least,
        })
    }

    /// Returns the ledger: its rows and the sessions with their owners. After a failed write, all rows must be stored.
    #[must_use]
    pub const fn ledger(&self) -> &Ledger<N> {
        &self.ledger
    }

    /// Opens a session for `owner`, and returns its number.
    ///
    /// If there are too many sessions, one of them ends: a closed one, or else one of the same owner, or else any one;
    /// of several, the one that was used longest ago. A session that is in control, or whose requests have not ended,
    /// does not end. Returns `None` if no session can end, or if the numbers of sessions are
    /// [exhausted](Ledger::is_exhausted).
    ///
    /// # Errors
    /// Returns the error of `write` if a row cannot be written.
    pub fn open<E>(
        &mut self,
        owner: SessionOwner,
        write: impl FnMut(usize, &LedgerRow) -> Result<(), E>,
    ) -> Result<Option<u32>, E> {
        let in_control = self.in_control;
        self.ledger
            .open(owner, write, |session| in_control != Some(session))
    }

    /// Puts `session` in control, if no other session is in control or if `from_other` is true. Returns true if
    /// `session` is in control after the call; a session that is closed or does not exist cannot be. The program
    /// itself can always be, by [`OWN`].
    ///
    /// Requests that another session has enqueued stay; see [`abort`](Self::abort).
    pub fn take_control(&mut self, session: u32, from_other: bool) -> bool {
        let is_free = self.in_control.is_none_or(|it| it == session) || from_other;
        let is_open = self.ledger.has_session(session) && !self.ledger.is_closed(session);
        if is_free && (is_open || session == OWN) {
            self.in_control = Some(session);
        }
        self.in_control == Some(session)
    }

    /// Ends the control of `session`; nothing happens if it is not in control.
    pub fn give_up_control(&mut self, session: u32) {
        self.in_control = self.in_control.filter(|it| *it != session);
    }

    /// Binds the requests of a session to it, until the program ends: if the session is [closed](Self::close) while one
    /// of them waits or runs, all motion must end. Before that, [`Ledger::owners_of_bound_requests`]
    /// tells of which sessions that is so.
    pub fn bind(&mut self, session: u32) {
        self.ledger.bind(session);
    }

    /// Closes a session whose owner has ended: the session can offer no more requests, and is not in control any more.
    /// Its requests in the queue stay. Returns true if the session was in control.
    ///
    /// # Errors
    /// Returns the error of `write` if a row cannot be written; the session is not closed then.
    pub fn close<E>(
        &mut self,
        session: u32,
        write: impl FnMut(usize, &LedgerRow) -> Result<(), E>,
    ) -> Result<bool, E> {
        self.ledger.close(session, write)?;
        let was = self.in_control == Some(session);
        self.give_up_control(session);
        Ok(was)
    }

    /// Returns the session that is in control.
    #[must_use]
    pub fn in_control(&self) -> InControl {
        match self.in_control {
            None => InControl::Nobody,
            Some(OWN) => InControl::Program,
            Some(session) => InControl::Session(session),
        }
    }

    /// Returns the state of a request as far as the queue knows it, or why the queue does not know
    /// it.
    #[must_use]
    pub fn answer(&self, identity: RequestIdentity) -> QueueAnswer {
        if !self.ledger.has_session(identity.session) {
            return QueueAnswer::NoSession;
        }
        match self.ledger.state(identity) {
            Some((state, reason)) => QueueAnswer::Known(state, reason),
            None if identity.number <= self.ledger.forgotten(identity.session) => {
                QueueAnswer::Forgotten
            }
            None if identity.number <= self.ledger.answered(identity.session)
                || self.ledger.is_closed(identity.session) =>
            {
                QueueAnswer::Never
            }
            None => QueueAnswer::New,
        }
    }

    /// Returns the number of requests that come before this one, including one that runs; `None` if this one does not
    /// wait in the queue.
    #[must_use]
    pub fn before(&self, identity: RequestIdentity) -> Option<usize> {
        let mut waiting = self.waiting.iter();
        let place = waiting.position(|(it, _)| *it == identity)?;
        Some(place + usize::from(self.running.is_some()))
    }

    /// Accepts or refuses a new request, and returns the answer for the client. A request that the queue knows already
    /// is not changed; its present state is returned.
    ///
    /// `make` makes the data of the request, or returns the reason to refuse it. It is called only if the session is in
    /// control and the queue has room.
    ///
    /// # Errors
    /// Returns the error of `write` if a row cannot be written; the queue does not have the request then.
    pub fn offer<E>(
        &mut self,
        identity: RequestIdentity,
        mut write: impl FnMut(usize, &LedgerRow) -> Result<(), E>,
        make: impl FnOnce() -> Result<P, RefusalReason>,
    ) -> Result<QueueAnswer, E> {
        match self.answer(identity) {
            QueueAnswer::New => {}
            known => return Ok(known),
        }
        let accepted = if self.in_control != Some(identity.session) {
            Err(RefusalReason::NotInControl)
        } else if self.waiting.is_full() {
            Err(RefusalReason::Full)
        } else {
            make()
        };
        let (state, reason, work) = match accepted {
            Ok(work) => (RequestState::Accepted, RefusalReason::None, Some(work)),
            Err(reason) => (RequestState::Refused, reason, None),
        };
        self.record(identity, state, reason, &mut write)?;
        if let Some(work) = work {
            // The deque is not full: `make` was called only if it had room.
            let _ = self.waiting.push_back((identity, work));
        }
        Ok(self.answer(identity))
    }

    /// Refuses a request that its client has withdrawn, if the queue does not have it yet: it never runs, even if it
    /// comes later. Otherwise nothing changes. Returns the answer for the client.
    ///
    /// # Errors
    /// Returns the error of `write` if a row cannot be written; the request can still come then.
    pub fn withdraw<E>(
        &mut self,
        identity: RequestIdentity,
        write: impl FnMut(usize, &LedgerRow) -> Result<(), E>,
    ) -> Result<QueueAnswer, E> {
        if self.answer(identity) == QueueAnswer::New {
            let (state, reason) = (RequestState::Refused, RefusalReason::Withdrawn);
            self.record(identity, state, reason, write)?;
        }
        Ok(self.answer(identity))
    }

    /// Enqueues a request of the program itself, with this data. It is not in the ledger.
    ///
    /// # Errors
    /// Returns [`RefusalReason::NotInControl`] if the program is not in control, [`RefusalReason::Full`] if the queue has
    /// no room.
    pub fn enqueue(&mut self, work: P) -> Result<(), RefusalReason> {
        if self.in_control != Some(OWN) {
            return Err(RefusalReason::NotInControl);
        }
        self.own = self.own.wrapping_add(1);
        let identity = RequestIdentity {
            session: OWN,
            number: self.own,
        };
        (self.waiting.push_back((identity, work))).map_err(|_| RefusalReason::Full)
    }

    /// Records the state of a request in the ledger, unless it is one of the program itself.
    fn record<E>(
        &mut self,
        identity: RequestIdentity,
        state: RequestState,
        reason: RefusalReason,
        write: impl FnMut(usize, &LedgerRow) -> Result<(), E>,
    ) -> Result<(), E> {
        if identity.session == OWN {
            return Ok(());
        }
        // The ledger has a place: of 4 * N requests at most N + 1 have not ended.
        self.ledger.set(identity, state, reason, write).map(drop)
    }

    /// Returns the identity and the data of the request whose turn it is; `None` if no request
    /// waits, or if one runs.
    #[must_use]
    pub fn next(&self) -> Option<(RequestIdentity, &P)> {
        let next = self.waiting.front().filter(|_| self.running.is_none());
        next.map(|(identity, work)| (*identity, work))
    }

    /// Refuses the first request that waits, for `reason`, and removes it from the queue. It is for
    /// a request that turns out to be impossible when its turn comes.
    ///
    /// # Errors
    /// Returns the error of `write` if a row cannot be written; the request waits then.
    pub fn refuse_next<E>(
        &mut self,
        reason: RefusalReason,
        write: impl FnMut(usize, &LedgerRow) -> Result<(), E>,
    ) -> Result<(), E> {
        if let Some(&(identity, _)) = self.waiting.front() {
            self.record(identity, RequestState::Refused, reason, write)?;
            self.waiting.pop_front();
        }
        Ok(())
    }

    /// Removes the first request from the queue and records that it runs. The caller must then run it, and call
    /// [`end`](Self::end) afterwards. Returns `None` if no request waits, or if one runs already.
    ///
    /// # Errors
    /// Returns the error of `write` if a row cannot be written; the request must not run then, and waits.
    pub fn start<E>(
        &mut self,
        write: impl FnMut(usize, &LedgerRow) -> Result<(), E>,
    ) -> Result<Option<(RequestIdentity, P)>, E> {
        let Some(&(identity, _)) = self.waiting.front().filter(|_| self.running.is_none()) else {
            return Ok(None);
        };
        self.record(identity, RequestState::Started, RefusalReason::None, write)?;
        self.running = Some(identity);
        Ok(self.waiting.pop_front())
    }

    /// Returns the identity of the request that runs; `None` if none runs.
    #[must_use]
    pub fn running(&self) -> Option<RequestIdentity> {
        self.running
    }

    /// Iterates over the data of the requests that wait, in the order in which they will run.
    pub fn works(&self) -> impl Iterator<Item = &P> + '_ {
        self.waiting.iter().map(|(_, work)| work)
    }

    /// Returns the number of requests that wait, without the one that runs.
    #[must_use]
    pub fn waiting(&self) -> usize {
        self.waiting.len()
    }

    /// Records that the running request has ended, with its final `state` and the `reason` for it.
    /// Nothing happens if no request runs.
    ///
    /// # Errors
    /// Returns the error of `write` if a row cannot be written; the request has not ended then.
    pub fn end<E>(
        &mut self,
        state: RequestState,
        reason: RefusalReason,
        write: impl FnMut(usize, &LedgerRow) -> Result<(), E>,
    ) -> Result<(), E> {
        if let Some(identity) = self.running {
            self.record(identity, state, reason, write)?;
            self.running = None;
        }
        Ok(())
    }

    /// Aborts all requests that wait, for `reason`, in their order. A request that runs is not changed.
    ///
    /// # Errors
    /// Returns the error of `write` if a row cannot be written; the requests that are left wait then.
    pub fn abort<E>(
        &mut self,
        reason: RefusalReason,
        mut write: impl FnMut(usize, &LedgerRow) -> Result<(), E>,
    ) -> Result<(), E> {
        while let Some(&(identity, _)) = self.waiting.front() {
            self.record(identity, RequestState::Aborted, reason, &mut write)?;
            self.waiting.pop_front();
        }
        Ok(())
    }
}

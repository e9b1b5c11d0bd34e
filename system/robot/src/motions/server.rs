use core::time::Duration;

use condor_mbox::Instant;

use super::Offer;
use super::post::{Abort, MotionsPost, MotionsState};
use crate::queue::{
    InControl, LedgerRow, MotionQueue, RefusalReason, RequestIdentity, RequestState, RestoreError,
    SessionOwner,
};

/// A ledger that cannot be read or written is tried again after this time.
const AGAIN: Duration = Duration::from_millis(500);

/// Storage for the rows of a [`Ledger`](crate::queue::Ledger), which a controller implements: a file, or memory that
/// outlives the program.
///
/// # For implementers
/// Rows that were written or replaced must be in the store however the program ends. Rows are written whole or
/// not at all. The controller waits for each call, so no call may take long.
pub trait LedgerStore {
    /// The reason why rows cannot be read or written.
    type Error;

    /// Calls `restore` with the bytes of all rows of the former incarnation, or with no bytes if there are
    /// none. The second argument is the least number of the next session, as for [`MotionQueue::restore`]: the
    /// time in seconds, if there is a clock.
    ///
    /// # Errors
    /// Returns the store's error if the rows cannot be read; the server tries again later.
    fn read<T>(&mut self, restore: impl FnOnce(&[u8], u32) -> T) -> Result<T, Self::Error>;

    /// Replaces all rows in the store with `rows`. If the program ends meanwhile, the store has either the
    /// former rows or the new ones.
    ///
    /// # Errors
    /// Returns the store's error if the rows cannot be replaced; the server tries again later.
    fn replace(&mut self, rows: impl Iterator<Item = LedgerRow>) -> Result<(), Self::Error>;

    /// Writes the row with this index.
    ///
    /// # Errors
    /// Returns the store's error if the row cannot be written; the server then replaces all rows. The row may
    /// be in the store or not, but it must not appear there after the replacement.
    fn write(&mut self, row: usize, bytes: &LedgerRow) -> Result<(), Self::Error>;
}

/// An event of the motion queue that [`MotionsServer::attend`] returns, to act on or to announce to
/// people.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum MotionsEvent {
    /// A client has ended all motion, or is gone and its motions are bound to it: stop the robot, then call
    /// [`MotionsServer::abort`].
    Aborted,
    /// A client has taken control with this session.
    Taken(u32),
    /// The client of this session is gone, and no session is in control.
    Gone(u32),
}

/// The relation of the stored rows to the queue.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Condition {
    /// The rows of the former incarnation have not been read.
    Unread,
    /// The rows must be replaced by those of the queue in memory.
    Missing,
    /// The rows agree with the queue in memory.
    Whole,
}

/// The part of a motion queue that runs in the background of a controller: it decides about requests, and writes the
/// ledger.
///
/// After an error of the store, [`attend`](Self::attend) replaces all rows of the ledger, and repeats that until it
/// succeeds. Until then no request begins, nothing is decided, and clients that want something new are told to ask
/// again.
#[derive(Debug)]
pub struct MotionsServer<'p, P, L, const N: usize> {
    post: &'p MotionsPost<P, N>,
    store: L,
    condition: Condition,
    /// The time at which a store that could not be read or written is tried again.
    again: Option<Instant>,
    /// True if the controller has been told of the failure.
    has_complained: bool,
    /// The state and the reason with which the running request has ended, if they could not be written.
    ending: Option<(RequestState, RefusalReason)>,
    /// The reason to abort all requests, if that could not be written.
    aborting: Option<RefusalReason>,
}

impl<'p, P, L: LedgerStore, const N: usize> MotionsServer<'p, P, L, N> {
    /// Makes the server that works on the queue in `post`, with the ledger in `store`. The first
    /// call of [`attend`](Self::attend) reads the ledger.
    pub const fn new(post: &'p MotionsPost<P, N>, store: L) -> Self {
        Self {
            post,
            store,
            condition: Condition::Unread,
            again: None,
            has_complained: false,
            ending: None,
            aborting: None,
        }
    }

    /// Handles the requests that have come by message: opens sessions, and accepts, refuses or withdraws requests.
    /// Closes the sessions of clients that are gone. Call it periodically. Returns the next event that the controller
    /// must act on or announce; `None` if there is none.
    ///
    /// * `now`: the present time, with which failed writes of the ledger are tried again.
    /// * `incarnation` returns the present [incarnation](SessionOwner::incarnation) of a processor, or `None` if the
    ///   processor is not up.
    /// * `make` makes the data of a request from an offer, or returns the reason to refuse the offer.
    ///
    /// # Errors
    /// Returns [`RestoreError::Ledger`] if the bytes in the store are not those of the ledger,
    /// [`RestoreError::Write`] if the store cannot be read or written. Until it can, no other call returns an
    /// error.
    pub fn attend(
        &mut self,
        now: Instant,
        incarnation: impl Fn(u32) -> Option<u32>,
        make: impl FnOnce(Offer) -> Result<P, RefusalReason>,
    ) -> Result<Option<MotionsEvent>, RestoreError<L::Error>> {
        // Motion ends whether the ledger can be written or not.
        let ends_motion = self.look(|queue| {
            let mut owners = queue.ledger().owners_of_bound_requests();
            owners.any(|owner| incarnation(owner.processor) != Some(owner.incarnation))
        });
        if ends_motion == Some(true) {
            self.post.with(|desk| desk.abort = Abort::Asked);
        }
        self.mend(now)?;
        if self.aborting.is_none() && self.post.with(|desk| desk.abort) == Some(Abort::Asked) {
            return Ok(Some(MotionsEvent::Aborted));
        }
        let gone = if self.condition == Condition::Whole {
            // The ends of requests are written before anything new is decided.
            self.finish().map_err(RestoreError::Write)?;
            self.decide(&incarnation, make)
                .map_err(RestoreError::Write)?;
            self.close_gone(&incarnation).map_err(RestoreError::Write)?
        } else {
            None
        };
        let taken = || {
            let taken = self.post.with(|desk| {
                let taken = desk.taken_by.take();
                taken.filter(|&session| {
                    let queue = desk.queue.as_ref();
                    queue.is_some_and(|it| it.in_control() == InControl::Session(session))
                })
            });
            taken.flatten().map(MotionsEvent::Taken)
        };
        Ok(gone.map(MotionsEvent::Gone).or_else(taken))
    }

    /// Opens a session, and decides about an offer.
    fn decide(
        &mut self,
        incarnation: &impl Fn(u32) -> Option<u32>,
        make: impl FnOnce(Offer) -> Result<P, RefusalReason>,
    ) -> Result<(), L::Error> {
        let asks = self.post.with(MotionsState::next_to_open).flatten();
        if let Some(asks) = asks
            && let Some(incarnation) = incarnation(asks.0.into())
        {
            let owner = SessionOwner {
                processor: asks.0.into(),
                incarnation,
            };
            let opened = self.change(|queue, write| queue.open(owner, write))?;
            self.post.with(|desk| desk.open(asks, opened.flatten()));
        }
        // The offer stays in the inbox until the queue has it, so that it never counts as new in between.
        let offered = self.post.with(|desk| desk.inbox.front().cloned());
        if let Some(offered) = offered.flatten() {
            let (sender, identity, ref offer) = offered;
            let (post, incarnation) = (self.post, incarnation(sender.processor));
            let is_there = |desk: &MotionsState<P, N>| desk.inbox.front() == Some(&offered);
            let decided = self.change(|queue, write| {
                if post.with(|desk| is_there(desk)) != Some(true) {
                    // An abort has come meanwhile.
                    return Ok(());
                }
                let is_of_sender = queue.ledger().owner(identity.session) == Some(sender);
                // An offer of an incarnation that has ended since then is dropped.
                if !is_of_sender || incarnation != Some(sender.incarnation) {
                    return Ok(());
                }
                match offer {
                    None => queue.withdraw(identity, write).map(drop),
                    Some(offer) => queue
                        .offer(identity, write, || make(offer.clone()))
                        .map(drop),
                }
            })?;
            if decided.is_some() {
                self.post.with(|desk| {
                    if is_there(desk) {
                        desk.inbox.pop_front();
                    }
                });
            }
        }
        Ok(())
    }

    /// Closes the session of a client whose incarnation has ended, if there is one. Returns it if it was in
    /// control.
    fn close_gone(
        &mut self,
        incarnation: &impl Fn(u32) -> Option<u32>,
    ) -> Result<Option<u32>, L::Error> {
        let gone = self.look(|queue| {
            let mut sessions = queue
                .ledger()
                .sessions()
                .filter(|it| !queue.ledger().is_closed(it.0));
            sessions.find(|(_, owner)| incarnation(owner.processor) != Some(owner.incarnation))
        });
        let Some((session, _)) = gone.flatten() else {
            return Ok(None);
        };
        let was_in_control = self.change(|queue, write| queue.close(session, write))?;
        Ok((was_in_control == Some(true)).then_some(session))
    }

    /// Reads or replaces the rows if necessary; returns an error only the first time that this fails.
    fn mend(&mut self, now: Instant) -> Result<(), RestoreError<L::Error>> {
        let mended = self.try_to_mend(now);
        let has_complained = self.has_complained;
        self.has_complained =
            self.condition != Condition::Whole && (has_complained || mended.is_err());
        if has_complained { Ok(()) } else { mended }
    }

    fn try_to_mend(&mut self, now: Instant) -> Result<(), RestoreError<L::Error>> {
        if self.condition == Condition::Whole {
            return Ok(());
        }
        if self.again.is_some_and(|again| again.ns_since(now) > 0) {
            return Ok(());
        }
        self.again = Some(now.after(AGAIN));
        let queue = if self.condition == Condition::Unread {
            let restore = |bytes: &[u8], least| {
                // All rows are written below.
                MotionQueue::restore(bytes, least, |_, _| Ok(()))
            };
            self.store.read(restore).map_err(RestoreError::Write)??
        } else if let Some(queue) = self.post.with(|desk| desk.queue.take()).flatten() {
            queue
        } else {
            return Ok(());
        };
        let replaced = self.store.replace(queue.ledger().rows());
        if replaced.is_ok() {
            self.condition = Condition::Whole;
        }
        if self.condition != Condition::Unread {
            self.post.with(|desk| desk.queue = Some(queue));
        }
        replaced.map_err(RestoreError::Write)
    }

    /// Calls `work` with the queue, to read it, and returns the result. Returns `None`, without a
    /// call, if the ledger has not been read yet.
    pub fn look<T>(&self, work: impl FnOnce(&MotionQueue<P, N>) -> T) -> Option<T> {
        self.post
            .with(|desk| desk.queue.as_ref().map(work))
            .flatten()
    }

    /// Calls `work` with the queue, to change it, and with the function that writes a row of the ledger, for the
    /// methods of [`MotionQueue`]. Meanwhile clients are told to ask again. The controller can enqueue its own requests
    /// in this way, too.
    ///
    /// Returns the result of `work`, or `None`, without a call, while the ledger cannot be read or written.
    ///
    /// # Errors
    /// Returns the error of `work` if it fails; the ledger counts as not written then, and
    /// [`attend`](Self::attend) replaces it.
    pub fn change<T>(
        &mut self,
        work: impl FnOnce(
            &mut MotionQueue<P, N>,
            &mut dyn FnMut(usize, &LedgerRow) -> Result<(), L::Error>,
        ) -> Result<T, L::Error>,
    ) -> Result<Option<T>, L::Error> {
        if self.condition != Condition::Whole {
            return Ok(None);
        }
        let Some(mut queue) = self.post.with(|desk| desk.queue.take()).flatten() else {
            return Ok(None);
        };
        let store = &mut self.store;
        let outcome = work(&mut queue, &mut |row, bytes| store.write(row, bytes));
        self.post.with(|desk| desk.queue = Some(queue));
        if outcome.is_err() {
            self.condition = Condition::Missing;
            self.has_complained = true;
        }
        outcome.map(Some)
    }

    /// Returns the identity and the data of the request whose turn it is. Returns `None` if no request waits, if one
    /// runs, or if a client has ended all motion.
    ///
    /// Then call [`begin`](Self::begin) or [`refuse`](Self::refuse); until then the request waits.
    #[must_use]
    pub fn next_request(&self) -> Option<(RequestIdentity, P)>
    where
        P: Clone,
    {
        let next = self.post.with(|desk| {
            let queue = desk.queue.as_ref().filter(|_| desk.abort != Abort::Asked);
            let (identity, work) = queue?.next()?;
            Some((identity, work.clone()))
        });
        next.flatten()
    }

    /// Refuses the next request for `reason`, because it cannot run, and removes it from the queue.
    ///
    /// # Errors
    /// Returns the store's error if the ledger cannot be written; the request waits then.
    pub fn refuse(&mut self, reason: RefusalReason) -> Result<(), L::Error> {
        self.change(|queue, write| queue.refuse_next(reason, write))
            .map(drop)
    }

    /// Begins the next request: records in the ledger that it runs. The caller must move the robot only if this returns
    /// true.
    ///
    /// Returns false if a client has ended all motion meanwhile, if no request can begin, or while the ledger cannot be
    /// written.
    ///
    /// # Errors
    /// Returns the store's error if the ledger cannot be written; the request must not run then, and waits.
    pub fn begin(&mut self) -> Result<bool, L::Error> {
        self.tell_progress(None);
        let post = self.post;
        let begun = self.change(|queue, write| {
            let abort = post.with(|desk| {
                desk.abort = desk.abort.over();
                desk.abort
            });
            // No abort is accepted while this works on the queue.
            if abort != Some(Abort::No) {
                return Ok(false);
            }
            queue.start(write).map(|it| it.is_some())
        })?;
        Ok(begun == Some(true))
    }

    /// Sets the part of the running request that is done, 0 to 1, which clients can read; `None` if the controller does
    /// not know it.
    pub fn tell_progress(&self, done: Option<f64>) {
        let done = done.filter(|done| done.is_finite());
        let progress = done.map(|done| done.clamp(0.0, 1.0));
        self.post.with(|desk| desk.progress = progress);
    }

    /// Ends the request that runs, with its final `state` and the `reason` for that state.
    ///
    /// # Errors
    /// Returns the store's error if the ledger cannot be written; [`attend`](Self::attend) tries it again.
    pub fn end(&mut self, state: RequestState, reason: RefusalReason) -> Result<(), L::Error> {
        let ended = self.change(|queue, write| queue.end(state, reason, write));
        self.ending = match &ended {
            Ok(Some(())) => None,
            _ => Some((state, reason)),
        };
        ended.map(drop)
    }

    /// Aborts the request that runs and all requests that wait, for `reason`. Call it after the robot has stopped.
    ///
    /// # Errors
    /// Returns the store's error if the ledger cannot be written; [`attend`](Self::attend) tries it again.
    pub fn abort(&mut self, reason: RefusalReason) -> Result<(), L::Error> {
        self.aborting = Some(reason);
        self.post.with(|desk| desk.inbox.clear());
        self.finish()
    }

    /// Writes the ends of requests that could not be written before. A request that has ended by itself keeps
    /// its end when all are aborted.
    fn finish(&mut self) -> Result<(), L::Error> {
        let aborted = self.aborting.map(|reason| (RequestState::Aborted, reason));
        if let Some((state, reason)) = self.ending.or(aborted) {
            self.end(state, reason)?;
        }
        if let Some(reason) = self.aborting {
            let aborted = self.change(|queue, write| queue.abort(reason, write))?;
            if aborted.is_some() {
                self.aborting = None;
                self.post.with(|desk| desk.abort = desk.abort.done());
            }
        }
        Ok(())
    }
}

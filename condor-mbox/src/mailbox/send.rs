//! Sending, with and without reply.

use core::time::Duration;

use super::call::{Message, Messenger, Pending, Ticket};
use super::wait::{End, Limit, Watch};
use super::{Mailbox, Peer};
use crate::doorbell::Doorbell;
use crate::error::{Error, Progress, ProtocolWord};
use crate::exclusion::Exclusion;
use crate::id::{Processor, Vector};
use crate::layout::{self, SLOTS, header};
use crate::mail::{Entry, Mail};
use crate::sync::{Ordering, fence};
use crate::time::Instant;
use crate::window::{LoadOrder, MemoryWindow};

/// What a request asks for; the low byte of a slot's kind word is the vector, the third the cell.
pub(super) mod kind {
    /// Run the handler.
    pub(in super::super) const SEND: u32 = 1 << 8;
    /// Run the handler and reply.
    pub(in super::super) const CALL: u32 = 2 << 8;
    /// Let the sender listen to our vectors.
    pub(in super::super) const LISTEN: u32 = 3 << 8;
    /// No longer let it.
    pub(in super::super) const IGNORE: u32 = 4 << 8;
    /// Where the number of the reply cell stands.
    pub(in super::super) const CELL_SHIFT: u32 = 16;

    /// Whether a request is for a handler; the others are the mailboxes' own affair.
    pub(in super::super) const fn is_message(kind: u32) -> bool {
        matches!(kind & 0xff00, SEND | CALL)
    }
}

/// How a request ended, in the kind word of its reply cell.
pub(super) mod status {
    /// The handler's result is the value.
    pub(in super::super) const DONE: u32 = 1;
    /// There is no handler for the vector.
    pub(in super::super) const NO_HANDLER: u32 = 2;
    /// The handler did not return.
    pub(in super::super) const HANDLER_FAILED: u32 = 3;
}

/// Why a request cannot enter the ring now.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Refusal {
    /// The two ends have not acknowledged each other.
    NotConnected,
    /// The receiver has not taken enough requests, or too many calls are unanswered.
    NoSlot,
    /// Only listeners have not taken enough requests.
    Listeners,
}

impl<W: MemoryWindow, D: Doorbell, X: Exclusion, const N: usize> Mailbox<'_, W, D, X, N> {
    /// Sends `data` to `vector` of `to`, which may be this processor, and does not wait for its
    /// handler (memo, section 3.3.1).
    ///
    /// Waits for a free slot, or for the receiver to join, for at most `timeout`, serving
    /// meanwhile. Messages to one receiver are taken there in the order in which they were sent. A
    /// receiver that serves from an interrupt, too, may be interrupted between taking a message and
    /// the first instruction of its handler, and then runs the next one first.
    ///
    /// # Errors
    /// [`Error::NoSuchProcessor`], [`Error::NoSuchVector`], [`Error::NotJoined`]; after `timeout`
    /// [`Error::NoSlot`], [`Error::NotConnected`] or [`Error::Stalled`]; [`Error::PeerDied`] as
    /// soon as it is known; [`Error::Layout`], [`Error::Protocol`], [`Error::Window`]. After an
    /// error the message was not sent.
    pub fn send(
        &self,
        to: Processor,
        vector: Vector,
        data: u32,
        timeout: Duration,
    ) -> Result<(), Error> {
        self.send_before(Message { to, vector, data }, timeout, Instant::FOREVER)
    }

    /// Sends like [`send`](Self::send), but never waits and never serves: for servo loops.
    ///
    /// # Errors
    /// As [`send`](Self::send), at once.
    pub fn try_send(&self, to: Processor, vector: Vector, data: u32) -> Result<(), Error> {
        self.post(Message { to, vector, data })
    }

    /// Sends `data` to `vector` of `to` and waits for what its handler returns.
    ///
    /// Serves incoming requests meanwhile, on the same stack, so that two processors may call
    /// each other. After `timeout` the request may still run once, if it was sent; its reply is
    /// dropped.
    ///
    /// # Errors
    /// As [`send`](Self::send), and [`Error::TimedOut`] or [`Error::Stalled`] after `timeout`,
    /// [`Error::NoHandler`], [`Error::HandlerFailed`]; [`Error::PeerDied`], [`Error::PeerLeft`]
    /// and [`Error::PeerRestarted`] as soon as they are known.
    pub fn send_with_reply(
        &self,
        to: Processor,
        vector: Vector,
        data: u32,
        timeout: Duration,
    ) -> Result<u32, Error> {
        self.send_with_reply_before(Message { to, vector, data }, timeout, Instant::FOREVER)
    }

    /// Sends `data` to `vector` of `to` and gives a ticket to poll for the reply: for servo
    /// loops. Never waits and never serves.
    ///
    /// # Errors
    /// As [`try_send`](Self::try_send).
    pub fn begin(
        &self,
        to: Processor,
        vector: Vector,
        data: u32,
    ) -> Result<Ticket<'_, Self>, Error> {
        Ticket::begin(self, Message { to, vector, data })
    }

    /// Waits for the reply to a request that has been sent.
    #[inline(always)]
    fn wait_for_reply(&self, pending: &Pending, limit: Limit) -> Result<u32, Error> {
        let Pending { to, life, .. } = *pending;
        let peer = self.peer(to)?;
        let watch = (to != self.me).then_some(Watch { peer: to, life });
        match self.wait(limit, watch, |_| self.reply(&peer, pending)) {
            Ok(End::Came(value)) => Ok(value),
            end => Err(self.no_reply(&peer, pending, &end)),
        }
    }

    /// Why there is no reply.
    #[cold]
    fn no_reply(
        &self,
        peer: &Peer<'_, W, N>,
        pending: &Pending,
        end: &Result<End<u32>, Error>,
    ) -> Error {
        let Pending { to, vector, .. } = *pending;
        self.count_failure(kind::CALL, vector);
        let progress = self.progress(peer, pending);
        match end {
            // The reply came, and says that there is no value; or memory is gone.
            Err(error) => *error,
            Ok(End::Expired { stalled: true }) => Error::Stalled {
                to,
                vector,
                progress,
            },
            Ok(End::Expired { .. } | End::Came(_)) => Error::TimedOut {
                to,
                vector,
                progress,
            },
            Ok(End::Died) => Error::PeerDied { to, progress },
            Ok(End::Left) => Error::PeerLeft { to, progress },
            Ok(End::Restarted) => Error::PeerRestarted { to, progress },
        }
    }

    /// The reply to `pending`, if it has come; frees its cell.
    #[inline(always)]
    fn reply(&self, peer: &Peer<'_, W, N>, pending: &Pending) -> Result<Option<u32>, Error> {
        let at = Mail::<W, N>::cell(self.me, pending.cell);
        if peer.mail.carries(at, pending.sequence)? {
            self.take_reply(peer, pending, at)
        } else {
            Ok(None)
        }
    }

    /// Reads the reply to `pending`, whose sequence has been seen, from the cell at `at`.
    fn take_reply(
        &self,
        peer: &Peer<'_, W, N>,
        pending: &Pending,
        at: u32,
    ) -> Result<Option<u32>, Error> {
        let reply = match peer.mail.get(at, pending.sequence)? {
            Some(reply) if reply.epoch == pending.epoch => reply,
            _ => return Ok(None),
        };
        self.exclusion.with(|| {
            // Requests are taken in order: this one and all before it have been.
            if peer.pair.epoch_out.get() == pending.epoch {
                peer.pair.advance(pending.sequence);
            }
            peer.pair.release(pending.cell, pending.epoch);
        });
        match reply.kind {
            status::DONE => Ok(Some(reply.value)),
            status => Err(without_value(pending, status)),
        }
    }

    /// Publishes a request, waiting for a slot, and says how long its sender may wait then.
    #[inline(always)]
    fn publish_by(
        &self,
        peer: &Peer<'_, W, N>,
        kind: u32,
        data: u32,
        limit: Limit,
    ) -> Result<(Pending, Limit), Error> {
        let vector = self.check(kind)?;
        // Mostly there is a slot, and the clock need not be read.
        match self.publish(peer, kind, data, false)? {
            Ok(pending) => Ok((pending, limit)),
            Err(refusal) => self.publish_late(peer, vector, kind, data, limit, refusal),
        }
    }

    /// Does so after the first `refusal`.
    #[cold]
    fn publish_late(
        &self,
        peer: &Peer<'_, W, N>,
        vector: Vector,
        kind: u32,
        data: u32,
        mut limit: Limit,
        mut refusal: Refusal,
    ) -> Result<(Pending, Limit), Error> {
        let begun = self.doorbell.now();
        limit.enclosing = begun.after(limit.timeout).min(limit.enclosing);
        // Listeners are waited for half of the time: whoever falls behind, on purpose or not,
        // must not keep a call from its reply.
        let patience = Duration::from_nanos(limit.enclosing.ns_since(begun) / 2);
        let leave_behind_at = begun.after(patience);
        if refusal == Refusal::Listeners {
            self.leave_dead_behind(peer)?;
        }
        let watch = (peer.number != self.me).then_some(Watch {
            peer: peer.number,
            life: 0,
        });
        let end = self.wait(limit, watch, |_| {
            let leave_behind =
                refusal == Refusal::Listeners && self.doorbell.now() >= leave_behind_at;
            match self.publish(peer, kind, data, leave_behind)? {
                Ok(pending) => Ok(Some(pending)),
                Err(reason) => {
                    refusal = reason;
                    Ok(None)
                }
            }
        });
        let to = peer.number;
        let progress = Progress::NotSent;
        let error = match end {
            Ok(End::Came(pending)) => return Ok((pending, limit)),
            // Listeners are waited for once; from here on those that are behind are left behind.
            Ok(_) if refusal == Refusal::Listeners => {
                match self.publish(peer, kind, data, true)? {
                    Ok(pending) => return Ok((pending, limit)),
                    Err(refusal) => refusal.error(to),
                }
            }
            Ok(End::Expired { stalled: true }) if peer.has_joined()? => Error::Stalled {
                to,
                vector,
                progress,
            },
            Ok(End::Died) => Error::PeerDied { to, progress },
            Ok(_) => refusal.error(to),
            Err(error) => error,
        };
        self.count_failure(kind, vector);
        Err(error)
    }

    fn check(&self, kind: u32) -> Result<Vector, Error> {
        let vector = Vector(kind.to_le_bytes()[0]);
        if vector.index() >= Vector::COUNT {
            return Err(Error::NoSuchVector { vector });
        }
        if self.life.get() == 0 {
            return Err(Error::NotJoined { number: self.me });
        }
        Ok(vector)
    }

    /// Puts a request into the ring, if it can enter, and rings the receiver if it wants that.
    ///
    /// Listeners that are behind are waited for, unless `leave_behind`.
    fn publish(
        &self,
        peer: &Peer<'_, W, N>,
        kind: u32,
        data: u32,
        leave_behind: bool,
    ) -> Result<Result<Pending, Refusal>, Error> {
        self.notice(peer)?;
        let published = self
            .exclusion
            .with(|| self.publish_alone(peer, kind, data, leave_behind))?;
        if let Ok((_, listeners)) = published {
            // It has been sent, and a receiver whose memory is gone cannot be waiting.
            let _ = self.wake(peer);
            if listeners != 0 {
                self.wake_listeners(listeners);
            }
        }
        Ok(published.map(|(pending, _)| pending))
    }

    /// Reserving the slot and publishing it are one section: no context of this processor can
    /// publish a later request before an earlier one.
    #[inline(always)]
    fn publish_alone(
        &self,
        peer: &Peer<'_, W, N>,
        kind: u32,
        data: u32,
        leave_behind: bool,
    ) -> Result<Result<(Pending, u32), Refusal>, Error> {
        let pair = peer.pair;
        // A receiver that began another life since `notice` ignores the old epoch.
        let life = pair.life.get();
        if !self.is_connected(peer)? {
            return Ok(Err(Refusal::NotConnected));
        }
        pair.connected.set(1);
        let sequence = pair.head.get().wrapping_add(1);
        if sequence.wrapping_sub(pair.taken.get()) > SLOTS
            && let Some(refusal) = self.refresh_taken(peer, sequence)?
        {
            return Ok(Err(refusal));
        }
        let listeners = peer.mail.load(header::LISTENERS, LoadOrder::Relaxed)?;
        if listeners != 0 && !self.listeners_keep_up(peer, listeners, sequence, leave_behind) {
            return Ok(Err(Refusal::Listeners));
        }
        let own = self.own()?;
        let mut tag = 0;
        let mut cell = 0;
        if kind & !0xff == kind::CALL {
            let Some(free) = self.reserve_cell(peer)? else {
                return Ok(Err(Refusal::NoSlot));
            };
            cell = free;
            tag = cell << kind::CELL_SHIFT;
            pair.busy.set(pair.busy.get() | 1 << cell);
            if let Some(owner) = pair.owner.get(cell as usize) {
                owner.set(sequence);
            }
        }
        let epoch = pair.epoch_out.get();
        let entry = Entry {
            value: data,
            epoch,
            kind: kind | tag,
        };
        own.put(Mail::<W, N>::slot(peer.number, sequence), sequence, entry)?;
        pair.head.set(sequence);
        let vector = Vector(kind.to_le_bytes()[0]);
        if kind::is_message(kind) {
            own.add(
                Mail::<W, N>::vector(vector.index()) + layout::vector::SENT,
                1,
            )?;
        }
        Ok(Ok((
            Pending {
                to: peer.number,
                vector,
                cell,
                sequence,
                epoch,
                life,
            },
            listeners,
        )))
    }

    /// Reads how many requests the receiver has taken; why `sequence` has no slot, if it has none.
    #[inline(never)]
    fn refresh_taken(
        &self,
        peer: &Peer<'_, W, N>,
        sequence: u32,
    ) -> Result<Option<Refusal>, Error> {
        // Acquire: pairs with the Release store in `take_alone`; the slot that is overwritten has
        // been read before.
        let count = peer
            .mail
            .load(Mail::<W, N>::taken(self.me), LoadOrder::Acquire)?;
        let untaken = sequence.wrapping_sub(count);
        if untaken == 0 || untaken > SLOTS + 1 {
            // Between `notice` and here the receiver may have begun another life, and its count
            // anew. Ordered by the Acquire load above, which pairs with the fence in `join`.
            if peer.mail.load(header::LIFE, LoadOrder::Relaxed)? != peer.pair.life.get() {
                return Ok(Some(Refusal::NotConnected));
            }
            return Err(Error::Protocol {
                peer: peer.number,
                word: ProtocolWord::Taken,
                found: count,
            });
        }
        peer.pair.taken.set(count);
        Ok((untaken > SLOTS).then_some(Refusal::NoSlot))
    }

    /// A reply cell that no call owns, or whose late reply has come.
    #[inline(always)]
    fn reserve_cell(&self, peer: &Peer<'_, W, N>) -> Result<Option<u32>, Error> {
        let free = peer.pair.busy.get().trailing_ones();
        if free < SLOTS {
            Ok(Some(free))
        } else {
            self.reclaim_cell(peer)
        }
    }

    /// A reply cell whose late reply has come.
    #[cold]
    fn reclaim_cell(&self, peer: &Peer<'_, W, N>) -> Result<Option<u32>, Error> {
        let pair = peer.pair;
        for (cell, owner) in (0..SLOTS).zip(&pair.owner) {
            let late = Mail::<W, N>::cell(self.me, cell);
            if pair.abandoned.get() & 1 << cell != 0
                && peer
                    .mail
                    .get(late, owner.get())?
                    .is_some_and(|e| e.epoch == pair.epoch_out.get())
            {
                pair.release(cell, pair.epoch_out.get());
                return Ok(Some(cell));
            }
        }
        Ok(None)
    }

    /// How far a request had come when its sender gave up.
    fn progress(&self, peer: &Peer<'_, W, N>, pending: &Pending) -> Progress {
        let taken = peer
            .mail
            .load(Mail::<W, N>::taken(self.me), LoadOrder::Acquire);
        // What the private cursor knows is true even if the receiver has forgotten it since.
        let known = |count: u32| count.wrapping_sub(pending.sequence) <= u32::MAX / 2;
        if known(peer.pair.taken.get()) && peer.pair.epoch_out.get() == pending.epoch {
            return Progress::Taken;
        }
        match taken {
            Ok(count) if known(count) => Progress::Taken,
            _ => Progress::Waiting,
        }
    }

    /// Rings `peer` if it asked for that.
    pub(super) fn wake(&self, peer: &Peer<'_, W, N>) -> Result<(), Error> {
        // Pairs with the fence in `wait`: what was stored before is seen by a receiver that
        // looks after it asked to be rung, or its asking is seen here.
        fence(Ordering::SeqCst);
        if peer.mail.load(header::ATTENTION, LoadOrder::Relaxed)? != 0 {
            self.doorbell.ring(peer.number);
        }
        Ok(())
    }

    fn count_failure(&self, kind: u32, vector: Vector) {
        if let Ok(own) = self.own()
            && kind::is_message(kind)
        {
            let at = Mail::<W, N>::vector(vector.index()) + layout::vector::FAILED;
            // A count that cannot be stored is a window error at the next message.
            let _ = self.exclusion.with(|| own.add(at, 1));
        }
    }
}

/// The error for a reply that is no value.
#[cold]
fn without_value(pending: &Pending, status: u32) -> Error {
    let Pending { to, vector, .. } = *pending;
    match status {
        status::NO_HANDLER => Error::NoHandler { to, vector },
        status::HANDLER_FAILED => Error::HandlerFailed { to, vector },
        found => Error::Protocol {
            peer: to,
            word: ProtocolWord::ReplyStatus,
            found,
        },
    }
}

impl Refusal {
    fn error(self, to: Processor) -> Error {
        match self {
            Self::NotConnected => Error::NotConnected { to },
            Self::NoSlot | Self::Listeners => Error::NoSlot { to },
        }
    }
}

impl<W: MemoryWindow, D: Doorbell, X: Exclusion, const N: usize> Messenger
    for Mailbox<'_, W, D, X, N>
{
    fn number(&self) -> Processor {
        self.me
    }

    fn send_before(
        &self,
        message: Message,
        timeout: Duration,
        enclosing: Instant,
    ) -> Result<(), Error> {
        let peer = self.peer(message.to)?;
        let kind = kind::SEND | u32::from(message.vector.0);
        let limit = Limit { timeout, enclosing };
        self.publish_by(&peer, kind, message.data, limit).map(drop)
    }

    // Off the stack while the reply is waited for, and others are served.
    #[inline(never)]
    fn open_before(
        &self,
        message: Message,
        timeout: Duration,
        enclosing: Instant,
    ) -> Result<(Pending, Instant), Error> {
        let kind = kind::CALL | u32::from(message.vector.0);
        let limit = Limit { timeout, enclosing };
        let (pending, limit) =
            self.publish_by(&self.peer(message.to)?, kind, message.data, limit)?;
        Ok((pending, limit.enclosing))
    }

    #[inline(always)]
    fn wait_before(
        &self,
        pending: &Pending,
        timeout: Duration,
        enclosing: Instant,
    ) -> Result<u32, Error> {
        self.wait_for_reply(pending, Limit { timeout, enclosing })
    }

    fn post(&self, message: Message) -> Result<(), Error> {
        self.publish_now(message, kind::SEND).map(drop)
    }

    fn open(&self, message: Message) -> Result<Pending, Error> {
        self.publish_now(message, kind::CALL)
    }

    fn look(&self, pending: &Pending) -> Result<Option<u32>, Error> {
        self.reply_or_end(pending)
            .inspect_err(|_| self.count_failure(kind::CALL, pending.vector))
    }

    fn abandon(&self, pending: &Pending) {
        if let Ok(peer) = self.peer(pending.to) {
            self.exclusion.with(|| {
                let pair = peer.pair;
                let owns = pair
                    .owner
                    .get(pending.cell as usize)
                    .map(super::pair::Word::get)
                    == Some(pending.sequence);
                if pair.epoch_out.get() == pending.epoch && owns {
                    pair.abandoned
                        .set(pair.abandoned.get() | pair.busy.get() & 1 << pending.cell);
                }
            });
        }
    }
}

impl<W: MemoryWindow, D: Doorbell, X: Exclusion, const N: usize> Mailbox<'_, W, D, X, N> {
    /// Sends a request that is answered by what it changes; gives the life of its receiver.
    pub(super) fn request_without_reply(
        &self,
        to: Processor,
        kind: u32,
        limit: Limit,
    ) -> Result<u32, Error> {
        let (pending, _) = self.publish_by(&self.peer(to)?, kind, 0, limit)?;
        Ok(pending.life)
    }

    /// Does so without waiting, if there is a slot.
    pub(super) fn post_without_reply(&self, to: &Peer<'_, W, N>, kind: u32) -> Result<bool, Error> {
        Ok(self.publish(to, kind, 0, true)?.is_ok())
    }

    /// The reply to `pending`, if it has come; an error also if its receiver's life is over.
    fn reply_or_end(&self, pending: &Pending) -> Result<Option<u32>, Error> {
        let (to, progress) = (pending.to, Progress::Waiting);
        let peer = self.peer(to)?;
        if let Some(value) = self.reply(&peer, pending)? {
            return Ok(Some(value));
        }
        // Acquire: pairs with the Release store of the life in `join`.
        let life = peer.mail.load(header::LIFE, LoadOrder::Acquire)?;
        if life == pending.life {
            return Ok(None);
        }
        // What came just before the end still counts.
        match self.reply(&peer, pending)? {
            None if life == 0 => Err(Error::PeerLeft { to, progress }),
            None => Err(Error::PeerRestarted { to, progress }),
            found => Ok(found),
        }
    }

    fn publish_now(&self, message: Message, kind: u32) -> Result<Pending, Error> {
        let peer = self.peer(message.to)?;
        let kind = kind | u32::from(message.vector.0);
        let vector = self.check(kind)?;
        // A servo loop cannot wait for listeners.
        let refusal = match self.publish(&peer, kind, message.data, true)? {
            Ok(pending) => return Ok(pending),
            Err(refusal) => refusal,
        };
        self.count_failure(kind, vector);
        Err(refusal.error(message.to))
    }
}

//! Sending, with and without reply.
//!
//! What every message runs is one flat function each, from the first look to the last store:
//! [`Mailbox::publish`] and [`Mailbox::take_reply`]. All else is cold.

use core::hint::spin_loop;
use core::time::Duration;

use super::messenger::{MessageTicket, Messenger, PendingReply};
use super::pace::Pace;
use super::peer::{Peer, Word};
use super::wait::{End, GLANCES, Watch};
use super::{Mailbox, Waiting};
use crate::backend::Backend;
use crate::doorbell::Doorbell as _;
use crate::error::{MailboxError, ProtocolWord, SendProgress};
use crate::exclusion::Exclusion as _;
use crate::id::{Processor, Vector};
use crate::layout::vector::{FAILED, SENT};
use crate::layout::{SLOTS, header, kind, status};
use crate::mail::{At, Entry, Mail};
use crate::sync::{Ordering, fence};
use crate::time::{Clock as _, Instant};
use crate::window::{LoadOrder, MemoryWindow};

/// The longest time for which a sender waits for listeners; it is half of its timeout at most.
const LISTENERS: Duration = Duration::from_millis(100);

/// The reason why a request did not enter the ring.
pub(super) enum Refusal {
    /// The two ends have not acknowledged each other.
    NotConnected,
    /// The receiver has not taken enough requests, or too many calls are unanswered.
    NoSlot,
    /// Only listeners have not taken enough requests.
    Listeners,
    /// Something else is wrong.
    Error(MailboxError),
}

impl From<MailboxError> for Refusal {
    fn from(error: MailboxError) -> Self {
        Self::Error(error)
    }
}

impl Refusal {
    fn error(self, to: Processor) -> MailboxError {
        match self {
            Self::NotConnected => MailboxError::NotConnected { to },
            Self::NoSlot | Self::Listeners => MailboxError::NoSlot { to },
            Self::Error(error) => error,
        }
    }
}

impl<B: Backend, const N: usize> Mailbox<'_, B, N> {
    /// Puts a request of `kind` into the ring for `peer`, if it can enter, and rings the receiver
    /// if it wants that. Listeners that are behind are left behind if there is no `patience`.
    ///
    /// Reserving the slot and publishing it are one section: no context of this processor can
    /// publish a later request before an earlier one.
    ///
    /// It is compiled into its callers, once for `CALLS` with their reply and once for all else.
    #[inline(always)]
    fn publish<const CALLS: bool>(
        &self,
        peer: &Peer<B::Window, N>,
        kind: u32,
        data: u32,
        patience: Duration,
    ) -> Result<PendingReply, Refusal> {
        let mail = peer.mail();
        if mail.present() != peer.incarnation.get() {
            self.notice(peer)?;
        }
        let own = self.own()?;
        let vector = Vector(kind.to_le_bytes()[0]);
        let (pending, listeners) = self.exclusion.with(|| {
            // A receiver that began another incarnation since ignores the old epoch.
            let incarnation = peer.incarnation.get();
            if peer.connected.get() == 0 {
                self.connect(peer)?;
            }
            let sequence = peer.head.get().wrapping_add(1);
            if sequence.wrapping_sub(peer.taken.get()) > SLOTS {
                peer.refresh_taken(sequence)?;
            }
            let listeners = mail.look(At::header(header::LISTENERS), LoadOrder::Relaxed);
            if listeners != 0
                && !self.listeners_keep_up(peer, listeners, sequence, patience.is_zero())
            {
                return Err(Refusal::Listeners);
            }
            let mut cell = 0;
            if CALLS || kind & !0xff == kind::CALL {
                cell = peer.busy.get().trailing_ones();
                if cell >= SLOTS {
                    cell = peer.reclaim_cell()?;
                }
                peer.busy.set(peer.busy.get() | 1 << cell);
                if let Some(owner) = peer.owner.get(cell as usize) {
                    owner.set(sequence);
                }
            }
            let epoch = peer.epoch_out.get();
            let entry = Entry {
                value: data,
                epoch,
                kind: kind | cell << kind::CELL_SHIFT,
            };
            own.put(peer.ours.slot(sequence), sequence, entry);
            peer.head.set(sequence);
            if vector.index() < Vector::COUNT {
                let at = At::<N>::vector(vector, SENT);
                // The access of a message that shows when this mailbox's own memory is gone.
                let sent = own.load(at, LoadOrder::Relaxed)?;
                own.set(at, sent.wrapping_add(1));
            }
            let pending = PendingReply {
                to: peer.number,
                vector,
                cell: cell as u8,
                sequence,
                epoch,
                incarnation,
            };
            Ok((pending, listeners))
        })?;
        self.notify(mail);
        if listeners != 0 {
            self.notify_listeners(listeners);
        }
        Ok(pending)
    }

    /// The same, for where a few instructions more do not matter.
    #[inline(never)]
    fn publish_once(
        &self,
        peer: &Peer<B::Window, N>,
        kind: u32,
        data: u32,
        patience: Duration,
    ) -> Result<PendingReply, Refusal> {
        self.publish::<false>(peer, kind, data, patience)
    }

    /// Rings the owner of `mail` if it asked for that.
    #[inline(always)]
    pub(super) fn notify(&self, mail: Mail<'_, B::Window, N>) {
        // Pairs with the fence in `wait`: what was stored before is seen by a receiver that
        // looks after it asked to be rung, or its asking is seen here.
        fence(Ordering::SeqCst);
        let asked = mail.look(At::header(header::NOTIFY), LoadOrder::Relaxed) != 0;
        if Pace::of(&self.doorbell).rings(asked) {
            self.ring(mail.owner());
        }
    }

    #[cold]
    #[inline(never)]
    fn ring(&self, number: Processor) {
        self.doorbell.ring(number);
    }

    /// Returns the peer `to`, after checking all arguments of a request and that we have joined.
    #[inline(always)]
    fn receiver(&self, to: Processor, vector: Vector) -> Result<&Peer<B::Window, N>, MailboxError> {
        let peer = self.peer(to)?;
        if vector.index() >= Vector::COUNT {
            return Err(MailboxError::NoSuchVector { vector });
        }
        self.check_joined()?;
        Ok(peer)
    }

    /// Publishes a request, waiting for a slot for at most `timeout`.
    #[inline(always)]
    fn publish_within(
        &self,
        peer: &Peer<B::Window, N>,
        kind: u32,
        data: u32,
        timeout: Duration,
    ) -> Result<PendingReply, MailboxError> {
        // Mostly there is a slot, and the clock need not be read.
        match self.publish_once(peer, kind, data, timeout) {
            Ok(pending) => Ok(pending),
            Err(refusal) => self.publish_late(peer, kind, data, timeout, refusal),
        }
    }

    /// Goes on after a first try of [`publish_within`](Self::publish_within) ended in `refusal`.
    #[cold]
    #[inline(never)]
    fn publish_late(
        &self,
        peer: &Peer<B::Window, N>,
        kind: u32,
        data: u32,
        timeout: Duration,
        mut refusal: Refusal,
    ) -> Result<PendingReply, MailboxError> {
        let (to, vector) = (peer.number, Vector(kind.to_le_bytes()[0]));
        let progress = SendProgress::Never;
        let failed = |error| {
            self.count_failure(vector);
            Err(error)
        };
        if timeout.is_zero() || matches!(refusal, Refusal::Error(_)) {
            return failed(refusal.error(to));
        }
        let begun = self.doorbell.now();
        let deadline = begun.after(timeout);
        // A listener that is slow, or hostile, must not use up the time in which a call waits for its reply.
        let leave_behind_at = begun.after(LISTENERS.min(timeout / 2));
        if matches!(refusal, Refusal::Listeners) {
            self.leave_dead_behind(peer);
        }
        let watch = (to != self.me).then_some(Watch {
            peer: to,
            incarnation: Some(0),
        });
        let end = self.wait(begun, deadline, watch, |_| {
            let leave_behind =
                matches!(refusal, Refusal::Listeners) && self.doorbell.now() >= leave_behind_at;
            let patience = if leave_behind {
                Duration::ZERO
            } else {
                timeout
            };
            match self.publish_once(peer, kind, data, patience) {
                Ok(pending) => Ok(Some(pending)),
                Err(Refusal::Error(error)) => Err(error),
                Err(reason) => {
                    refusal = reason;
                    Ok(None)
                }
            }
        });
        failed(match end {
            Ok(End::Came(pending)) => return Ok(pending),
            // Listeners are waited for once; from here on those that are behind are left behind.
            Ok(_) if matches!(refusal, Refusal::Listeners) => {
                match self.publish_once(peer, kind, data, Duration::ZERO) {
                    Ok(pending) => return Ok(pending),
                    Err(refusal) => refusal.error(to),
                }
            }
            Ok(End::Expired { stalled: true }) if peer.has_joined() => MailboxError::Stalled {
                to,
                vector,
                progress,
            },
            Ok(End::Died) => MailboxError::PeerDied { to, progress },
            Ok(_) => refusal.error(to),
            Err(error) => error,
        })
    }

    /// Notes that `peer` has acknowledged our incarnation, if it has.
    #[cold]
    #[inline(never)]
    fn connect(&self, peer: &Peer<B::Window, N>) -> Result<(), Refusal> {
        peer.load_present()?;
        if !self.is_connected(peer) {
            return Err(Refusal::NotConnected);
        }
        peer.connected.set(1);
        Ok(())
    }

    /// Reads the reply to `pending`, and frees its cell; `None` if it has not come.
    #[inline(always)]
    fn take_reply(
        &self,
        peer: &Peer<B::Window, N>,
        pending: &PendingReply,
    ) -> Option<Result<u32, MailboxError>> {
        let at = peer.theirs.cell(u32::from(pending.cell));
        let mail = peer.mail();
        if !mail.carries(at, pending.sequence) {
            return None;
        }
        let reply = mail.get(at, pending.sequence)?;
        if reply.epoch != pending.epoch {
            return None;
        }
        self.exclusion.with(|| {
            if peer.epoch_out.get() == pending.epoch {
                // Requests are taken in order: this one and all before it have been.
                peer.advance(pending.sequence);
                peer.release(u32::from(pending.cell));
            }
        });
        if reply.kind != status::DONE {
            return Some(Err(without_value(pending, reply)));
        }
        Some(Ok(reply.value))
    }

    /// Waits for the reply to a request that has been sent; if there is none, the request is given up
    /// if it `gives_up`.
    #[inline(always)]
    fn wait_for_reply(
        &self,
        peer: &Peer<B::Window, N>,
        pending: &PendingReply,
        begun: Instant,
        timeout: Duration,
        gives_up: bool,
    ) -> Result<u32, MailboxError> {
        if Pace::of(&self.doorbell).serves_first() {
            self.serve_present(begun, begun.after(timeout))?;
        }
        // A quick reply, to one that spins and has nothing to serve meanwhile.
        for glance in 1..=GLANCES {
            if let Some(reply) = self.take_reply(peer, pending) {
                return reply.inspect_err(|_| self.count_failure(pending.vector));
            }
            if matches!(self.waiting, Waiting::Sleep) {
                break;
            }
            // The own rings are other lines, and can wait a little longer.
            if glance % 4 == 0 && self.glance().is_some() {
                break;
            }
            spin_loop();
        }
        self.wait_long_for_reply(peer, pending, begun, timeout, gives_up)
    }

    /// Sends after a first `refusal`, and waits for the reply.
    #[cold]
    #[inline(never)]
    fn send_late_with_reply(
        &self,
        peer: &Peer<B::Window, N>,
        kind: u32,
        data: u32,
        timeout: Duration,
        refusal: Refusal,
    ) -> Result<u32, MailboxError> {
        let deadline = self.doorbell.now().after(timeout);
        let pending = self.publish_late(peer, kind, data, timeout, refusal)?;
        let begun = self.doorbell.now();
        let left = Duration::from_nanos(deadline.ns_since(begun));
        self.wait_for_reply(peer, &pending, begun, left, true)
    }

    #[inline(never)]
    fn wait_long_for_reply(
        &self,
        peer: &Peer<B::Window, N>,
        pending: &PendingReply,
        begun: Instant,
        timeout: Duration,
        gives_up: bool,
    ) -> Result<u32, MailboxError> {
        let deadline = begun.after(timeout);
        let watch = (peer.number != self.me).then_some(Watch {
            peer: peer.number,
            incarnation: Some(pending.incarnation),
        });
        let look = |_| self.take_reply(peer, pending).transpose();
        match self.wait(begun, deadline, watch, look) {
            Ok(End::Came(value)) => Ok(value),
            end => {
                if gives_up {
                    self.abandon(pending);
                }
                Err(self.no_reply(peer, pending, &end))
            }
        }
    }

    /// Returns the error that says why there is no reply.
    #[cold]
    #[inline(never)]
    fn no_reply(
        &self,
        peer: &Peer<B::Window, N>,
        pending: &PendingReply,
        end: &Result<End<u32>, MailboxError>,
    ) -> MailboxError {
        let PendingReply { to, vector, .. } = *pending;
        self.count_failure(vector);
        let over = match end {
            Ok(End::Died) => Some(pending.incarnation),
            Ok(End::Left) => Some(0),
            _ => None,
        };
        let progress = peer.progress(pending, over);
        match end {
            // The reply came, and says that there is no value; or memory is gone.
            Err(error) => *error,
            Ok(End::Expired { stalled: true }) => MailboxError::Stalled {
                to,
                vector,
                progress,
            },
            Ok(End::Expired { .. } | End::Came(_)) => MailboxError::TimedOut {
                to,
                vector,
                progress,
            },
            Ok(End::Died) => MailboxError::PeerDied { to, progress },
            Ok(End::Left) => MailboxError::PeerLeft { to, progress },
            Ok(End::Restarted) => MailboxError::PeerRestarted { to, progress },
        }
    }

    /// The reply to `pending`, if it has come; an error also if its receiver's incarnation is over.
    fn reply_or_end(&self, pending: &PendingReply) -> Result<Option<u32>, MailboxError> {
        let to = pending.to;
        let peer = self.peer(to)?;
        if let Some(reply) = self.take_reply(peer, pending) {
            return reply.map(Some);
        }
        let present = peer.load_present()?;
        if present == pending.incarnation {
            return Ok(None);
        }
        // A reply that came just before the end still counts.
        if let Some(reply) = self.take_reply(peer, pending) {
            return reply.map(Some);
        }
        let over = (present == 0).then_some(0);
        let progress = peer.progress(pending, over);
        Err(match over {
            Some(_) => MailboxError::PeerLeft { to, progress },
            None => MailboxError::PeerRestarted { to, progress },
        })
    }

    /// Sends a request that is answered by what it changes; returns the incarnation of its
    /// receiver.
    pub(super) fn request_without_reply(
        &self,
        to: Processor,
        kind: u32,
        timeout: Duration,
    ) -> Result<u32, MailboxError> {
        self.check_joined()?;
        let none = u32::from(u8::MAX);
        let pending = self.publish_within(self.peer(to)?, kind | none, 0, timeout)?;
        Ok(pending.incarnation)
    }

    #[cold]
    fn count_failure(&self, vector: Vector) {
        if let Ok(own) = self.own()
            && vector.index() < Vector::COUNT
        {
            let at = At::<N>::vector(vector, FAILED);
            self.exclusion.with(|| own.count(at));
        }
    }
}

impl<W: MemoryWindow, const N: usize> Peer<W, N> {
    /// Reads how many requests the receiver has taken; fails if `sequence` has no slot.
    #[cold]
    #[inline(never)]
    fn refresh_taken(&self, sequence: u32) -> Result<(), Refusal> {
        // Acquire: pairs with the Release store in `take`; the slot that is overwritten has
        // been read before.
        let at = self.theirs.taken();
        let count = self.mail().load(at, LoadOrder::Acquire)?;
        let untaken = sequence.wrapping_sub(count);
        if untaken == 0 || untaken > SLOTS + 1 {
            // The receiver may have begun another incarnation meanwhile, and its count anew.
            // Ordered by the Acquire load above, which pairs with the fence in `join`.
            let present = self
                .mail()
                .load(At::header(header::INCARNATION), LoadOrder::Relaxed)?;
            if present != self.incarnation.get() {
                return Err(Refusal::NotConnected);
            }
            return Err(Refusal::Error(MailboxError::Protocol {
                peer: self.number,
                word: ProtocolWord::Taken,
                found: count,
            }));
        }
        self.taken.set(count);
        if untaken > SLOTS {
            return Err(Refusal::NoSlot);
        }
        Ok(())
    }

    /// A reply cell whose late reply has come.
    #[cold]
    #[inline(never)]
    fn reclaim_cell(&self) -> Result<u32, Refusal> {
        for (cell, owner) in (0..SLOTS).zip(&self.owner) {
            let late = self.theirs.cell(cell);
            let epoch = self.epoch_out.get();
            if self.abandoned.get() & 1 << cell != 0
                && let Some(reply) = self.mail().get(late, owner.get())
                && reply.epoch == epoch
            {
                self.release(cell);
                return Ok(cell);
            }
        }
        Err(Refusal::NoSlot)
    }

    /// Returns the state that a request had reached when its sender gave up; `over` is the receiver's
    /// incarnation word if nothing runs there any more.
    fn progress(&self, pending: &PendingReply, over: Option<u32>) -> SendProgress {
        let at = self.theirs.taken();
        let taken = self.mail().load(at, LoadOrder::Acquire);
        // The private cursor's knowledge is true even if the receiver has forgotten it since.
        let known = |count: u32| count.wrapping_sub(pending.sequence) <= u32::MAX / 2;
        if known(self.taken.get()) && self.epoch_out.get() == pending.epoch {
            return SendProgress::Taken;
        }
        match taken {
            Ok(count) if known(count) => SendProgress::Taken,
            // The count is still that of the incarnation that ended: the next one begins it anew.
            Ok(_) if over == Some(self.present()) => SendProgress::Never,
            _ => SendProgress::MayRun,
        }
    }
}

/// The error for a reply that is not a value.
#[cold]
fn without_value(pending: &PendingReply, reply: Entry) -> MailboxError {
    let PendingReply { to, vector, .. } = *pending;
    match reply.kind {
        status::NO_HANDLER => MailboxError::NoHandler { to, vector },
        status::HANDLER_FAILED => MailboxError::HandlerFailed { to, vector },
        status::REFUSED => MailboxError::Refused {
            to,
            vector,
            code: reply.value,
        },
        found => MailboxError::Protocol {
            peer: to,
            word: ProtocolWord::ReplyStatus,
            found,
        },
    }
}

impl<B: Backend, const N: usize> Messenger for Mailbox<'_, B, N> {
    #[inline]
    fn number(&self) -> Processor {
        self.me
    }

    #[inline]
    fn now(&self) -> Instant {
        self.doorbell.now()
    }

    fn send(
        &self,
        to: Processor,
        vector: Vector,
        data: u32,
        timeout: Duration,
    ) -> Result<(), MailboxError> {
        let peer = self.receiver(to, vector)?;
        let kind = kind::SEND | u32::from(vector.0);
        self.publish_within(peer, kind, data, timeout).map(drop)
    }

    fn send_with_reply(
        &self,
        to: Processor,
        vector: Vector,
        data: u32,
        timeout: Duration,
    ) -> Result<u32, MailboxError> {
        let peer = self.receiver(to, vector)?;
        let kind = kind::CALL | u32::from(vector.0);
        // The clock is read after the request is on its way, so that the receiver need not wait for it.
        match self.publish::<true>(peer, kind, data, timeout) {
            Ok(pending) => self.wait_for_reply(peer, &pending, self.doorbell.now(), timeout, true),
            Err(refusal) => self.send_late_with_reply(peer, kind, data, timeout, refusal),
        }
    }

    fn begin(
        &self,
        to: Processor,
        vector: Vector,
        data: u32,
        timeout: Duration,
    ) -> Result<MessageTicket<'_>, MailboxError> {
        let peer = self.receiver(to, vector)?;
        let kind = kind::CALL | u32::from(vector.0);
        let pending = self.publish_within(peer, kind, data, timeout)?;
        Ok(MessageTicket::attach(self, pending))
    }

    fn serve(&self, timeout: Duration) -> Result<usize, MailboxError> {
        self.serve_within(timeout, None)
    }

    fn serve_for(&self, whom: Processor, timeout: Duration) -> Result<usize, MailboxError> {
        self.serve_within(timeout, Some(whom))
    }

    fn poll_pending(&self, pending: &PendingReply) -> Result<Option<u32>, MailboxError> {
        self.reply_or_end(pending)
            .inspect_err(|_| self.count_failure(pending.vector))
    }

    fn wait_pending(&self, pending: &PendingReply, timeout: Duration) -> Result<u32, MailboxError> {
        let begun = self.doorbell.now();
        let peer = self.peer(pending.to)?;
        self.wait_for_reply(peer, pending, begun, timeout, false)
    }

    fn abandon(&self, pending: &PendingReply) {
        if let Ok(peer) = self.peer(pending.to) {
            self.exclusion.with(|| {
                let owner = peer.owner.get(pending.cell as usize).map(Word::get);
                if peer.epoch_out.get() == pending.epoch && owner == Some(pending.sequence) {
                    let cell = 1 << (u32::from(pending.cell) % SLOTS);
                    peer.abandoned
                        .set(peer.abandoned.get() | peer.busy.get() & cell);
                }
            });
        }
    }

    #[cfg(feature = "async")]
    fn wake_after_serve(&self, waker: &core::task::Waker) {
        self.tasks.add(waker);
    }
}

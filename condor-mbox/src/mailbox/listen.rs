//! Listening to the vectors of another number.
//!
//! The kernel of A.I. Memo 977 "signals all processes that have expressed an interest" in a number's
//! interrupt (section 3.4). Here its holder admits listeners by a bit in its header; senders do
//! not overwrite a request that an admitted listener has not taken, as long as it keeps up.

use core::cell::Cell;
use core::time::Duration;

use super::Mailbox;
use super::messenger::{Call, Handler};
use super::peer::{Peer, Word};
use super::wait::{End, Watch};
use crate::backend::Backend;
use crate::doorbell::{Doorbell as _, Evidence};
use crate::error::{MailboxError, SendProgress};
use crate::exclusion::Exclusion as _;
use crate::id::{Processor, Vector};
use crate::layout::{self, JOINING, SLOTS, entry, header, kind};
use crate::mail::{At, Entry};
use crate::time::{Clock as _, Instant};
use crate::window::{LoadOrder, MemoryWindow, StoreOrder};

/// The notes of a mailbox about the number that it listens to.
pub(super) struct Listening<const N: usize> {
    /// That number plus one; 0 while it listens to none.
    to: Word,
    /// The incarnation of its holder that was asked to admit us.
    incarnation: Word,
    senders: [ListenerProgress; N],
}

struct ListenerProgress {
    /// Epoch of the requests from the sender to the number listened to.
    epoch: Word,
    /// Sequence of the latest that was taken or missed.
    tail: Word,
    missed: Word,
}

/// The result of a look for the next message of one sender.
enum Look {
    Heard(Entry),
    /// The sender was faster; what is still there comes next.
    Overrun,
    Nothing,
}

impl<const N: usize> Listening<N> {
    pub(super) fn new() -> Self {
        let progress = |_| ListenerProgress {
            epoch: Word::new(0),
            tail: Word::new(0),
            missed: Word::new(0),
        };
        Self {
            to: Word::new(0),
            incarnation: Word::new(0),
            senders: core::array::from_fn(progress),
        }
    }
}

impl<'v, B: Backend, const N: usize> Mailbox<'v, B, N> {
    /// Sets the handler that runs for each message that this mailbox hears, whatever its vector,
    /// while it [listens](Self::listen) to another number. Its result is dropped: only the processor
    /// to which the message was sent replies. It replaces the handler that was set before.
    pub fn set_listener(&mut self, handler: Handler<'v>) {
        self.listener = Some(handler);
    }
}

impl<B: Backend, const N: usize> Mailbox<'_, B, N> {
    /// Makes this mailbox listen to `number`: from the return of this call on, it hears every
    /// message that is sent to the processor `number`, as that processor (the *holder*) does. The
    /// handler of [`set_listener`](Self::set_listener) runs for each of them.
    ///
    /// Senders wait for a listener as they wait for the holder, but for 100 ms and half of their timeout
    /// at most, and then no more until it has caught up. A listener
    /// that does not keep up loses messages, which [`missed`](Self::missed) counts; servo loops do
    /// not wait for listeners at all, and a [`Doorbell`](crate::Doorbell::waits_for_listener) can
    /// name listeners for which nobody waits. When the holder begins a new incarnation, listening continues. A mailbox listens to one number at a time; `None` ends
    /// listening. Only the background may call this function.
    ///
    /// ```
    /// use std::sync::atomic::{AtomicU32, Ordering};
    /// # use std::time::Duration;
    /// # use condor_mbox::sim::SimSystem;
    /// # use condor_mbox::{Messenger, Processor, Vector};
    /// # const HOLDER: Processor = Processor(0);
    /// # const SENDER: Processor = Processor(1);
    /// # const LISTENER: Processor = Processor(2);
    /// # const PLACE: Vector = Vector(3);
    /// # const SECOND: Duration = Duration::from_secs(1);
    /// # fn main() -> Result<(), Box<dyn std::error::Error>> {
    /// # let system = SimSystem::<3>::in_virtual_time(4096);
    /// # let mut holder = system.mailbox(HOLDER)?;
    /// # holder.set_vector(PLACE, &|_| 1, "place")?;
    /// # holder.join()?;
    /// # system.while_waiting(HOLDER, move || {
    /// #     holder.serve(Duration::ZERO).expect("its memory is there");
    /// # });
    /// static HEARD: AtomicU32 = AtomicU32::new(0);
    ///
    /// let log = |call: &condor_mbox::Call<'_>| {
    ///     assert_eq!((call.sender(), call.addressee()), (SENDER, HOLDER));
    ///     HEARD.store(call.data(), Ordering::Relaxed);
    ///     0 // to nobody
    /// };
    /// let mut listener = system.mailbox(LISTENER)?;
    /// listener.set_listener(&log);
    /// listener.join()?;
    /// listener.listen(Some(HOLDER), SECOND)?;
    ///
    /// # let mut sender = system.mailbox(SENDER)?;
    /// # sender.join()?;
    /// assert_eq!(sender.send_with_reply(HOLDER, PLACE, 77, SECOND)?, 1);
    /// listener.serve(Duration::ZERO)?;
    /// assert_eq!(HEARD.load(Ordering::Relaxed), 77);
    /// # Ok(())
    /// # }
    /// ```
    ///
    /// # Errors
    /// [`MailboxError::NoSuchProcessor`] if no processor has the number, [`MailboxError::ListensToItself`] if it is
    /// this mailbox's number, [`MailboxError::NotJoined`] if this mailbox has not joined;
    /// [`MailboxError::TimedOut`] or [`MailboxError::Stalled`] if the holder does not admit this mailbox in
    /// time; [`MailboxError::PeerDied`], [`MailboxError::PeerLeft`] or [`MailboxError::PeerRestarted`] if the
    /// holder ends.
    pub fn listen(&self, number: Option<Processor>, timeout: Duration) -> Result<(), MailboxError> {
        if number == Some(self.me) {
            return Err(MailboxError::ListensToItself { number: self.me });
        }
        let begun = self.doorbell.now();
        let deadline = begun.after(timeout);
        let left = || Duration::from_nanos(deadline.ns_since(self.doorbell.now()));
        if let Some(former) = self.listens_to() {
            self.exclusion.with(|| self.stop_hearing())?;
            // A former holder that takes no requests must not take all the time of the new one.
            let timeout = number.map_or(timeout, |_| timeout / 2);
            // A holder that is gone has forgotten us anyway.
            let _ = self.request_without_reply(former, kind::IGNORE, timeout);
        }
        let Some(to) = number else { return Ok(()) };
        let peer = self.peer(to)?;
        let incarnation = self.request_without_reply(to, kind::LISTEN, left())?;
        let watch = Some(Watch {
            peer: to,
            incarnation: Some(incarnation),
        });
        let admitted = |_| Ok(self.is_admitted(peer)?.then_some(()));
        let end = self.wait(self.doorbell.now(), deadline, watch, admitted)?;
        let (vector, progress) = (Vector(0), SendProgress::MayRun);
        match end {
            End::Came(()) => {}
            End::Expired { stalled: true } => {
                return Err(MailboxError::Stalled {
                    to,
                    vector,
                    progress,
                });
            }
            End::Expired { stalled: false } => {
                return Err(MailboxError::TimedOut {
                    to,
                    vector,
                    progress,
                });
            }
            End::Died => return Err(MailboxError::PeerDied { to, progress }),
            End::Left => return Err(MailboxError::PeerLeft { to, progress }),
            End::Restarted => return Err(MailboxError::PeerRestarted { to, progress }),
        }
        // A context that serves meanwhile sees all of this, or nothing.
        self.exclusion
            .with(|| self.begin_to_hear(peer, incarnation))
    }

    /// Begins to hear the holder's messages, of which those that it has taken were sent before.
    fn begin_to_hear(
        &self,
        holder: &Peer<B::Window, N>,
        incarnation: u32,
    ) -> Result<(), MailboxError> {
        for (sender, progress) in self.peers.iter().zip(&self.listening.senders) {
            progress.missed.set(0);
            let present = latest(sender);
            // The holder's count is of this incarnation of the sender only once it has acknowledged that.
            // Acquire: pairs with the Release store in `acknowledge`.
            let word = |offset| holder.mail().load(offset, LoadOrder::Acquire);
            let taken = if word(sender.ours.acknowledged())? == present {
                word(sender.ours.taken())?
            } else {
                0
            };
            let epoch = layout::epoch(present, incarnation);
            self.start_hearing(sender.number, progress, epoch, taken)?;
        }
        self.listening.incarnation.set(incarnation);
        self.listening.to.set(u32::from(holder.number.0) + 1);
        Ok(())
    }

    /// Forgets the number to which this mailbox listens, so that no sender waits for it.
    pub(super) fn stop_hearing(&self) -> Result<(), MailboxError> {
        self.listening.to.set(0);
        self.listening.incarnation.set(0);
        let own = self.own()?;
        for sender in 0..N as u8 {
            // An epoch is never 0. Pairs with the Acquire load in `untaken_by`.
            own.store(At::heard_epoch(Processor(sender)), 0, StoreOrder::Release)?;
        }
        Ok(())
    }

    /// Returns the number that this mailbox listens to; `None` if it listens to none.
    #[must_use]
    pub fn listens_to(&self) -> Option<Processor> {
        self.listening
            .to
            .get()
            .checked_sub(1)
            .map(|number| Processor(number as u8))
    }

    /// Returns the number of messages from `sender` that this mailbox has missed since it began to
    /// [listen](Self::listen), because it did not keep up. Only messages to the number that it
    /// listens to count.
    ///
    /// # Errors
    /// [`MailboxError::NoSuchProcessor`] if there is no processor `sender`.
    pub fn missed(&self, sender: Processor) -> Result<u32, MailboxError> {
        let progress = self.listening.senders.get(sender.index());
        progress
            .map(|progress| progress.missed.get())
            .ok_or_else(|| Self::no_such(sender))
    }

    /// Returns true if the holder of the number has set our bit.
    fn is_admitted(&self, holder: &Peer<B::Window, N>) -> Result<bool, MailboxError> {
        // Acquire: pairs with the Release store in `admit_listener`.
        let bits = holder
            .mail()
            .load(At::header(header::LISTENERS), LoadOrder::Acquire)?;
        Ok(bits & 1 << self.me.0 != 0)
    }

    /// Sets or clears the bit of a listener in our header.
    #[cold]
    pub(super) fn admit_listener(
        &self,
        listener: &Peer<B::Window, N>,
        admit: bool,
    ) -> Result<(), MailboxError> {
        let own = self.own()?;
        self.exclusion.with(|| {
            let bit = 1 << listener.number.0;
            let others = own.load(At::header(header::LISTENERS), LoadOrder::Relaxed)? & !bit;
            let bits = if admit { others | bit } else { others };
            // Release: pairs with the Acquire load in `is_admitted`.
            own.store(At::header(header::LISTENERS), bits, StoreOrder::Release)
        })
    }

    /// Returns true if every listener in the set `listeners` has taken what request `sequence` overwrites.
    #[cold]
    pub(super) fn listeners_keep_up(
        &self,
        peer: &Peer<B::Window, N>,
        listeners: u32,
        sequence: u32,
        leave_behind: bool,
    ) -> bool {
        let lagging = &peer.lagging;
        let mut keep_up = true;
        for listener in self.of(listeners) {
            let bit = 1 << listener.number.0;
            if self.untaken_by(listener, peer.epoch_out.get(), sequence) <= SLOTS {
                lagging.set(lagging.get() & !bit);
            } else if leave_behind || !self.doorbell.waits_for_listener(listener.number) {
                lagging.set(lagging.get() | bit);
            } else if lagging.get() & bit == 0 {
                keep_up = false;
            }
        }
        keep_up
    }

    /// Returns the number of requests in `epoch` up to `sequence` that the listener has not taken; 0 if it has
    /// not begun to hear this epoch, or its memory is gone.
    fn untaken_by(&self, listener: &Peer<B::Window, N>, epoch: u32, sequence: u32) -> u32 {
        let at = At::heard_epoch(self.me);
        // Acquire: pairs with the Release stores in `start_hearing` and `hear_alone`.
        let word = |offset| listener.mail().load(offset, LoadOrder::Acquire);
        match word(at) {
            Ok(known) if known == epoch => {}
            _ => return 0,
        }
        word(At::heard_count(self.me)).map_or(0, |count| sequence.wrapping_sub(count))
    }

    /// Leaves those listeners behind whose programs are known to have ended.
    pub(super) fn leave_dead_behind(&self, peer: &Peer<B::Window, N>) {
        for listener in self.of(peer
            .mail()
            .look(At::header(header::LISTENERS), LoadOrder::Relaxed))
        {
            if self.doorbell.evidence(listener.number) == Evidence::Dead {
                let lagging = &peer.lagging;
                self.exclusion
                    .with(|| lagging.set(lagging.get() | 1 << listener.number.0));
            }
        }
    }

    #[cold]
    pub(super) fn notify_listeners(&self, listeners: u32) {
        for listener in self.of(listeners) {
            self.notify(listener.mail());
        }
    }

    /// Those whose bit is set.
    fn of(&self, bits: u32) -> impl Iterator<Item = &Peer<B::Window, N>> {
        let has_bit = move |peer: &&Peer<_, N>| bits & 1 << peer.number.0 != 0;
        self.peers.iter().filter(has_bit)
    }

    /// Runs the listener for one message to the number listened to, if there is a new one; returns
    /// whether there was.
    #[cold]
    #[inline(never)]
    pub(super) fn hear(&self, deadline: Instant) -> Result<bool, MailboxError> {
        let Some(to) = self.listens_to() else {
            return Ok(false);
        };
        let holder = self.peer(to)?;
        let Some(_turn) = self.begin_turn() else {
            return Ok(false);
        };
        for (sender, progress) in self.peers.iter().zip(&self.listening.senders) {
            if let Some((from, entry)) = self.hear_from(holder, sender, progress)? {
                // The sender may wait for us to take it.
                if self.doorbell.waits_for_listener(self.me) {
                    self.notify(sender.mail());
                }
                self.run_heard(to, (sender.number, from), entry, deadline);
                return Ok(true);
            }
        }
        Ok(false)
    }

    /// Returns the next message of `sender` and the incarnation in which it was sent; 0 if that has ended.
    // Off the stack when the handler runs.
    #[inline(never)]
    fn hear_from(
        &self,
        holder: &Peer<B::Window, N>,
        sender: &Peer<B::Window, N>,
        progress: &ListenerProgress,
    ) -> Result<Option<(u32, Entry)>, MailboxError> {
        let present = holder.present();
        if present != self.listening.incarnation.get() && !matches!(present, 0 | JOINING) {
            // The holder began a new incarnation, which has not admitted us yet.
            let asked = self.request_without_reply(holder.number, kind::LISTEN, Duration::ZERO);
            let known = if asked.is_ok() { present } else { 0 };
            self.listening.incarnation.set(known);
        }
        self.exclusion.with(|| {
            // The background may have begun to listen to another number.
            if self.listens_to() != Some(holder.number) {
                return Ok(None);
            }
            // Loaded in the section: a context that was interrupted before must not go back to
            // the former epoch and hear the present one twice.
            let (to, from) = (holder.present(), latest(sender));
            if matches!(to, 0 | JOINING) || matches!(from, 0 | JOINING) {
                return Ok(None);
            }
            let epoch = layout::epoch(from, to);
            if epoch != progress.epoch.get() {
                self.start_hearing(sender.number, progress, epoch, 0)?;
            }
            // Every slot may have been overrun.
            for _ in 0..=SLOTS {
                match self.hear_alone(holder, sender, progress)? {
                    Look::Heard(entry) => {
                        let is_there = sender.present() == from;
                        return Ok(Some((if is_there { from } else { 0 }, entry)));
                    }
                    Look::Overrun => {}
                    Look::Nothing => break,
                }
            }
            Ok(None)
        })
    }

    /// Begins to hear a sender in a new epoch, after its request number `tail`.
    fn start_hearing(
        &self,
        sender: Processor,
        progress: &ListenerProgress,
        epoch: u32,
        tail: u32,
    ) -> Result<(), MailboxError> {
        progress.epoch.set(epoch);
        progress.tail.set(tail);
        let own = self.own()?;
        let at = At::heard_epoch(sender);
        own.store(at, 0, StoreOrder::Relaxed)?;
        own.store(At::heard_count(sender), tail, StoreOrder::Release)?;
        own.store(at, epoch, StoreOrder::Release)
    }

    fn hear_alone(
        &self,
        holder: &Peer<B::Window, N>,
        sender: &Peer<B::Window, N>,
        progress: &ListenerProgress,
    ) -> Result<Look, MailboxError> {
        let depth = self.depth.get();
        if depth >= Call::MAX_DEPTH {
            return Ok(Look::Nothing);
        }
        let next = progress.tail.get().wrapping_add(1);
        // The pair of any processor with the holder is where ours is.
        let slot = holder.ours.slot(next);
        let found = sender
            .mail()
            .look(slot.word(entry::SEQUENCE), LoadOrder::Acquire);
        let ahead = found.wrapping_sub(next);
        let Some(entry) = sender.mail().get(slot, found) else {
            return Ok(Look::Nothing);
        };
        if entry.epoch == 0
            || entry.epoch != progress.epoch.get()
            || ahead > u32::MAX / 2
            || !ahead.is_multiple_of(SLOTS)
        {
            return Ok(Look::Nothing);
        }
        let own = self.own()?;
        let tail = if ahead == 0 {
            next
        } else {
            // Overrun: what may still be there begins a ringful before the one found.
            progress.missed.set(
                progress
                    .missed
                    .get()
                    .wrapping_add(ahead.wrapping_sub(SLOTS).wrapping_add(1)),
            );
            found.wrapping_sub(SLOTS)
        };
        progress.tail.set(tail);
        // Release: pairs with the Acquire load in `untaken_by`; the slot has been read.
        own.store(At::heard_count(sender.number), tail, StoreOrder::Release)?;
        if ahead != 0 {
            return Ok(Look::Overrun);
        }
        self.depth.set(depth + 1);
        Ok(Look::Heard(entry))
    }

    fn run_heard(
        &self,
        to: Processor,
        (sender, incarnation): (Processor, u32),
        entry: Entry,
        deadline: Instant,
    ) {
        let vector = Vector(entry.kind.to_le_bytes()[0]);
        let is_message = matches!(entry.kind & 0xff00, kind::SEND | kind::CALL)
            && vector.index() < Vector::COUNT;
        let listener = self.listener.filter(|_| is_message);
        let finish = FinishHeard {
            mailbox: self,
            ends_serving: listener.is_some() && self.doorbell.ends_serving(sender),
        };
        if let Some(listener) = listener {
            listener(&Call {
                messenger: self,
                sender,
                incarnation,
                addressee: to,
                vector,
                data: entry.value,
                depth: self.depth.get(),
                deadline,
                refused: Cell::new(false),
            });
        }
        drop(finish);
    }
}

/// Returns the incarnation whose messages are in the rings of `sender`: the present one, or the last one if it has left,
/// since it may leave before it was heard; 0 if there is none, or its memory is gone.
fn latest<W: MemoryWindow, const N: usize>(sender: &Peer<W, N>) -> u32 {
    match sender.present() {
        0 => sender
            .mail()
            .look(At::header(header::LAST_INCARNATION), LoadOrder::Relaxed),
        present => present,
    }
}

/// Ends a heard message however its handler ends.
struct FinishHeard<'f, 'v, B: Backend, const N: usize> {
    mailbox: &'f Mailbox<'v, B, N>,
    ends_serving: bool,
}

impl<B: Backend, const N: usize> Drop for FinishHeard<'_, '_, B, N> {
    fn drop(&mut self) {
        let mailbox = self.mailbox;
        let deepest = mailbox.depth.get() >= Call::MAX_DEPTH;
        mailbox.exclusion.with(|| {
            mailbox.depth.set(mailbox.depth.get().wrapping_sub(1));
            if self.ends_serving {
                mailbox.served.set(mailbox.served.get().wrapping_add(1));
            }
        });
        if deepest {
            // As in `finish`.
            mailbox.ring_again();
        }
    }
}

//! Listening to the vectors of another number.
//!
//! The memo's kernel "signals all processes that have expressed an interest" in a number's
//! interrupt (section 3.4). Here its holder admits listeners by a bit in its header; senders do
//! not overwrite a request that an admitted listener has not taken, as long as it keeps up.

use core::time::Duration;

use super::call::Call;
use super::pair::Word;
use super::send::kind;
use super::wait::{End, Limit, Watch};
use super::{MAX_DEPTH, Mailbox, Peer};
use crate::doorbell::{Doorbell, Evidence};
use crate::error::Error;
use crate::exclusion::Exclusion;
use crate::id::{Processor, Vector};
use crate::layout::{self, JOINING, SLOTS, entry, header};
use crate::mail::{Entry, Mail};
use crate::time::Instant;
use crate::window::{LoadOrder, MemoryWindow, StoreOrder};

/// What a mailbox remembers of the number it listens to.
pub(super) struct Listening<const N: usize> {
    /// That number plus one; 0 while it listens to none.
    to: Word,
    /// The life of its holder that was asked to admit us.
    life: Word,
    senders: [Heard; N],
}

struct Heard {
    /// Epoch of the requests from the sender to the number listened to.
    epoch: Word,
    /// Sequence of the latest that was taken or missed.
    tail: Word,
    missed: Word,
}

/// What a look for the next message of one sender found.
enum Look {
    Heard(Entry),
    /// The sender was faster; what is still there comes next.
    Overrun,
    Nothing,
}

impl<const N: usize> Listening<N> {
    pub(super) fn new() -> Self {
        let heard = |_| Heard {
            epoch: Word::new(0),
            tail: Word::new(0),
            missed: Word::new(0),
        };
        Self {
            to: Word::new(0),
            life: Word::new(0),
            senders: core::array::from_fn(heard),
        }
    }
}

impl<W: MemoryWindow, D: Doorbell, X: Exclusion, const N: usize> Mailbox<'_, W, D, X, N> {
    /// Gets every message to `number`, beside its holder, from when this returns: our own handler
    /// for the vector runs, if there is one, and its result is dropped; the holder replies.
    ///
    /// Senders wait for a listener as they wait for the holder, within their deadline. One that
    /// does not keep up is left behind and told how much it [`missed`](Self::missed); servo loops
    /// do not wait for listeners at all. When the holder begins a new life, listening goes on by
    /// itself. A mailbox listens to one number at a time; `None` ends it.
    ///
    /// ```
    /// use std::sync::atomic::{AtomicU32, Ordering};
    /// # use std::time::Duration;
    /// # use condor_mbox::sim::System;
    /// # use condor_mbox::{Processor, Vector};
    /// # const HOLDER: Processor = Processor(0);
    /// # const SENDER: Processor = Processor(1);
    /// # const LISTENER: Processor = Processor(2);
    /// # const PLACE: Vector = Vector(3);
    /// # const SECOND: Duration = Duration::from_secs(1);
    /// # fn main() -> Result<(), Box<dyn std::error::Error>> {
    /// # let system = System::<3>::in_virtual_time(4096);
    /// # let mut holder = system.mailbox(HOLDER)?;
    /// # holder.set_vector(PLACE, &|_| 1, "place")?;
    /// # holder.join()?;
    /// # system.while_waiting(HOLDER, move || {
    /// #     holder.service(SECOND).expect("its memory is there");
    /// # });
    /// static HEARD: AtomicU32 = AtomicU32::new(0);
    ///
    /// let log = |call: &condor_mbox::Call<'_>| {
    ///     assert_eq!((call.sender(), call.addressee()), (SENDER, HOLDER));
    ///     HEARD.store(call.data(), Ordering::Relaxed);
    ///     0 // to nobody
    /// };
    /// let mut listener = system.mailbox(LISTENER)?;
    /// listener.set_vector(PLACE, &log, "log places")?;
    /// listener.join()?;
    /// listener.listen(Some(HOLDER), SECOND)?;
    ///
    /// # let mut sender = system.mailbox(SENDER)?;
    /// # sender.join()?;
    /// assert_eq!(sender.send_with_reply(HOLDER, PLACE, 77, SECOND)?, 1);
    /// listener.service(SECOND)?;
    /// assert_eq!(HEARD.load(Ordering::Relaxed), 77);
    /// # Ok(())
    /// # }
    /// ```
    ///
    /// # Errors
    /// [`Error::NoSuchProcessor`], [`Error::ListensToItself`], [`Error::NotJoined`];
    /// [`Error::TimedOut`] or
    /// [`Error::Stalled`] if the holder does not admit us; [`Error::PeerDied`] and the like.
    pub fn listen(&mut self, number: Option<Processor>, timeout: Duration) -> Result<(), Error> {
        if number == Some(self.me) {
            return Err(Error::ListensToItself { number: self.me });
        }
        let limit = Limit {
            timeout,
            enclosing: self.doorbell.now().after(timeout),
        };
        if let Some(former) = self.listens_to() {
            self.stop_hearing()?;
            // A former holder that takes no requests must not take all the time of the new one.
            let timeout = number.map_or(timeout, |_| timeout / 2);
            // A holder that is gone has forgotten us anyway.
            let _ = self.request_without_reply(former, kind::IGNORE, Limit { timeout, ..limit });
        }
        let Some(to) = number else { return Ok(()) };
        let peer = self.peer(to)?;
        let life = self.request_without_reply(to, kind::LISTEN, limit)?;
        let watch = Some(Watch { peer: to, life });
        let end = self.wait(limit, watch, |_| Ok(self.is_admitted(&peer)?.then_some(())))?;
        let (vector, progress) = (Vector(0), crate::error::Progress::Waiting);
        match end {
            End::Came(()) => {}
            End::Expired { stalled: true } => {
                return Err(Error::Stalled {
                    to,
                    vector,
                    progress,
                });
            }
            End::Expired { stalled: false } => {
                return Err(Error::TimedOut {
                    to,
                    vector,
                    progress,
                });
            }
            End::Died => return Err(Error::PeerDied { to, progress }),
            End::Left => return Err(Error::PeerLeft { to, progress }),
            End::Restarted => return Err(Error::PeerRestarted { to, progress }),
        }
        for (sender, heard) in self.peers().zip(&self.listening.senders) {
            heard.missed.set(0);
            // A sender whose memory is gone sends nothing; it is heard from its next life on.
            let life_of_sender = sender
                .mail
                .load(header::LIFE, LoadOrder::Acquire)
                .unwrap_or(JOINING);
            // What the holder has taken by now was sent before. Its count is of this life of the
            // sender only once it has acknowledged that. Acquire: pairs with the Release store in
            // `acknowledge`.
            let acknowledged = peer.mail.load(
                Mail::<W, N>::acknowledged(sender.number),
                LoadOrder::Acquire,
            )?;
            let taken = if acknowledged == life_of_sender {
                peer.mail
                    .load(Mail::<W, N>::taken(sender.number), LoadOrder::Acquire)?
            } else {
                0
            };
            self.start_hearing(
                sender.number,
                heard,
                layout::epoch(life_of_sender, life),
                taken,
            )?;
        }
        self.listening.life.set(life);
        self.listening.to.set(u32::from(to.0) + 1);
        Ok(())
    }

    /// Forgets to whom this mailbox listens, so that no sender waits for it.
    pub(super) fn stop_hearing(&self) -> Result<(), Error> {
        self.listening.to.set(0);
        self.listening.life.set(0);
        let own = self.own()?;
        for sender in 0..N as u32 {
            // An epoch is never 0. Pairs with the Acquire load in `untaken_by`.
            own.store(layout::listen(sender), 0, StoreOrder::Release)?;
        }
        Ok(())
    }

    /// The number that this mailbox listens to.
    #[must_use]
    pub fn listens_to(&self) -> Option<Processor> {
        self.listening
            .to
            .get()
            .checked_sub(1)
            .map(|number| Processor(number as u8))
    }

    /// How many messages of `sender` to the number listened to came too fast to be heard.
    ///
    /// # Errors
    /// [`Error::NoSuchProcessor`].
    pub fn missed(&self, sender: Processor) -> Result<u32, Error> {
        let heard = self.listening.senders.get(sender.index());
        heard
            .map(|heard| heard.missed.get())
            .ok_or_else(|| Self::no_such(sender))
    }

    /// Whether the holder of the number has set our bit.
    fn is_admitted(&self, holder: &Peer<'_, W, N>) -> Result<bool, Error> {
        // Acquire: pairs with the Release store in `admit_listener`.
        Ok(holder.mail.load(header::LISTENERS, LoadOrder::Acquire)? & 1 << self.me.0 != 0)
    }

    /// Sets or clears the bit of a listener in our header.
    #[cold]
    pub(super) fn admit_listener(&self, listener: Processor, admit: bool) -> Result<(), Error> {
        let own = self.own()?;
        self.exclusion.with(|| {
            let bit = 1 << listener.0;
            let others = own.load(header::LISTENERS, LoadOrder::Relaxed)? & !bit;
            let bits = if admit { others | bit } else { others };
            // Release: pairs with the Acquire load in `is_admitted`.
            own.store(header::LISTENERS, bits, StoreOrder::Release)
        })?;
        // A listener whose memory is gone cannot be waiting.
        let _ = self.wake(&self.peer(listener)?);
        Ok(())
    }

    /// Whether every listener in the set `listeners` has taken what request `sequence` overwrites.
    #[cold]
    pub(super) fn listeners_keep_up(
        &self,
        peer: &Peer<'_, W, N>,
        listeners: u32,
        sequence: u32,
        leave_behind: bool,
    ) -> bool {
        let lagging = &peer.pair.lagging;
        let mut keep_up = true;
        for listener in self
            .peers()
            .filter(|listener| listeners & 1 << listener.number.0 != 0)
        {
            let bit = 1 << listener.number.0;
            if self.untaken_by(&listener, peer.pair.epoch_out.get(), sequence) <= SLOTS {
                lagging.set(lagging.get() & !bit);
            } else if leave_behind {
                lagging.set(lagging.get() | bit);
            } else if lagging.get() & bit == 0 {
                keep_up = false;
            }
        }
        keep_up
    }

    /// How many requests in `epoch` up to `sequence` the listener has not taken; 0 if it has not
    /// begun to hear this epoch, or its memory is gone.
    fn untaken_by(&self, listener: &Peer<'_, W, N>, epoch: u32, sequence: u32) -> u32 {
        let at = layout::listen(u32::from(self.me.0));
        // Acquire: pairs with the Release stores in `start_hearing` and `hear_alone`.
        match listener.mail.load(at, LoadOrder::Acquire) {
            Ok(heard) if heard == epoch => {}
            _ => return 0,
        }
        let count = listener.mail.load(at + 4, LoadOrder::Acquire);
        count.map_or(0, |count| sequence.wrapping_sub(count))
    }

    /// Leaves those listeners behind whose programs are known to have ended.
    pub(super) fn leave_dead_behind(&self, peer: &Peer<'_, W, N>) -> Result<(), Error> {
        let listeners = peer.mail.load(header::LISTENERS, LoadOrder::Relaxed)?;
        for listener in self
            .peers()
            .filter(|listener| listeners & 1 << listener.number.0 != 0)
        {
            if self.doorbell.evidence(listener.number) == Evidence::Dead {
                let lagging = &peer.pair.lagging;
                self.exclusion
                    .with(|| lagging.set(lagging.get() | 1 << listener.number.0));
            }
        }
        Ok(())
    }

    #[cold]
    pub(super) fn wake_listeners(&self, listeners: u32) {
        for listener in self
            .peers()
            .filter(|listener| listeners & 1 << listener.number.0 != 0)
        {
            // A listener whose memory is gone cannot be waiting.
            let _ = self.wake(&listener);
        }
    }

    /// Runs our handler for one message to the number listened to, if there is a new one.
    // Few listen, and all serve: out of the frame of `serve_one`.
    #[inline(never)]
    pub(super) fn hear(&self, deadline: Instant) -> Result<Option<Vector>, Error> {
        let Some(to) = self.listens_to() else {
            return Ok(None);
        };
        let holder = self.peer(to)?;
        for (sender, heard) in self.peers().zip(&self.listening.senders) {
            match self.hear_from(&holder, &sender, heard) {
                Ok(Some(entry)) => {
                    // The sender may wait for us to take it. If its memory is gone, it does not.
                    let _ = self.wake(&sender);
                    return Ok(Some(self.run_heard(to, sender.number, entry, deadline)));
                }
                Ok(None) => {}
                Err(error) => self.fatal(error)?,
            }
        }
        Ok(None)
    }

    // Off the stack when the handler runs.
    #[inline(never)]
    fn hear_from(
        &self,
        holder: &Peer<'_, W, N>,
        sender: &Peer<'_, W, N>,
        heard: &Heard,
    ) -> Result<Option<Entry>, Error> {
        // Acquire, here and below: pairs with the Release store of the life in `join`.
        let holder_life = holder.mail.load(header::LIFE, LoadOrder::Acquire)?;
        if holder_life != self.listening.life.get() && !matches!(holder_life, 0 | JOINING) {
            // The holder began a new life, which has not admitted us yet.
            let asked = self.post_without_reply(holder, kind::LISTEN)?;
            self.listening.life.set(if asked { holder_life } else { 0 });
        }
        self.exclusion.with(|| {
            // Loaded in the section: a context that was interrupted before must not go back to
            // the former epoch and hear the present one twice.
            let holder_life = holder.mail.load(header::LIFE, LoadOrder::Acquire)?;
            let sender_life = sender.mail.load(header::LIFE, LoadOrder::Acquire)?;
            if matches!(holder_life, 0 | JOINING) || matches!(sender_life, 0 | JOINING) {
                return Ok(None);
            }
            let epoch = layout::epoch(sender_life, holder_life);
            if epoch != heard.epoch.get() {
                self.start_hearing(sender.number, heard, epoch, 0)?;
            }
            // Every slot may have been overrun.
            for _ in 0..=SLOTS {
                match self.hear_alone(holder, sender, heard)? {
                    Look::Heard(entry) => return Ok(Some(entry)),
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
        heard: &Heard,
        epoch: u32,
        tail: u32,
    ) -> Result<(), Error> {
        heard.epoch.set(epoch);
        heard.tail.set(tail);
        let own = self.own()?;
        let at = layout::listen(u32::from(sender.0));
        own.store(at, 0, StoreOrder::Relaxed)?;
        own.store(at + 4, tail, StoreOrder::Release)?;
        own.store(at, epoch, StoreOrder::Release)
    }

    fn hear_alone(
        &self,
        holder: &Peer<'_, W, N>,
        sender: &Peer<'_, W, N>,
        heard: &Heard,
    ) -> Result<Look, Error> {
        let depth = self.depth.get();
        if depth >= MAX_DEPTH {
            return Ok(Look::Nothing);
        }
        let next = heard.tail.get().wrapping_add(1);
        let slot = Mail::<W, N>::slot(holder.number, next);
        let found = sender
            .mail
            .load(slot + entry::SEQUENCE, LoadOrder::Acquire)?;
        let ahead = found.wrapping_sub(next);
        let Some(entry) = sender.mail.get(slot, found)? else {
            return Ok(Look::Nothing);
        };
        if entry.epoch == 0
            || entry.epoch != heard.epoch.get()
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
            heard.missed.set(
                heard
                    .missed
                    .get()
                    .wrapping_add(ahead.wrapping_sub(SLOTS).wrapping_add(1)),
            );
            found.wrapping_sub(SLOTS)
        };
        heard.tail.set(tail);
        // Release: pairs with the Acquire load in `untaken_by`; the slot has been read.
        own.store(
            layout::listen(u32::from(sender.number.0)) + 4,
            tail,
            StoreOrder::Release,
        )?;
        if ahead != 0 {
            return Ok(Look::Overrun);
        }
        self.depth.set(depth + 1);
        Ok(Look::Heard(entry))
    }

    fn run_heard(
        &self,
        to: Processor,
        sender: Processor,
        entry: Entry,
        deadline: Instant,
    ) -> Vector {
        let vector = Vector(entry.kind.to_le_bytes()[0]);
        let handler = self.handlers.get(vector.index()).copied().flatten();
        let is_message = matches!(entry.kind & 0xff00, kind::SEND | kind::CALL);
        let finish = FinishHeard {
            mailbox: self,
            handled: handler.is_some() && is_message,
            vector,
        };
        if let (Some(handler), true) = (handler, is_message) {
            handler(&Call {
                messenger: self,
                sender,
                addressee: to,
                vector,
                data: entry.value,
                depth: self.depth.get(),
                deadline,
            });
        }
        drop(finish);
        vector
    }
}

/// Ends a heard message however its handler ends.
struct FinishHeard<'f, 'v, W: MemoryWindow, D: Doorbell, X: Exclusion, const N: usize> {
    mailbox: &'f Mailbox<'v, W, D, X, N>,
    handled: bool,
    vector: Vector,
}

impl<W: MemoryWindow, D: Doorbell, X: Exclusion, const N: usize> Drop
    for FinishHeard<'_, '_, W, D, X, N>
{
    fn drop(&mut self) {
        let mailbox = self.mailbox;
        let deepest = mailbox.depth.get() >= MAX_DEPTH;
        mailbox.exclusion.with(|| {
            mailbox.depth.set(mailbox.depth.get().wrapping_sub(1));
            if self.handled {
                mailbox.served.set(mailbox.served.get().wrapping_add(1));
                if let Ok(own) = mailbox.own() {
                    let at = Mail::<W, N>::vector(self.vector.index()) + layout::vector::HANDLED;
                    // As above.
                    let _ = own.add(at, 1);
                }
            }
        });
        if deepest {
            // As in `finish`.
            mailbox.ring_again();
        }
    }
}

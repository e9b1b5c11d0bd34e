//! Taking requests from the rings and running their handlers.

use core::time::Duration;

use super::call::Call;
use super::send::{kind, status};
use super::wait::{End, Limit};
use super::{MAX_DEPTH, Mailbox, Peer};
use crate::doorbell::Doorbell;
use crate::error::Error;
use crate::exclusion::Exclusion;
use crate::id::{Processor, Vector};
use crate::layout::{self, SLOTS, header};
use crate::mail::{Entry, Mail};
use crate::time::Instant;
use crate::window::{LoadOrder, MemoryWindow, StoreOrder};

/// Stands for the vector of a request that ran no handler.
const NO_VECTOR: Vector = Vector(u8::MAX);

/// A request that has been taken: nobody else will run it.
#[derive(Clone, Copy)]
struct Taken {
    sender: Processor,
    life: u32,
    sequence: u32,
    entry: Entry,
    depth: u32,
}

impl<W: MemoryWindow, D: Doorbell, X: Exclusion, const N: usize> Mailbox<'_, W, D, X, N> {
    /// Serves the requests that are there, without waiting, and says how many it served: for the
    /// mailbox interrupt's handler, and for event loops.
    ///
    /// Serves at most a ringful for each sender, so that nobody can keep an interrupt busy for
    /// ever; nested calls of the handlers end `timeout` from now at the latest. If there may be
    /// more, and rings are [always](Self::ring_always) wanted, it rings this processor again.
    ///
    /// # Errors
    /// [`Error::NotJoined`]; [`Error::Window`] if the own memory is gone.
    pub fn service(&self, timeout: Duration) -> Result<usize, Error> {
        self.check_joined()?;
        let mut now = self.doorbell.now();
        let deadline = now.after(timeout);
        let most = N * SLOTS as usize;
        for served in 0..most {
            let Some(vector) = self.serve_one(deadline)? else {
                return Ok(served);
            };
            let begun = core::mem::replace(&mut now, self.doorbell.now());
            self.note_time(vector, now.ns_since(begun))?;
        }
        self.ring_again();
        Ok(most)
    }

    /// Rings this processor, if its doorbell is what makes it look, for requests that are left.
    pub(super) fn ring_again(&self) {
        if self.always {
            self.doorbell.ring(self.me);
        }
    }

    /// Waits until at least one request has been served, for at most `timeout`, and says how many
    /// were: for the background of a processor that has nothing else to do.
    ///
    /// A spinning mailbox goes on as long as requests follow each other closely, to a ringful for
    /// each sender. The handlers' nested calls end with `timeout`, too: in a loop, give it as long
    /// as they may take.
    ///
    /// # Errors
    /// [`Error::NotJoined`]; [`Error::Window`] if the own memory is gone.
    pub fn serve(&self, timeout: Duration) -> Result<usize, Error> {
        self.check_joined()?;
        let limit = Limit {
            timeout,
            enclosing: Instant::FOREVER,
        };
        let before = self.served.get();
        let most = N * SLOTS as usize;
        let served = || self.served.get().wrapping_sub(before) as usize;
        let end = self.wait(limit, None, |idle| {
            let served = served();
            Ok((served >= most || (idle && served > 0)).then_some(served))
        })?;
        Ok(match end {
            End::Came(served) => served,
            _ => served(),
        })
    }

    fn check_joined(&self) -> Result<(), Error> {
        if self.life.get() == 0 {
            Err(Error::NotJoined { number: self.me })
        } else {
            Ok(())
        }
    }

    /// Beats the heart, notices who came and went, and serves one request, if there is one; gives
    /// the vector whose handler ran.
    pub(super) fn serve_one(&self, deadline: Instant) -> Result<Option<Vector>, Error> {
        self.attend()?;
        for number in self.in_turn() {
            let peer = self.peer(number)?;
            if self
                .next_carries(&peer)
                .or_else(|error| self.fatal(error).map(|()| false))?
                && let Some(vector) = self.serve_next_of(&peer, deadline)?
            {
                return Ok(Some(vector));
            }
        }
        self.hear(deadline)
    }

    /// As `serve_one`, beginning with `sender`, whose ring seems to hold a request; all else waits
    /// until that has been answered.
    #[inline(always)]
    pub(super) fn serve_first(
        &self,
        sender: Processor,
        deadline: Instant,
    ) -> Result<Option<Vector>, Error> {
        match self.serve_next_of(&self.peer(sender)?, deadline)? {
            None => self.serve_one(deadline),
            served => self.attend().map(|()| served),
        }
    }

    /// Beats the heart, and notices who came and went.
    fn attend(&self) -> Result<(), Error> {
        let beat = self.beats.get().wrapping_add(1);
        self.beats.set(beat);
        self.own()?
            .store(header::HEARTBEAT, beat, StoreOrder::Relaxed)?;
        for peer in self.peers() {
            self.notice(&peer).or_else(|error| self.fatal(error))?;
        }
        Ok(())
    }

    /// Serves the next request of `peer`, if it is there.
    ///
    /// A life of `peer` that has not been noticed is no harm: its requests have another epoch.
    #[inline(never)]
    fn serve_next_of(
        &self,
        peer: &Peer<'_, W, N>,
        deadline: Instant,
    ) -> Result<Option<Vector>, Error> {
        match self.take(peer) {
            Ok(Some(taken)) => self.run(peer, taken, deadline).map(Some),
            Ok(None) => Ok(None),
            Err(error) => self.fatal(error).map(|()| None),
        }
    }

    /// Whose ring seems to hold a request: one load for each.
    #[inline(always)]
    pub(super) fn glance(&self) -> Result<Option<Processor>, Error> {
        for number in self.in_turn() {
            match self.next_carries(&self.peer(number)?) {
                Ok(false) => {}
                Ok(true) => return Ok(Some(number)),
                Err(error) => self.fatal(error)?,
            }
        }
        Ok(None)
    }

    /// Everybody, beginning after who was served last.
    #[inline(always)]
    fn in_turn(&self) -> impl Iterator<Item = Processor> {
        let first = self.turn.get() as u8;
        (first..N as u8).chain(0..first).map(Processor)
    }

    #[inline(always)]
    fn next_carries(&self, peer: &Peer<'_, W, N>) -> Result<bool, Error> {
        let next = peer.pair.tail.get().wrapping_add(1);
        peer.mail.carries(Mail::<W, N>::slot(self.me, next), next)
    }

    /// What is wrong with a peer concerns those who wait for it, not those who serve others.
    pub(super) fn fatal(&self, error: Error) -> Result<(), Error> {
        match error {
            Error::Window { processor, .. } if processor == self.me => Err(error),
            _ => Ok(()),
        }
    }

    // Off the stack when the handler runs.
    #[inline(never)]
    fn take(&self, peer: &Peer<'_, W, N>) -> Result<Option<Taken>, Error> {
        self.exclusion.with(|| self.take_alone(peer))
    }

    /// Reading the slot and moving the cursor are one section: a request is taken once.
    #[inline(always)]
    fn take_alone(&self, peer: &Peer<'_, W, N>) -> Result<Option<Taken>, Error> {
        let pair = peer.pair;
        let depth = self.depth.get();
        if depth >= MAX_DEPTH {
            return Ok(None);
        }
        let sequence = pair.tail.get().wrapping_add(1);
        let slot = Mail::<W, N>::slot(self.me, sequence);
        let Some(entry) = peer.mail.get(slot, sequence)? else {
            return Ok(None);
        };
        // Nothing is taken from a peer that has not been acknowledged: then the epoch here is 0,
        // which only a peer that breaks the rules writes.
        if entry.epoch != pair.epoch_in.get() || entry.epoch == 0 {
            return Ok(None);
        }
        let own = self.own()?;
        pair.tail.set(sequence);
        // Release: pairs with the Acquire load in `refresh_taken`; the slot has been read.
        own.store(
            Mail::<W, N>::taken(peer.number),
            sequence,
            StoreOrder::Release,
        )?;
        self.depth.set(depth + 1);
        let next = u32::from(peer.number.0) + 1;
        self.turn.set(if next < N as u32 { next } else { 0 });
        let life = pair.life.get();
        Ok(Some(Taken {
            sender: peer.number,
            life,
            sequence,
            entry,
            depth: depth + 1,
        }))
    }

    #[inline(always)]
    fn run(&self, peer: &Peer<'_, W, N>, taken: Taken, deadline: Instant) -> Result<Vector, Error> {
        let Entry { value, kind, .. } = taken.entry;
        let vector = Vector(kind.to_le_bytes()[0]);
        if kind & 0xff00 != kind::CALL {
            // The sender may wait for the slot. If its memory is gone, it does not.
            let _ = self.wake(peer);
        }
        let mut finish = Finish {
            mailbox: self,
            peer,
            taken: &taken,
            outcome: (status::HANDLER_FAILED, 0),
        };
        finish.outcome = match kind & 0xff00 {
            kind::SEND | kind::CALL => match self.handlers.get(vector.index()).copied().flatten() {
                Some(handler) => {
                    let call = Call {
                        messenger: self,
                        sender: taken.sender,
                        addressee: self.me,
                        vector,
                        data: value,
                        depth: taken.depth,
                        deadline,
                    };
                    (status::DONE, handler(&call))
                }
                None => (status::NO_HANDLER, 0),
            },
            kind @ (kind::LISTEN | kind::IGNORE) => {
                self.admit_listener(taken.sender, kind == kind::LISTEN)?;
                (status::NO_HANDLER, 0)
            }
            _ => (status::NO_HANDLER, 0),
        };
        // `drop` is for handlers that panic, and out of the way. Errors are dropped as there.
        let outcome = finish.outcome;
        core::mem::forget(finish);
        let _ = self.finish(peer, &taken, outcome);
        let handled = outcome.0 == status::DONE;
        Ok(if handled { vector } else { NO_VECTOR })
    }

    /// Counts a handled request and replies, if a reply is wanted and its sender still lives the
    /// life in which it asked.
    // Not on the stack while the handler runs.
    #[inline(never)]
    fn finish(
        &self,
        peer: &Peer<'_, W, N>,
        taken: &Taken,
        outcome: (u32, u32),
    ) -> Result<(), Error> {
        let Entry { kind, epoch, .. } = taken.entry;
        let (status, value) = outcome;
        let replies = kind & 0xff00 == kind::CALL;
        let deepest = self.depth.get() >= MAX_DEPTH;
        let own = self.own()?;
        self.exclusion.with(|| {
            self.depth.set(self.depth.get().wrapping_sub(1));
            self.served.set(self.served.get().wrapping_add(1));
            let vector = usize::from(kind.to_le_bytes()[0]);
            let is_message = matches!(kind & 0xff00, kind::SEND | kind::CALL);
            if is_message && status == status::DONE && vector < Vector::COUNT {
                own.add(Mail::<W, N>::vector(vector) + layout::vector::HANDLED, 1)?;
            }
            if replies && peer.pair.life.get() == taken.life {
                let cell = Mail::<W, N>::cell(peer.number, kind >> kind::CELL_SHIFT);
                own.put(
                    cell,
                    taken.sequence,
                    Entry {
                        value,
                        epoch,
                        kind: status,
                    },
                )?;
            }
            Ok(())
        })?;
        if deepest {
            // What came meanwhile was refused for want of depth, and its ring was taken.
            self.ring_again();
        }
        if replies { self.wake(peer) } else { Ok(()) }
    }

    /// Notes that a handler took `ns`, from the clock's reading before the look that found its
    /// message until the one after its reply.
    pub(super) fn note_time(&self, vector: Vector, ns: u64) -> Result<(), Error> {
        if vector.index() >= Vector::COUNT {
            return Ok(());
        }
        let own = self.own()?;
        let at = Mail::<W, N>::vector(vector.index()) + layout::vector::WORST;
        let ns = u32::try_from(ns).unwrap_or(u32::MAX);
        if ns <= own.load(at, LoadOrder::Relaxed)? {
            return Ok(());
        }
        self.exclusion.with(|| {
            if ns > own.load(at, LoadOrder::Relaxed)? {
                own.store(at, ns, StoreOrder::Relaxed)?;
            }
            Ok(())
        })
    }
}

/// Ends a request however its handler ends; a panic on a hosted processor is a failed request.
struct Finish<'f, 'v, W: MemoryWindow, D: Doorbell, X: Exclusion, const N: usize> {
    mailbox: &'f Mailbox<'v, W, D, X, N>,
    peer: &'f Peer<'f, W, N>,
    taken: &'f Taken,
    outcome: (u32, u32),
}

impl<W: MemoryWindow, D: Doorbell, X: Exclusion, const N: usize> Drop
    for Finish<'_, '_, W, D, X, N>
{
    #[cold]
    fn drop(&mut self) {
        // A sender whose memory is gone cannot wait for its reply; ours is noticed at the next look.
        let _ = self.mailbox.finish(self.peer, self.taken, self.outcome);
    }
}

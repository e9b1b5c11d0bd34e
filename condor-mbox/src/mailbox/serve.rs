//! Taking requests from the rings and running their handlers.

use core::cell::Cell;
use core::time::Duration;

use super::Mailbox;
use super::messenger::Call;
use super::pace::Pace;
use super::peer::Peer;
use super::wait::End;
use crate::backend::Backend;
use crate::doorbell::Doorbell as _;
use crate::error::MailboxError;
use crate::exclusion::Exclusion as _;
use crate::id::{Processor, Vector};
use crate::layout::vector::{HANDLED, WORST};
use crate::layout::{SLOTS, header, kind, status};
use crate::mail::{At, Entry, Mail};
use crate::time::{Clock as _, Instant};
use crate::window::{LoadOrder, StoreOrder};

/// The number of rings that a glance examines. In a system of more processors, these are the ring
/// of the peer that was served last and the next ones in turn; so a glance costs the same in every
/// system.
const PROBES: usize = 4;

/// Marks the number of the peer that was served last, until the other peers have been examined.
const FRESH: u32 = 1 << 8;

/// The data for the reply to a request that was taken. No other context runs that request.
#[derive(Clone, Copy)]
struct ReplyData {
    incarnation: u32,
    sequence: u32,
    epoch: u32,
    kind: u32,
}

impl<B: Backend, const N: usize> Mailbox<'_, B, N> {
    /// Does the work of [`Messenger::serve`](super::Messenger::serve), and of `serve_for` with `whom`.
    pub(super) fn serve_within(
        &self,
        timeout: Duration,
        whom: Option<Processor>,
    ) -> Result<usize, MailboxError> {
        self.check_joined()?;
        let begun = self.doorbell.now();
        let most = N * SLOTS as usize;
        let before = self.served.get();
        let served = || self.served.get().wrapping_sub(before) as usize;
        let outcome = if timeout.is_zero() {
            self.serve_present(begun, Instant::FOREVER)
        } else if let Some(whom) = whom.filter(|_| Pace::of(&self.doorbell).serves_first()) {
            // The caller looks after each ring what `whom` has done.
            let seen = self.doorbell.prepare();
            match self.serve_present(begun, Instant::FOREVER) {
                Ok(0) => {
                    self.doorbell.wait(seen, begun.after(timeout), Some(whom));
                    self.serve_present(begun, Instant::FOREVER)
                }
                other => other,
            }
        } else {
            self.wait(begun, begun.after(timeout), None, |idle| {
                let served = served();
                Ok((served >= most || (idle && served > 0)).then_some(served))
            })
            .map(|end| match end {
                End::Came(served) => served,
                _ => served(),
            })
        };
        #[cfg(feature = "async")]
        self.tasks.wake();
        outcome
    }

    /// Serves what is there: one walk over all rings, and a ringful of each.
    pub(super) fn serve_present(
        &self,
        mut now: Instant,
        deadline: Instant,
    ) -> Result<usize, MailboxError> {
        self.beat()?;
        let (mut count, mut more) = (0, false);
        for peer in &self.peers {
            if peer.present() != peer.incarnation.get() {
                self.attend(peer);
            }
            if peer.has_request() {
                let mut served = 0;
                while self.serve_next(peer, deadline, &mut now) {
                    served += 1;
                    if served == SLOTS as usize || !peer.has_request() {
                        break;
                    }
                }
                count += served;
                more |= served == SLOTS as usize;
            }
        }
        if self.listens_to().is_some() {
            let most = count + N * SLOTS as usize;
            while count < most && self.hear(deadline)? {
                count += 1;
            }
            more |= count == most;
        }
        if more {
            self.ring_again();
        }
        Ok(count)
    }

    /// Rings this processor, if its doorbell is what makes it look, for requests that are left.
    pub(super) fn ring_again(&self) {
        if self.always {
            self.doorbell.ring(self.me);
        }
    }

    /// Increments the heartbeat, notices peers that have joined or left, and serves one request, if
    /// there is one. `now` is the latest reading of the clock, before and after the call.
    pub(super) fn serve_one(
        &self,
        deadline: Instant,
        now: &mut Instant,
    ) -> Result<bool, MailboxError> {
        self.beat()?;
        for peer in &self.peers {
            if peer.present() != peer.incarnation.get() {
                self.attend(peer);
            }
        }
        for peer in self.in_turn() {
            if peer.has_request() && self.serve_next(peer, deadline, now) {
                self.turn.set(u32::from(peer.number.0));
                return Ok(true);
            }
        }
        let heard = self.listens_to().is_some() && self.hear(deadline)?;
        if heard {
            *now = self.doorbell.now();
        }
        Ok(heard)
    }

    /// Notices that `peer` has joined or left. Errors of the peer are ignored here: they concern
    /// only calls that wait for that peer.
    #[cold]
    #[inline(never)]
    fn attend(&self, peer: &Peer<B::Window, N>) {
        let _ = self.notice(peer);
    }

    /// Lets this context take messages; returns `None` while a parallel context takes them.
    #[inline(always)]
    pub(super) fn begin_turn(&self) -> Option<Turn<'_, B>> {
        self.exclusion.begin_serving().then(|| Turn {
            me: self.me,
            doorbell: &self.doorbell,
            exclusion: &self.exclusion,
        })
    }

    /// Increments the heartbeat, which shows others that this processor is not stuck. Every call
    /// that serves or waits does so, too. Call this function in a background that makes no such
    /// calls because an interrupt serves.
    ///
    /// # Errors
    /// [`MailboxError::Window`] if this mailbox's own memory is gone.
    #[inline(always)]
    pub fn beat(&self) -> Result<(), MailboxError> {
        let beat = self.beats.get().wrapping_add(1);
        self.beats.set(beat);
        self.own()?
            .store(At::header(header::HEARTBEAT), beat, StoreOrder::Relaxed)
    }

    /// Returns a peer whose ring seems to hold a request. It costs one load for each ring that is
    /// looked at.
    #[inline(always)]
    pub(super) fn glance(&self) -> Option<&Peer<B::Window, N>> {
        if N <= PROBES {
            return self.in_turn().find(|peer| peer.has_request());
        }
        let last = self.last.get();
        let favourite = self.peers.get((last & !FRESH) as usize)?;
        // Not twice in a row before the others: nobody can keep them from being served.
        if last & FRESH == 0 && favourite.has_request() {
            return Some(favourite);
        }
        let mut next = self.turn.get() as usize;
        for _ in 0..PROBES {
            next = if next + 1 < N { next + 1 } else { 0 };
            if let Some(peer) = self.peers.get(next)
                && peer.has_request()
            {
                self.turn.set(next as u32);
                return Some(peer);
            }
        }
        self.turn.set(next as u32);
        if last & FRESH == 0 {
            return None;
        }
        self.last.set(last & !FRESH);
        favourite.has_request().then_some(favourite)
    }

    /// Iterates over all peers, beginning after the one that was served last.
    #[inline(always)]
    fn in_turn(&self) -> impl Iterator<Item = &Peer<B::Window, N>> {
        let first = self.turn.get() as usize;
        (1..=N).filter_map(move |step| {
            let at = first + step;
            self.peers.get(if at < N { at } else { at - N })
        })
    }

    /// Serves the next request of `peer`, if it is there; `now` is the latest reading of the clock,
    /// before and after.
    ///
    /// An incarnation of `peer` that has not been noticed does no harm: its requests have another epoch.
    #[inline(never)]
    pub(super) fn serve_next(
        &self,
        peer: &Peer<B::Window, N>,
        deadline: Instant,
        now: &mut Instant,
    ) -> bool {
        let Ok(own) = self.own() else { return false };
        let Some(_turn) = self.begin_turn() else {
            return false;
        };
        let Some((taken, data, depth)) = self.exclusion.with(|| self.take(peer, &own)) else {
            return false;
        };
        let kind = taken.kind;
        let vector = Vector(kind.to_le_bytes()[0]);
        let unfinished = Unfinished {
            mailbox: self,
            peer,
            taken,
        };
        let (status, value) = match (kind & 0xff00, self.handlers.get(vector.index())) {
            (kind @ (kind::SEND | kind::CALL), Some(Some(handler))) => {
                if kind == kind::SEND {
                    // The sender may wait for the slot.
                    self.notify(peer.mail());
                }
                let call = Call {
                    messenger: self,
                    sender: peer.number,
                    incarnation: unfinished.taken.incarnation,
                    addressee: self.me,
                    vector,
                    data,
                    depth,
                    deadline,
                    refused: Cell::new(false),
                };
                let value = handler(&call);
                let refused = call.refused.get();
                (
                    if refused {
                        status::REFUSED
                    } else {
                        status::DONE
                    },
                    value,
                )
            }
            (kind, _) => {
                self.serve_otherwise(peer, kind);
                (status::NO_HANDLER, 0)
            }
        };
        core::mem::forget(unfinished);
        self.finish::<false>(peer, &own, &taken, (status, value));
        // The time of a handler begins with the last reading of the clock before its message was found.
        let begun = core::mem::replace(now, self.doorbell.now());
        if status != status::NO_HANDLER {
            let at = At::<N>::vector(vector, WORST);
            let ns = u32::try_from(now.ns_since(begun)).unwrap_or(u32::MAX);
            if ns > own.look(at, LoadOrder::Relaxed) {
                self.note_worst(at, ns);
            }
        }
        true
    }

    /// A request for no handler.
    #[cold]
    #[inline(never)]
    fn serve_otherwise(&self, peer: &Peer<B::Window, N>, kind: u32) {
        if kind == kind::LISTEN || kind == kind::IGNORE {
            // If this mailbox's own memory is gone, the next look says so.
            let _ = self.admit_listener(peer, kind == kind::LISTEN);
        }
        // The sender may wait for the slot.
        self.notify(peer.mail());
    }

    /// Takes the next request; returns it, with its data and the depth of its handler.
    ///
    /// Reading the slot and moving the cursor are one section: a request is taken once.
    #[inline(always)]
    fn take(
        &self,
        peer: &Peer<B::Window, N>,
        own: &Mail<'_, B::Window, N>,
    ) -> Option<(ReplyData, u32, u32)> {
        let depth = self.depth.get();
        if depth >= Call::MAX_DEPTH {
            return None;
        }
        let (sequence, entry) = peer.next_request()?;
        // Nothing is taken from a peer that has not been acknowledged: then the epoch here is 0,
        // which only a peer that breaks the rules writes.
        if entry.epoch != peer.epoch_in.get() || entry.epoch == 0 {
            return None;
        }
        peer.set_tail(sequence);
        // Release: pairs with the Acquire load in `refresh_taken`; the slot has been read.
        own.set(peer.ours.taken(), sequence);
        self.depth.set(depth + 1);
        let number = u32::from(peer.number.0);
        if N <= PROBES {
            self.turn.set(number);
        } else {
            self.last.set(number | FRESH);
        }
        let taken = ReplyData {
            incarnation: peer.incarnation.get(),
            sequence,
            epoch: entry.epoch,
            kind: entry.kind,
        };
        Some((taken, entry.value, depth + 1))
    }

    /// Replies, if a reply is wanted and its sender is still in the incarnation in which it asked, and counts
    /// what was handled.
    #[inline(always)]
    fn finish<const PANICKED: bool>(
        &self,
        peer: &Peer<B::Window, N>,
        own: &Mail<'_, B::Window, N>,
        taken: &ReplyData,
        (status, value): (u32, u32),
    ) {
        let ReplyData { kind, epoch, .. } = *taken;
        let replies = kind & 0xff00 == kind::CALL;
        let deepest = self.exclusion.with(|| {
            let depth = self.depth.get();
            self.depth.set(depth.wrapping_sub(1));
            if self.doorbell.ends_serving(peer.number) {
                self.served.set(self.served.get().wrapping_add(1));
            }
            if replies && peer.incarnation.get() == taken.incarnation {
                let cell = peer.ours.cell(kind >> kind::CELL_SHIFT);
                let reply = Entry {
                    value,
                    epoch,
                    kind: status,
                };
                own.put(cell, taken.sequence, reply);
            }
            if !PANICKED && status != status::NO_HANDLER {
                let vector = Vector(kind.to_le_bytes()[0]);
                own.count(At::<N>::vector(vector, HANDLED));
            }
            depth >= Call::MAX_DEPTH
        });
        if replies {
            self.notify(peer.mail());
        }
        if deepest {
            // A request that came meanwhile was refused for want of depth, and its ring was taken.
            self.ring_again();
        }
    }

    #[cold]
    #[inline(never)]
    fn note_worst(&self, at: At<N>, ns: u32) {
        if let Ok(own) = self.own() {
            self.exclusion.with(|| {
                if ns > own.look(at, LoadOrder::Relaxed) {
                    own.set(at, ns);
                }
            });
        }
    }
}

/// The right of a context to take messages, until it is dropped.
pub(super) struct Turn<'t, B: Backend> {
    me: Processor,
    doorbell: &'t B::Doorbell,
    exclusion: &'t B::Exclusion,
}

impl<B: Backend> Drop for Turn<'_, B> {
    #[inline(always)]
    fn drop(&mut self) {
        if self.exclusion.end_serving() {
            self.doorbell.ring(self.me);
        }
    }
}

/// A request whose handler has not ended; a panic on a hosted processor is a failed request.
struct Unfinished<'f, 'v, B: Backend, const N: usize> {
    mailbox: &'f Mailbox<'v, B, N>,
    peer: &'f Peer<B::Window, N>,
    taken: ReplyData,
}

impl<B: Backend, const N: usize> Drop for Unfinished<'_, '_, B, N> {
    #[cold]
    fn drop(&mut self) {
        if let Ok(own) = self.mailbox.own() {
            let failed = (status::HANDLER_FAILED, 0);
            self.mailbox
                .finish::<true>(self.peer, &own, &self.taken, failed);
        }
    }
}

//! Waiting, always with a deadline.

use core::time::Duration;

use super::Mailbox;
use super::pace::Pace;
use crate::backend::Backend;
use crate::doorbell::{Doorbell as _, Evidence};
use crate::error::MailboxError;
use crate::exclusion::Exclusion as _;
use crate::id::Processor;
use crate::layout::{JOINING, header};
use crate::mail::At;
use crate::sync::{Ordering, fence};
use crate::time::{Clock as _, Instant};
use crate::window::{LoadOrder, StoreOrder};

/// The interval at which a waiter asks the platform whether the peer it waits for is alive.
const WATCH: Duration = Duration::from_micros(250);
/// The time for which a waiter waits before it feels the pulse of its peer for the first time: reading the
/// heartbeat takes the line from the peer, which quick answers need not pay for.
const PULSE: Duration = Duration::from_micros(20);

/// The number of rings that are glanced at between two readings of the clock while spinning: a fraction of a
/// microsecond.
pub(super) const GLANCES: usize = if cfg!(condor_loom) { 1 } else { 32 };

/// The way in which a mailbox waits for messages, replies and free slots.
///
/// ```
/// # use std::time::Duration;
/// # use condor_mbox::{MailboxError, Processor, Waiting, sim::SimSystem};
/// # fn main() -> Result<(), MailboxError> {
/// # let mut mailbox = SimSystem::<2>::in_real_time(4096).mailbox(Processor(0))?;
/// mailbox.set_waiting(Waiting::SpinThenSleep { spin: Duration::from_micros(20) });
/// # Ok(())
/// # }
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Waiting {
    /// Looks again and again, without sleeping: fastest, but takes a whole core.
    Spin,
    /// Spins for a time, then sleeps. (The limit is a time and not a number of looks: a preemption
    /// would use up such a number, and every later wait would sleep.)
    SpinThenSleep {
        /// The time to spin before each sleep.
        spin: Duration,
    },
    /// Sleeps until the doorbell rings: on Linux in the kernel, on bare metal by waiting for an
    /// interrupt.
    Sleep,
}

impl Default for Waiting {
    /// Spins for 50 µs, a few times a wake-up by the kernel.
    fn default() -> Self {
        Self::SpinThenSleep {
            spin: Duration::from_micros(50),
        }
    }
}

/// The peer on which a wait depends, and what ends it early.
#[derive(Clone, Copy)]
pub(super) struct Watch {
    pub(super) peer: Processor,
    /// The wait ends with this incarnation, or with any if it is 0; `None` if no end ends it.
    pub(super) incarnation: Option<u32>,
}

/// The way in which a wait ended.
pub(super) enum End<T> {
    /// The event that was waited for came.
    Came(T),
    /// The deadline passed; `stalled` if the peer's heart did not beat meanwhile.
    Expired { stalled: bool },
    /// The program of the peer ended.
    Died,
    /// The peer left the system.
    Left,
    /// The peer is in another incarnation.
    Restarted,
}

impl<B: Backend, const N: usize> Mailbox<'_, B, N> {
    /// Sets the way in which this mailbox waits for messages, replies and free slots.
    pub fn set_waiting(&mut self, waiting: Waiting) {
        self.waiting = waiting;
    }

    /// Asks senders to ring this processor's doorbell for every message, even if nothing waits
    /// here, if `always` is true. With `false`, they ring it again only while this mailbox sleeps.
    ///
    /// Call it on a processor that [serves](super::Messenger::serve) from its mailbox interrupt,
    /// and in a program that watches its doorbell's descriptor in an event loop. The call itself
    /// rings this processor's own doorbell once, for messages that were sent before.
    ///
    /// # Errors
    /// [`MailboxError::Window`] if this mailbox's own memory cannot be accessed.
    pub fn ring_always(&mut self, always: bool) -> Result<(), MailboxError> {
        let step = match (self.always, always) {
            (false, true) => 1,
            (true, false) => u32::MAX,
            _ => return Ok(()),
        };
        self.always = always;
        self.want_rings(step)?;
        // Pairs with the fence in `notify`: what was sent without a ring is seen by who answers this.
        fence(Ordering::SeqCst);
        self.ring_again();
        Ok(())
    }

    /// Waits until `peer` has joined and messages pass both ways, for at most `timeout`, and serves
    /// messages meanwhile. Returns the peer's incarnation.
    ///
    /// If `former` is an incarnation, the call waits for another one: for a peer that is about to
    /// restart.
    ///
    /// # Errors
    /// [`MailboxError::NotConnected`] if `peer` has not joined after `timeout`;
    /// [`MailboxError::NoSuchProcessor`] if no processor has the number;
    /// [`MailboxError::NotJoined`] if this mailbox has not joined; [`MailboxError::Layout`] if the
    /// peer belongs to another system; [`MailboxError::Window`] if memory cannot be accessed.
    pub fn wait_for_peer(
        &self,
        peer: Processor,
        former: Option<u32>,
        timeout: Duration,
    ) -> Result<u32, MailboxError> {
        self.check_joined()?;
        let known = self.peer(peer)?;
        let begun = self.doorbell.now();
        let mut refused = Ok(());
        let look = |_| {
            if known.present() != known.incarnation.get() {
                refused = self.notice(known);
            }
            let incarnation = known.incarnation.get();
            let there = incarnation != 0
                && Some(incarnation) != former
                && self.is_connected(known)
                && self.doorbell.evidence(peer) != Evidence::Dead;
            Ok(there.then_some(incarnation))
        };
        let watch = Some(Watch {
            peer,
            incarnation: None,
        });
        match self.wait(begun, begun.after(timeout), watch, look)? {
            End::Came(incarnation) => Ok(incarnation),
            _ => refused.and(Err(MailboxError::NotConnected { to: peer })),
        }
    }

    /// Waits until `look` finds something, serving one request per look meanwhile.
    ///
    /// `look` is told whether all rings are empty, as far as was seen.
    pub(super) fn wait<T>(
        &self,
        begun: Instant,
        deadline: Instant,
        watch: Option<Watch>,
        mut look: impl FnMut(bool) -> Result<Option<T>, MailboxError>,
    ) -> Result<End<T>, MailboxError> {
        let pace = Pace::of(&self.doorbell);
        if pace.serves_first() {
            self.serve_present(begun, deadline)?;
        }
        let mut now = begun;
        let mut spin_until = self.spin_end(now);
        let mut ask_at = now.after(WATCH);
        let feel_at = now.after(PULSE);
        let mut first_beat = None;
        let mut rings = None;
        loop {
            // Most of the time of a spin is spent here, so what comes is seen at once; the reading
            // of the clock between two bursts gives way to the core's other threads.
            let mut request = None;
            for _ in 0..if now < spin_until { GLANCES } else { 1 } {
                if let Some(found) = look(false)? {
                    return Ok(End::Came(found));
                }
                request = self.glance();
                if request.is_some() {
                    break;
                }
                // A processor that looks all the time keeps taking the line from the one that is about to write
                // it.
                core::hint::spin_loop();
            }
            if request.is_some_and(|peer| self.serve_next(peer, deadline, &mut now))
                || self.serve_one(deadline, &mut now)?
            {
                spin_until = self.spin_end(now);
                if now < deadline && (watch.is_none() || now < ask_at) {
                    continue;
                }
            } else {
                now = self.doorbell.now();
            }
            if let Some(found) = look(true)? {
                return Ok(End::Came(found));
            }
            let mut end = None;
            if let Some(watch) = watch {
                let ask = pace.asks(now, ask_at);
                if ask {
                    ask_at = now.after(WATCH);
                }
                end = self.fate(watch, ask)?;
            }
            if end.is_none() && now >= deadline {
                let beat = watch.and_then(|watch| self.heartbeat(watch.peer));
                end = Some(End::Expired {
                    // A heart that nobody needs to feel may stand still.
                    stalled: beat.is_some() && beat == first_beat && pace.feels_hearts(),
                });
            }
            if let Some(end) = end {
                // A message that came just before the end still counts.
                return Ok(look(true)?.map_or(end, End::Came));
            }
            if first_beat.is_none() && now >= feel_at {
                first_beat = watch.and_then(|watch| self.heartbeat(watch.peer));
            }
            if now < spin_until {
                continue;
            }
            if rings.is_none() {
                rings = Some(Rings::want(self)?);
            }
            // Pairs with the fence in `notify`: either the sender sees that we want to be rung, or
            // the looks that follow see what it sent.
            fence(Ordering::SeqCst);
            let seen = self.doorbell.prepare();
            let served = self.serve_one(deadline, &mut now)?;
            if served {
                spin_until = self.spin_end(now);
            }
            if let Some(found) = look(true)? {
                return Ok(End::Came(found));
            }
            // Behind what was served there may be more that rang before.
            if !served {
                let asks = watch.is_some_and(|watch| watch.incarnation.is_some());
                let until = pace.sleep_end(now, asks.then_some(ask_at), deadline);
                // The sleep may last until the deadline.
                if first_beat.is_none() {
                    first_beat = watch.and_then(|watch| self.heartbeat(watch.peer));
                }
                let whom = watch.map(|watch| watch.peer);
                self.doorbell.wait(seen, until, whom);
                now = self.doorbell.now();
            }
        }
    }

    fn spin_end(&self, now: Instant) -> Instant {
        match self.waiting {
            Waiting::Spin => Instant::FOREVER,
            Waiting::SpinThenSleep { spin } => now.after(spin),
            Waiting::Sleep => now,
        }
    }

    /// Returns the end of the wait if the peer of `watch` ended or began an incarnation; asks the platform too if
    /// `ask`.
    fn fate<T>(&self, watch: Watch, ask: bool) -> Result<Option<End<T>>, MailboxError> {
        let Some(incarnation) = watch.incarnation else {
            return Ok(None);
        };
        let dead = ask && self.doorbell.evidence(watch.peer) == Evidence::Dead;
        // Loaded after the platform was asked: a program that died and was replaced is a restart.
        let present = self.peer(watch.peer)?.load_present()?;
        Ok(match (incarnation, present) {
            (0, 0) => None,
            (was, is) if was == is => dead.then_some(End::Died),
            (0, _) => dead.then_some(End::Died),
            (_, 0) => Some(End::Left),
            (_, JOINING) if dead => Some(End::Died),
            (_, _) => Some(End::Restarted),
        })
    }

    fn heartbeat(&self, peer: Processor) -> Option<u32> {
        if peer == self.me {
            return None;
        }
        let mail = self.peer(peer).ok()?.mail();
        mail.load(At::header(header::HEARTBEAT), LoadOrder::Relaxed)
            .ok()
    }

    /// Adds `step` to the number of contexts that want to be rung.
    fn want_rings(&self, step: u32) -> Result<(), MailboxError> {
        let own = self.own()?;
        self.exclusion.with(|| {
            let waiters = self.waiters.get().wrapping_add(step);
            self.waiters.set(waiters);
            own.store(
                At::header(header::NOTIFY),
                u32::from(waiters > 0),
                StoreOrder::Relaxed,
            )
        })
    }
}

/// Makes senders ring this processor until it is dropped.
struct Rings<'r, 'v, B: Backend, const N: usize> {
    mailbox: &'r Mailbox<'v, B, N>,
}

impl<'r, 'v, B: Backend, const N: usize> Rings<'r, 'v, B, N> {
    fn want(mailbox: &'r Mailbox<'v, B, N>) -> Result<Self, MailboxError> {
        mailbox.want_rings(1)?;
        Ok(Self { mailbox })
    }
}

impl<B: Backend, const N: usize> Drop for Rings<'_, '_, B, N> {
    fn drop(&mut self) {
        // If our own memory is gone, nobody can send to it.
        let _ = self.mailbox.want_rings(u32::MAX);
    }
}

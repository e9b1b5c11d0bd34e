//! Waiting, always with a deadline.

use core::time::Duration;

use super::Mailbox;
use crate::doorbell::{Doorbell, Evidence};
use crate::error::Error;
use crate::exclusion::Exclusion;
use crate::id::Processor;
use crate::layout::{JOINING, header};
use crate::sync::{Ordering, fence};
use crate::time::Instant;
use crate::window::{LoadOrder, MemoryWindow, StoreOrder};

/// How often a waiter asks the platform whether the peer it waits for is alive.
const WATCH: Duration = Duration::from_micros(250);
/// How long a waiter waits before it feels the pulse of its peer for the first time: reading the
/// heartbeat takes the line from the peer, which quick answers need not pay for.
const PULSE: Duration = Duration::from_micros(20);
/// How long a sleep lasts at most, so that a lost doorbell only delays.
const NAP: Duration = Duration::from_millis(10);

/// How many rings are glanced at between two readings of the clock while spinning: a fraction of a
/// microsecond.
const GLANCES: usize = if cfg!(condor_loom) { 1 } else { 32 };

/// How a mailbox waits.
///
/// ```
/// # use std::time::Duration;
/// # use condor_mbox::{Error, Processor, Waiting, sim::System};
/// # fn main() -> Result<(), Error> {
/// # let mut mailbox = System::<2>::in_real_time(4096).mailbox(Processor(0))?;
/// mailbox.set_waiting(Waiting::SpinThenSleep { spin: Duration::from_micros(20) });
/// # Ok(())
/// # }
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Waiting {
    /// Look again and again: fastest, takes a core.
    Spin,
    /// Spin for a time, then sleep. The budget is time, not looks: after a preemption a budget of
    /// looks is gone and every later wait sleeps, too.
    SpinThenSleep {
        /// How long to spin before each sleep.
        spin: Duration,
    },
    /// Sleep until the doorbell rings: on Linux in the kernel, on bare metal waiting for an
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

/// How long a wait may last, and whether it serves.
#[derive(Clone, Copy)]
pub(super) struct Limit {
    pub(super) timeout: Duration,
    /// The end of the enclosing wait.
    pub(super) enclosing: Instant,
}

/// Whom a wait depends on, and in which life; 0 for any.
#[derive(Clone, Copy)]
pub(super) struct Watch {
    pub(super) peer: Processor,
    pub(super) life: u32,
}

/// What a burst of glances found.
enum Glimpse<T> {
    /// What is waited for.
    Found(T),
    /// A request of this processor, it seems.
    Request(Processor),
    Nothing,
}

/// How a wait ended.
pub(super) enum End<T> {
    /// What was waited for came.
    Came(T),
    /// The deadline passed; `stalled` if the peer's heart did not beat meanwhile.
    Expired { stalled: bool },
    /// The program of the peer ended.
    Died,
    /// The peer left the system.
    Left,
    /// The peer is in another life.
    Restarted,
}

impl<W: MemoryWindow, D: Doorbell, X: Exclusion, const N: usize> Mailbox<'_, W, D, X, N> {
    /// Chooses how this mailbox waits; see [`Waiting`].
    pub fn set_waiting(&mut self, waiting: Waiting) {
        self.waiting = waiting;
    }

    /// Asks senders to ring the doorbell for every message, also while nobody waits.
    ///
    /// For a processor that [serves](Self::service) from its mailbox interrupt, and for one that
    /// watches its doorbell's descriptor in an event loop. It is rung at once, for what was sent
    /// before. Undone by `false`.
    ///
    /// # Errors
    /// [`Error::Window`].
    pub fn ring_always(&mut self, always: bool) -> Result<(), Error> {
        let step = match (self.always, always) {
            (false, true) => 1,
            (true, false) => u32::MAX,
            _ => return Ok(()),
        };
        self.always = always;
        self.want_rings(step)?;
        // Pairs with the fence in `wake`: what was sent without a ring is seen by who answers this.
        fence(Ordering::SeqCst);
        self.ring_again();
        Ok(())
    }

    /// Waits until `look` finds something, serving one request per look meanwhile.
    ///
    /// `look` is told whether all rings are empty, as far as was seen.
    pub(super) fn wait<T>(
        &self,
        limit: Limit,
        watch: Option<Watch>,
        mut look: impl FnMut(bool) -> Result<Option<T>, Error>,
    ) -> Result<End<T>, Error> {
        // Before the first look: a handler's time begins here, and whoever has just sent a request
        // has nothing to see yet.
        let mut now = self.doorbell.now();
        let deadline = now.after(limit.timeout).min(limit.enclosing);
        let mut spin_until = self.spin_end(now);
        let mut ask_at = now.after(WATCH);
        let feel_at = now.after(PULSE);
        let mut first_beat = None;
        let mut rings = None;
        loop {
            let served = match self.burst(now < spin_until, &mut look)? {
                Glimpse::Found(found) => return Ok(End::Came(found)),
                Glimpse::Request(sender) => self.serve_first(sender, deadline)?,
                Glimpse::Nothing => self.serve_one(deadline)?,
            };
            let begun = core::mem::replace(&mut now, self.doorbell.now());
            if let Some(vector) = served {
                self.note_time(vector, now.ns_since(begun))?;
                spin_until = self.spin_end(now);
                if now < deadline && (watch.is_none() || now < ask_at) {
                    continue;
                }
            }
            if let Some(found) = look(true)? {
                return Ok(End::Came(found));
            }
            let mut end = None;
            if let Some(watch) = watch {
                let ask = now >= ask_at;
                if ask {
                    ask_at = now.after(WATCH);
                }
                end = self.fate(watch, ask)?;
            }
            if end.is_none() && now >= deadline {
                let beat = watch.and_then(|watch| self.heartbeat(watch.peer));
                end = Some(End::Expired {
                    stalled: beat.is_some() && beat == first_beat,
                });
            }
            if let Some(end) = end {
                // What came just before the end still counts.
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
            // Pairs with the fence in `wake`: either the sender sees that we want to be rung, or
            // the looks that follow see what it sent.
            fence(Ordering::SeqCst);
            let seen = self.doorbell.prepare();
            let served = self.serve_one(deadline)?;
            if let Some(vector) = served {
                let begun = core::mem::replace(&mut now, self.doorbell.now());
                self.note_time(vector, now.ns_since(begun))?;
                spin_until = self.spin_end(now);
            }
            if let Some(found) = look(true)? {
                return Ok(End::Came(found));
            }
            // Behind what was served there may be more that rang before.
            if served.is_none() {
                let until = if watch.is_some() {
                    ask_at
                } else {
                    now.after(NAP)
                };
                self.doorbell.wait(seen, until.min(deadline));
                now = self.doorbell.now();
            }
        }
    }

    /// Looks once and, while `spinning`, glances at the rings and looks again for a fraction of a
    /// microsecond.
    ///
    /// Most of the time of a spin is spent here, so what comes is seen at once; the reading of
    /// the clock between two bursts gives way to the core's other threads.
    #[inline(always)]
    fn burst<T>(
        &self,
        spinning: bool,
        look: &mut impl FnMut(bool) -> Result<Option<T>, Error>,
    ) -> Result<Glimpse<T>, Error> {
        let mut left = if spinning {
            const { GLANCES.div_ceil(N) }
        } else {
            0
        };
        loop {
            if let Some(found) = look(false)? {
                return Ok(Glimpse::Found(found));
            }
            if left == 0 {
                return Ok(Glimpse::Nothing);
            }
            left -= 1;
            if let Some(sender) = self.glance()? {
                return Ok(Glimpse::Request(sender));
            }
            // Whoever looks all the time keeps taking the line from who is about to write it.
            core::hint::spin_loop();
        }
    }

    fn spin_end(&self, now: Instant) -> Instant {
        match self.waiting {
            Waiting::Spin => Instant::FOREVER,
            Waiting::SpinThenSleep { spin } => now.after(spin),
            Waiting::Sleep => now,
        }
    }

    /// Whether the peer of `watch` ended or began a life; asks the platform too if `ask`.
    fn fate<T>(&self, watch: Watch, ask: bool) -> Result<Option<End<T>>, Error> {
        let mail = self.peer(watch.peer)?.mail;
        let dead = ask && self.doorbell.evidence(watch.peer) == Evidence::Dead;
        // Acquire: pairs with the Release store of the life in `join`. Loaded after the platform
        // was asked: a program that died and was replaced is a restart.
        let life = mail.load(header::LIFE, LoadOrder::Acquire)?;
        Ok(match (watch.life, life) {
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
        let mail = self.peer(peer).ok()?.mail;
        mail.load(header::HEARTBEAT, LoadOrder::Relaxed).ok()
    }

    /// Adds `step` to the number of contexts that want to be rung.
    fn want_rings(&self, step: u32) -> Result<(), Error> {
        let own = self.own()?;
        self.exclusion.with(|| {
            let waiters = self.waiters.get().wrapping_add(step);
            self.waiters.set(waiters);
            own.store(
                header::ATTENTION,
                u32::from(waiters > 0),
                StoreOrder::Relaxed,
            )
        })
    }
}

/// While it lives, senders ring this processor.
struct Rings<'r, 'v, W: MemoryWindow, D: Doorbell, X: Exclusion, const N: usize> {
    mailbox: &'r Mailbox<'v, W, D, X, N>,
}

impl<'r, 'v, W: MemoryWindow, D: Doorbell, X: Exclusion, const N: usize> Rings<'r, 'v, W, D, X, N> {
    fn want(mailbox: &'r Mailbox<'v, W, D, X, N>) -> Result<Self, Error> {
        mailbox.want_rings(1)?;
        Ok(Self { mailbox })
    }
}

impl<W: MemoryWindow, D: Doorbell, X: Exclusion, const N: usize> Drop
    for Rings<'_, '_, W, D, X, N>
{
    fn drop(&mut self) {
        // If our own memory is gone, nobody can send to it.
        let _ = self.mailbox.want_rings(u32::MAX);
    }
}

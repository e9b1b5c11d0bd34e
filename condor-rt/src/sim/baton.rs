//! [`Baton`]: who runs next.

use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, MutexGuard, OnceLock, PoisonError};
use std::thread::{self, Thread};

use condor_mbox::{Evidence, Processor};

use super::error::Cause;
use crate::numbers::PROCESSORS;

/// The lead, in nanoseconds, at which a background that only reads its clock lets the other
/// processors run. One reading of the clock may exceed it.
pub const LEAD_NS: u64 = 100_000;

/// How long after the end of a run its programs may still take to stop.
const PATIENCE_NS: u64 = 10_000_000_000;

/// An instant that never comes.
pub(super) const NEVER: u64 = u64::MAX;

/// What passes from thread to thread. Its state is changed only by who runs, so nobody waits for the
/// lock.
pub(super) struct Baton {
    state: Mutex<BatonState>,
    /// Who runs.
    holder: AtomicUsize,
    /// Each processor's thread, once it is there.
    threads: [OnceLock<Thread>; PROCESSORS],
}

struct BatonState {
    /// From when on programs are to stop.
    stop_at: u64,
    of: [Bell; PROCESSORS],
}

#[derive(Clone, Copy)]
struct Bell {
    /// There is a program that has not ended.
    alive: bool,
    /// It has begun.
    begun: bool,
    /// When it goes on; [`NEVER`] if there is no program.
    next: u64,
    /// A ring has it go on at once.
    listens: bool,
    rings: u64,
}

/// What makes a processor go on earlier than it asked for.
#[derive(Clone, Copy)]
pub(super) enum Until {
    /// Nothing.
    Instant,
    /// A ring after so many.
    Ring(u64),
}

impl Baton {
    pub(super) fn new() -> Self {
        let bell = Bell {
            alive: false,
            begun: false,
            next: NEVER,
            listens: false,
            rings: 0,
        };
        Self {
            state: Mutex::new(BatonState {
                stop_at: NEVER,
                of: [bell; PROCESSORS],
            }),
            holder: AtomicUsize::new(PROCESSORS),
            threads: [const { OnceLock::new() }; PROCESSORS],
        }
    }

    /// There is a program that begins at `at`.
    pub(super) fn enter(&self, me: Processor, at: u64) {
        if let Some(bell) = self.lock().of.get_mut(me.index()) {
            bell.alive = true;
            bell.next = at;
        }
    }

    /// Before anybody runs: there is no program of `me` after all.
    pub(super) fn withdraw(&self, me: Processor) {
        if let Some(bell) = self.lock().of.get_mut(me.index()) {
            bell.alive = false;
        }
    }

    /// Everybody has entered: the first one runs.
    pub(super) fn begin(&self, stop_at: u64) {
        let mut state = self.lock();
        state.stop_at = stop_at;
        self.give(state);
    }

    /// Waits for the first turn of `me`.
    pub(super) fn first_turn(&self, me: Processor) {
        {
            let _state = self.lock();
            if let Some(place) = self.threads.get(me.index()) {
                // Once for each processor.
                let _ = place.set(thread::current());
            }
        }
        self.await_turn(me);
        if let Some(bell) = self.lock().of.get_mut(me.index()) {
            bell.begun = true;
        }
    }

    /// The program of `me`, which runs, has ended at `now`; `failed` has all others stop.
    pub(super) fn leave(&self, me: Processor, now: u64, failed: bool) {
        let mut state = self.lock();
        if let Some(bell) = state.of.get_mut(me.index()) {
            bell.alive = false;
            bell.next = NEVER;
        }
        if failed && now < state.stop_at {
            state.stop_at = now;
            for bell in &mut state.of {
                if bell.listens {
                    bell.next = bell.next.min(now);
                }
            }
        }
        self.give(state);
    }

    /// Has `me`, which runs, go on at `at` or as `until` says, after all who go on more than `lead`
    /// before; gives when it does.
    pub(super) fn turn(&self, me: Processor, now: u64, at: u64, until: Until, lead: u64) -> u64 {
        let mut state = self.lock();
        let stop_at = state.stop_at;
        let Some(bell) = state.of.get_mut(me.index()) else {
            return at;
        };
        bell.next = at;
        if let Until::Ring(seen) = until {
            bell.listens = true;
            if now < stop_at {
                bell.next = bell.next.min(stop_at);
            }
            if bell.rings != seen {
                bell.next = now;
            }
        }
        let mine = bell.next;
        let (next, first) = state.first();
        if first != me.index() && next.saturating_add(lead) <= mine {
            self.give(state);
            self.await_turn(me);
            state = self.lock();
        }
        let mut next = at;
        if let Some(bell) = state.of.get_mut(me.index()) {
            bell.listens = false;
            next = bell.next.max(now);
        }
        let overdue = next > state.stop_at.saturating_add(PATIENCE_NS);
        drop(state);
        if next == NEVER {
            Cause::WaitsForever.unwind();
        }
        if overdue {
            Cause::NotStopping.unwind();
        }
        next
    }

    pub(super) fn rings(&self, me: Processor) -> u64 {
        self.lock().of.get(me.index()).map_or(0, |bell| bell.rings)
    }

    /// Whoever runs rings `processor` at `now`.
    pub(super) fn ring(&self, processor: Processor, now: u64) {
        if let Some(bell) = self.lock().of.get_mut(processor.index()) {
            bell.rings += 1;
            if bell.listens {
                bell.next = bell.next.min(now);
            }
        }
    }

    pub(super) fn evidence(&self, processor: Processor) -> Evidence {
        match self.lock().of.get(processor.index()) {
            Some(bell) if bell.alive && bell.begun => Evidence::Alive,
            Some(_) => Evidence::Dead,
            None => Evidence::Unknown,
        }
    }

    pub(super) fn stop_at(&self) -> u64 {
        self.lock().stop_at
    }

    /// Gives the baton to who goes on first.
    fn give(&self, state: MutexGuard<'_, BatonState>) {
        let (_, first) = state.first();
        self.holder.store(first, Ordering::Release);
        // Under the lock, as in `first_turn`: a thread that is not there yet will see that it holds.
        let thread = self.threads.get(first).and_then(OnceLock::get);
        drop(state);
        if let Some(thread) = thread {
            thread.unpark();
        }
    }

    fn await_turn(&self, me: Processor) {
        while self.holder.load(Ordering::Acquire) != me.index() {
            thread::park();
        }
    }

    fn lock(&self) -> MutexGuard<'_, BatonState> {
        // Nothing panics while it is locked.
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl BatonState {
    /// Who goes on first, and when; nobody's number if all have ended.
    fn first(&self) -> (u64, usize) {
        let alive = self.of.iter().enumerate().filter(|(_, bell)| bell.alive);
        let first = alive.map(|(number, bell)| (bell.next, number)).min();
        first.unwrap_or((NEVER, PROCESSORS))
    }
}

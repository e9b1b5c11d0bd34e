//! [`Core`]: how time passes on one processor, and what interrupts it.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU32, AtomicU64, Ordering::Relaxed};

use condor_mbox as mbox;
use condor_mos::sim::Processor as LocalTime;
use condor_mos::{Armed, ConnectError, Platform as _, Rate, Timer as _};

use super::baton::{Baton, LEAD_NS, NEVER, Until};
use super::error::Cause;

/// The time that reading a clock in the background takes, in nanoseconds.
pub const CLOCK_NS: u64 = 100;

/// After how many readings in a row those of the timer take their time, all at once: a scheduler reads
/// it a few times for one event, which is to take none.
const READINGS: u32 = 100;

/// After how many readings in a row a loop is taken to poll the clock, which stands still there.
const TOO_MANY_READINGS: u32 = 1_000_000;

/// How many loops a processor has at most, as schedulers have.
pub(super) const RANKS: usize = 32;

/// What the parts of a processor share. All but one thread only look at it before or after.
pub(super) struct Core {
    pub(super) number: mbox::Processor,
    pub(super) baton: Arc<Baton>,
    /// Its clock, and how interrupts nest.
    pub(super) timer: LocalTime,
    /// When the timer is to interrupt.
    armed: AtomicU64,
    /// Whether there is a handler.
    connected: AtomicBool,
    /// In how many contexts it is in which no time passes.
    still: AtomicU32,
    /// How often a clock was read since the clock went on last.
    readings: AtomicU32,
    /// How long the loop of each rank takes.
    work: [u64; RANKS],
}

impl Core {
    pub(super) fn new(
        number: mbox::Processor,
        baton: Arc<Baton>,
        begins_at: u64,
        work: [u64; RANKS],
    ) -> Self {
        let timer = LocalTime::new(Rate::hz(1_000_000_000));
        timer.run_until(begins_at);
        Self {
            number,
            baton,
            timer,
            armed: AtomicU64::new(NEVER),
            connected: AtomicBool::new(false),
            still: AtomicU32::new(0),
            readings: AtomicU32::new(0),
            work,
        }
    }

    pub(super) fn now(&self) -> u64 {
        self.timer.now()
    }

    pub(super) fn arm(&self, at: u64) -> Armed {
        self.armed.store(at, Relaxed);
        self.timer.arm(at)
    }

    pub(super) fn disarm(&self) {
        self.armed.store(NEVER, Relaxed);
        self.timer.disarm();
    }

    /// Runs `body` while no time passes.
    pub(super) fn standing_still<R>(&self, body: impl FnOnce() -> R) -> R {
        let _still = Still::begin(&self.still);
        body()
    }

    fn stands_still(&self) -> bool {
        self.still.load(Relaxed) > 0
    }

    /// When the timer interrupts next; [`NEVER`] if it cannot.
    fn next_interrupt(&self) -> u64 {
        if self.connected.load(Relaxed) {
            self.armed.load(Relaxed).max(self.now())
        } else {
            NEVER
        }
    }

    /// Somebody reads the clock.
    pub(super) fn spend_reading(&self) {
        if self.stands_still() {
            self.count_reading();
        } else {
            self.pass(CLOCK_NS, LEAD_NS);
        }
    }

    /// Somebody reads the timer, perhaps where no interrupt may come.
    pub(super) fn spend_reading_timer(&self) {
        if self.count_reading() >= READINGS && !self.stands_still() {
            self.move_to(self.now() + u64::from(READINGS) * CLOCK_NS);
        }
    }

    /// How many readings there were since the clock went on last, with this one.
    fn count_reading(&self) -> u32 {
        let readings = self.readings.load(Relaxed) + 1;
        if readings >= TOO_MANY_READINGS {
            Cause::Polls.unwind();
        }
        self.readings.store(readings, Relaxed);
        readings
    }

    /// Lets `ns` of a context pass that can be interrupted: interrupts take their time in addition.
    pub(super) fn pass(&self, ns: u64, lead: u64) {
        let mut left = ns;
        loop {
            let now = self.now();
            let interrupt = self.next_interrupt();
            let at = now.saturating_add(left).min(interrupt);
            self.baton.turn(self.number, now, at, Until::Instant, lead);
            self.move_to(at);
            if interrupt > at {
                return;
            }
            left -= at - now;
            self.timer.interrupt();
        }
    }

    /// Waits until there are other than `seen` rings, until the instant `until`, or until programs
    /// are to stop.
    pub(super) fn wait(&self, seen: u64, until: u64) {
        let was_stopping = self.is_stopping();
        loop {
            let now = self.now();
            // In a loop or a handler nothing interrupts a wait.
            let interrupt = if self.stands_still() {
                NEVER
            } else {
                self.next_interrupt()
            };
            let at = until.max(now).min(interrupt);
            let at = self.baton.turn(self.number, now, at, Until::Ring(seen), 0);
            self.move_to(at);
            if interrupt <= at {
                self.timer.interrupt();
            }
            if self.now() >= until
                || self.baton.rings(self.number) != seen
                || (!was_stopping && self.is_stopping())
            {
                return;
            }
        }
    }

    /// The clock goes on to `at`, and nothing interrupts on the way.
    fn move_to(&self, at: u64) {
        self.readings.store(0, Relaxed);
        self.timer
            .hold_interrupts(at.saturating_sub(self.now()) + 1);
        self.timer.run_until(at);
    }

    /// Runs a loop: first what it does, then the time that it takes.
    pub(super) fn run_loop(&self, rank: u32, body: impl FnOnce()) {
        self.timer.interruptible(rank, || {
            self.standing_still(body);
            let work = self.work.get(rank as usize).copied().unwrap_or(0);
            if work > 0 {
                self.pass(work, 0);
            }
        });
    }

    pub(super) fn is_stopping(&self) -> bool {
        self.now() >= self.baton.stop_at()
    }

    pub(super) fn with_handler<R>(
        &self,
        handler: impl Fn() + Sync,
        background: impl FnOnce() -> R,
    ) -> Result<R, ConnectError> {
        if self.connected.swap(true, Relaxed) {
            return Err(ConnectError::Connected);
        }
        let _disconnect = Disconnect(&self.connected);
        let handler = || {
            self.armed.store(NEVER, Relaxed);
            self.standing_still(&handler);
        };
        Ok(self.timer.with_handler(handler, background))
    }
}

/// While it lives, no time passes.
struct Still<'s>(&'s AtomicU32);

impl<'s> Still<'s> {
    fn begin(still: &'s AtomicU32) -> Self {
        still.fetch_add(1, Relaxed);
        Self(still)
    }
}

impl Drop for Still<'_> {
    fn drop(&mut self) {
        self.0.fetch_sub(1, Relaxed);
    }
}

struct Disconnect<'c>(&'c AtomicBool);

impl Drop for Disconnect<'_> {
    fn drop(&mut self) {
        self.0.store(false, Relaxed);
    }
}

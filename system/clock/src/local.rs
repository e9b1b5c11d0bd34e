//! [`LocalClock`]: the simulated clock as one processor has it.

#[cfg(all(test, not(condor_loom)))]
mod tests;

use core::ops::Deref;
use core::ptr;

use crate::handover::{ClockFault, Handover};
use crate::page::{NEVER, Page, Until};
use crate::sizes::LOOPS;
// Of one processor: its contexts are calls on one stack.
use core::sync::atomic::{AtomicBool, AtomicPtr, AtomicU32, AtomicU64, Ordering::Relaxed};

/// After this many readings in a row the clock advances by `POLLED_NS`, so that a background that
/// polls it comes to an end, and other processors get the turn.
const READINGS: u32 = 1000;
const POLLED_NS: u64 = 100_000;

/// After this many readings in a row it is a fault that a loop polls the clock, which stands still
/// while the loop runs.
const TOO_MANY_READINGS: u32 = 1_000_000;

/// The time for which a program may still run after the instant for stopping, in nanoseconds.
const PATIENCE_NS: u64 = 10_000_000_000;

/// A handler of an interrupt.
type Handler = &'static (dyn Fn() + Sync);

/// An interrupt that may have a handler.
#[derive(Debug)]
struct Connection {
    /// The address of a reference to the handler, on the stack of `with`; or null.
    handler: AtomicPtr<Handler>,
}

impl Connection {
    const fn new() -> Self {
        Self {
            handler: AtomicPtr::new(ptr::null_mut()),
        }
    }

    /// Runs `program`, with which the interrupt has this handler; `None` if it has one already.
    fn with<R>(&self, handler: &(dyn Fn() + Sync), program: impl FnOnce() -> R) -> Option<R> {
        // SAFETY: only the lifetime differs. `_disconnect` takes it away before it ends, also when
        // the program unwinds; a call in progress is on this stack, and so ends before.
        let mut handler = unsafe { core::mem::transmute::<&(dyn Fn() + Sync), Handler>(handler) };
        (!self.is_connected()).then(|| {
            self.handler.store(&raw mut handler, Relaxed);
            let _disconnect = AtEnd(|| self.handler.store(ptr::null_mut(), Relaxed));
            program()
        })
    }

    fn is_connected(&self) -> bool {
        !self.handler.load(Relaxed).is_null()
    }

    fn handler(&self) -> Option<Handler> {
        // SAFETY: it is null, or leads to the stack of `with`, which has not ended: only the program
        // of this processor comes here.
        unsafe { self.handler.load(Relaxed).as_ref() }.copied()
    }
}

/// The simulated clock as one processor uses it: to read the time, to let time pass, to set its
/// timer, to ring and to wait.
///
/// The timer interrupts at exactly the instant for which it is armed: in waits, where the
/// background passes time, and while a slower loop spends its declared time. Boards interrupt in waits, at the
/// instant at which the processor is rung for them; where the background passes time, after a loop or at the end.
///
/// ```
/// # #[cfg(feature = "linux")] {
/// use condor_clock::linux::Futex;
/// use condor_clock::{LOOPS, LocalClock, Page};
///
/// let page: Page = Page::new();
/// let clock = LocalClock::new(0, &page, Futex::new(), [0; LOOPS]);
/// clock.announce(0);
/// clock.begin();
/// clock.pass(3_600_000_000_000); // computes for an hour, which takes no time
/// assert_eq!(clock.now(), 3_600_000_000_000);
/// clock.leave();
/// # }
/// ```
#[derive(Debug)]
pub struct LocalClock<P, H> {
    number: u8,
    page: P,
    by: H,
    /// The instant at which the timer interrupts.
    armed: AtomicU64,
    timer: Connection,
    boards: Connection,
    /// Whether the timer may interrupt.
    open: AtomicBool,
    /// The number of contexts in which the processor is and in which no time passes.
    still: AtomicU32,
    /// The number of readings of the clock since the processor last went on.
    readings: AtomicU32,
    /// The time that the loop of each rank takes, in nanoseconds.
    work: [u64; LOOPS],
}

impl<P: Deref<Target = Page<N>>, H: Handover, const N: usize> LocalClock<P, H> {
    /// Makes the clock of processor `number`. `page` is the page that all participants share, and
    /// `by` is the way in which they sleep and wake each other. After the body of the loop of rank
    /// *i* has run, `work[i]` nanoseconds pass; the fastest loop has rank 0.
    pub const fn new(number: u8, page: P, by: H, work: [u64; LOOPS]) -> Self {
        Self {
            number,
            page,
            by,
            armed: AtomicU64::new(NEVER),
            timer: Connection::new(),
            boards: Connection::new(),
            open: AtomicBool::new(true),
            still: AtomicU32::new(0),
            readings: AtomicU32::new(0),
            work,
        }
    }

    /// Returns the number of this processor.
    pub const fn number(&self) -> u8 {
        self.number
    }

    /// Returns the page of the simulated time, which all participants share.
    pub fn page(&self) -> &Page<N> {
        &self.page
    }

    /// Returns the way in which this processor sleeps until it has the turn, and wakes others.
    pub const fn handover(&self) -> &H {
        &self.by
    }

    /// Announces that this processor takes part in the simulated time from the instant `at` on, in nanoseconds, or from
    /// now on if `at` has passed. Does not wait: [`begin`](Self::begin) waits for the first turn.
    pub fn announce(&self, at: u64) {
        self.page.announce(self.number, at);
    }

    /// Waits until this processor, which was [announced](Self::announce), has its first turn.
    pub fn begin(&self) {
        self.page.kick(self.number, &self.by);
        self.page.first_turn(self.number, &self.by);
    }

    /// Ends the participation of this processor in the simulated time. Call it when the program
    /// ends.
    pub fn leave(&self) {
        self.page.leave(self.number, &self.by);
    }

    /// Returns the present instant of simulated time, in nanoseconds. This reading takes no time.
    pub fn now(&self) -> u64 {
        self.page.now()
    }

    /// Returns true if the program must stop, because the present instant is not before that of
    /// [`Page::set_stop_at`].
    pub fn is_stopping(&self) -> bool {
        self.now() >= self.page.stop_at()
    }

    /// Returns the present instant in nanoseconds, for a program that may poll the clock: each
    /// thousandth reading in a row lets 100 µs of simulated time pass, so that the poll ends.
    pub fn read(&self) -> u64 {
        if self.by.is_own_context() {
            let readings = self.count_reading();
            if readings >= READINGS && !self.stands_still() {
                self.pass(POLLED_NS);
            }
        }
        self.now()
    }

    /// Returns the present instant in nanoseconds, for a scheduler of loops. It may be polled like
    /// [`read`](Self::read), but the timer does not interrupt during the call.
    pub fn read_timer(&self) -> u64 {
        if self.by.is_own_context() {
            let readings = self.count_reading();
            if readings >= READINGS && !self.stands_still() {
                self.turn(self.now().saturating_add(POLLED_NS), Until::Instant);
            }
        }
        self.now()
    }

    /// Sets the timer, so that it interrupts at the instant `at`, in nanoseconds. Returns true if
    /// `at` is still ahead; returns false if it is the present instant or has passed.
    pub fn arm(&self, at: u64) -> bool {
        self.armed.store(at, Relaxed);
        at > self.now()
    }

    /// Disarms the timer: it does not interrupt until it is [armed](Self::arm) again.
    pub fn disarm(&self) {
        self.armed.store(NEVER, Relaxed);
    }

    /// Runs `body` as a critical section, in which no simulated time passes and which nothing
    /// interrupts. Returns the result of `body`.
    pub fn standing_still<R>(&self, body: impl FnOnce() -> R) -> R {
        self.still.fetch_add(1, Relaxed);
        let _still = AtEnd(|| {
            self.still.fetch_sub(1, Relaxed);
        });
        body()
    }

    fn stands_still(&self) -> bool {
        self.still.load(Relaxed) > 0
    }

    /// Runs `program` and returns its result; meanwhile calls `handler` at each interrupt of the
    /// timer. Returns `None` without running `program` if the timer has a handler already.
    pub fn with_handler<R>(
        &self,
        handler: &(dyn Fn() + Sync),
        program: impl FnOnce() -> R,
    ) -> Option<R> {
        self.timer.with(handler, program)
    }

    /// Runs `program` and returns its result; meanwhile calls `handler` where boards may interrupt. `handler` looks
    /// whether one does. Returns `None` without running `program` if there is such a handler already.
    pub fn with_boards<R>(
        &self,
        handler: &(dyn Fn() + Sync),
        program: impl FnOnce() -> R,
    ) -> Option<R> {
        self.boards.with(handler, program)
    }

    /// Runs the loop of rank `rank`, where the fastest loop has rank 0: first `body`, during which
    /// no time passes; then the loop's declared time passes, during which faster loops can
    /// interrupt it.
    pub fn run_loop(&self, rank: u32, body: impl FnOnce()) {
        let former = self.open.swap(true, Relaxed);
        let _restore = AtEnd(|| self.open.store(former, Relaxed));
        self.standing_still(body);
        let work = self.work.get(rank as usize).copied().unwrap_or(0);
        if work > 0 {
            self.pass(work);
        }
    }

    /// Lets `ns` nanoseconds pass, as if the caller computed for so long. Interrupts take their
    /// time in addition.
    pub fn pass(&self, ns: u64) {
        let mut left = ns;
        loop {
            let now = self.now();
            let interrupt = self.next_interrupt();
            let at = now.saturating_add(left).min(interrupt);
            self.turn(at, Until::Instant);
            let is_over = interrupt > at;
            if !is_over {
                left -= at - now;
                self.interrupt();
            }
            self.serve_boards();
            if is_over {
                return;
            }
        }
    }

    /// Returns the number of times that this processor was rung. The count wraps.
    pub fn rings(&self) -> u32 {
        self.page.rings(self.number)
    }

    /// Rings the processor `number`, so that its wait ends. If `number` is a service, this only
    /// counts a message to it; the caller must then ring the service's own doorbell.
    pub fn ring(&self, number: u8) {
        if self.by.is_own_context() {
            self.page.count_ring(number);
            if self.page.is_service(number) {
                // Nothing that the clock shows until its answer depends on how fast it is.
                self.readings.store(0, Relaxed);
            }
        } else {
            self.page.ring(self.number, number, &self.by);
        }
    }

    /// Waits until the count of rings is no longer `seen`, until the instant `until`, in
    /// nanoseconds, or until programs must stop, whichever is first. `whom` is the participant for
    /// whose answer the caller waits, if there is one: if it is a service, no time passes, and the
    /// wait may end early. A thread that is not the program's own waits for a ring only, and for at
    /// most 10 ms of real time.
    pub fn wait(&self, seen: u32, until: u64, whom: Option<u8>) {
        if !self.by.is_own_context() {
            return self.page.doze(self.number, seen, &self.by);
        }
        if let Some(service) = whom.filter(|&whom| self.page.is_service(whom)) {
            self.readings.store(0, Relaxed);
            return self.page.ask(self.number, service, seen, &self.by);
        }
        let was_stopping = self.is_stopping();
        self.serve_boards();
        loop {
            let now = self.now();
            // In a loop or a handler nothing interrupts a wait.
            let interrupt = if self.stands_still() {
                NEVER
            } else {
                self.next_interrupt()
            };
            let at = until.max(now).min(interrupt);
            let at = self.turn(at, Until::Ring { seen });
            if interrupt <= at {
                self.interrupt();
            }
            self.serve_boards();
            if self.now() >= until || self.rings() != seen || (!was_stopping && self.is_stopping())
            {
                return;
            }
        }
    }

    /// Passes the turn on until the instant `at` or the event `until`; returns the instant at which this
    /// processor goes on.
    fn turn(&self, at: u64, until: Until) -> u64 {
        self.readings.store(0, Relaxed);
        let now = self.page.turn(self.number, at, until, &self.by);
        if now == NEVER {
            self.by.fault(ClockFault::WaitsForever);
        } else if now > self.page.stop_at().saturating_add(PATIENCE_NS) {
            self.by.fault(ClockFault::NotStopping);
        }
        now
    }

    /// When the timer interrupts next; [`NEVER`] if it cannot.
    fn next_interrupt(&self) -> u64 {
        if !self.timer.is_connected() || !self.open.load(Relaxed) {
            return NEVER;
        }
        match self.armed.load(Relaxed) {
            NEVER => NEVER,
            armed => armed.max(self.now()),
        }
    }

    fn interrupt(&self) {
        if let Some(handler) = self.timer.handler()
            && self.open.swap(false, Relaxed)
        {
            let _restore = AtEnd(|| self.open.store(true, Relaxed));
            self.armed.store(NEVER, Relaxed);
            self.standing_still(handler);
        }
    }

    /// Has boards interrupt, unless loops run.
    fn serve_boards(&self) {
        if let Some(handler) = self.boards.handler()
            && !self.stands_still()
        {
            self.standing_still(handler);
        }
    }

    /// Counts a reading; returns the number of readings since the clock went on last, with this one.
    fn count_reading(&self) -> u32 {
        let readings = self.readings.load(Relaxed).saturating_add(1);
        if readings >= TOO_MANY_READINGS {
            self.by.fault(ClockFault::Polls);
        }
        self.readings.store(readings, Relaxed);
        readings
    }
}

/// Calls a closure when it goes, also when the program unwinds.
struct AtEnd<F: FnMut()>(F);

impl<F: FnMut()> Drop for AtEnd<F> {
    fn drop(&mut self) {
        (self.0)();
    }
}

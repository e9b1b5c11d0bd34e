//! A processor in virtual time, for tests on any machine with std.
//!
//! Time passes only where a program says so: while it computes or waits, and, if
//! [`SimPlatform::set_access_time`] asked for it, at each access to the timer. So every run is the
//! same to the last tick. Loops nest by a call on the interrupted stack, as on RISC-V, or by one
//! vector for each rank, as on Cortex-M.

mod drift;
mod wrapping;

use std::ops::Deref;
use std::sync::atomic::{AtomicBool, AtomicU32, AtomicU64, Ordering::Relaxed};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::ThreadId;

pub use drift::worst_release_error;
pub use wrapping::WrappingProcessor;

use crate::error::ConnectError;
use crate::platform::Platform;
use crate::rate::Rate;
use crate::timer::{Alarm, Armed, Timer};

/// A simulated processor in virtual time, for tests: the [`Platform`] of loops without hardware.
/// Time passes only in calls of its methods. Clones are the same processor. The background and all
/// loops run on the thread that calls the methods.
///
/// ```
/// use condor_mos::sim::SimPlatform;
/// use condor_mos::{ClockSpec, EventTable, LoopId, Loops, Overrun, Rate, Scheduler};
///
/// const MICROSECONDS: Rate = Rate::hz(1_000_000);
/// const RATES: [Rate; 2] = [Rate::hz(400), Rate::hz(50)];
///
/// let processor = SimPlatform::new(MICROSECONDS);
/// let table = EventTable::<2, 8>::new(&RATES, ClockSpec::of::<u64>(MICROSECONDS));
/// let scheduler = Scheduler::new(processor.clone(), table);
/// let (mut fast, mut slow) = (0, 0);
/// // Each loop computes for a while; the 50 Hz loop is interrupted by the 400 Hz loop.
/// let mut fast_loop = |_| { processor.work(500); fast += 1; };
/// let mut slow_loop = |_| { processor.work(6_000); slow += 1; };
/// scheduler.scope(|scope| {
///     scope.assign(LoopId(0), Overrun::Skip, &mut fast_loop)?;
///     scope.assign(LoopId(1), Overrun::Skip, &mut slow_loop)?;
///     // The background waits for a second.
///     scheduler.run(|| processor.run_until(1_000_000))?;
///     let slow = scheduler.statistics(LoopId(1))?;
///     assert_eq!((slow.worst_run, slow.worst_lateness), (6_000, 500));
///     Ok::<_, Box<dyn std::error::Error>>(())
/// })?;
/// assert_eq!((fast, slow), (400, 50));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone)]
pub struct SimPlatform {
    machine: Arc<Machine>,
}

struct Machine {
    frequency: Rate,
    now: AtomicU64,
    /// Ticks that each access to the timer takes.
    access_time: AtomicU64,
    /// When the timer's interrupt is to come; [`NEVER`] if it is not armed.
    armed: AtomicU64,
    /// Until when interrupts are held back.
    held_until: AtomicU64,
    /// Whether the timer may interrupt.
    enabled: AtomicBool,
    /// Whether the timer's interrupt was pended, due or not.
    pended: AtomicBool,
    /// The function that the timer's interrupt calls.
    handler: Mutex<Option<Connected>>,
    /// The function that vectors of ranks call.
    vectors: Mutex<Option<Connected>>,
    /// Vectors that are pending, by rank, and the priority in progress.
    pending: AtomicU32,
    priority: AtomicU32,
}

const NEVER: u64 = u64::MAX;

/// The priority of the background.
const BACKGROUND: u32 = u32::MAX;

/// The function that interrupts call with a rank, in truth there as long as [`SimPlatform::with_handler`] or
/// [`SimPlatform::with_vectors`] runs; on the thread that does so alone.
struct Connected {
    thread: ThreadId,
    call: &'static (dyn Fn(u32) + Sync),
}

impl SimPlatform {
    /// Makes a processor whose time is at tick 0. Its timer counts `frequency` ticks per second.
    #[must_use]
    pub fn new(frequency: Rate) -> Self {
        let machine = Machine {
            frequency,
            now: AtomicU64::new(0),
            access_time: AtomicU64::new(0),
            armed: AtomicU64::new(NEVER),
            held_until: AtomicU64::new(0),
            enabled: AtomicBool::new(true),
            pended: AtomicBool::new(false),
            handler: Mutex::new(None),
            vectors: Mutex::new(None),
            pending: AtomicU32::new(0),
            priority: AtomicU32::new(BACKGROUND),
        };
        Self {
            machine: Arc::new(machine),
        }
    }

    /// Runs `program`; while it runs, the timer's interrupt calls `handler` on the calling thread.
    /// [`Loops::run`](crate::Loops::run) does this for a scheduler.
    ///
    /// Outside of this call the processor has no handler, and no interrupt comes.
    pub fn with_handler<R>(&self, handler: impl Fn() + Sync, program: impl FnOnce() -> R) -> R {
        connect(&self.machine.handler, &|_| handler(), program)
    }

    /// Runs `program`; while it runs, the vector of each rank calls `vectors` with its rank. See
    /// [`Vectored`].
    pub fn with_vectors<R>(&self, vectors: impl Fn(u32) + Sync, program: impl FnOnce() -> R) -> R {
        connect(&self.machine.vectors, &vectors, program)
    }

    /// Lets time pass until `instant`, in ticks, while the background waits; interrupts run loops
    /// meanwhile. An interrupt at `instant` itself comes in the next call.
    pub fn run_until(&self, instant: u64) {
        while self.now() < instant {
            let interrupt = self.next_interrupt().min(instant);
            self.machine.now.store(interrupt, Relaxed);
            if interrupt < instant {
                self.interrupt();
            }
        }
    }

    /// Lets the calling context, a loop or the background, compute for `ticks` ticks. Loops that
    /// interrupt it take their time in addition.
    pub fn work(&self, ticks: u64) {
        let mut remaining = ticks;
        loop {
            let now = self.now();
            let interrupt = self.next_interrupt();
            if interrupt >= now.saturating_add(remaining) {
                self.machine
                    .now
                    .store(now.saturating_add(remaining), Relaxed);
                return;
            }
            remaining -= interrupt - now;
            self.machine.now.store(interrupt, Relaxed);
            self.interrupt();
        }
    }

    /// Delays interrupts that come in the next `ticks` ticks until these ticks have passed, so that
    /// a test can make loops late.
    pub fn hold_interrupts(&self, ticks: u64) {
        let until = self.now().saturating_add(ticks);
        self.machine.held_until.store(until, Relaxed);
    }

    /// Sets the time that each access to the timer takes, in ticks; the default is 0.
    ///
    /// [`Timer::now`] and [`Timer::arm`] then see the time before this delay. Interrupts come only
    /// in [`work`](Self::work) and [`run_until`](Self::run_until), so this time passes inside
    /// critical sections, as on hardware; it becomes visible at the next access.
    ///
    /// ```
    /// use condor_mos::sim::SimPlatform;
    /// use condor_mos::{Armed, Rate, Timer};
    ///
    /// let processor = SimPlatform::new(Rate::hz(1_000_000));
    /// processor.set_access_time(1);
    /// assert_eq!(processor.now(), 0);
    /// assert_eq!(processor.arm(1), Armed::Past);
    /// assert_eq!(processor.now(), 2);
    /// ```
    pub fn set_access_time(&self, ticks: u32) {
        self.machine.access_time.store(ticks.into(), Relaxed);
    }

    /// Has the timer's interrupt come at `at`, or soon if that has passed.
    fn arm_for(&self, at: u64) {
        self.machine.armed.store(at, Relaxed);
    }

    /// The time at an access to the timer, which takes its time after that.
    fn access(&self) -> u64 {
        let now = self.now();
        let ticks = self.machine.access_time.load(Relaxed);
        self.machine.now.store(now.saturating_add(ticks), Relaxed);
        now
    }

    /// Makes an interrupt of the timer without a cause: calls the timer's handler. Does nothing
    /// while interrupts are disabled, or if there is no handler.
    pub fn interrupt(&self) {
        let Some(handler) = connected(&self.machine.handler) else {
            return;
        };
        if !self.machine.enabled.load(Relaxed) {
            return;
        }
        loop {
            {
                let _restore = self.enable(false);
                self.machine.armed.store(NEVER, Relaxed);
                self.machine.pended.store(false, Relaxed);
                handler(0);
            }
            if !self.machine.pended.load(Relaxed) {
                break;
            }
        }
        self.take_vectors();
    }

    /// Lets time pass until `instant`, and no interrupt come.
    #[cfg(all(test, not(condor_loom)))]
    pub(crate) fn skip_to(&self, instant: u64) {
        self.machine.now.store(instant.max(self.now()), Relaxed);
    }

    /// Returns true if the timer can interrupt what is in progress.
    #[cfg(all(test, not(condor_loom)))]
    pub(crate) fn is_interruptible(&self) -> bool {
        self.machine.enabled.load(Relaxed)
    }

    /// When the timer is armed for.
    #[cfg(all(test, not(condor_loom)))]
    pub(crate) fn armed(&self) -> Option<u64> {
        Some(self.machine.armed.load(Relaxed)).filter(|&armed| armed != NEVER)
    }

    /// Runs the pending vectors that outrank what is in progress, the fastest first.
    fn take_vectors(&self) {
        let machine = &*self.machine;
        let Some(vectors) = connected(&machine.vectors) else {
            return;
        };
        loop {
            let pending = machine.pending.load(Relaxed);
            let rank = pending.trailing_zeros();
            if pending == 0
                || rank >= machine.priority.load(Relaxed)
                || !machine.enabled.load(Relaxed)
            {
                return;
            }
            machine.pending.fetch_and(!(1 << rank), Relaxed);
            let former = machine.priority.swap(rank, Relaxed);
            let _restore = AtEnd(|| machine.priority.store(former, Relaxed));
            vectors(rank);
        }
    }

    /// Lets the timer interrupt, or not, until the guard goes.
    fn enable(&self, enabled: bool) -> AtEnd<impl FnMut()> {
        let former = self.machine.enabled.swap(enabled, Relaxed);
        AtEnd(move || self.machine.enabled.store(former, Relaxed))
    }

    pub(crate) fn now(&self) -> u64 {
        self.machine.now.load(Relaxed)
    }

    /// When the next interrupt comes, if nothing changes.
    fn next_interrupt(&self) -> u64 {
        let armed = self.machine.armed.load(Relaxed);
        let connected = connected(&self.machine.handler).is_some();
        if armed == NEVER || !connected || !self.machine.enabled.load(Relaxed) {
            return NEVER;
        }
        armed
            .max(self.machine.held_until.load(Relaxed))
            .max(self.now())
    }
}

/// Runs `program`, while interrupts of this thread call `call`.
fn connect<R>(
    place: &Mutex<Option<Connected>>,
    call: &(dyn Fn(u32) + Sync),
    program: impl FnOnce() -> R,
) -> R {
    // SAFETY: only the lifetime differs. `_restore` takes the reference away before it ends; a call
    // that is still in progress would be on this thread, and so end before.
    let call = unsafe {
        core::mem::transmute::<&(dyn Fn(u32) + Sync), &'static (dyn Fn(u32) + Sync)>(call)
    };
    let thread = this_thread();
    let mut former = lock(place).replace(Connected { thread, call });
    let _restore = AtEnd(|| *lock(place) = former.take());
    program()
}

/// Returns the connected function, if this thread connected it.
fn connected(place: &Mutex<Option<Connected>>) -> Option<&'static (dyn Fn(u32) + Sync)> {
    let connected = lock(place);
    let connected = connected.as_ref()?;
    (connected.thread == this_thread()).then_some(connected.call)
}

fn this_thread() -> ThreadId {
    thread_local! {
        static THIS: ThreadId = std::thread::current().id();
    }
    THIS.with(|this| *this)
}

fn lock<T>(place: &Mutex<T>) -> MutexGuard<'_, T> {
    place.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Calls a closure when it goes, also when the program unwinds.
struct AtEnd<F: FnMut()>(F);

impl<F: FnMut()> Drop for AtEnd<F> {
    fn drop(&mut self) {
        (self.0)();
    }
}

impl Timer for SimPlatform {
    type Instant = u64;

    fn frequency(&self) -> Rate {
        self.machine.frequency
    }

    fn now(&self) -> u64 {
        self.access()
    }

    fn arm(&self, at: u64) -> Armed {
        self.arm_for(at);
        if at > self.access() {
            Armed::Ahead
        } else {
            Armed::Past
        }
    }

    fn disarm(&self) {
        self.machine.armed.store(NEVER, Relaxed);
    }
}

impl Alarm for SimPlatform {
    fn pend(&self) {
        self.machine.pended.store(true, Relaxed);
        self.interrupt();
    }
}

impl Platform for SimPlatform {
    fn connect<R>(
        &self,
        handler: impl Fn() + Sync,
        program: impl FnOnce() -> R,
    ) -> Result<R, ConnectError> {
        Ok(self.with_handler(handler, program))
    }

    fn has_handler(&self) -> bool {
        connected(&self.machine.handler).is_some()
    }

    fn interruptible(&self, _: u32, body: impl FnOnce()) {
        let _restore = self.enable(true);
        body();
    }
}

/// A [`SimPlatform`] with an interrupt vector for each rank of loops, like the NVIC of Cortex-M.
/// The vector of rank 0, the fastest, is the timer's. A pended vector waits while a loop of the
/// same rank or a faster one is in progress.
#[derive(Clone)]
pub struct Vectored(pub SimPlatform);

impl Deref for Vectored {
    type Target = SimPlatform;

    fn deref(&self) -> &SimPlatform {
        &self.0
    }
}

impl Timer for Vectored {
    type Instant = u64;

    fn frequency(&self) -> Rate {
        self.0.frequency()
    }

    fn now(&self) -> u64 {
        Timer::now(&self.0)
    }

    fn arm(&self, at: u64) -> Armed {
        self.0.arm(at)
    }

    fn disarm(&self) {
        self.0.disarm();
    }
}

impl Platform for Vectored {
    const VECTORS: bool = true;

    fn has_handler(&self) -> bool {
        self.0.has_handler()
    }

    fn pend(&self, ranks: u32) {
        self.machine.pending.fetch_or(ranks & !1, Relaxed);
        if ranks & 1 != 0 {
            Alarm::pend(&self.0);
        }
        self.take_vectors();
    }

    fn interruptible(&self, _: u32, body: impl FnOnce()) {
        body();
    }
}

//! A processor in virtual time, for tests on any machine with std.
//!
//! Time passes only where a program says so, so every run is the same to the last tick. The
//! timer's interrupt nests by a call on the interrupted stack, as on RISC-V.

mod wrapping;

pub use wrapping::WrappingProcessor;

use std::sync::atomic::{AtomicBool, AtomicU64, Ordering::Relaxed};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use crate::platform::Platform;
use crate::rate::Rate;
use crate::timer::{Armed, Timer};

/// A processor whose time is virtual; its clones are the same one. All its contexts run on the
/// thread that calls it.
///
/// ```
/// use condor_mos::sim::Processor;
/// use condor_mos::{Clock, EventTable, LoopId, Overrun, Rate, Scheduler, StartError};
///
/// const MICROSECONDS: Rate = Rate::hz(1_000_000);
/// const RATES: [Rate; 2] = [Rate::hz(400), Rate::hz(50)];
///
/// let processor = Processor::new(MICROSECONDS);
/// let table = EventTable::<2, 8>::new(RATES, Clock::of::<u64>(MICROSECONDS));
/// let scheduler = Scheduler::new(processor.clone(), table);
/// let (mut fast, mut slow) = (0, 0);
/// // Each loop computes for a while; the 50 Hz loop is interrupted by the 400 Hz loop.
/// let mut fast_loop = || { processor.work(500); fast += 1; };
/// let mut slow_loop = || { processor.work(6_000); slow += 1; };
/// scheduler.scope(|scope| {
///     scope.assign(LoopId(0), Overrun::Skip, &mut fast_loop)?;
///     scope.assign(LoopId(1), Overrun::Skip, &mut slow_loop)?;
///     processor.with_handler(
///         || scheduler.on_timer(),
///         || {
///             scheduler.start()?;
///             // The background waits for a second.
///             processor.run_until(1_000_000);
///             Ok::<_, StartError>(())
///         },
///     )?;
///     let slow = scheduler.statistics(LoopId(1))?;
///     assert_eq!((slow.worst_run, slow.worst_lateness), (6_000, 500));
///     Ok::<_, Box<dyn std::error::Error>>(())
/// })?;
/// assert_eq!((fast, slow), (400, 50));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone)]
pub struct Processor {
    machine: Arc<Machine>,
}

struct Machine {
    frequency: Rate,
    now: AtomicU64,
    /// When the timer's interrupt is to come; [`NEVER`] if it is not armed.
    armed: AtomicU64,
    /// Until when interrupts are held back.
    held_until: AtomicU64,
    enabled: AtomicBool,
    handler: Mutex<Option<Handler>>,
}

const NEVER: u64 = u64::MAX;

/// What the timer's interrupt calls; in truth there as long as [`Processor::with_handler`] runs.
type Handler = &'static (dyn Fn() + Sync);

impl Processor {
    /// A processor at its first tick, whose timer counts with `frequency`.
    #[must_use]
    pub fn new(frequency: Rate) -> Self {
        let machine = Machine {
            frequency,
            now: AtomicU64::new(0),
            armed: AtomicU64::new(NEVER),
            held_until: AtomicU64::new(0),
            enabled: AtomicBool::new(true),
            handler: Mutex::new(None),
        };
        Self {
            machine: Arc::new(machine),
        }
    }

    /// Runs `program`, while the timer's interrupt calls `handler`.
    ///
    /// Without a handler no interrupt comes.
    pub fn with_handler<R>(&self, handler: impl Fn() + Sync, program: impl FnOnce() -> R) -> R {
        let handler: &(dyn Fn() + Sync) = &handler;
        // SAFETY: only the lifetime differs, and `_connected` takes the handler away before it goes.
        let handler = unsafe { core::mem::transmute::<&(dyn Fn() + Sync), Handler>(handler) };
        let former = self.handler().replace(handler);
        let _connected = Connected {
            processor: self,
            former,
        };
        program()
    }

    /// Has the background do nothing until `instant`. An interrupt at `instant` itself is left for
    /// the next call.
    pub fn run_until(&self, instant: u64) {
        while self.now() < instant {
            let interrupt = self.next_interrupt().min(instant);
            self.machine.now.store(interrupt, Relaxed);
            if interrupt < instant {
                self.interrupt();
            }
        }
    }

    /// Computes for `ticks`; interrupts that come meanwhile take their time in addition.
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

    /// Holds interrupts back for `ticks` from now on: they come late.
    pub fn hold_interrupts(&self, ticks: u64) {
        let until = self.now().saturating_add(ticks);
        self.machine.held_until.store(until, Relaxed);
    }

    /// Calls the handler, as an interrupt without cause does; not while interrupts are disabled.
    pub fn interrupt(&self) {
        let handler = *self.handler();
        let Some(handler) = handler else {
            return;
        };
        if !self.machine.enabled.swap(false, Relaxed) {
            return;
        }
        let _enabled = Enabled {
            processor: self,
            former: true,
        };
        self.machine.armed.store(NEVER, Relaxed);
        handler();
    }

    fn now(&self) -> u64 {
        self.machine.now.load(Relaxed)
    }

    /// When the next interrupt comes, if nothing changes.
    fn next_interrupt(&self) -> u64 {
        let armed = self.machine.armed.load(Relaxed);
        let connected = self.handler().is_some();
        if armed == NEVER || !connected || !self.machine.enabled.load(Relaxed) {
            return NEVER;
        }
        armed
            .max(self.machine.held_until.load(Relaxed))
            .max(self.now())
    }

    fn handler(&self) -> MutexGuard<'_, Option<Handler>> {
        self.machine
            .handler
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
    }
}

/// Takes the handler away when [`Processor::with_handler`] ends.
struct Connected<'p> {
    processor: &'p Processor,
    former: Option<Handler>,
}

impl Drop for Connected<'_> {
    fn drop(&mut self) {
        *self.processor.handler() = self.former;
    }
}

/// Puts the interrupt enable back as it was.
struct Enabled<'p> {
    processor: &'p Processor,
    former: bool,
}

impl Drop for Enabled<'_> {
    fn drop(&mut self) {
        self.processor.machine.enabled.store(self.former, Relaxed);
    }
}

impl Timer for Processor {
    type Instant = u64;

    fn frequency(&self) -> Rate {
        self.machine.frequency
    }

    fn now(&self) -> u64 {
        self.now()
    }

    fn arm(&self, at: u64) -> Armed {
        self.machine.armed.store(at, Relaxed);
        if at > self.now() {
            Armed::Ahead
        } else {
            Armed::Past
        }
    }

    fn disarm(&self) {
        self.machine.armed.store(NEVER, Relaxed);
    }
}

impl Platform for Processor {
    fn dispatch(&self, _: u32, run: impl FnOnce()) {
        run();
    }

    fn interruptible(&self, body: impl FnOnce()) {
        let former = self.machine.enabled.swap(true, Relaxed);
        let _enabled = Enabled {
            processor: self,
            former,
        };
        body();
    }
}

//! Loom on the lock of loops on one stack: what it holds is reached by one thread at a time, or not at all.

use condor_mos::{
    Armed, ClockSpec, LoopId, LoopLock, LoopLockError, Loops, Overrun, Platform, Rate, Scan,
    Scheduler, Timer,
};
use loom::sync::Arc;

/// A processor that is never interrupted, and whose loops run where they become free to.
struct Still;

const FREQUENCY: Rate = Rate::hz(1000);

impl Timer for Still {
    type Instant = u64;

    fn frequency(&self) -> Rate {
        FREQUENCY
    }

    fn now(&self) -> u64 {
        0
    }

    fn arm(&self, _: u64) -> Armed {
        Armed::Ahead
    }

    fn disarm(&self) {}
}

impl Platform for Still {
    fn interruptible(&self, _: u32, body: impl FnOnce()) {
        body();
    }
}

struct Shared {
    scheduler: Scheduler<Still, 2, 0>,
    lock: LoopLock<u32>,
}

impl Shared {
    fn new() -> Arc<Self> {
        let clock = ClockSpec::of::<u64>(FREQUENCY);
        Arc::new(Self {
            scheduler: Scheduler::new(Still, Scan::new(&[Rate::hz(2), Rate::hz(1)], clock)),
            lock: LoopLock::new(&[LoopId(0)], 0),
        })
    }

    /// Increments what the lock holds, twice if it can; says how often.
    fn increment(&self) -> u32 {
        let increments = (0..2).map(|_| {
            let locked = self.lock.lock(&self.scheduler, |value| *value += 1);
            assert_ne!(locked, Err(LoopLockError::Undeclared));
            u32::from(locked.is_ok())
        });
        increments.sum()
    }
}

/// Unbounded. Fails without the look at `taken`, or if it is not in the section that sets it; loom's
/// cell tells.
#[test]
fn two_threads_do_not_hold_it_together() {
    loom::model(|| {
        let shared = Shared::new();
        let other = {
            let shared = Arc::clone(&shared);
            loom::thread::spawn(move || shared.increment())
        };
        let increments = shared.increment() + other.join().expect("no panic");
        let value = shared.lock.lock(&shared.scheduler, |value| *value);
        assert_eq!(value, Ok(increments));
    });
}

/// Unbounded. Loops are started by two threads at once, against the contract: none twice at a time.
/// Fails if a loop in progress can be begun again.
#[test]
fn a_loop_is_not_on_two_stacks() {
    loom::model(|| {
        let shared = Shared::new();
        // Loom's cell tells if two have it.
        let context = Box::leak(Box::new(loom::cell::UnsafeCell::new(0)));
        let body = |context: &mut loom::cell::UnsafeCell<u32>, _| {
            // SAFETY: `&mut`: nobody else has it.
            context.with_mut(|runs| unsafe { *runs += 1 });
        };
        let id = LoopId(0);
        let assigned = shared
            .scheduler
            .assign(id, Overrun::CatchUp(3), body, context);
        assigned.expect("a loop that is free");
        let other = {
            let shared = Arc::clone(&shared);
            loom::thread::spawn(move || shared.scheduler.on_vector(0))
        };
        shared.scheduler.start().expect("not started");
        shared.scheduler.stop();
        shared.scheduler.start().expect("stopped");
        other.join().expect("no panic");
        shared.scheduler.on_vector(0);
        let seen = shared.scheduler.statistics(id).expect("a loop");
        assert_eq!((seen.released, seen.running), (2, 0));
    });
}

//! Events that come faster than they can be counted neither hang the processor nor get lost.

use std::sync::atomic::{AtomicU32, AtomicU64, Ordering::Relaxed};

use condor_mos::{
    Armed, ClockSpec, LoopId, Loops, Overrun, Platform, Rate, Scan, Scheduler, Timer,
};

const FREQUENCY: Rate = Rate::hz(1_000_000);
const NEVER: u64 = u64::MAX;

/// A processor on which arming the timer takes time.
struct Slow {
    now: AtomicU64,
    armed: AtomicU64,
    ticks_to_arm: AtomicU64,
}

impl Timer for &Slow {
    type Instant = u64;

    fn frequency(&self) -> Rate {
        FREQUENCY
    }

    fn now(&self) -> u64 {
        self.now.load(Relaxed)
    }

    fn arm(&self, at: u64) -> Armed {
        let ticks = self.ticks_to_arm.load(Relaxed);
        let now = self.now.fetch_add(ticks, Relaxed) + ticks;
        self.armed.store(at, Relaxed);
        if at > now { Armed::Ahead } else { Armed::Past }
    }

    fn disarm(&self) {
        self.armed.store(NEVER, Relaxed);
    }
}

impl Platform for &Slow {
    fn interruptible(&self, _: u32, body: impl FnOnce()) {
        body();
    }
}

#[test]
fn an_overload_is_counted_and_the_background_goes_on() {
    let slow = Slow {
        now: AtomicU64::new(0),
        armed: AtomicU64::new(NEVER),
        ticks_to_arm: AtomicU64::new(7),
    };
    // An event every two ticks, or every tick.
    let rates = [Rate::hz(500_000), Rate::hz(333_333)];
    let scheduler = Scheduler::new(
        &slow,
        Scan::<2>::new(&rates, ClockSpec::of::<u64>(FREQUENCY)),
    );
    let runs = AtomicU32::new(0);
    let body = |_| {
        runs.fetch_add(1, Relaxed);
    };
    let (mut fast, mut other) = (body, body);
    scheduler.scope(|scope| {
        scope.assign(LoopId(0), Overrun::Skip, &mut fast).unwrap();
        scope
            .assign(LoopId(1), Overrun::CatchUp(3), &mut other)
            .unwrap();
        scheduler.start().unwrap();
        let count = |id| {
            let seen = scheduler.statistics(LoopId(id)).unwrap();
            assert_eq!(
                seen.released,
                seen.run + seen.skipped + seen.running + seen.pending
            );
            seen.released
        };
        let mut before = count(0);
        for _ in 0..100 {
            // The background gets here: the interrupt that comes next is ahead.
            let armed = slow.armed.load(Relaxed);
            assert!(armed != NEVER && armed > slow.now.load(Relaxed));
            slow.now.store(armed, Relaxed);
            scheduler.on_timer();
            assert!(count(0) > before, "it goes on counting");
            before = count(0);
        }
        let behind = slow.now.load(Relaxed) / 2 - count(0);
        assert!(behind > 10_000, "it was too much: {behind}");
        // The load goes: everything that was due is counted in the end.
        slow.ticks_to_arm.store(0, Relaxed);
        let end = slow.now.load(Relaxed) + 100;
        while slow.now.load(Relaxed) < end || count(0) <= end / 2 {
            let armed = slow.armed.load(Relaxed);
            slow.now.fetch_max(armed, Relaxed);
            scheduler.on_timer();
        }
        let now = slow.now.load(Relaxed);
        assert_eq!(count(0), now / 2 + 1);
        // The nearest ticks to 3.000003 times their number.
        let due = (0..=now)
            .take_while(|n| (2 * n * 1_000_000 + 333_333) / 666_666 <= now)
            .count();
        assert_eq!(count(1) as usize, due);
    });
    assert!(runs.load(Relaxed) > 100);
}

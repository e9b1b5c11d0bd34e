//! Uses every call of `condor-mos` that runs without an operating system, over any platform.
//!
//! The firmware has a [`Tabled`] and a [`Scanned`] scheduler of one platform as statics, calls them
//! from its interrupts (those that are not started ignore them), and then [`loops`].
#![no_std]

mod analysis;
mod changes;
mod latest;
mod nesting;
mod plans;
mod schedules;
mod sharing;
mod texts;
mod trace;

use checks::Checks;
use condor_mos::{ClockSpec, CounterReading, EventTable, Platform, Rate, Scan, Scheduler};

/// The number of loops.
pub const LOOPS: usize = 3;
/// Their rates, the fastest first.
pub const RATES: [Rate; LOOPS] = [Rate::hz(200), Rate::hz(50), Rate::hz(10)];
/// Events that a table has place for.
pub const EVENTS: usize = 24;

/// A scheduler with an event table.
pub type Tabled<P> = Scheduler<P, LOOPS, EVENTS>;
/// A scheduler with a scan.
pub type Scanned<P> = Scheduler<P, LOOPS, 0>;

/// Creates a scheduler of the loops, with an event table, for a platform with this clock.
pub const fn tabled<P: Platform + Sync>(platform: P, clock: ClockSpec) -> Tabled<P> {
    Scheduler::new(platform, EventTable::new(&RATES, clock))
}

/// Creates a scheduler of the loops, with a scan, for a platform with this clock.
pub const fn scanned<P: Platform + Sync>(platform: P, clock: ClockSpec) -> Scanned<P> {
    Scheduler::new(platform, Scan::new(&RATES, clock))
}

/// Seconds. Nothing here takes as long, unless something is broken.
const PATIENCE: u32 = 20;

/// Makes all checks; `interrupts` counts those of the timer.
pub fn loops<P: Platform + Sync>(
    checks: &mut Checks<'_>,
    platform: &P,
    tabled: &'static Tabled<&'static P>,
    scanned: &'static Scanned<&'static P>,
    interrupts: impl Fn() -> u32,
) {
    #[cfg(feature = "conformance")]
    {
        checks.group("the timer");
        let verdict = condor_mos::conformance::timer(platform, &interrupts, core::hint::spin_loop);
        checks.same(verdict, Ok(()));
        platform.disarm();
    }
    // Only the suite asks.
    let _ = interrupts;
    checks.group("plans");
    plans::plans(checks, platform);
    schedules::schedules(checks);
    checks.group("texts");
    texts::texts(checks, ClockSpec::of::<P::Instant>(platform.frequency()));
    checks.group("responses");
    analysis::declared(checks);
    checks.group("the latest value");
    latest::calls(checks);
    checks.group("the platform");
    schedules::platform(checks, platform);
    checks.group("an event table");
    each(checks, tabled);
    checks.group("a scan");
    each(checks, scanned);
    checks.group("loops for good");
    plans::for_good(checks, tabled);
}

fn each<P: Platform + Sync, const E: usize>(
    checks: &mut Checks<'_>,
    scheduler: &Scheduler<P, LOOPS, E>,
) {
    nesting::nesting(checks, scheduler);
    analysis::measured(checks, scheduler);
    changes::changes(checks, scheduler);
    sharing::sharing(checks, scheduler);
    latest::latest(checks, scheduler);
}

/// Waits until `done`; says whether it came to that.
fn await_until<P: Platform + Sync>(platform: &P, mut done: impl FnMut() -> bool) -> bool {
    let frequency = platform.frequency();
    let second = frequency.numerator() / frequency.denominator().max(1);
    let begin = platform.now();
    while !done() {
        if platform.now().since(begin) >= second.saturating_mul(PATIENCE) {
            return false;
        }
    }
    true
}

//! `condor-mos`: servo loops that nest on one core.
//!
//! Both schedulers, one with an event table and one with a scan, are called from the interrupts of the machine;
//! the one that is not started ignores them.
#![no_std]
#![no_main]

#[cfg(target_arch = "arm")]
mod arm;
mod kept;
mod nesting;
#[cfg(target_arch = "riscv64")]
mod riscv64;
mod trace;

#[cfg(target_arch = "arm")]
use arm::{CLOCK, Core, PLATFORM};
use condor_mos::{CounterReading as _, EventTable, Rate, Scan, Scheduler, Timer as _};
use firmware::Checks;
#[cfg(target_arch = "riscv64")]
use riscv64::{CLOCK, Core, PLATFORM};

/// The number of loops.
const LOOPS: usize = 3;
/// Their rates, the fastest first.
const RATES: [Rate; LOOPS] = [Rate::hz(200), Rate::hz(50), Rate::hz(10)];

/// A scheduler with an event table of so many entries; of none, with a scan.
type Loops<const EVENTS: usize> = Scheduler<&'static Core, LOOPS, EVENTS>;

static TABLED: Loops<24> = Scheduler::new(&PLATFORM, EventTable::new(&RATES, CLOCK));
static SCANNED: Loops<0> = Scheduler::new(&PLATFORM, Scan::new(&RATES, CLOCK));

/// Seconds. Nothing here takes as long, unless something is broken.
const PATIENCE: u32 = 20;

/// Makes the checks of every machine; `interrupts` counts those of the timer.
fn loops(checks: &mut Checks, interrupts: impl Fn() -> u32) {
    kept::kept();
    #[cfg(feature = "conformance")]
    {
        checks.group("the timer");
        let verdict = condor_mos::conformance::timer(&PLATFORM, &interrupts, core::hint::spin_loop);
        checks.same(verdict, Ok(()));
        PLATFORM.disarm();
    }
    // Only the suite asks.
    let _ = interrupts;
    checks.group("an event table");
    nesting::nesting(checks, &TABLED);
    checks.group("a scan");
    nesting::nesting(checks, &SCANNED);
}

/// Waits until `done`; returns true if it came to that.
fn await_until(mut done: impl FnMut() -> bool) -> bool {
    let frequency = PLATFORM.frequency();
    let second = frequency.numerator() / frequency.denominator().max(1);
    let begin = PLATFORM.now();
    while !done() {
        if PLATFORM.now().since(begin) >= second.saturating_mul(PATIENCE) {
            return false;
        }
    }
    true
}

//! The two backends of condor-mos for Linux, and what its schedules are off in virtual time.

use condor_mos::linux::{CLOCK, RealTime, SignalPlatform, Threads};
use condor_mos::sim::worst_release_error;
use condor_mos::{ClockSpec, EventTable, LoopId, Loops, Overrun, Platform as _, Rate, Scheduler};

use super::turn::{LOOPS, Loop, Turn};
use crate::Result;

/// No release is skipped: bodies count them.
const OVERRUN: Overrun = Overrun::CatchUp(u8::MAX);

pub(super) fn run_threads(turn: &'static Turn) -> Result<()> {
    let wishes = RealTime::none().priority(80);
    let threads = Threads::new(&turn.loops.each_ref().map(rate), wishes)?;
    let mut bodies = turn.loops.each_ref().map(body);
    threads.scope(|scope| {
        for (id, body) in (0..).map(LoopId).zip(&mut bodies) {
            scope.assign(id, OVERRUN, body)?;
        }
        threads.start_at(turn.start_ns)?;
        turn.background()
    })
}

pub(super) fn run_signals(turn: &'static Turn) -> Result<()> {
    let table = EventTable::<LOOPS, 16>::try_new(&turn.loops.each_ref().map(rate), CLOCK)?;
    // SAFETY: the loops read the clock and use atomics, on a stack of megabytes.
    let scheduler = Scheduler::new(unsafe { SignalPlatform::new() }, table);
    let mut bodies = turn.loops.each_ref().map(body);
    scheduler.scope(|scope| {
        for (id, body) in (0..).map(LoopId).zip(&mut bodies) {
            scope.assign(id, OVERRUN, body)?;
        }
        let program = || {
            scheduler.start_at(turn.start_ns)?;
            let result = turn.background();
            scheduler.stop();
            result
        };
        let signals = scheduler.platform();
        signals.connect(|| scheduler.on_timer(), program)?
    })
}

fn rate(servo_loop: &Loop) -> Rate {
    // The periods are milliseconds.
    Rate::fraction(1_000_000_000, servo_loop.period_ns as u32)
}

fn body(servo_loop: &'static Loop) -> impl FnMut(u64) + Send {
    let mut release = 0;
    move |_| {
        servo_loop.run(release);
        release += 1;
    }
}

/// Returns the largest distance, in ticks, between a release and its exact instant, over 10^6 hyperperiods
/// of 400, 60 and 7 Hz in ticks that none of them divides.
pub(super) fn drift_ticks() -> Result<f64> {
    let clock = ClockSpec::of::<u64>(Rate::fraction(14_318_180, 12));
    let rates = [Rate::hz(400), Rate::hz(60), Rate::hz(7)];
    let mut table = EventTable::<3, 512>::try_new(&rates, clock)?;
    Ok(worst_release_error(&mut table, 1_000_000))
}

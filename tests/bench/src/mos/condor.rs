//! The two backends of condor-mos for Linux.

use condor_mos::linux::{CLOCK, RealTime, SignalPlatform, Threads};
use condor_mos::{EventTable, LoopId, Loops, Overrun, Platform as _, Rate, Scheduler};

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

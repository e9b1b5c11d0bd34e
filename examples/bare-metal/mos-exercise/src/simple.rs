//! One loop and a background.

use core::sync::atomic::{AtomicBool, AtomicU32, Ordering::Relaxed};

use checks::Checks;
use condor_mos::{
    Clock, Instant, LoopError, LoopId, Overrun, Platform, Rate, RateError, SimpleServo, StartError,
    Wrapping,
};

use crate::await_until;
use crate::plans::Nothing;

/// What errors call the loop.
const ID: LoopId = LoopId(0);
const SLOWER: Rate = Rate::hz(100);

pub(crate) fn simple<P: Platform + Sync>(
    checks: &mut Checks<'_>,
    servo: &'static SimpleServo<&'static P>,
) {
    let platform = *servo.platform();
    refusals(checks, servo);
    let runs = AtomicU32::new(0);
    let is_late = AtomicBool::new(false);
    let mut body = |_| {
        runs.store(runs.load(Relaxed).wrapping_add(1), Relaxed);
        if is_late.load(Relaxed) {
            wait_for_periods(platform, SLOWER, 3);
        }
    };
    let mut second = |_| {};
    let has_run = |times: u32| {
        let before = runs.load(Relaxed);
        await_until(platform, || {
            runs.load(Relaxed).wrapping_sub(before) >= times
        })
    };
    let done = servo.scope(Overrun::Skip, &mut body, || {
        let other = servo.scope(Overrun::Skip, &mut second, || ());
        checks.same("it has one loop", other, Err(LoopError::Taken { id: ID }));
        checks.same("it starts", servo.start(), Ok(()));
        checks.same("but once", servo.start(), Err(StartError::Started));
        checks.that("the loop runs", has_run(3));
        checks.same("it is disabled", servo.disable(), Ok(()));
        let before = runs.load(Relaxed);
        wait_for_periods(platform, SLOWER, 3);
        checks.same("it does not run any more", runs.load(Relaxed), before);
        checks.same("it is enabled", servo.enable(), Ok(()));
        checks.that("it runs again", has_run(3));
        checks.same("it gets another rate", servo.set_rate(SLOWER), Ok(()));
        checks.same("that is told", servo.statistics().rate, SLOWER);
        checks.that("it runs at that, too", has_run(3));
        let refused = servo.set_rate(Rate::hz(u32::MAX));
        checks.that(
            "what cannot be is refused",
            matches!(refused, Err(RateError::TooFast { .. })),
        );
        servo.stop();
    });
    checks.same("a closure was the loop", done, Ok(()));
    // A busy host alone may stop such a loop, so that it is asked for nothing else.
    is_late.store(true, Relaxed);
    let done = servo.scope(Overrun::Fault, &mut body, || {
        checks.same("it starts again", servo.start(), Ok(()));
        let faulted = await_until(platform, || servo.statistics().faulted);
        checks.that("being late stops it", faulted);
        checks.same("it is enabled", servo.enable(), Ok(()));
        servo.stop();
    });
    checks.same("so it was again", done, Ok(()));
    let counts = servo.statistics();
    checks.same(
        "nothing is unfinished",
        (counts.running, counts.pending),
        (0, 0),
    );
    checks.same(
        "no release is lost",
        counts.released,
        counts.run.wrapping_add(counts.skipped),
    );
    checks.same("each run is counted", counts.run, runs.load(Relaxed).into());
    for_good(checks, servo);
}

fn refusals<P: Platform>(checks: &mut Checks<'_>, servo: &SimpleServo<&'static P>) {
    let unassigned = Err(LoopError::Unassigned { id: ID });
    checks.same(
        "a loop without a body is not enabled",
        servo.enable(),
        unassigned,
    );
    checks.same("nor disabled", servo.disable(), unassigned);
    let platform = *servo.platform();
    let timer = Clock::of::<P::Instant>(platform.frequency());
    let fast = SimpleServo::try_new(platform, Rate::hz(u32::MAX), timer).err();
    checks.that(
        "a rate can be too fast",
        matches!(fast, Some(RateError::TooFast { .. })),
    );
    let schedule = Clock::of::<Wrapping<16>>(Rate::fraction(12_345, 7));
    let other = SimpleServo::try_new(platform, SLOWER, schedule);
    checks.same(
        "a servo is of one clock",
        other.map(|servo| servo.start()),
        Ok(Err(StartError::Clock { timer, schedule })),
    );
}

fn for_good<P: Platform>(checks: &mut Checks<'_>, servo: &SimpleServo<&'static P>) {
    static RUNS: AtomicU32 = AtomicU32::new(0);
    let body: fn(&mut Nothing, P::Instant) =
        |_, _| RUNS.store(RUNS.load(Relaxed).wrapping_add(1), Relaxed);
    let assigned = servo.assign(Overrun::CatchUp(1), body, &mut []);
    checks.same("a function becomes the loop", assigned, Ok(()));
    let again = servo.assign(Overrun::Skip, body, &mut []);
    checks.same("once", again, Err(LoopError::Taken { id: ID }));
    checks.same("it starts", servo.start(), Ok(()));
    let ran = await_until(servo.platform(), || RUNS.load(Relaxed) >= 5);
    servo.stop();
    checks.that("it runs", ran);
}

/// Waits for so many periods of a rate, and a tick.
fn wait_for_periods<P: Platform>(platform: &P, rate: Rate, periods: u32) {
    let frequency = platform.frequency();
    let second = frequency.numerator() / frequency.denominator().max(1);
    let period = second / rate.numerator().max(1) * rate.denominator();
    let ticks = period.saturating_mul(periods).saturating_add(1);
    let begin = platform.now();
    // A loop's deadline is its own; a timer that stands still is seen by who waits for the loop.
    while platform.now().since(begin) < ticks {}
}

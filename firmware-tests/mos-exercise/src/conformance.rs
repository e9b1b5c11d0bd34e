//! The suite of `condor-mos` for the timer of this machine.

use checks::Checks;
use condor_mos::{Timer, conformance};

/// A timer that nothing else arms meanwhile; `interrupts` counts its interrupts.
pub(crate) fn timer<T: Timer>(checks: &mut Checks<'_>, timer: &T, interrupts: impl Fn() -> u32) {
    checks.group("the timer");
    let verdict = conformance::timer(timer, interrupts, core::hint::spin_loop);
    checks.same("it keeps the promises of timers", verdict, Ok(()));
    timer.disarm();
}

//! The calls of [`files_exercise`] on a hart, and on a core without compare-and-swap.
#![no_std]
#![no_main]

use condor_mbox::Instant;
use machine::{check, now_ns};

#[machine::entry]
fn main() -> ! {
    #[cfg(target_arch = "arm")]
    machine::start_clock();
    #[cfg(target_arch = "riscv64")]
    machine::switch_floats_off();
    check(|checks| {
        files_exercise::everything(checks, || Instant::from_ns(now_ns()));
        #[cfg(target_arch = "arm")]
        stack(checks);
    })
}

/// Checks the stack that the exercise takes, including that of the checks and the host's end.
#[cfg(target_arch = "arm")]
fn stack(checks: &mut checks::Checks<'_>) {
    use core::fmt::Write as _;

    checks.group("the stack");
    let used = machine::stack_used();
    // The console takes everything.
    let _ = writeln!(checks, "          {used} bytes were in use at most");
    checks.that(used <= 12 * 1024);
}

//! The run of a program: by the clock of the machine, or in simulated time.

use condor_rt::Program;

use crate::hart::Hart;
use crate::program::status;
use crate::simulated;

/// Runs `program` on the calling hart, and returns the status for the monitor, 0 for success. The
/// program runs in simulated time if the system has a simulated clock, otherwise by the clock of
/// the machine.
pub fn run(program: &impl Program, hart: &Hart) -> u32 {
    // The page of the hart is there.
    match hart.control().simulated() {
        Ok(Some(work)) => simulated::run(program, hart, work),
        _ => run_in_real_time(program, hart),
    }
}

/// Its frame is its own: that of a `main` with many programs has no room for all of them at once.
#[inline(never)]
fn run_in_real_time(program: &impl Program, hart: &Hart) -> u32 {
    status(&program.run(hart), hart)
}

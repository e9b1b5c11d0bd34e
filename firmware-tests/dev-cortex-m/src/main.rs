//! The calls of [`dev_exercise`] on a core without compare-and-swap.
#![no_std]
#![no_main]

use condor_dev::{NoInterrupts, Switch};
use dev_exercise::{Boards, Devices, Memory};
use machine::check;

static MEMORY: Memory = Memory::new();
static SYSTEM: Devices<NoInterrupts> = Switch::new(MEMORY.bus(), NoInterrupts, Boards::new());

#[machine::entry]
fn main() -> ! {
    check(|checks| {
        let exercised = dev_exercise::everything(checks, &SYSTEM, MEMORY.bus());
        checks.same("memory answers as boards do", exercised, Ok(()));
    })
}

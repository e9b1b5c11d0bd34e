//! How much of the stack has been used: `cortex-m-rt` has painted it before the start.

use core::fmt::Write as _;

use checks::Checks;
use cortex_m_rt::STACK_PAINT_VALUE;

unsafe extern "C" {
    static _stack_end: u32;
    static _stack_start: u32;
}

/// The most bytes of stack that were in use at a time since the start.
pub(crate) fn used() -> usize {
    let end = &raw const _stack_end;
    let start = (&raw const _stack_start).addr();
    let mut unused = end;
    // SAFETY: the linker puts RAM for the stack between the two. What is above the lowest word that
    // is not painted any more is not looked at.
    while unused.addr() < start && unsafe { unused.read_volatile() } == STACK_PAINT_VALUE {
        unused = unused.wrapping_add(1);
    }
    start.saturating_sub(unused.addr())
}

/// Prints it.
pub(crate) fn report(checks: &mut Checks<'_>, used: usize) {
    // The console takes everything.
    let _ = writeln!(checks, "          {used} bytes were in use at most");
}

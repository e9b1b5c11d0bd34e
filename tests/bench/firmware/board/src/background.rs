//! A background of known length: it runs when no loop does, and counts its own instructions.

use core::arch::asm;

use crate::body::Trace;
use crate::timer::COUNTER_VALUE;

/// The ticks and instructions that have passed while the background ran.
#[derive(Clone, Copy, Debug)]
pub struct Passed {
    /// Ticks between the two reads of the counter.
    pub ticks: u32,
    /// Instructions of the background itself between the two reads, the second of them included.
    pub own_instructions: u32,
}

/// The number of instructions of a turn of [`until`].
const TURN: u32 = 4;

/// Turns until the loop has run `runs` times, and says what has passed.
///
/// `runs` must be ahead by less than half the range; it is, if it is not yet reached.
#[inline(never)]
pub fn until(trace: &Trace, runs: u32) -> Passed {
    let (first, last, turns): (u32, u32, u32);
    // SAFETY: the address is that of a number of runs, and the counter's register can be read.
    unsafe {
        asm!(
            ".p2align 2",
            "ldr {first}, [{counter}]",
            "2:",
            "ldr {now}, [{address}]",
            "adds {turns}, {turns}, #1",
            "cmp {now}, {runs}",
            "bne 2b",
            "ldr {last}, [{counter}]",
            first = out(reg) first,
            last = out(reg) last,
            now = out(reg) _,
            turns = inout(reg) 0_u32 => turns,
            address = in(reg) trace.runs_address(),
            runs = in(reg) runs,
            counter = in(reg) COUNTER_VALUE,
            options(nostack, readonly),
        );
    }
    Passed {
        // The counter counts down.
        ticks: first.wrapping_sub(last),
        own_instructions: TURN * turns + 1,
    }
}
